"""Episodes played again: rays as the controller saw them, videos that run at the right speed, and what is refused."""

import os
from collections.abc import Iterator, Sequence
from importlib.util import find_spec
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from commands import Command
from PIL import Image

import navbench
from navbench.cli import replay
from navbench.cli.replay import frames_of, rays_of
from navbench.contract import Command as Asked
from navbench.contract import Observation, Setup
from navbench.report.film import Film, Played, played
from navbench.simulation.planar import PlanarSimulator

PLANAR: dict[str, Any] = {"simulator": "planar", "workers": 1}
SEEN: list[tuple[float, np.ndarray]] = []


class Looker:
    """Drives a curve, and notes what it sees."""

    def reset(self, setup: Setup, rng: np.random.Generator) -> None:
        SEEN.clear()

    def act(self, observation: Observation) -> Asked:
        SEEN.append((observation.t_s, observation.ranges_m.copy()))
        return Asked(0.1, 0.6)


def episode(ran: navbench.Result, index: int = 0) -> tuple[Played, dict[str, Any]]:
    (cell,) = ran._stored.manifest["cells"]
    return played(ran._stored, cell["run_id"], index), cell["configuration"]


@pytest.fixture(scope="module")
def fleet(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("fleet") / "kept"
    navbench.run(controller="go_to_goal", world="zhao2017_dynamic", dir=folder, **PLANAR)
    return folder


@pytest.fixture(scope="module")
def single(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("single") / "kept"
    navbench.run(controller="sflc", world="corner", episodes=2, dir=folder, **PLANAR)
    return folder


def test_rays_are_what_the_controller_saw_to_the_last_bit() -> None:
    it, configuration = episode(navbench.run(controller=Looker(), world="deadlock", simulator="planar", workers=0))
    rays = rays_of(configuration, it)
    assert len(SEEN) > 50
    for t_s, ranges_m in SEEN:
        (found,) = rays(t_s, it.poses(t_s))
        lengths_m = np.hypot(*(found[:, 2:4] - found[:, :2]).T)
        np.testing.assert_allclose(lengths_m, ranges_m, rtol=0.0, atol=1e-12)
    assert len({ranges_m.tobytes() for _, ranges_m in SEEN}) > 10


@pytest.mark.parametrize("simulator", ["planar", "pybullet"])
def test_recorded_ranges_are_what_the_controller_saw_to_the_last_bit_and_are_played(simulator: str) -> None:
    noisy = "sensors.noise_std_m=0.01", "sensors.dropout_probability=0.02", "record=ranges"
    ran = navbench.run(*noisy, controller=Looker(), world="deadlock", simulator=simulator, workers=0)
    kept = ran.trajectories["ranges_m"].tolist()
    assert kept[-1] is None, "at the end nothing is read"
    assert [row.tobytes() for row in kept[:-1]] == [ranges_m.tobytes() for _, ranges_m in SEEN]
    it, configuration = episode(ran)
    rays = rays_of(configuration, it)
    for t_s, ranges_m in SEEN:
        (found,) = rays(t_s, it.poses(t_s))
        lengths_m = np.hypot(*(found[:, 2:4] - found[:, :2]).T)
        np.testing.assert_allclose(lengths_m, ranges_m, rtol=0.0, atol=1e-12)
    assert [len(of) for of in rays(it.end_s, it.poses(it.end_s))] == [0]
    assert replay._note(it, 1.0) == "rays as recorded"


def test_ranges_are_recorded_in_metres_of_the_world_whatever_the_controller_s_units() -> None:
    ran = navbench.run("record=ranges", controller="go_to_goal", world="zhao2017_dynamic", sensors="ring16", **PLANAR)
    (cell,) = ran._stored.manifest["cells"]
    readings = np.stack(ran.trajectories["ranges_m"].dropna().tolist())
    radius_m = cell["configuration"]["robot"]["radius_m"]
    suite = navbench.sensors.suite_of(cell["configuration"]["sensors"]).scaled_to(radius_m)
    assert readings.max() == suite.max_range_m
    assert 0.0 <= readings.min() < readings.max()


def test_a_run_that_is_to_record_runs_again_what_was_not_recorded_and_keeps_the_rows(tmp_path: Path) -> None:
    words: dict[str, Any] = {"controller": "sflc", "world": "corner", "dir": tmp_path / "kept", **PLANAR}
    before = navbench.run(**words)
    assert "ranges_m" not in before.trajectories.columns
    (part,) = (tmp_path / "kept/episodes").iterdir()
    recorded = navbench.run("record=ranges", **words)
    assert recorded.trajectories["ranges_m"].notna().sum() == len(recorded.trajectories) - 1
    assert recorded.episodes.equals(before.episodes)
    written = part.stat().st_mtime_ns
    for again in (navbench.run("record=ranges", **words), navbench.run(**words)):
        assert "ranges_m" in again.trajectories.columns
        assert part.stat().st_mtime_ns == written, "what is recorded is not run again"


def test_a_wrong_record_is_refused_in_one_line(command: Command) -> None:
    done = command("controller=sflc", "record=range")
    assert (done.code, done.err) == (2, "navbench: record=range: must be ranges, or null for nothing more\n")


def test_what_a_ray_hits_is_seen_where_another_robot_stands(fleet: Path) -> None:
    it, configuration = episode(navbench.load(fleet))
    end_s = float(it.end_s)
    measured = rays_of(configuration, it)(end_s, it.poses(end_s))
    assert len(measured) == len(it.robots) == 3
    assert any((rays[:, 4] > 0.0).any() for rays in measured)


def test_a_frame_shows_the_clock_and_what_is_active(single: Path) -> None:
    it, configuration = episode(navbench.load(single))
    film = Film(it, [0], rays_of(configuration, it), "rays computed again")
    first, later, again = (film.picture(t_s) for t_s in (0.0, 3.0, 0.0))
    assert (first != later).any()
    assert (first == again).all()
    assert first.shape[0] % 2 == first.shape[1] % 2 == 0
    words = [text.get_text() for text in film._sheet.texts]
    assert "0.00 s" in words
    assert "rays computed again" in words
    assert any(word.endswith("\ngo to goal") for word in words)
    assert it.robots[0].says(1e9)[0].startswith("R1  reached after")


@pytest.mark.parametrize(("speed", "most", "step", "a_second"), [(1.0, 30.0, 1, 20.0), (4.0, 30.0, 3, 80 / 3)])
def test_frames_come_at_the_speed_that_is_asked_for(
    speed: float, most: float, step: int, a_second: float, single: Path
) -> None:
    it, _ = episode(navbench.load(single))
    times_s, found = frames_of(it, speed, most)
    assert found == pytest.approx(a_second)
    assert times_s[1] == pytest.approx(0.05 * step)
    assert times_s[-1] == it.end_s


def test_a_gif_lasts_as_long_as_the_episode(single: Path, command: Command, tmp_path: Path) -> None:
    done = command("replay", str(single), "episode=1", "--video", "out.gif", "speed=2")
    assert done.code == 0
    assert done.out == "sflc in corner, episode 1, seed 0, planar\nvideo: out.gif\n"
    assert [file.name for file in tmp_path.iterdir()] == ["out.gif"]
    image = Image.open(tmp_path / "out.gif")
    lasts_ms = 0.0
    for frame in range(image.n_frames):  # type: ignore[attr-defined]
        image.seek(frame)
        lasts_ms += image.info["duration"]
    end_s = float(navbench.load(single).episodes["time_s"].iloc[1])
    assert lasts_ms == pytest.approx(1000.0 * (end_s / 2.0 + replay.HOLD_S), abs=150.0)


@pytest.mark.skipif(not find_spec("imageio_ffmpeg"), reason="needs the extra video")
def test_an_mp4_lasts_as_long_as_the_episode(fleet: Path, command: Command, tmp_path: Path) -> None:
    from imageio_ffmpeg import count_frames_and_secs

    done = command("replay", str(fleet), "robot=1", "--video", "out.mp4")
    assert done.code == 0
    _, lasts_s = count_frames_and_secs(tmp_path / "out.mp4")
    end_s = float(navbench.load(fleet).episodes["time_s"].max())
    assert lasts_s == pytest.approx(end_s + replay.HOLD_S, abs=0.6)  # two control periods


@pytest.mark.skipif(not find_spec("imageio_ffmpeg"), reason="needs the extra video")
@pytest.mark.parametrize("keeps", [0, 0.5, None])
def test_an_mp4_that_a_full_disk_cuts_off_is_said_and_not_left(
    single: Path, command: Command, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, keeps: float | None
) -> None:
    import imageio_ffmpeg

    write_frames = imageio_ffmpeg.write_frames

    def cut_off(file: Path, *given: Any, **options: Any) -> Iterator[None]:
        writer = write_frames(file, *given, **options)
        writer.send(None)
        try:
            while True:
                writer.send((yield))
                if keeps is None:
                    raise OSError("Broken pipe\n\nFFMPEG COMMAND:\n...")
        finally:
            writer.close()
            os.truncate(file, int(file.stat().st_size * (keeps or 0)))

    monkeypatch.setattr(imageio_ffmpeg, "write_frames", cut_off)
    done = command("replay", str(single), "--video", "out.mp4")
    assert done.code == 2
    assert done.err.endswith("navbench: out.mp4: ffmpeg could not write the whole video; is there room?\n")
    assert not list(tmp_path.iterdir())


def test_an_interrupt_leaves_no_half_video(
    single: Path, command: Command, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def interrupted(self: Film, t_s: float) -> None:
        raise KeyboardInterrupt

    monkeypatch.setattr(Film, "picture", interrupted)
    assert command("replay", str(single), "--video", "out.gif").code == 130
    assert not list(tmp_path.iterdir())


def test_a_simulator_s_window_shows_what_was_driven_until_it_is_closed(
    fleet: Path, command: Command, monkeypatch: pytest.MonkeyPatch
) -> None:
    shown: list[tuple[int, list[str]]] = []

    class Window(PlanarSimulator):
        has_window = True

        def mark(self, lines: np.ndarray, words: Sequence[str]) -> bool:
            shown.append((len(lines), list(words)))
            return len(shown) < 3

        def show(self, dt_s: float) -> None:
            pass

    monkeypatch.setenv("DISPLAY", "elsewhere:1")
    monkeypatch.setattr(replay, "_with_window", lambda: Window)
    assert command("replay", str(fleet), "robot=2", "speed=0.01").code == 0
    assert [count for count, _ in shown] == [3 + 16] * 3  # where each robot looks, and one's rays
    assert shown[0][1][0].startswith("0.00 s  R3  ")
    assert "rays computed again in planar, without noise" in shown[0][1]


REFUSED = [
    (("speed=0",), "speed=0: must be a number from 0.01 to 1000"),
    (("speed=fast",), "speed=fast: must be a number"),
    (("episode=9",), "episode=9: there is no such episode; there are episodes 0 to 1"),
    (("robot=1",), "robot=1: there is no such robot; there is only robot 0"),
    (("controller=pid",), "controller=pid: there is no such cell; there are: sflc"),
    (("epsode=1",), "epsode=1: unknown key; did you mean episode?"),
    (("--video", "out.avi"), "--video out.avi: must end in .mp4 or .gif"),
    (("--video", "nope/out.gif"), "--video nope/out.gif: must be a file in a directory that is there"),
    (("other",), "name one results directory"),
]


@pytest.mark.parametrize(("words", "says"), REFUSED)
def test_what_is_wrong_is_one_line(words: tuple[str, ...], says: str, single: Path, command: Command) -> None:
    video = () if "--video" in words else ("--video", "out.gif")
    done = command("replay", str(single), *words, *video)
    assert done.code == 2
    assert says in done.err
    assert done.err.count("\n") == 1


def test_without_a_display_it_says_how_to_write_a_video(
    single: Path, command: Command, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.delenv("DISPLAY", raising=False)
    monkeypatch.setattr("sys.platform", "linux")
    done = command("replay", str(single))
    assert done.code == 2
    assert "needs a display" in done.err
    assert "--video FILE.gif" in done.err


def test_without_the_extra_it_says_what_to_install(
    single: Path, command: Command, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(replay, "find_spec", lambda name: None)
    done = command("replay", str(single), "--video", "out.mp4")
    assert done.code == 2
    assert "pip install 'navbench[video]'; or name a .gif" in done.err
