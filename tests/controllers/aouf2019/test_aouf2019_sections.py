"""The sections of aouf2019's report that draw its own figures, on a run in the planar simulator."""

from pathlib import Path

import pandas as pd
import pytest
from stored import a_cell, a_record, store, told

import navbench
from navbench.analysis.stored import StoredResults
from navbench.controllers.aouf2019.sections import abbreviations, vectors
from navbench.experiments.store import Results


def test_the_drawn_vectors_are_those_that_the_run_steered_by(tmp_path: Path) -> None:
    words = ("controller=sflc", "world=deadlock_long", "simulator=planar", "workers=1")
    navbench.run(*words, dir=tmp_path / "in")
    stored = StoredResults(Results(tmp_path / "in"))
    text = told(vectors, stored, tmp_path, select={}, approach_s=8.4, follow_s=10.6)
    table = pd.read_csv(tmp_path / "tables/t.csv")
    assert table["behavior"].tolist() == ["go to goal", "follow wall"]
    assert table["heading_error_deg"].tolist() == pytest.approx(table["traced_deg"].tolist(), abs=1e-9)
    assert (table["traced_deg"].abs() > 1.0).all()  # something is in reach
    drawn = (tmp_path / "figures/t.svg").read_text()
    for i in range(1, 10):
        assert f"Fig {i}: " in drawn
    assert "figures/t.png" in text


def test_vectors_are_drawn_of_a_run_that_does_other_things_at_these_instants(tmp_path: Path) -> None:
    for world, behaviors in (("deadlock_long", ["go to goal", "follow wall"]), ("empty", ["go to goal"])):
        there = tmp_path / world
        navbench.run("controller=sflc", f"world={world}", "simulator=planar", "workers=0", dir=there / "in")
        told(vectors, StoredResults(Results(there / "in")), there, select={}, approach_s=10.6, follow_s=8.4)
        table = pd.read_csv(there / "tables/t.csv")
        assert table["behavior"].tolist() == behaviors
        assert table["heading_error_deg"].tolist() == pytest.approx(table["traced_deg"].tolist(), abs=1e-9)


def test_table_1_names_what_the_paper_leaves_out_and_what_no_variable_has(tmp_path: Path) -> None:
    sets = {"variable": ["speed", "speed", "turn"], "term": ["S", "L", "S"], "x": [0.0, 1.0, 0.0], "degree": [1.0] * 3}
    reading = store(tmp_path / "in", [(a_cell("A"), [a_record()])], descriptions={"it-sets": sets})
    text = told(abbreviations, reading, tmp_path, table="it-sets", printed={"S": "Small", "NL": "Negative Large"})
    assert "| S | Small | speed, turn |" in text
    assert "| NL | Negative Large | – |" in text
    assert "| L | – | speed |" in text
