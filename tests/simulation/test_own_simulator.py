"""A simulator of a user's own: a file in a folder outside, and the module with its class."""

import hashlib
import json
from pathlib import Path

import pandas as pd
import pytest
from commands import Command, in_a_process

from navbench.cli.configuration import compose_cell
from navbench.experiments.code import code_of, roots_of
from navbench.experiments.store import Results

MINE = '''
import math

from pydantic.dataclasses import dataclass

from navbench.records import Thing
from navbench.simulation.base import Simulator
from navbench.simulation.options import SimulatorOptions
from navbench.validation import STRICT, Positive


@dataclass(frozen=True, slots=True, kw_only=True, config=STRICT)
class CircleOptions(SimulatorOptions):
    grain_share: Positive


class Circles(Simulator):
    """Discs and robots alone, by their formulas."""

    Options = CircleOptions
    packages = ("pytest",)

    def build(self):
        self.discs = [(Thing("disc", i), (d.x_m, d.y_m), d.radius_m) for i, d in enumerate(self.scene.layout.discs)]

    def place(self):
        robots = [(Thing("robot", i), (r.x_m, r.y_m), self.robot.radius_m) for i, r in enumerate(self.states())]
        self.circles = self.discs + robots

    def cast(self, index, rays):
        me, table = self.states()[index], self.rays.table
        cosine, sine = math.cos(me.heading_rad), math.sin(me.heading_rad)

        def turned(x, y):
            return me.x_m + cosine * x - sine * y, me.y_m + sine * x + cosine * y

        return [
            self.free(index, turned(ray["begin_x_m"], ray["begin_y_m"]), turned(ray["end_x_m"], ray["end_y_m"]))
            for ray in table[rays]
        ]

    def free(self, index, begin, end):
        (ax, ay), (ux, uy) = begin, (end[0] - begin[0], end[1] - begin[1])
        shares = [1.0]
        for thing, (x, y), radius in self.circles:
            b, c = ux * (ax - x) + uy * (ay - y), (ax - x) ** 2 + (ay - y) ** 2 - radius**2
            square = b * b - (ux * ux + uy * uy) * c
            if thing != Thing("robot", index) and square > 0.0 and c > 0.0 > b:
                shares.append((-b - math.sqrt(square)) / (ux * ux + uy * uy))
        grain = self.options.grain_share
        return grain * round(min(shares) / grain)
'''
YAML = """# Circles by their formulas
_target_: mine.Circles
grain_share: 1.0e-9
drive: ideal
on_collision: end
"""
RUN = ("--config-dir", "conf", "world=zhao2017_static", "start_jitter_m=0.5")


@pytest.fixture
def own(tmp_path: Path) -> Path:
    """A user's folder with a simulator: two files."""
    (tmp_path / "conf/simulator").mkdir(parents=True)
    (tmp_path / "conf/simulator/circles.yaml").write_text(YAML)
    (tmp_path / "mine.py").write_text(MINE)
    return tmp_path


def table_of(own: Path, command: Command, simulator: str, *words: str) -> pd.DataFrame:
    done = command(*RUN, "workers=1", f"simulator={simulator}", f"hydra.run.dir={simulator}", *words)
    assert done.code == 0, done.err
    return pd.read_csv(own / simulator / "episodes.csv", keep_default_na=False)


@pytest.mark.parametrize(
    "words",
    [
        # a ray that passes a disc by a hair parts the two before long
        ("controller=oa_to", "world.time_limit_s=5", "episodes=1"),
        ("controller=go_to_goal", "world.time_limit_s=90", "episodes=3"),
        ("controller=go_to_goal", "world.time_limit_s=90", "episodes=3", "simulator.on_collision=block"),
    ],
)
def test_a_users_simulator_does_what_ours_does(own: Path, command: Command, words: tuple[str, ...]) -> None:
    theirs, ours = (table_of(own, command, simulator, *words) for simulator in ("circles", "pybullet"))
    assert set(theirs["simulator"]) == {"circles"}
    assert (theirs["collisions"].sum() > 0) == ("controller=go_to_goal" in words)
    exact = ["outcome", "reason", "hit", "hit_index", "collisions", "robot_collisions", "standing_collisions"]
    pd.testing.assert_frame_equal(theirs[exact], ours[exact])
    near = ["time_s", "path_length_m", "min_clearance_m", "total_turning_rad", "goal_distance_m"]
    pd.testing.assert_frame_equal(theirs[near], ours[near], rtol=1e-3, atol=1e-3)


def test_a_users_simulator_reaches_worker_processes_and_names_its_packages(own: Path) -> None:
    words = ("controller=go_to_goal", "simulator=circles", "workers=2", "episodes=30", "hydra.run.dir=here")
    done = in_a_process(own, *RUN, *words)
    assert done.code == 0, done.err
    manifest = json.loads((own / "here/manifest.json").read_text())
    assert "pytest" in manifest["versions"]
    assert not any("bullet" in name for name in manifest["versions"])


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (["simulator.grain_share=0"], "simulator.grain_share=0: must be greater than 0"),
        (["+simulator.grian_share=1"], "simulator.grian_share: unknown key; did you mean grain_share? allowed here: "),
        (["+simulator.gui=true"], "simulator.gui=True: circles has no window"),
        (["simulator._target_=mine.Squares"], "simulator._target_=mine.Squares: cannot be imported"),
        (["simulator._target_=mine.CircleOptions"], "must name a subclass of navbench.simulation.base.Simulator"),
    ],
)
def test_a_wrong_option_of_a_users_simulator_is_refused_in_one_line(
    own: Path, command: Command, words: list[str], said: str
) -> None:
    done = command(*RUN, "controller=go_to_goal", "simulator=circles", *words)
    assert (done.code, done.out) == (2, "")
    assert said in done.err


def test_the_code_of_a_cell_covers_the_module_of_its_simulator(
    own: Path, command: Command, caplog: pytest.LogCaptureFixture
) -> None:
    words = ("--config-dir", "conf", "controller=go_to_goal", "world=empty", "world.time_limit_s=0.2", "workers=1")
    ours = compose_cell("controller=go_to_goal", "world=empty", "simulator=pybullet").configuration
    assert "navbench.simulation.bullet" in code_of(roots_of(ours))
    assert command(*words, "simulator=circles", "hydra.run.dir=here").code == 0
    code = Results(own / "here").manifest()["code"]
    assert code["mine"] == hashlib.sha256((own / "mine.py").read_bytes()).hexdigest()[:16]
    (own / "mine.py").write_text(MINE.replace("grain * round(", "grain * math.floor("))
    assert command(*words, "simulator=circles", "hydra.run.dir=here").code == 0
    assert "1 parts are of other code (mine): they are run anew" in caplog.text
