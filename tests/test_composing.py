"""What is composed quickly, from parts, is what Hydra composes; what is unusual or wrong, Hydra composes itself."""

import json
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
from navbench.cli.parts import UnusualError

from navbench.cli.catalogue import GROUPS, files_of
from navbench.cli.composing import Composed, Composer, composing, plain
from navbench.cli.configuration import cell_of

CONF = Path(__file__).parents[1] / "conf"
ALIKE = [
    "run",
    "run controller=sflc world=corner seed=3 episodes=200 workers=2 start_jitter_m=0.1",
    "run controller=dual_layer controller.build.rules=literal sensors=ring45 +sensors.sources.x={a:[1,2],b:null}",
    "run controller=oa_to world=zhao2018_fleet robot=khepera3 simulator.drive=limited robot.wheel_accel_max_mps2=null",
    "run world=lei_disc world.discs=[{x_m:3.0,y_m:2.0,radius_m:0.3}] world.starts.0.x_m=0.5 ~world.sources.discs",
    "run robot@controller.native.robot=tracked ++controller={build:{kp:2}} ++controller.tunable={} controller=pid",
    "run world=unfinished world.time_limit_s=8.0",
    "tune",
    "tune controller=oa_to tuner=ga objective=zhao2018 worlds=[deadlock,corner] tuner.build.n=10 name=x budget=70",
]
WORLD = "# A user's world\ndefaults: [/schema/world@_here_, corner, _self_]\n"
MINE = {
    "elsewhere": f"{WORLD}time_limit_s: ${{sensors.drawn_for_radius_m}}\n",
    "number": f"{WORLD}time_limit_s: ${{hydra:job.num}}\n",
    "beside": "# @package _global_\ndefaults: [/schema/world@world, corner@world, _self_]\nworld: {time_limit_s: 9}\n",
    "unfinished": (CONF / "world/corner.yaml").read_text().replace("time_limit_s: 60.0\n", ""),
    "wrong": f"{WORLD}time_limit_s: ${{deg:much}}\n",
}
UNUSUAL = [
    "world.time_limit_s=${deg:90}",
    "robot.radius_m=${world.goal_tolerance_m}",
    "hydra.run.dir=there",
    "hydra/job_logging=default",
    "world=elsewhere",
    "world=beside",
]
WRONG = [
    "seed",
    "seed=1,2",
    "+seed=1",
    "seed=one",
    "world=nowhere",
    "world=null",
    "world=unfinished",
    "world=wrong",
    "world=number",
    "world.time_limit=1.0",
    "world.starts.7.x_m=0.0",
    "~world",
    "~controller.nothing",
    "+robot@elsewhere=khepera3",
    "tuner=pso",
    "hydra.nothing=1",
]


@pytest.fixture(scope="module")
def composer(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Composer]:
    """Composes with a user's worlds."""
    folder = tmp_path_factory.mktemp("conf")
    (folder / "world").mkdir()
    for name, text in MINE.items():
        (folder / "world" / f"{name}.yaml").write_text(text)
    with composing(str(folder)) as composer:
        yield composer


def text_of(composed: Composed) -> tuple[str, Any, dict[str, Any]]:
    """All that is composed, in which no two things that differ look alike; JSON keeps the order of keys."""
    ours = {group: choice for group, choice in composed.choices.items() if not group.startswith("hydra/")}
    return json.dumps(composed.values), composed.keys, ours


def complaint(made: Any, *arguments: Any) -> tuple[type, str]:
    with pytest.raises(Exception) as refused:  # noqa: PT011 - of many kinds
        made(*arguments)
    return type(refused.value), str(refused.value)


@pytest.mark.parametrize("words", ALIKE)
def test_what_is_composed_from_parts_is_what_hydra_composes(composer: Composer, words: str) -> None:
    name, *rest = words.split()
    composer.parts.compose(name, rest)  # it does not leave this to Hydra
    quick = composer.values(name, rest)
    assert text_of(quick) == text_of(plain(*composer.config(name, rest)))


def test_every_file_of_a_run_is_composed_from_parts(composer: Composer) -> None:
    for group in GROUPS:
        for name in files_of(group, [CONF]):
            _, whole, choices = composer.parts.compose("run", [f"{group}={name}"])
            assert choices[group] == name
            assert set(whole) == set(GROUPS)


def test_what_one_run_changes_another_does_not_find(composer: Composer) -> None:
    before = text_of(composer.values("run", []))
    changed = composer.values("run", ["world.starts.0.x_m=0.25", "world.walls=[]", "robot.radius_m=0.01", "seed=5"])
    cell_of(changed)
    changed.values["controller"].clear()
    changed.values["sensors"]["mounts"].clear()
    assert text_of(composer.values("run", [])) == before


@pytest.mark.parametrize("word", UNUSUAL)
def test_what_is_unusual_hydra_composes(composer: Composer, word: str) -> None:
    with pytest.raises(UnusualError):
        composer.parts.compose("run", [word])
    assert text_of(composer.values("run", [word])) == text_of(plain(*composer.config("run", [word])))


@pytest.mark.parametrize("word", WRONG)
def test_of_what_is_wrong_hydra_speaks(composer: Composer, word: str) -> None:
    def by_hydra() -> None:
        plain(*composer.config("run", [word]))

    assert complaint(composer.values, "run", [word]) == complaint(by_hydra)
