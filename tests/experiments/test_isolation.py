"""Isolation: whatever a controller does costs its own episodes, with a reason, and the rest is as if it were not."""

import errno
import os
import random
from dataclasses import replace
from pathlib import Path

import pandas as pd
import pytest
from commands import Command, in_a_process

from navbench.cli.configuration import compose_cell
from navbench.cli.study_configuration import compose_tuning
from navbench.episode.isolation import WIPE_ON_FORK, Isolation
from navbench.experiments.cells import Unnamed
from navbench.experiments.crew import Crew, Task
from navbench.experiments.engines import in_processes
from navbench.experiments.plan import Plan
from navbench.experiments.running import Ran, run_plan
from navbench.experiments.workers import Begun, Death, MachineError
from navbench.validation import DescriptionError

CODE = """
import asyncio, ctypes, math, os, random, resource, signal, subprocess, time
import numba
import numpy as np
from navbench.metrics import metric
from navbench.policy import CompiledController, Policy, compiled


@numba.njit
def drawn(): return random.random() + np.random.random()


@compiled
def draw(state, parameters, ranges_m, discs, pose, goal, speed, trace):
    trace[0] = drawn()
    return 0.1, 0.0


class Drawing(CompiledController):
    def __init__(self, **_): pass
    def make_policy(self, setup): return Policy(step=draw, trace_names=("drawn",))


held = []


class Mute(Exception):
    def __str__(self):
        raise ValueError


def fail(how):
    if how == "sys.exit": raise SystemExit(0)
    if how == "KeyboardInterrupt": raise KeyboardInterrupt
    if how == "GeneratorExit": raise GeneratorExit
    if how == "CancelledError": raise asyncio.CancelledError
    if how == "mute": raise Mute
    if how == "surrogate": raise ValueError("half a \\udc80")
    if how == "os._exit": os._exit(0)
    if how == "abort": os.abort()
    if how == "killed": os.kill(os.getpid(), signal.SIGKILL)
    if how == "spins in C": math.factorial(10**8)
    if how == "forks": os.fork()
    if how == "forks unseen": ctypes.CDLL(None).fork()
    if how == "opens files":
        resource.setrlimit(resource.RLIMIT_NOFILE, (100, 100))
        held.extend(open(os.devnull) for _ in range(300))
    if how == "patches": math.atan2 = lambda *_: 0.0
    if how == "times itself":
        signal.signal(signal.SIGALRM, lambda *_: None)
        signal.setitimer(signal.ITIMER_REAL, 0.5)
        signal.setitimer(signal.ITIMER_REAL, 0.0)
        time.sleep(3600)


@metric("chance", "", "", "what a metric draws itself")
def chance(run): return random.random() + np.random.random() + drawn()


@metric("noted", "", "", "how often it was looked at")
def noted(run):
    with open("noted", "a") as file: file.write("once\\n")
    return 1


class Mine:
    def __init__(self, how, where="act", gain=0.0):
        self.how, self.where, self.gain = how, where, gain

    def reset(self, setup, rng):
        self.doomed = rng.random() < 0.014
        if self.where == "large gain" and self.gain > 0.5: fail(self.how)
        if self.doomed and self.where == "reset": fail(self.how)
        if self.how == "chdir, opens": open("beside.txt").close(), os.chdir("/")

    def act(self, o):
        if self.doomed and self.where == "act": fail(self.how)
        if self.how == "writes": o.ranges_m[0] = 0.0
        if "forks" in self.how or self.how == "patches": fail(self.how)
        return 0.1 + 0.1 * self.gain, 0.0

    @property
    def trace(self):
        if self.how == "draws": return {"drawn": random.random() + np.random.random()}
        return {"drawn": drawn()} if self.how == "draws in compiled code" else {}
"""
WORDS = ("controller=mine", "world=empty", "world.time_limit_s=0.1", "episodes=4", "simulator=planar")
DOOMED = {2}  # what the stream of seed 0 says


@pytest.fixture
def own(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A user's folder with a controller that misbehaves."""
    (tmp_path / "misbehaving.py").write_text(CODE)
    (tmp_path / "conf/controller").mkdir(parents=True)
    yaml = "# Misbehaves\nbuild: {_target_: misbehaving.Mine, how: nothing, where: act, gain: 0.2}\n"
    yaml += "tunable: {gain: {low: 0.1, high: 1.0, scale: linear}}\n"
    (tmp_path / "conf/controller/mine.yaml").write_text(yaml)
    monkeypatch.syspath_prepend(str(tmp_path))
    monkeypatch.chdir(tmp_path)
    return tmp_path


def run_it(own: Path, how: str, *words: str, workers: int | None = 1, where: str = "act") -> Ran:
    given = (*WORDS, f"controller.build.how='{how}'", f"controller.build.where={where}", *words)
    cell = compose_cell(*given, config_dir=own / "conf")
    return run_plan(Plan(cells=(cell,)), own / "results", workers)


def doomed_rows(ran: Ran) -> pd.DataFrame:
    """Return the rows of the episodes that failed, after a look at the others."""
    assert (ran.finished, ran.planned, ran.reasons) == (4, 4, ())
    rows = ran.results.episodes().set_index("episode")
    assert list(rows.index) == list(range(4))
    failed = rows[rows["outcome"] == "controller_error"]
    assert set(failed.index) == DOOMED
    assert set(rows["outcome"].drop(list(DOOMED))) == {"timed_out"}
    assert set(rows["reason"].drop(list(DOOMED))) == {""}
    return failed


PLACE = " (misbehaving.py, line "


@pytest.mark.parametrize("where", ["act", "reset"])
@pytest.mark.parametrize(
    ("how", "reason"),
    [
        ("sys.exit", "SystemExit: 0" + PLACE),
        ("KeyboardInterrupt", "KeyboardInterrupt:" + PLACE),
        ("GeneratorExit", "GeneratorExit:" + PLACE),
        ("CancelledError", "CancelledError:" + PLACE),
        ("mute", "Mute: says nothing: its __str__ raises ValueError" + PLACE),
        ("surrogate", r"ValueError: half a \udc80" + PLACE),
    ],
)
def test_whatever_a_controller_raises_costs_its_episode(own: Path, how: str, where: str, reason: str) -> None:
    failed = doomed_rows(run_it(own, how, where=where))
    assert all(said.startswith(reason) for said in failed["reason"]), list(failed["reason"])
    assert all('misbehaving.py", line' in said for said in failed["traceback"])


@pytest.mark.parametrize(
    ("how", "timeout_s", "reason"),
    [
        ("os._exit", 60.0, "its process ended with exit code 0"),
        ("abort", 60.0, "its process died of SIGABRT"),
        ("spins in C", 0.5, "a step took more CPU time than controller_timeout_s allows"),
    ],
)
def test_whatever_ends_or_holds_a_process_costs_its_episode(own: Path, how: str, timeout_s: float, reason: str) -> None:
    failed = doomed_rows(run_it(own, how, f"controller_timeout_s={timeout_s}"))
    assert set(failed["reason"]) == {reason}
    assert how == "os._exit" or all("in fail" in said for said in failed["traceback"])


def test_what_was_killed_from_outside_is_no_row_and_is_run_later(own: Path, command: Command) -> None:
    words = [*WORDS, "--config-dir", str(own / "conf"), "hydra.run.dir=results", "workers=1"]
    done = command(*words, "controller.build.how=killed")
    assert done.code == 3
    assert done.err == "navbench: machine_error: its process died of SIGKILL; nothing is kept\n"
    assert not (own / "results").exists()


def test_a_batch_that_was_killed_is_missing_and_the_others_are_kept(own: Path) -> None:
    ran = run_it(own, "killed", "episodes=10")  # of which the second batch has none that is killed
    assert (ran.finished, ran.planned) == (5, 10)
    assert ran.reasons == ("mine in empty: machine_error: its process died of SIGKILL",)
    assert list(ran.results.episodes()["episode"]) == list(range(5, 10))


def test_a_controller_that_uses_the_clocks_signal_itself_is_timed_all_the_same(own: Path) -> None:
    failed = doomed_rows(run_it(own, "times itself", "controller_timeout_s=0.2"))
    assert set(failed["reason"]) == {"a step waited longer than controller_timeout_s allows"}
    assert all("in fail" in said for said in failed["traceback"])


def test_files_that_a_controller_leaves_open_cost_its_own_episodes(own: Path, command: Command) -> None:
    words = ["--config-dir", str(own / "conf"), "hydra.sweep.dir=results", "workers=1", "world=empty,corner"]
    how = "controller.build.how='opens files',nothing"
    done = command("-m", WORDS[0], *WORDS[2:], *words, how, "controller.build.where=act")
    assert done.code == 0, done
    rows = pd.read_csv(own / "results/episodes.csv")
    assert len(rows) == 16
    failed = rows[rows["outcome"] == "controller_error"]
    assert set(failed["episode"]) == DOOMED
    assert set(failed["world"]) == {"empty"}
    assert all("Too many open files" in reason for reason in failed["reason"])


def run_out(number: int) -> None:
    raise MemoryError if number == 0 else OSError(number, os.strerror(number))


def test_what_a_controller_patches_is_not_patched_for_others(own: Path) -> None:
    words = ("world=corner", "start_jitter_m=0.01", "episodes=4", "simulator=pybullet")
    mine = compose_cell("controller=mine", "controller.build.how=patches", *words, config_dir=own / "conf")
    pid = compose_cell("controller=pid", *words)
    rows = {
        folder: run_plan(Plan(cells=cells), own / folder, 1).results.episodes().query("controller == 'pid'")
        for folder, cells in {
            "alone": (pid,),
            "after": (mine, pid),
            "between": (mine, pid, replace(mine, seed=1)),
        }.items()
    }
    assert set(rows["alone"]["outcome"]) == {"reached"}
    for folder in ("after", "between"):
        pd.testing.assert_frame_equal(rows[folder].reset_index(drop=True), rows["alone"], rtol=0.0, atol=0.0)


def test_a_process_runs_one_user_controller_only_and_ours_in_others() -> None:
    crew = Crew([])
    none, first, second = frozenset[str](), frozenset({"mine.Mine"}), frozenset({"yours.Yours"})
    sets = none, none, first, first, second, none
    pids = [crew.do(Task(_pid, None, foreign=foreign)) for foreign in sets]
    assert pids[0] == pids[1]
    assert pids[2] == pids[3]
    assert len(set(pids)) == 4
    assert len(crew.idle) == 1
    crew.end()


def test_what_shares_a_process_is_the_same_controller_with_the_same_parameters(own: Path) -> None:
    def foreign(*words: str) -> frozenset[str]:
        return compose_cell(*words, config_dir=own / "conf").foreign

    mine = foreign(*WORDS)
    assert foreign(*WORDS, "world=corner", "seed=1") == mine != foreign(*WORDS, "controller.build.how=other")
    assert foreign("controller=pid", "world=empty") == frozenset()
    noted = {foreign(f"controller={name}", "world=empty", "metrics=[misbehaving.noted]") for name in ("pid", "sflc")}
    assert len(noted) == 2
    assert frozenset() not in noted
    given = replace(compose_cell("controller=pid", "world=empty"), controller=Unnamed(object(), is_object=True))
    assert given.foreign


def test_a_change_of_a_users_code_stops_only_what_runs_such_code() -> None:
    crew = Crew([])
    crew._begun = Begun(crew._begun.place, {"commands": "0" * 16})
    assert isinstance(crew.do(Task(_pid, None)), int)
    refused = crew.do(Task(_pid, None, foreign=frozenset({"mine.Mine"})))
    assert refused == Death("commands: changed since this run began", by_machine=True)
    crew.end()


def test_helpers_of_one_name_in_two_folders_are_refused(own: Path) -> None:
    for name in ("A", "B"):
        (own / name).mkdir()
        (own / name / "helping.py").touch()
        (own / f"of_{name}.py").write_text(f"import sys\nsys.path.append('{own / name}')\nimport helping\n{CODE}")
        yaml = f"# Mine\nbuild: {{_target_: of_{name}.Mine, how: nothing}}\n"
        (own / "conf/controller" / f"{name}.yaml").write_text(yaml)
    words = ("--config-dir", "conf", *WORDS[1:], "hydra.sweep.dir=sweep")
    assert in_a_process(own, "-m", "controller=A,go_to_goal", *words).code == 0
    done = in_a_process(own, "-m", "controller=A,B", *words[:-1], "hydra.sweep.dir=both")
    assert done.code == 2
    assert done.err.startswith(f"navbench: helping: lies in {own / 'A'} and in {own / 'B'}, of which of_A adds")
    assert not (own / "both").exists()


def _pid(_: object) -> int:
    return os.getpid()


def test_a_process_that_has_no_room_for_more_is_not_used_again() -> None:
    with pytest.raises(DescriptionError, match="^its process ran out of files: .*Too many open files"):
        in_processes(run_out, [errno.EMFILE], workers=1)
    for number in (0, errno.ENOMEM, errno.EAGAIN):
        with pytest.raises(MachineError, match="machine_error: its process ran out of memory, files or processes"):
            in_processes(run_out, [number], workers=1)
    with pytest.raises(OSError, match="No space left on device"):  # of which the command says what is kept
        in_processes(run_out, [errno.ENOSPC], workers=1)


def test_every_episode_begins_in_the_users_folder(own: Path) -> None:
    (own / "beside.txt").touch()
    rows = run_it(own, "chdir, opens").results.episodes()
    assert set(rows["outcome"]) == {"timed_out"}


def draws_of(own: Path, folder: str, how: str, *words: str, workers: int | None = 1) -> dict[int, list[float]]:
    """Return what each episode's controller drew, of a run that is then moved away, so that none is resumed."""
    rows = run_it(own, how, "episodes=6", *words, workers=workers).results.trajectories()
    (own / "results").rename(own / folder)
    return {int(str(episode)): ones["drawn"].dropna().tolist() for episode, ones in rows.groupby("episode")}


@pytest.mark.parametrize(
    ("how", "target"), [("draws", "Mine"), ("draws in compiled code", "Mine"), ("as a policy", "Drawing")]
)
def test_the_global_generators_are_seeded_for_each_episode_apart_from_the_controllers_stream(
    own: Path, how: str, target: str
) -> None:
    target = f"controller.build._target_=misbehaving.{target}"
    first = draws_of(own, "first", how, target)
    random.random()  # in this process they have been used before
    assert draws_of(own, "second", how, target, workers=0) == first
    assert draws_of(own, "alone", how, target, "episode=4") == {4: first[4]}
    every = [value for values in first.values() for value in values]
    assert len(set(every)) == len(every) > 6


def test_what_a_metric_draws_is_of_its_episode(own: Path) -> None:
    words = ("controller=go_to_goal", "episodes=6", "metrics=[misbehaving.chance]")
    drawn = []
    for folder, more, workers in (("first", (), 1), ("second", (), 0), ("alone", ("episode=4",), 0)):
        cell = compose_cell(*WORDS[1:], *words, *more, config_dir=own / "conf")
        rows = run_plan(Plan(cells=(cell,)), own / folder, workers).results.episodes()
        drawn.append(dict(zip(rows["episode"], rows["chance"], strict=True)))
    assert drawn[0] == drawn[1]
    assert drawn[2] == {4: drawn[0][4]}
    assert len(set(drawn[0].values())) == 6


def test_an_observation_cannot_be_written_to_and_leads_to_no_other(own: Path) -> None:
    (reason,) = set(run_it(own, "writes").results.episodes()["reason"])
    assert reason.startswith("ValueError: assignment destination is read-only" + PLACE)


@pytest.mark.parametrize("how", ["forks", "forks unseen"])  # by Python
def test_a_fork_does_not_go_on_with_the_episode(own: Path, how: str) -> None:
    ran = run_it(own, how, "metrics=[misbehaving.noted]", where="every act")
    assert set(ran.results.episodes()["outcome"]) == {"timed_out"}
    assert len((own / "noted").read_text().splitlines()) == 4  # once an episode


@pytest.mark.parametrize("advice", [WIPE_ON_FORK, 9999])  # that systems know, or not
def test_a_fork_ends_also_where_the_system_empties_no_page(monkeypatch: pytest.MonkeyPatch, advice: int) -> None:
    monkeypatch.setattr("navbench.episode.isolation.WIPE_ON_FORK", advice)
    apart = Isolation(None)
    apart.check()
    if not (fork := os.fork()):
        apart.check()
        os._exit(7)
    assert os.waitpid(fork, 0)[1] == 0


TUNED = (
    *("controller=mine", "world=empty", "world.time_limit_s=0.1", "episodes=2", "start_jitter_m=0.01"),
    *("tuner=random", "budget=10", "objective=weighted", "verify=null", "controller.build.where=large gain"),
)


def evaluations(own: Path, how: str, folder: str, workers: int, *seeds: int) -> list[pd.DataFrame]:
    """Return what tunings found, of which some candidates misbehave."""
    words = (*TUNED, f"controller.build.how='{how}'")
    tunings = [compose_tuning([*words, f"seed={seed}"], str(own / "conf"))[0] for seed in seeds]
    cell = compose_cell(*WORDS, config_dir=own / "conf")
    ran = run_plan(Plan(cells=(cell,), tunings=tuple(tunings)), own / folder, workers)
    return [ran.results.evaluations_of(tuning.key()).drop(columns="tuning_id") for tuning in tunings]


def test_a_tuning_charges_a_candidate_that_ends_its_process_as_one_that_raises(own: Path) -> None:
    raised, ended = evaluations(own, "sys.exit", "raised", 1, 0), evaluations(own, "os._exit", "ended", 1, 0)
    pd.testing.assert_frame_equal(raised[0], ended[0], rtol=0.0, atol=0.0)
    assert len(set(ended[0]["cost"])) > 2
    beside = evaluations(own, "os._exit", "beside", 2, 0, 1)
    pd.testing.assert_frame_equal(raised[0], beside[0], rtol=0.0, atol=0.0)


def test_a_process_that_cannot_be_started_is_a_fault_of_the_machine(monkeypatch: pytest.MonkeyPatch) -> None:
    def fail(*_: object) -> None:
        raise EOFError("unexpected EOF")  # as where the server that forks workers was killed

    monkeypatch.setattr("navbench.experiments.crew.Worker", fail)
    for alone in (False, True):
        found = Crew([]).do(Task(str, 1, alone))
        assert isinstance(found, Death)
        assert found.by_machine
        assert found.reason.startswith("its process could not be started: EOFError: unexpected EOF")
