"""A user's generator in one Python file and one YAML, with a bad draw now and then; and the layouts that are kept."""

import sys
from collections.abc import Iterator
from pathlib import Path

import pytest

import navbench
from navbench.analysis.stored import StoredResults
from navbench.cli.configuration import compose_cell
from navbench.experiments.store import Results, ResultsError
from navbench.records import NOT_DRIVEN
from navbench.validation import DescriptionError

ROOMS = '''"""Two rooms with a door at a random place."""

from dataclasses import dataclass

from navbench.world import Bounds, Layout, NoRoomError, Pose, Wall


@dataclass(frozen=True, kw_only=True)
class TwoRooms:
    width_m: float
    height_m: float
    door_m: float

    def draw(self, rng, episode):
        if episode == 1:
            raise KeyError("no such door")
        if episode == 2:
            return {"walls": []}
        if episode == 4 or rng.uniform() < 0.5:
            raise NoRoomError("no room for the door")
        x, y = 0.5 * self.width_m, rng.uniform(self.door_m, self.height_m - self.door_m)
        return Layout(
            bounds=Bounds.of(self.width_m, self.height_m),
            walls=(Wall(x, 0.0, x, y - 0.5 * self.door_m), Wall(x, y + 0.5 * self.door_m, x, self.height_m)),
            starts=(Pose(0.1 * self.width_m, 0.5 * self.height_m, 0.0),),
            goals=((x, 0.0) if episode == 3 else (0.9 * self.width_m, 0.5 * self.height_m),),
        )
'''
YAML = """# Two rooms with a door at a random place
defaults: [/schema/world@_here_, _self_, override /robot@_global_.robot: khepera3]
source: {_target_: mine.rooms.TwoRooms, width_m: 3.0, height_m: 2.0, door_m: 0.4}
goal_tolerance_m: 0.05
time_limit_s: 2.0
"""
REASONS = {
    1: "world=two_rooms, seed=0, episode=1: KeyError: 'no such door'",
    2: "world=two_rooms, seed=0, episode=2: draw must return a Layout, got dict",
    3: "goals[0]: (1.5, 0.0) lies 0 m from an obstacle, where a robot of radius 0.065 m cannot come nearer to it than "
    "goal_tolerance_m=0.05",
    4: "world=two_rooms, seed=0, episode=4: no room for the door; tried 100 times",
}


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Path]:
    """A folder of a user's own, with the two files in it."""
    for name, text in (("mine/rooms.py", ROOMS), ("conf/world/two_rooms.yaml", YAML)):
        (tmp_path / name).parent.mkdir(parents=True)
        (tmp_path / name).write_text(text)
    monkeypatch.syspath_prepend(str(tmp_path))
    monkeypatch.delitem(sys.modules, "mine", raising=False)  # of another user
    yield tmp_path
    for name in ("mine.rooms", "mine"):
        sys.modules.pop(name, None)


def run(folder: Path, *words: str, episodes: int = 8) -> StoredResults:
    """Run go_to_goal, and return what is kept."""
    words = ("controller=go_to_goal", f"episodes={episodes}", "workers=1", *words)
    navbench.run(*words, config_dir=str(folder / "conf"), dir=folder / "out")
    return StoredResults(Results(folder / "out"))


def test_a_bad_draw_costs_its_episode_and_says_why(folder: Path) -> None:
    rows = run(folder, "world=two_rooms").rows.set_index("episode")
    assert {episode: rows.loc[episode, "reason"] for episode in rows.index[rows["outcome"].isin(NOT_DRIVEN)]} == REASONS
    assert list(rows.index[rows["outcome"] == "impossible"]) == [3]
    lost = rows.loc[list(REASONS)]
    assert (lost["time_s"] == 0.0).all()
    assert lost["goal_distance_m"].isna().all()
    assert (lost["layout_id"] == "").all()


def test_another_draw_after_no_room_is_the_next_of_the_same_stream(folder: Path) -> None:
    world = compose_cell("controller=go_to_goal", "world=two_rooms", config_dir=str(folder / "conf")).world
    drawn = [world.drawn_for(0, episode) for episode in range(5, 30)]
    assert drawn == [world.drawn_for(0, episode) for episode in range(5, 30)]
    assert len({layout.walls for layout in drawn}) == len(drawn)


def test_what_is_read_is_the_layout_that_was_driven_not_what_the_generator_would_draw_today(folder: Path) -> None:
    reading = run(folder, "world=two_rooms")
    (run_id,) = reading.cells["run_id"]
    kept = [reading.world(run_id, episode).walls for episode in (0, 5, 6, 7)]
    (folder / "mine" / "rooms.py").unlink()
    again = StoredResults(Results(folder / "out"))
    assert [again.world(run_id, episode).walls for episode in (0, 5, 6, 7)] == kept
    assert len(set(kept)) == 4
    common = again.world_in_common(run_id)
    assert common is not None
    assert common.walls == ()
    assert len(common.starts) == 1
    with pytest.raises(ResultsError, match="no layout is stored for episode 1 of"):
        again.world(run_id, 1)


def test_a_fixed_worlds_layout_is_kept_once_for_all_batches(folder: Path) -> None:
    reading = run(folder, "world=lei_gate", "world.time_limit_s=0.1", episodes=60)
    assert reading.episodes["layout_id"].nunique() == 1
    assert len(list((folder / "out" / "layouts").iterdir())) == 1
    assert len(reading.results.layouts()) == 1


@pytest.mark.parametrize(
    ("word", "said"),
    [
        (
            "door_n=3",
            "world.source.door_n: unknown key; did you mean door_m? allowed here: _target_, width_m, height_m, door_m",
        ),
        ("door_m=wide", "world.source.door_m='wide': must be a number"),
        ("_target_=mine.rooms.Rooms", "world.source._target_=mine.rooms.Rooms: cannot be imported"),
        ("_target_=mine.rooms.Bounds", "world.source._target_=mine.rooms.Bounds: must name a class with draw"),
    ],
)
def test_a_slip_in_the_yaml_is_refused_in_one_line(folder: Path, word: str, said: str) -> None:
    sign = "+" if word.startswith("door_n") else ""
    words = ("controller=go_to_goal", "world=two_rooms", f"{sign}world.source.{word}")
    with pytest.raises(DescriptionError) as caught:
        compose_cell(*words, config_dir=str(folder / "conf"))
    assert said in str(caught.value)
    assert "\n" not in str(caught.value)
