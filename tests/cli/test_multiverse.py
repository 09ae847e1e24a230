"""A multiverse: shares and what decides them where the answer is known, stopped and gone on with, and wrong words."""

import json
import re
import shutil
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pyarrow.parquet as pq
import pytest
from commands import Command, in_a_process

from benchmarks.kill import WORLD
from navbench.analysis.fitting import Met, Target, targets, values_in
from navbench.analysis.shares import FAILS, HOLDS, Drawn
from navbench.analysis.stored import StoredResults
from navbench.cli.prior import reconstructions_of
from navbench.cli.rebuilding import between, fitted
from navbench.cli.sample import Places, Sample
from navbench.cli.sampling import Block, places, run_block
from navbench.cli.searching import POPULATION, Searches
from navbench.cli.study_configuration import compose_study
from navbench.experiments import parts
from navbench.experiments.files import locked
from navbench.experiments.samples import DRAWN, MOVED, Samples
from navbench.tuning.space import Dimension

STUDY = """
# @package _global_
title: "tiny: a straight line"
summary: A robot drives 1.95 m; its speed is anything between 0.1 and a third of a metre a second.
cells:
  - {name: line, label: rule, overrides: [controller=go_to_goal, world=line, simulator=planar]}
  - name: set
    label: rule
    overrides: [controller=go_to_goal, world=line, simulator=planar, controller.build.speed_mps=0.195]
claims:
  time: {says: it takes 10 s, printed: 10.0 s, within: 2.0 s, measure: median, of: {metric: time_s, cell: line}}
  time-set: {says: it takes 10 s, printed: 10.0 s, within: 0.1 s, measure: median, of: {metric: time_s, cell: set}}
  arrives: {says: it arrives, holds: in 95 % of the cases, measure: share_reached, of: {cell: line}}
  fast: {says: it takes a second, printed: 1.0 s, within: 0.1 s, measure: median, of: {metric: time_s, cell: line}}
multiverse:
  admissible: {there: {says: it arrives, holds: in 80 % of the cases, measure: share_reached, of: {cell: line}}}
  implied: [arrives]
  priors: {narrow: {go_to_goal.speed_mps: [0.18, 0.21]}, same: {go_to_goal.speed_mps: null}}
report: [{name: verdicts, title: Claims, groups: {}}]
"""
LOW, HIGH = 0.1, 0.3333  # the range of go_to_goal's speed
SHARE = (1.95 / 7.95 - 1.95 / 12.05) / (HIGH - LOW)  # of it in which the line takes 10.0 s, to its decimals, within 2 s


WORDS = ("multiverse", "tiny", "n=128", "decide=0", "search=32", "workers=1", "--config-dir", "conf", "out=there")


def fill(folder: Path) -> None:
    for name, text in (("world/line.yaml", WORLD), ("study/tiny.yaml", STUDY.lstrip())):
        file = folder / "conf" / name
        file.parent.mkdir(parents=True, exist_ok=True)
        file.write_text(text)


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A user's folder with the study."""
    fill(tmp_path)
    monkeypatch.chdir(tmp_path)
    return tmp_path


@pytest.fixture(scope="module")
def ended(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder where ``WORDS`` have been called."""
    folder = tmp_path_factory.mktemp("ended")
    fill(folder)
    done = in_a_process(folder, *WORDS)
    assert done.code == 0, done.err
    return folder


@pytest.fixture
def there(ended: Path, folder: Path) -> Path:
    """What ``WORDS`` keep, in a folder of the test's own."""
    shutil.copytree(ended, folder, dirs_exist_ok=True)
    return folder / "there"


def test_a_claim_holds_in_the_share_of_the_range_in_which_it_does_and_its_factor_decides(
    command: Command, folder: Path
) -> None:
    done = command("multiverse", "tiny", "n=128", "decide=64", "search=32", "workers=1", "--config-dir", "conf")
    assert done.code == 0, done.err
    assert "results/tiny/multiverse/report.md" in done.out
    tables = folder / "results/tiny/multiverse/tables"
    shares: dict[Any, Any] = pd.read_csv(tables / "shares.csv").set_index("id").to_dict("index")
    time = shares["time"]
    assert time["share"] == pytest.approx(SHARE, abs=0.05)
    assert time["share_low"] <= SHARE <= time["share_high"]
    assert [one["verdict"] for one in shares.values()] == ["open", "robust", "robust", "out of reach"]
    assert time["decided"] == "go_to_goal.speed_mps"
    deciding: dict[Any, Any] = pd.read_csv(tables / "deciding.csv").set_index("id").loc["time"].to_dict()
    assert deciding["flips"] == pytest.approx(2.0 * SHARE * (1.0 - SHARE), abs=0.15)
    entropy = -SHARE * np.log2(SHARE) - (1.0 - SHARE) * np.log2(1.0 - SHARE)
    assert 0.75 * entropy < deciding["bits"] <= entropy + 0.05
    done = command("study", "tiny", "reconstruction=best", "workers=1", "--config-dir", "conf")
    assert done.code == 0, done.err
    best: dict[Any, Any] = pd.read_csv("results/tiny/best/claims.csv").set_index("id").to_dict("index")
    assert (best["time"]["verdict"], best["time"]["evidence"]) == ("not_testable", "fitted")
    assert 7.95 <= best["time"]["measured"] <= 12.05
    assert best["time-set"]["measured"] == pytest.approx(10.0, abs=0.05)
    prior = json.loads((folder / "results/tiny/multiverse/prior.json").read_text())
    assert prior["factors"][0]["name"] == "go_to_goal.speed_mps"
    assert prior["factors"][0]["of"] == {"build.speed_mps": {"range": [LOW, HIGH]}}
    report = (folder / "results/tiny/multiverse/report.md").read_text()
    assert "| fast | it takes a second | out of reach | – | no | 0.000 [0.000, 0.028] | 0 of 128 |" in report
    drawn = {file.stem for file in (tables.parent / "figures").iterdir()}
    assert drawn == {"shares", "curves", "specification", "numbers"}
    together: dict[Any, Any] = pd.read_csv(tables / "together.csv").set_index("id").to_dict("index")
    at_best: dict[Any, Any] = pd.read_csv(tables / "factors.csv").set_index("factor")["at_best"].to_dict()
    speed = at_best["go_to_goal.speed_mps"]
    assert f" To meet most it takes `go_to_goal.speed_mps` {speed}" in report
    assert together["time"]["value"] == pytest.approx(1.95 / float(speed), rel=0.02)
    assert np.isnan(together["time"]["admissible"])  # fewer than 200 are admissible
    assert pd.notna([*at_best.values()]).all()
    held, least, most, worth = re.findall(
        r"(\d) of 3 printed numbers hold at once; of 20 placebo tables, with .*?, (\d) to (\d): (.*?)\.", report
    )[0]
    assert 0 <= int(least) <= int(most) <= 3
    assert worth.endswith("fit the paper better than chance" if most < held else "hardly better than chance")


def test_another_prior_stands_beside_the_study_s_own(command: Command, there: Path) -> None:
    few = ("n=128", "decide=0", "search=0", "workers=0", "--config-dir", "conf")
    results = there.parent / "results/tiny/multiverse"
    for prior in ("narrow", "same"):
        assert command("multiverse", "tiny", f"prior={prior}", *few).code == 0
        table = pd.read_csv(results / prior / "tables/shares.csv").set_index("id")
        assert table["share"]["time"] == (1.0 if prior == "narrow" else pytest.approx(SHARE, abs=0.05))
    said = (results / "narrow/report.md").read_text()
    assert "`navbench multiverse tiny prior=narrow` draws" in said
    assert command(*WORDS, "workers=0").code == 0  # nothing to run; the report is written again
    beside = pd.read_csv(results / "tables/priors.csv").set_index("id").loc["time"]
    assert (beside["verdict"], beside["narrow_verdict"], beside["narrow_share"]) == ("open", "robust", 1.0)
    assert beside["same_share"] == pytest.approx(beside["share"], abs=0.1)
    places = "results/tiny/multiverse", "results/tiny/multiverse/narrow"
    assert command("verify", *places).out.splitlines() == [
        f"{place}: all well: 128 reconstructions" for place in places
    ]
    published = results / "reconstructions.parquet"
    published.write_bytes(published.read_bytes()[:-1] + b"\0")
    assert command("verify", places[0]).out == f"{places[0]}: reconstructions.parquet: damaged\n"
    published.unlink()
    done = command("verify", places[0])
    said = f"{places[0]}: reconstructions.parquet: missing, and there is no block either\n"
    assert (done.code, done.out) == (3, said)


def test_what_a_cell_sets_itself_stays_and_what_it_does_not_moves(folder: Path) -> None:
    of = reconstructions_of("tiny", folder, "conf")
    names = [entry.name for entry in of.claims]
    ends = [of.tell(np.full(len(of.names), u)) for u in (0.0, 1.0)]
    times = [told.values[names.index("time")] for told in ends]
    assert times == pytest.approx([1.95 / LOW, 1.95 / HIGH], rel=5e-3)  # and what it takes to reach its speed
    assert [told.codes[names.index("time-set")] for told in ends] == [HOLDS, HOLDS]
    assert [told.codes[names.index("time")] for told in ends] == [FAILS, FAILS]


def test_what_a_cell_sets_only_to_name_a_reading_moves_all_the_same(folder: Path) -> None:
    file = folder / "conf/study/tiny.yaml"
    before = reconstructions_of("tiny", folder, "conf")
    file.write_text(file.read_text().replace("  implied:", "  free: {go_to_goal.speed_mps: [rule]}\n  implied:"))
    of = reconstructions_of("tiny", folder, "conf")
    k = [entry.name for entry in of.claims].index("time-set")
    times = [of.tell(np.full(len(of.names), u)).values[k] for u in (0.0, 1.0)]
    assert times == pytest.approx([1.95 / LOW, 1.95 / HIGH], rel=5e-3)
    other = next(name for name in of.names if name != "go_to_goal.speed_mps")
    file.write_text(file.read_text().replace("priors: {", f"priors: {{other: {{{other}: null}}, "))
    assert reconstructions_of("tiny", folder, "conf", prior="other").names == [other]  # which need not name it
    (own, fast) = (one.names.index("go_to_goal.speed_mps") for one in (before, of))
    assert (own in before.reaches["time-set"], fast in of.reaches["time-set"]) == (False, True)


@pytest.mark.parametrize(
    ("free", "said"),
    [
        ("go_to_goal.speed_mph: [rule]", "free.go_to_goal.speed_mph: no such factor; did you mean"),
        (
            "go_to_goal.speed_mps: [rules]",
            "free.go_to_goal.speed_mps=rules: no cell has this label; did you mean rule?",
        ),
    ],
)
def test_what_is_to_move_all_the_same_is_a_factor_of_cells_that_there_are(
    command: Command, folder: Path, free: str, said: str
) -> None:
    file = folder / "conf/study/tiny.yaml"
    file.write_text(file.read_text().replace("  implied:", f"  free: {{{free}}}\n  implied:"))
    done = command(*WORDS)
    assert (done.code, done.err.count("\n")) == (2, 1)
    assert f"study/tiny.multiverse.{said}" in done.err


TUNED = """
# @package _global_
title: "bounded: a tuned PID"
summary: A PID drives a straight line.
tunings:
  - {name: few, overrides: [controller=pid, simulator=planar, tuner=random, objective=ise, world=line, budget=10]}
cells:
  - {name: line, label: tuned, tuning: few, overrides: [controller=pid, world=line, simulator=planar]}
  - {name: line, label: untuned, overrides: [controller=pid, world=line, simulator=planar]}
claims:
  tuned: {says: it arrives, holds: in 95 % of the cases, measure: share_reached, of: {cell: line, label: tuned}}
  untuned: {says: it arrives, holds: in 95 % of the cases, measure: share_reached, of: {cell: line, label: untuned}}
multiverse:
  admissible: {there: {says: it arrives, holds: in 80 % of the cases, measure: share_reached, of: {cell: line}}}
report: [{name: verdicts, title: Claims, groups: {}}]
"""


def test_a_tuned_cell_takes_what_lies_at_the_same_place_between_the_bounds_that_are_drawn(
    command: Command, folder: Path
) -> None:
    (folder / "conf/study/bounded.yaml").write_text(TUNED.lstrip())
    assert command("study", "bounded", "workers=1", "--config-dir", "conf").code == 0
    of = reconstructions_of("bounded", folder / "outputs/study/bounded", "conf")
    tuned, untuned = ({of.names[i] for i in of.reaches[name]} for name in ("tuned", "untuned"))
    assert tuned ^ untuned == {"pid.tunable.kp.high", "pid.kp", "pid.ki", "pid.kd"}
    assert "pid.tunable.kp.high" in tuned
    (one,) = (drawn for drawn in of.cells if drawn.cell.tuning)
    (gains,) = one.gains.values()
    assert 0.0 <= gains["kp"] <= 10.0
    moved = between(gains, one.searched, {"kp": {"high": 2.0}})
    assert moved == {**gains, "kp": pytest.approx(0.2 * gains["kp"], rel=1e-12)}
    assert between(gains, one.searched, {}) == gains
    bound = of.names.index("pid.tunable.kp.high")
    assert of.factors[bound].bounds == (1.0, 20.0)
    point = {of.names[bound]: 0.0}
    best = folder / "best.json"
    best.write_text(json.dumps({"point": point, "claims": []}))
    (tuning,) = fitted(compose_study("bounded", "conf"), best, "conf").tunings
    assert tuning.configuration["tunable"]["kp"] == {"low": 0.0, "high": 1.0, "scale": "linear"}
    (side,) = (side for side in tuning.dimensions if side.name == "kp")
    assert isinstance(side, Dimension)
    assert (side.high, side.start) == (1.0, 1.0)  # it starts at 5 where the bound allows it


def test_the_study_s_own_reconstruction_says_what_the_study_does(command: Command, folder: Path) -> None:
    assert command("study", "tiny", "workers=1", "--config-dir", "conf").code == 0
    stored: dict[Any, Any] = pd.read_csv("results/tiny/claims.csv").set_index("id")["measured"].to_dict()
    of = reconstructions_of("tiny", folder, "conf")
    told = dict(zip((entry.name for entry in of.claims), of.tell(None).values.tolist(), strict=True))
    assert {name: told[name] for name in stored} == pytest.approx(stored, rel=1e-12)
    assert of.unmeasured() == {}
    tables = folder / "results/tiny/multiverse/tables"
    tables.mkdir(parents=True)
    (tables / "shares.csv").write_text("id,verdict,share\ntime,open,0.4\narrives,robust,1.0\n")
    assert command("report", "join=results").code == 0
    joined = (folder / "results/README.md").read_text()
    assert "| tiny | – | – | none printed | 1 | 1 | 0 | 0 | 0 | – |" in joined
    assert (folder / "results/figures/shares.png").is_file()


def test_a_study_in_another_simulator_stands_beside_it(command: Command, folder: Path) -> None:
    done = command("study", "tiny", "simulator=pybullett", "--config-dir", "conf")
    assert (done.code, done.err.count("\n")) == (2, 1)
    assert "simulator=pybullett: did you mean pybullet?" in done.err
    assert command("study", "tiny", "simulator=pybullet", "workers=0", "--config-dir", "conf").code == 0
    told: dict[Any, Any] = pd.read_csv("results/tiny/pybullet/claims.csv").set_index("id").to_dict("index")
    assert {one["simulator"] for one in told.values()} == {"pybullet"}
    assert told["time-set"]["measured"] == pytest.approx(10.0, abs=0.02)
    assert "# tiny: a straight line, every cell in pybullet" in Path("results/tiny/pybullet/report.md").read_text()


def test_a_controller_that_ends_its_process_is_named(folder: Path) -> None:
    (folder / "ends.py").write_text(
        "import os\nclass Ends:\n    def reset(self, *_): pass\n    def act(self, o): os._exit(0)\n"
    )
    (folder / "conf/controller").mkdir()
    (folder / "conf/controller/ends.yaml").write_text("# Ends\nbuild: {_target_: ends.Ends}\n")
    text = STUDY.replace("[controller=go_to_goal, world=line, simulator=planar]", "[controller=ends, world=line]")
    (folder / "conf/study/tiny.yaml").write_text(text.lstrip())
    done = in_a_process(folder, *WORDS)
    assert done.code == 2
    assert done.err.endswith("navbench: its process ended with exit code 0, at its work on a reconstruction of tiny\n")


def test_moving_one_factor_alone_tells_what_running_all_again_does(folder: Path) -> None:
    of = reconstructions_of("tiny", folder, "conf")
    claims = [entry.name for entry in of.claims]
    for to in (0.9, 0.31):  # elsewhere, and hardly: choices stay what they are
        u, others = np.full(len(of.names), 0.3), np.full(len(of.names), to)
        for moved, told in of.tell_changed(u, others, claims):
            there = u.copy()
            if moved >= 0:
                there[moved] = others[moved]
            again = of.tell(there)
            assert told.codes.tolist() == again.codes.tolist()
            np.testing.assert_array_equal(told.values, again.values)
            np.testing.assert_array_equal(told.counts, again.counts)


def test_of_few_claims_only_what_they_hang_on_is_moved_and_run(folder: Path) -> None:
    of = reconstructions_of("tiny", folder, "conf")
    u, others = np.full(len(of.names), 0.3), np.full(len(of.names), 0.9)
    of_all = dict(of.tell_changed(u, others, [entry.name for entry in of.claims]))
    for k, entry in enumerate(of.claims):
        alone = dict(of.tell_changed(u, others, [entry.name]))
        assert list(alone) == [-1, *of.reaches[entry.name]]
        assert [told.codes[k] for told in alone.values()] == [of_all[i].codes[k] for i in alone]
        assert all(alone[i].episodes <= of_all[i].episodes for i in alone)


def test_a_block_that_was_asked_less_is_made_anew_and_one_that_was_asked_more_is_kept(
    command: Command, there: Path
) -> None:
    of, samples = reconstructions_of("tiny", there.parent, "conf"), Samples(there)
    more = Block(of, MOVED, 0, 3, 0, 1, ("time", "time-set"))
    samples.write(more.name, run_block(more))
    less = Block(of, MOVED, 0, 4, 0, 1, ("time-set",))
    samples.write(less.name, run_block(less))
    assert samples.has(more.name, ["time"])
    assert not samples.has(less.name, ["time"])
    assert list(samples.read(MOVED, ["time"])["scramble"].unique()) == [3]
    kept = (there / f"{more.name}.parquet").read_bytes()
    assert command(*WORDS, "decide=16").code == 0
    assert (there / f"{more.name}.parquet").read_bytes() == kept
    assert samples.has(less.name, ["time"])
    assert not samples.has(less.name, ["time-set"])
    assert sorted(samples.read(MOVED, ["time"])["scramble"].unique()) == list(range(16))


def test_a_sample_that_remembers_where_rows_lay_answers_as_one_that_does_not(folder: Path) -> None:
    of = reconstructions_of("tiny", folder, "conf")
    cells = [drawn.cell for drawn in of.cells]
    there: Places = {}
    for counts in ((2, 2), (2, 2), (3, 1)):  # a shape twice, and another
        ran = []
        for cell, count in zip(cells, counts, strict=True):
            with cell.runner() as runner:
                ran.append((cell, cell.key(), [(k, record) for k in range(count) for record in runner.run(k)]))
        remembers, forgets = Sample(of.study, ran, there), Sample(of.study, ran)
        ours, theirs = {"name": "line"}, {"name": "set"}
        for answer, wanted in (
            (remembers.select(episode=[0, 2]), forgets.select(episode=[0, 2])),
            (remembers.cases(**theirs), StoredResults.cases(forgets, **theirs)),
            (remembers.pairs(ours, theirs), StoredResults.pairs(forgets, ours, theirs)),
            (remembers.select(outcome="reached"), forgets.select(outcome="reached")),
        ):
            pd.testing.assert_frame_equal(answer.reset_index(drop=True), wanted.reset_index(drop=True))
        assert len(remembers.pairs(ours, theirs)) == min(counts)
    assert len(there) == 2


def test_a_search_finds_what_the_sample_misses_and_goes_on_where_it_was_stopped(folder: Path) -> None:
    file = folder / "conf/study/tiny.yaml"
    file.write_text(file.read_text().replace("printed: 1.0 s, within: 0.1 s", "printed: 11.11 s, within: 0.02 s"))
    of, samples = reconstructions_of("tiny", folder, "conf"), Samples(folder / "there")
    rows = pd.DataFrame(run_block(Block(of, DRAWN, 0, 0, 0, 40, tuple(entry.name for entry in of.claims))))
    drawn = Drawn(rows, places(0, len(of.names), rows), of.names, of.reaches, pd.DataFrame())
    told: list[int] = []

    def best() -> tuple[Target, Met, dict[str, bytes]]:
        searches = Searches(
            of, drawn, samples, seed=0, evaluations=320, workers=1, told=lambda _, done, of: told.append(done)
        )
        (target,) = (one for one in targets(searches.claims) if one.name == "without time")
        assert searches.free == of.reaches["fast"]
        return target, searches.meet(target), {file.name: file.read_bytes() for file in samples.path.glob("*.parquet")}

    target, met, parts = best()
    assert target.cost(values_in(drawn, target)).min() >= 1.0
    assert target.cost(met.values[None])[0] < 1.0
    assert of.tell(met.u).values[-1] == pytest.approx(11.11, abs=0.025)
    assert (len(parts), told[-1]) == (10, 320)
    begun = samples.part(min(parts).removesuffix(".parquet"))
    order = np.argsort(target.cost(values_in(drawn, target)), kind="stable")[:POPULATION]  # it begins with the best
    np.testing.assert_allclose(begun.filter(regex="^u:").to_numpy(), drawn.u[order], rtol=0.0, atol=1e-12)
    (samples.path / sorted(parts)[4]).unlink()
    assert best()[2] == parts


def test_a_search_for_other_numbers_is_made_anew(command: Command, there: Path, folder: Path) -> None:
    file, best = folder / "conf/study/tiny.yaml", folder / "results/tiny/multiverse/best.json"
    whole = file.read_text()
    for together, claims in (("  together: [time]\n", ["time"]), ("", ["time", "time-set", "fast"])):
        file.write_text(whole.replace("  implied:", f"{together}  implied:"))
        done = command(*WORDS)
        assert done.code == 0, done.err
        assert json.loads(best.read_text())["claims"] == claims
        told: dict[Any, Any] = pd.read_csv(best.parent / "tables/together.csv").set_index("id").to_dict("index")
        assert [*told] == ["time", "time-set", "fast"]
        assert [name for name, row in told.items() if pd.notna(row["predicts"])] == claims
        assert (told["time-set"]["value"], told["time-set"]["holds"]) == (pytest.approx(10.0, abs=0.05), "yes")


def test_going_on_with_more_and_with_other_workers_leaves_the_same_bytes(command: Command, folder: Path) -> None:
    words = ("multiverse", "tiny", "--config-dir", "conf")
    assert command(*words, "n=256", "decide=0", "search=0", "workers=1", "out=once").code == 0
    assert command(*words, "n=128", "decide=0", "search=0", "workers=2", "out=again").code == 0
    (folder / "again/drawn-03-000000-008.parquet").unlink()
    for name in ("", "seconds"):  # as a process that was killed leaves them
        (folder / "again" / name / ".drawn-03-000000-016.parquet.7.tmp").write_bytes(b"PAR1 and then")
    assert command(*words, "n=256", "decide=0", "search=0", "workers=1", "out=again").code == 0
    once, again = (sorted((folder / name).rglob("*")) for name in ("once", "again"))
    assert [file.name for file in once] == [file.name for file in again]
    once, again = (sorted((folder / name).glob("*.parquet")) for name in ("once", "again"))
    assert len(once) == 32
    assert [(file.name, file.read_bytes()) for file in once] == [(file.name, file.read_bytes()) for file in again]


def test_a_damaged_block_is_found_named_and_made_anew_and_nobody_else_writes_meanwhile(
    command: Command, there: Path
) -> None:
    assert command("verify", "there").out == "there: all well: 128 reconstructions\n"
    names = "drawn-03-000000-008", "searched-01-000", "seconds/drawn-05-000000-008"
    before = {there / f"{name}.parquet": (there / f"{name}.parquet").read_bytes() for name in names}
    damaged = {file: whole[:200] + bytes([whole[200] ^ 1]) + whole[201:] for file, whole in before.items()}
    for file, name in zip(before, names, strict=True):
        file.write_bytes(damaged[file])
        done = command("verify", "there")
        assert (done.code, done.out) == (3, f"there: {name}.parquet: damaged\n")
        file.write_bytes(before[file])
    for file in before:
        file.write_bytes(damaged[file])
    done = command(*WORDS)
    assert done.code == 0
    for file, whole in before.items():
        assert f"{file.name}: damaged, and made anew" in done.err
        assert file.parent.name == "seconds" or file.read_bytes() == whole
    assert command("verify", "there").code == 0
    with locked(there):
        done = command(*WORDS)
    assert done.code == 2
    assert "there: a run goes on here: process " in done.err


def test_blocks_without_seconds_or_seal_or_of_another_seed_are_named_and_made_anew(
    command: Command, there: Path
) -> None:
    block, seconds = there / "drawn-03-000000-008.parquet", there / "seconds/drawn-05-000000-008.parquet"
    whole = block.read_bytes()
    seconds.unlink()
    table = pq.read_table(block)
    pq.write_table(table.replace_schema_metadata(), block)
    said = [
        f"there: {name}: damaged" for name in ("drawn-03-000000-008.parquet", "seconds/drawn-05-000000-008.parquet")
    ]
    assert command("verify", "there").out.splitlines() == said
    assert command(*WORDS).code == 0
    assert (block.read_bytes(), command("verify", "there").code) == (whole, 0)
    parts.write(there, block.name, table, {"prior": "another"})
    assert command("verify", "there").out == f"there: {block.name}: of another prior\n"
    assert command(*WORDS).code == 0
    assert block.read_bytes() == whole
    (there / "prior.json").write_text(json.dumps(Samples(there).prior()))
    assert command("verify", "there").out.splitlines()[0] == "there: prior.json: no checksum"


def test_another_prior_is_refused_and_what_is_there_stays(command: Command, there: Path) -> None:
    before = sorted(there.glob("*.parquet"))
    done = command(*WORDS, "seed=1")
    assert done.code == 2
    assert "was begun with other seed" in done.err
    assert sorted(there.glob("*.parquet")) == before


def test_a_damaged_prior_is_found_and_named_and_what_is_there_stays(command: Command, there: Path) -> None:
    assert command("verify", str(there)).code == 0
    prior, kept = there / "prior.json", sorted(there.glob("*.parquet"))
    for text in ("", "[]", "[" * 100000, prior.read_text().replace("0.1", "0.2", 1)):
        prior.write_text(text)
        done = command(*WORDS)
        assert (done.code, done.err.count("\n")) == (2, 1)
        assert "prior.json: damaged" in done.err
        assert sorted(there.glob("*.parquet")) == kept
        done = command("verify", str(there))
        assert (done.code, done.out) == (3, f"{there}: prior.json: damaged\n")


def test_what_the_machine_ends_is_kept_and_told_with_exit_3(
    command: Command, folder: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def full(self: Samples, name: str, columns: Any) -> None:
        raise OSError(28, "No space left on device", name)

    monkeypatch.setattr(Samples, "write", full)
    words = ("multiverse", "tiny", "n=128", "decide=0", "search=0", "workers=0", "--config-dir", "conf")
    done = command(*words)
    assert done.code == 3
    assert "No space left on device: after 0 of 128 reconstructions; they are kept in " in done.err
    assert ", and this goes on from there: navbench multiverse " in done.err


WRONG = [
    (("multiverse",), "multiverse: name one study; there are: "),
    (("multiverse", "tiney"), "did you mean tiny?"),
    (("multiverse", "tiny", "n=100"), "n=100: must be a multiple of 128"),
    (("multiverse", "tiny", "n=-16"), "n=-16: must be a whole number from 0 to 1048576"),
    (("multiverse", "tiny", f"n={2**70}"), "must be a whole number from 0 to 1048576"),
    (("multiverse", "tiny", "n=١٢٨"), "must be a whole number from 0 to 1048576"),
    (("multiverse", "tiny", f"seed={2**63}"), "must be a whole number from 0 to 9223372036854775807"),
    (("multiverse", "tiny", "m=16"), "m=16: unknown key; "),
    (("multiverse", "tiny", "prior=narow"), "prior=narow: no such prior; did you mean narrow?"),
    (("multiverse", "smoke", "n=128"), "study/smoke.multiverse: missing; "),
]


@pytest.mark.parametrize(("words", "said"), WRONG, ids=[" ".join(words) for words, _ in WRONG])
def test_wrong_words_are_told_in_one_line(command: Command, folder: Path, words: tuple[str, ...], said: str) -> None:
    done = command(*words, "--config-dir", "conf")
    assert done.code == 2
    assert said in done.err
    assert done.err.count("\n") == 1
    assert not (folder / "outputs").exists()


def test_the_best_reconstruction_is_there_only_after_a_multiverse(command: Command, folder: Path) -> None:
    done = command("study", "tiny", "reconstruction=best", "--config-dir", "conf")
    assert (done.code, done.err.count("\n")) == (2, 1)
    assert "results/tiny/multiverse/best.json: missing; `navbench multiverse tiny` writes it" in done.err
    assert command("study", "tiny", "reconstruction=worst", "--config-dir", "conf").code == 2
    best = folder / "results/tiny/multiverse/best.json"
    best.parent.mkdir(parents=True)
    for text in ("[]", "{", '{"point": {"a": 5.0}, "claims": []}', '{"point": {}}', '{"point": {}, "claims": 3}'):
        best.write_text(text)
        done = command("study", "tiny", "reconstruction=best", "--config-dir", "conf")
        assert (done.code, done.err.count("\n")) == (2, 1), text
        assert "best.json: is not of this study; `navbench multiverse tiny` writes it" in done.err


@pytest.mark.parametrize(
    ("old", "new", "said"),
    [
        ("implied: [arrives]", "implied: [arrive]", "multiverse.implied=arrive: no such claim; did you mean arrives?"),
        (
            "{go_to_goal.speed_mps: null",
            "{go_to_goal.speed: null",
            "priors.same.go_to_goal.speed: no such factor; did you",
        ),
        ("[0.18, 0.21]", "[0.21, 0.18]", "narrow.go_to_goal.speed_mps: range=[0.21, 0.18]: the first must be below"),
        ("holds: in 80 % of the cases, ", "printed: 3 s, within: 1 s, ", "must have a measure, and hold in a share"),
    ],
)
def test_a_wrong_multiverse_of_a_study_is_told_before_anything_runs(
    command: Command, folder: Path, old: str, new: str, said: str
) -> None:
    file = folder / "conf/study/tiny.yaml"
    file.write_text(file.read_text().replace(old, new))
    done = command("multiverse", "tiny", "n=128", "--config-dir", "conf")
    assert (done.code, done.err.count("\n")) == (2, 1)
    assert said in done.err
