"""What is missing: undrawn layouts count in no figure, and reports say how much of a plan is there."""

from pathlib import Path

import pandas as pd
import pytest
from stored import CROSSING, a_cell, a_drive, a_record, store, told
from test_reports import STUDY

from navbench.analysis.comparisons import compare
from navbench.analysis.fleets import fleets
from navbench.analysis.measures import share_reached
from navbench.analysis.stored import StoredResults
from navbench.cli.tables import print_tables
from navbench.metrics import DECLARED
from navbench.records import RobotRecord
from navbench.report.reports import write_report
from navbench.report.tables import failures, summary
from navbench.report.trajectories import frames, time_series

UNDRAWN = RobotRecord.lost(0, "no_layout", "no room for the door", DECLARED)
SAID = "1 of 3 layouts could not be drawn, and count nowhere; the first of them in plain, episode 0: no room for the"


@pytest.fixture
def stored(tmp_path: Path) -> StoredResults:
    """Two controllers over three layouts, of which the first could not be drawn."""
    cells = [
        (a_cell("A"), [UNDRAWN, a_record(time_s=10.0), a_record("collided")]),
        (a_cell("B"), [UNDRAWN, a_record(time_s=9.0), a_record(time_s=8.0)]),
    ]
    return store(tmp_path / "in", cells, {**STUDY, "claims": {}, "report": ["failures"]})


def test_a_layout_that_could_not_be_drawn_is_no_failure_of_a_controller(stored: StoredResults) -> None:
    share = share_reached(stored, {"label": "A"})
    assert share is not None
    assert (share.value, share.n) == (0.5, 2)
    compared = compare(stored, {"world": "plain"}, "A", "B")
    assert compared is not None
    assert compared.reached[0::3] == (0.5, 2)
    assert compared.time_s.value == pytest.approx((10.0 + 60.0) / 2)
    assert compared.wins is not None
    assert compared.wins[:3] == (0, 2, 0)
    assert fleets(stored.select(label="A"))["success"].tolist() == [True, False]


def test_the_table_and_the_report_say_how_many_layouts_could_not_be_drawn(
    stored: StoredResults, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    text = told(summary, stored, tmp_path)
    assert SAID in text
    assert "| printed | A | ideal | 0 | 1 of 2 |" in text
    assert [row.split(":")[1].split()[0] for row in failures(stored.rows)] == ["collided"]
    print_tables(stored.results)
    printed = capsys.readouterr().out
    assert "1 of 2" in printed
    assert SAID in printed
    write_report([stored.results], tmp_path / "study")
    assert SAID in (tmp_path / "study/report.md").read_text().partition("## How it was made")[2]


def test_a_section_that_draws_one_episode_takes_the_first_that_was_driven(
    stored: StoredResults, tmp_path: Path
) -> None:
    told(time_series, stored, tmp_path, panels={"A": {"label": "A"}}, series={"v [m/s]": {"v_mps": "v"}})
    undrawn = [UNDRAWN, UNDRAWN._replace(robot_index=1)]
    fleet = [a_drive([1.0, 1.0], index=i, places=[(i, 0.0)] * 3) for i in range(2)]
    cell = a_cell("C", scene=CROSSING)
    told(frames, store(tmp_path / "fleet", [(cell, [undrawn, fleet])]), tmp_path, select={"label": "C"})
    assert (tmp_path / "figures/t.png").is_file()


def test_runs_of_which_no_layout_could_be_drawn_have_a_report_that_says_so(tmp_path: Path) -> None:
    runs = [store(tmp_path / label, [(a_cell(label, name="run"), [UNDRAWN])]).results for label in ("A", "B")]
    write_report(runs, tmp_path / "out")
    assert "1 of 1 layouts could not be drawn" in (tmp_path / "out/report.md").read_text()
    assert pd.read_csv(tmp_path / "out/tables/summary.csv")["no_layout"].tolist() == [1, 1]
    print_tables(runs[0])


def test_a_report_says_how_many_of_the_planned_episodes_are_there(tmp_path: Path) -> None:
    cell = a_cell("A")._replace(episodes=5)
    stored = store(tmp_path / "in", [(cell, [a_record(), a_record()])], {**STUDY, "claims": {}, "report": ["summary"]})
    write_report([stored.results], tmp_path / "out")
    before, _, after = (tmp_path / "out/report.md").read_text().partition("## How it was made")
    for part in (before, after):
        assert "2 of 5 planned episodes are there." in part
    assert "Measured: 2 episodes in 1 cells" in after


def test_an_impossible_task_is_no_failure_of_a_controller_and_is_counted_apart(tmp_path: Path) -> None:
    lost = RobotRecord.lost(0, "impossible", "goals[0]: nothing leads there", DECLARED)
    stored = store(tmp_path / "in", [(a_cell("A"), [lost, UNDRAWN, a_record(), a_record("collided")])], STUDY)
    share = share_reached(stored, {"label": "A"})
    assert share is not None
    assert (share.value, share.n) == (0.5, 2)
    said = "1 of 4 tasks are impossible, and count nowhere; the first of them in plain, episode 0: goals[0]: nothing"
    text = told(summary, stored, tmp_path)
    assert said in text
    assert "1 of 4 layouts could not be drawn" in text
    assert pd.read_csv(tmp_path / "tables/t.csv")[["no_layout", "impossible"]].to_numpy().tolist() == [[1, 1]]
