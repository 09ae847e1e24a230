"""What is composed in halves is what Hydra composes whole; a sweep's words give its runs; a user's files are found."""

import gc
import json
import weakref
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

from navbench.cli.catalogue import CONF, GROUPS, files_of
from navbench.cli.composing import COLLECTED_EVERY, Composed, Composer, combinations, composing
from navbench.validation import DescriptionError

ALIKE = [
    "",
    "controller=sflc world=corner seed=3 episodes=200 workers=2 start_jitter_m=0.1",
    "controller=dual_layer controller.build.rules=literal sensors=ring45 +sensors.sources.x={a:[1,2],b:null}",
    "controller=oa_to world=zhao2018_fleet robot=khepera3 simulator.drive=limited robot.wheel_accel_max_mps2=null",
    "world=lei_disc world.discs=[{x_m:3.0,y_m:2.0,radius_m:0.3}] world.starts.0.x_m=0.5 ~world.sources.discs",
    "robot@controller.native.robot=tracked ++controller={build:{kp:2}} ++controller.tunable={} controller=pid",
    "world=unfinished world.time_limit_s=8.0",
    "world.time_limit_s=${deg:90}",
]
WORLD = "# A user's world\ndefaults: [/schema/world@_here_, corner, _self_"
MINE = {
    "world/elsewhere": f"{WORLD}]\ntime_limit_s: ${{sensors.drawn_for_radius_m}}\n",
    "world/number": f"{WORLD}]\ntime_limit_s: ${{hydra:job.num}}\n",
    "world/beside": "# @package _global_\ndefaults: [/schema/world@world, corner@world]\nworld: {time_limit_s: 9}\n",
    "world/many": "# @package _global_\ndefaults: [/schema/world@world, corner@world]\nepisodes: 9\n",
    "world/sees": f"{WORLD}, override /sensors@_global_.sensors: ring45]\n",
    "world/unfinished": (CONF / "world/corner.yaml").read_text().replace("time_limit_s: 60.0\n", ""),
    "world/wrong": f"{WORLD}]\ntime_limit_s: ${{deg:much}}\n",
    "controller/moved": "defaults: [go_to_goal, _self_, override /robot@_global_.robot: disc4]\n",
    "controller/same": "defaults: [go_to_goal, _self_, override /robot@_global_.robot: khepera3]\n",
    "controller/slips": "# @package _global_\ndefaults: [go_to_goal@controller]\nsimulator: {drive: limited}\n",
    "controller/counts": 'defaults: [go_to_goal, _self_]\nbuild: {speed_mps: "${episodes}"}\n',
}
ENTANGLED = [
    "robot.radius_m=${sensors.drawn_for_radius_m}",
    "world.time_limit_s=${seed}",
    "world=elsewhere",
    "world=sees",
    "world=deadlock controller=moved",
    "world=lei_gate controller=same",
    "controller=slips",
    "controller=counts episodes=3",
]
WRONG = [
    "seed",
    "seed=1,2",
    "+seed=1",
    "+nothing=1",
    "seed=one",
    "~seed",
    "world=nowhere",
    "world=null",
    "world=corner.yaml",
    "world=unfinished",
    "world=wrong",
    "world=number",
    "world.time_limit=1.0",
    "world.starts.7.x_m=0.0",
    "~world",
    "~controller.nothing",
    "+robot@elsewhere=khepera3",
    "controller=moved ~robot",
    "tuner=pso",
    "hydra.nothing=1",
]


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A user's own files."""
    folder = tmp_path_factory.mktemp("it's conf, a=b")
    for name, text in MINE.items():
        (folder / name).parent.mkdir(exist_ok=True)
        (folder / f"{name}.yaml").write_text(text)
    return folder


@pytest.fixture(scope="module")
def composer(folder: Path) -> Iterator[Composer]:
    with composing(folder) as composer:
        yield composer


def text_of(composed: Composed | None) -> tuple[str, dict[str, Any]]:
    """All that is composed, in which no two things that differ look alike; JSON keeps the order of keys."""
    assert composed is not None
    return json.dumps(composed.values), dict(composed.choices)


def complaint(made: Any, words: list[str]) -> tuple[type, str]:
    with pytest.raises(Exception) as refused:  # noqa: PT011 - of many kinds
        made("run", words)
    return type(refused.value), str(refused.value)


@pytest.mark.parametrize("words", [*ALIKE, "world=beside", "world=many"])
def test_what_is_composed_in_halves_is_what_hydra_composes(composer: Composer, words: str) -> None:
    assert text_of(composer._halves(words.split())) == text_of(composer._whole("run", words.split()))


def test_every_file_of_a_run_is_composed_in_halves(composer: Composer) -> None:
    for group in GROUPS:
        for name in files_of(group, [CONF]).keys() - {"policy"}:  # which is nothing without a file of the user's
            halves = composer._halves([f"{group}={name}"])
            assert halves is not None
            assert halves.choices[group] == name


@pytest.mark.parametrize("words", ENTANGLED)
def test_halves_that_have_to_do_with_each_other_are_composed_together(composer: Composer, words: str) -> None:
    assert composer._halves(words.split()) is None
    assert text_of(composer.values("run", words.split())) == text_of(composer._whole("run", words.split()))


@pytest.mark.parametrize("words", WRONG)
def test_of_what_is_wrong_hydra_speaks(composer: Composer, words: str) -> None:
    assert complaint(composer.values, words.split()) == complaint(composer._whole, words.split())


def test_a_sweep_goes_over_every_combination_in_the_order_of_its_words(composer: Composer) -> None:
    words = ["controller=glob(*_pid)", "world=choice(deadlock,mine)", "seed=range(1,3)", "world.discs=[]", "~a.b"]
    jobs = combinations([*words, "name='a,b',\"c d\""])
    assert len(jobs) == 3 * 2 * 2 * 2
    assert jobs[0] == ["controller=abc_pid", "world=deadlock", "seed=1", "world.discs=[]", "~a.b", "name='a,b'"]
    assert jobs[1][-1] == 'name="c d"'
    assert [job[2] for job in jobs[:4:2]] == ["seed=1", "seed=2"]


def test_a_glob_finds_a_users_files(composer: Composer) -> None:
    assert combinations(["controller=glob([mo*,sl*])"]) == [["controller=moved"], ["controller=slips"]]


def test_a_glob_that_finds_nothing_is_refused(composer: Composer) -> None:
    with pytest.raises(DescriptionError, match="no name is like that"):
        combinations(["controller=glob(nope*)"])


def test_a_sweep_says_what_it_runs_and_where_its_results_go(composer: Composer) -> None:
    runs, path = composer.command("run", ["world=corner,deadlock", "hydra.sweep.dir=in/${hydra:job.name}"], sweep=True)
    assert [run.choices["world"] for run in runs] == ["corner", "deadlock"]
    assert path == Path("in/navbench")


def test_a_run_is_named_by_its_controller_and_world(composer: Composer) -> None:
    (run,), path = composer.command("run", ["controller=pid", "world=corner"])
    assert run.choices["controller"] == "pid"
    assert path.parts[0] == "outputs"
    assert path.name.endswith("-pid-corner")


@pytest.mark.parametrize("word", ["hydra.job.chdir=true", "hydra/job_logging=default", "hydra.run.dir=there"])
def test_what_hydra_would_do_beside_composing_is_refused(composer: Composer, word: str) -> None:
    with pytest.raises(DescriptionError, match=f"{word.split('=')[0]}: unknown key; .* hydra.sweep.dir$"):
        composer.command("run", [word], sweep=True)


def test_a_folder_may_be_the_one_where_one_stands(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(folder)
    with composing(".") as composer:
        assert composer.values("run", ["controller=moved"]).choices["robot"] == "disc4"


@pytest.mark.parametrize("name", ["run.yaml", "world/corner.yaml", "robot/disc4.yaml", "study/papers.yaml"])
def test_a_users_file_with_a_name_that_is_taken_is_refused(name: str, tmp_path: Path) -> None:
    assert (CONF / name).is_file()
    (tmp_path / name).parent.mkdir(exist_ok=True)
    (tmp_path / name).write_text("title: mine\n")
    with pytest.raises(DescriptionError, match=f"{name}: navbench has a .* of that name; choose another one"):
        composing(tmp_path).__enter__()


@pytest.mark.parametrize("entry", ["{'': corner}", "{'': 'j\u00d9\u00b8'}", "{'': null}"])
def test_a_default_of_a_group_without_a_name_is_refused(entry: str, tmp_path: Path) -> None:
    (tmp_path / "controller").mkdir()
    (tmp_path / "controller/mine.yaml").write_text(f"defaults: [{entry}, _self_]\nbuild: {{}}\n")
    with composing(tmp_path) as composer, pytest.raises(DescriptionError, match="controller=mine: defaults: each must"):
        composer.values("run", ["controller=mine"])


def test_a_users_schema_is_refused(tmp_path: Path) -> None:
    (tmp_path / "schema").mkdir()
    with pytest.raises(DescriptionError, match="schema: the schemas are navbench's own"):
        composing(tmp_path).__enter__()


@pytest.mark.parametrize(
    "files",
    [
        {"": "# @package _global_\ntitle: mine\ncells: [1]\nclaims: {a: 2}\n"},
        {"": "title: mine\ncells: [1]\nclaims: {a: 2}\n"},
        {"": "defaults: [mine/cells, _self_]\ntitle: mine\nclaims: {a: 2}\n", "/cells": "cells: [1]\n"},
        {"": "defaults: [mine/claims@claims, _self_]\ntitle: mine\ncells: [1]\n", "/claims": "a: 2\n"},
        {
            "": "# @package _global_\ndefaults: [mine/claims, _self_]\ntitle: mine\ncells: [1]\n",
            "/claims": "# @package claims\na: 2\n",
        },
    ],
)
def test_a_study_needs_no_header_and_may_be_split(files: dict[str, str], tmp_path: Path) -> None:
    (tmp_path / "study/mine").mkdir(parents=True)
    for name, text in files.items():
        (tmp_path / f"study/mine{name}.yaml").write_text(text)
    with composing(tmp_path) as composer:
        assert composer.study("mine") == {"title": "mine", "cells": [1], "claims": {"a": 2}}


def test_a_study_that_says_a_thing_twice_is_refused(tmp_path: Path) -> None:
    (tmp_path / "study/mine").mkdir(parents=True)
    (tmp_path / "study/mine.yaml").write_text("defaults: [mine/more, _self_]\ntitle: mine\n")
    (tmp_path / "study/mine/more.yaml").write_text("title: yours\n")
    with composing(tmp_path) as composer, pytest.raises(DescriptionError, match=r"study/mine\.title: stands in sev"):
        composer.study("mine")


def test_what_a_composition_leaves_is_collected(composer: Composer) -> None:
    class Circle:
        """What Hydra leaves: it holds itself."""

        def __init__(self) -> None:
            self.itself = self

    left = []
    for _ in range(3 * COLLECTED_EVERY):
        with composing():
            circle = Circle()
            left.append(weakref.ref(circle))
            gc.collect(1)  # it grows old: from now on only a full collection looks for it
            del circle
    assert sum(circle() is not None for circle in left) <= COLLECTED_EVERY
