"""The picture of a results directory, whose rows of panels are drawn apart."""

from functools import partial
from pathlib import Path
from unittest.mock import Mock

import pytest
from matplotlib.collections import LineCollection
from matplotlib.image import imread
from stored import a_cell, a_record, store

from navbench.experiments.engines import in_processes
from navbench.report.figures import draw_cells, panel_of
from navbench.report.picture import save_trajectories


def test_a_picture_drawn_by_rows_is_to_the_last_bit_the_figure_drawn_whole(tmp_path: Path) -> None:
    records = [a_record("timed_out" if i % 10 == 3 else "reached") for i in range(20)]
    stored = store(tmp_path / "kept", [(a_cell(label), records[i:]) for i, label in enumerate("ABCDEFG")])
    runs = list(stored.cells["run_id"])
    assert len(set(runs)) == 7
    pictures = [tmp_path / "here.png", tmp_path / "in processes.png"]
    save_trajectories(stored.results, runs, pictures[0])
    save_trajectories(stored.results, runs, pictures[1], partial(in_processes, workers=2))
    panels = [panel_of(stored, run, stored.episodes[stored.episodes["run_id"] == run]) for run in runs]
    draw_cells(panels).savefig(tmp_path / "whole.png", dpi=110)
    assert (imread(pictures[0]) == imread(tmp_path / "whole.png")).all()
    assert pictures[0].read_bytes() == pictures[1].read_bytes()


def test_below_a_title_rows_are_whole(tmp_path: Path) -> None:
    stored = store(tmp_path / "kept", [(a_cell(label), [a_record("collided")]) for label in "ABCDEFG"])
    runs = list(stored.cells["run_id"])
    save_trajectories(stored.results, runs, tmp_path / "rows.png", title="seven cells")
    panels = [panel_of(stored, run, stored.episodes[stored.episodes["run_id"] == run]) for run in runs]
    draw_cells(panels, "seven cells").savefig(tmp_path / "whole.png", dpi=110)
    assert (imread(tmp_path / "rows.png") == imread(tmp_path / "whole.png")).all()


def test_an_empty_place_moves_no_panel(tmp_path: Path) -> None:
    stored = store(tmp_path / "kept", [(a_cell("A"), [a_record()])])
    panel = panel_of(stored, stored.cells["run_id"][0], stored.episodes)
    every = draw_cells([panel] * 5).axes
    (last,) = draw_cells([None, None, None, None, panel]).axes
    assert last.get_position().bounds == every[4].get_position().bounds


def test_an_episode_that_ended_after_the_table_was_read_is_left_out(tmp_path: Path) -> None:
    stored = store(tmp_path / "kept", [(a_cell("A"), [a_record(), a_record("collided")])])
    episodes = stored.episodes
    panel = panel_of(stored, stored.cells["run_id"][0], episodes[episodes["episode"] == 0])
    (ax,) = draw_cells([panel]).axes
    (paths,) = (one for one in ax.collections if isinstance(one, LineCollection))
    assert len(paths.get_segments()) == 1


def test_panels_that_differ_in_their_seed_alone_name_it(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    draw = Mock(wraps=draw_cells)
    monkeypatch.setattr("navbench.report.picture.draw_cells", draw)
    cells = [a_cell(label, seed=seed)._replace(seed=seed) for label, seed in (("A", 1), ("A", 2), ("B", 2))]
    stored = store(tmp_path / "kept", [(cell, [a_record()]) for cell in cells])
    save_trajectories(stored.results, list(stored.cells["run_id"]), tmp_path / "rows.png")
    titles = [panel[0]["label"] for panel in draw.call_args.args[0]]
    assert titles == ["A, seed 1", "A, seed 2", "B"]
