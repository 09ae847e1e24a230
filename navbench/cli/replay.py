"""One episode played again, in a window or as a video: robots, movers, rays, and the controller's own trace."""

import errno
import math
import time
from collections.abc import Iterator, Mapping, Sequence
from importlib.util import find_spec
from itertools import chain
from pathlib import Path
from typing import TYPE_CHECKING, Any

from navbench.cli.display import why_none
from navbench.cli.limits import check_directory
from navbench.cli.progress import progress, tell
from navbench.cli.words import sort_words
from navbench.validation import DescriptionError, instead

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

    from navbench.report.film import Film, Played, Rays
    from navbench.simulation.base import Simulator

HELP = """navbench replay DIR [episode=K] [robot=I]: play one episode of a results directory in a window
navbench replay DIR [...] --video FILE.mp4|FILE.gif: write it as a video, which needs no display

  episode=K                                         which episode; without it the first in which a robot failed
  robot=I                                           whose rays and trace are shown; without it those of a failed robot
                                                    or, of up to 4, the rays of all
  controller=NAME world=NAME run_id=ID name= label= which cell, where there are several; ID may be cut short
  speed=X                                           how many times as fast as it was driven; default 1
  --video FILE                                      .gif, or .mp4 with `pip install 'navbench[video]'`

Rays are those that the controller met where the run was told `record=ranges`; elsewhere they are computed again in
planar, from the stored layout and poses, without noise.
"""
KEYS = ("episode", "robot", "speed", "run_id", "name", "label", "controller", "world")
FORMS = {".mp4": 30.0, ".gif": 20.0}  # and how many frames a second at most
SPEEDS = (0.01, 1000.0)
HOLD_S = 1.5  # how long the last frame stands
AGAIN, RECORDED = "rays computed again in planar, without noise", "rays as recorded"


def replay(arguments: Sequence[str]) -> int:
    """Play what the words name, and return the exit code."""
    words = sort_words(arguments, ("--video",))
    given = dict(word.split("=", 1) for word in words.overrides)
    for key, value in given.items():
        if key not in KEYS or not value:
            raise DescriptionError(f"{key}={value}: unknown key; {instead(key, KEYS, 'allowed with replay')}")
    if len(words.names) != 1:
        raise DescriptionError(f"replay {' '.join(words.names)}".rstrip() + ": name one results directory")
    check_directory(f"replay {words.names[0]}", Path(words.names[0]))
    speed, video = _speed(given.pop("speed", "1")), Path(words.video) if words.video else None
    _check_way_out(video)
    from navbench.analysis.stored import StoredResults
    from navbench.cli.show import cell_of_results, episode_of, number, robot_of
    from navbench.experiments.store import Results
    from navbench.report.film import played

    stored = StoredResults(Results(Path(words.names[0])))
    chosen = {key: value for key, value in given.items() if key not in ("episode", "robot")}
    run_id = str(cell_of_results(stored, chosen)["run_id"])
    rows = stored.rows[stored.rows["run_id"] == run_id]
    episode, note = episode_of(rows, number("episode", given))
    robot = robot_of(rows, number("robot", given))
    it = played(stored, run_id, episode)
    tell(it.title + (f": {note}" if note else ""))
    configuration = stored.configuration(run_id)["configuration"]
    robots, rays = _shown(it, robot), rays_of(configuration, it)
    if video is None:
        window = _with_window()
        if window is None:
            _play_figure(it, robots, rays, speed)
        else:
            _play_simulator(placed(window, configuration, it, gui=True), it, robots, rays, speed)
    else:
        write_video(it, robots, rays, speed, video)
        tell(f"video: {video}")
    return 0


def _speed(text: str) -> float:
    low, high = SPEEDS
    try:
        speed = float(text)
    except ValueError:
        speed = 0.0
    if not low <= speed <= high:
        raise DescriptionError(f"speed={text}: must be a number from {low:g} to {high:g}")
    return speed


def _check_way_out(video: Path | None) -> None:
    """Check that there is something to play on."""
    if video is None:
        if why := why_none():
            raise DescriptionError(f"replay: needs a display, {why}; --video FILE.gif writes a video")
        return
    if video.suffix not in FORMS:
        raise DescriptionError(f"--video {video}: must end in {' or '.join(FORMS)}")
    if video.suffix == ".mp4" and not find_spec("imageio_ffmpeg"):
        raise DescriptionError(f"--video {video}: needs imageio-ffmpeg: pip install 'navbench[video]'; or name a .gif")
    if video.is_dir() or not video.absolute().parent.is_dir():
        raise DescriptionError(f"--video {video}: must be a file in a directory that is there")


def _shown(it: "Played", robot: int | None) -> list[int]:
    """Return whose rays are shown, that whose trace is told first: one, or of a few robots all."""
    from navbench.report.drives import FEW

    if robot is not None:
        return [robot]
    failed = [i for i, robot in enumerate(it.robots) if robot.drive.row["outcome"] != "reached"]
    every = [*failed, *(i for i in range(len(it.robots)) if i not in failed)]
    return every if len(every) <= FEW else every[:1]


def placed(
    kind: "type[Simulator]", configuration: Mapping[str, Any], it: "Played", *, gui: bool = False
) -> "Simulator":
    """Return a simulator in which an episode's robots stand at its beginning."""
    from navbench.contract import Pose
    from navbench.robot import Robot
    from navbench.sensors import suite_of
    from navbench.validation import describe

    robot = describe(Robot, configuration["robot"], "robot")
    sensors = suite_of(configuration["sensors"]).scaled_to(robot.radius_m)
    simulator = kind(kind.Options(gui=gui), robot, sensors, None)
    simulator.reset(it.world, [Pose(*pose) for pose in it.poses(0.0).tolist()], it.world.goal_tolerance_m)
    return simulator


def move_to(simulator: "Simulator", t_s: float, poses: "NDArray[np.float64]") -> None:
    """Put robots, (robots, 3) x, y [m] and heading [rad], and movers where they were at an instant [s]."""
    for name, column in zip(("x_m", "y_m", "heading_rad"), poses.T, strict=True):
        simulator.robots[name] = column
    simulator.scene.move_to(t_s)


def rays_of(configuration: Mapping[str, Any], it: "Played") -> "Rays":
    """Return what tells at any instant what the rings read, see ``Film``: as recorded, or computed without noise."""
    import numpy as np

    from navbench.simulation.motion import measure_clearance
    from navbench.simulation.planar import PlanarSimulator

    simulator = placed(PlanarSimulator, configuration, it)
    sensors, radius_m = simulator.sensors.range_sensors(), simulator.robot.radius_m
    mounts = np.array([(one.x_m, one.y_m, one.heading_rad, one.max_range_m) for one in sensors]).reshape(-1, 4)

    def read(t_s: float, poses: "NDArray[np.float64]") -> "Sequence[NDArray[np.float64]]":
        if it.recorded:
            return [robot.read(t_s) for robot in it.robots]
        move_to(simulator, t_s, poses)
        measure_clearance(simulator.robots, simulator.scene.arrays, radius_m)
        return list(simulator.ranges())

    def rays(t_s: float, poses: "NDArray[np.float64]") -> list["NDArray[np.float64]"]:
        found = []
        for (x, y, heading), ranges_m in zip(poses.tolist(), read(t_s, poses), strict=True):
            ring = mounts[: len(ranges_m)]
            cosine, sine, (ahead, left) = np.cos(heading), np.sin(heading), ring.T[:2]
            begin = x + cosine * ahead - sine * left, y + sine * ahead + cosine * left
            along = heading + ring[:, 2]
            end = begin[0] + ranges_m * np.cos(along), begin[1] + ranges_m * np.sin(along)
            found.append(np.stack([*begin, *end, ranges_m < ring[:, 3]], axis=1))
        return found

    return rays


def frames_of(it: "Played", speed: float, most: float) -> tuple[list[float], float]:
    """Return the instants that are shown [s], and how many of them a second, so that it plays at a speed.

    Args:
        it: the episode.
        speed: how many times as fast as it was driven.
        most: frames a second at most: where there are more control periods, some are left out.
    """
    step_s = it.period_s * max(1, math.ceil(speed / it.period_s / most - 1e-9))
    return [*(k * step_s for k in range(math.ceil(it.end_s / step_s - 1e-9))), it.end_s], speed / step_s


def write_video(it: "Played", robots: Sequence[int], rays: "Rays", speed: float, file: Path) -> None:
    """Write an episode as a video, whole or not at all.

    Args:
        it: the episode.
        robots: whose rays are drawn; the first one's trace is told.
        rays: what these measure.
        speed: how many times as fast as it was driven.
        file: where to; its ending says what it is.
    """
    from navbench.experiments.files import replacing
    from navbench.report.film import Film

    times_s, a_second = frames_of(it, speed, FORMS[file.suffix])
    hold = [times_s[-1]] * round(HOLD_S * a_second)
    with replacing(file) as temporary, progress() as told:
        film = Film(it, robots, rays, _note(it, speed))
        pictures = _pictures(film, [*times_s, *hold], told)
        if file.suffix == ".gif":
            samples = [film.picture(times_s[k]) for k in (0, len(times_s) // 2, -1)]
            _write_gif(temporary, pictures, a_second, samples)
        else:
            _write_mp4(temporary, pictures, a_second)


def _note(it: "Played", speed: float) -> str:
    source = RECORDED if it.recorded else AGAIN
    return source if speed == 1.0 else f"{speed:g} times as fast as driven\n{source}"


def _pictures(film: "Film", times_s: Sequence[float], told: Any) -> Iterator["NDArray[np.uint8]"]:
    for done, t_s in enumerate(times_s, 1):
        yield film.picture(t_s)
        told("frames", done, len(times_s))


def _write_gif(
    file: Path, pictures: Iterator["NDArray[np.uint8]"], a_second: float, samples: Sequence["NDArray[np.uint8]"]
) -> None:
    """Write pictures in the colours of a few of them: to choose those of each takes as long as to draw it."""
    import numpy as np
    from PIL import Image

    colours = Image.fromarray(np.concatenate(samples)).quantize(128)
    images = (Image.fromarray(one).quantize(palette=colours, dither=Image.Dither.NONE) for one in pictures)
    pause_ms = max(round(100.0 / a_second), 2) * 10  # the format counts hundredths of a second
    next(images).save(file, "GIF", save_all=True, append_images=images, duration=pause_ms, loop=0)


def _write_mp4(file: Path, pictures: Iterator["NDArray[np.uint8]"], a_second: float) -> None:
    """Write pictures as a video; raises ``OSError`` where it then holds fewer, of which ffmpeg's caller is not told."""
    from imageio_ffmpeg import count_frames_and_secs, write_frames

    first, sent = next(pictures), 0
    size = first.shape[1], first.shape[0]
    options = {"macro_block_size": 2, "ffmpeg_log_level": "quiet", "output_params": ["-f", "mp4"]}
    writer = write_frames(file, size, fps=a_second, **options)
    writer.send(None)
    try:
        for picture in chain([first], pictures):
            writer.send(picture.tobytes())
            sent += 1
        writer.close()
        whole = count_frames_and_secs(file)[0] == sent
    except (OSError, RuntimeError):  # ffmpeg has ended, or the file is no video
        whole = False
    finally:
        writer.close()
    if not whole:
        raise OSError(errno.EIO, "ffmpeg could not write the whole video; is there room?", str(file))


def _with_window() -> "type[Simulator] | None":
    """Return a simulator of the catalogue that has a window, as far as it is installed."""
    import yaml

    from navbench.cli.building import simulator_class
    from navbench.cli.catalogue import CONF

    for file in sorted((CONF / "simulator").glob("*.yaml")):
        try:
            found = simulator_class(yaml.safe_load(file.read_text(encoding="utf-8"))["_target_"])
        except DescriptionError:
            continue
        if found.has_window:
            return found
    return None


def _play_simulator(simulator: "Simulator", it: "Played", robots: Sequence[int], rays: "Rays", speed: float) -> None:
    """Play an episode in a simulator's window, until it is over or the window is closed.

    What comes too late is left out, so that a slow window keeps the time.
    """
    import numpy as np

    rays(0.0, it.poses(0.0))  # the first time takes longer, and the clock does not run yet
    begin = time.monotonic()
    with simulator:
        while (now_s := (time.monotonic() - begin) * speed) < it.end_s + HOLD_S * speed:
            at_s = it.end_s if now_s >= it.end_s else now_s // it.period_s * it.period_s
            poses = it.poses(at_s)
            move_to(simulator, at_s, poses)
            measured = rays(at_s, poses)
            noses = np.concatenate([poses[:, :2], poses[:, :2] + _ahead(it.radius_m, poses)], axis=1)
            lines = np.concatenate([noses, *(measured[i][:, :4] for i in robots)])
            told = "  ".join([f"{at_s:.2f} s", *it.robots[robots[0]].says(at_s)])
            words = [told, *_note(it, speed).split("\n")]
            if not simulator.mark(lines, [word.replace("°", "deg") for word in words]):
                return
            simulator.show(it.period_s / speed)


def _ahead(radius_m: float, poses: "NDArray[np.float64]") -> "NDArray[np.float64]":
    """Return (robots, 2) what leads from each robot's centre to somewhat ahead of its hull [m]."""
    import numpy as np

    return 1.5 * radius_m * np.stack([np.cos(poses[:, 2]), np.sin(poses[:, 2])], axis=1)


def _play_figure(it: "Played", robots: Sequence[int], rays: "Rays", speed: float) -> None:
    """Play an episode in a window of Matplotlib's, which stays until it is closed."""
    from matplotlib import pyplot
    from matplotlib.animation import FuncAnimation

    from navbench.report.film import Film

    times_s, a_second = frames_of(it, speed, FORMS[".mp4"])
    figure = pyplot.figure()
    if pyplot.get_backend().lower() == "agg":
        raise DescriptionError("replay: Matplotlib finds no window toolkit, such as tkinter; --video FILE.gif")
    film = Film(it, robots, rays, _note(it, speed), figure)
    kept = FuncAnimation(figure, film.update, times_s, interval=1000.0 / a_second, blit=True, repeat=False)
    pyplot.show()
    del kept  # which would stop without a name
