"""Whatever stands in a configuration, a manifest or a part is read or refused in one line: nothing else comes of it.

``NAVBENCH_FUZZ=5000 pytest tests/test_fuzz.py`` looks longer, ``--hypothesis-seed=N`` elsewhere.
"""

import copy
import gc
import json
import os
import shutil
import sys
import tempfile
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pyarrow as pa
import pytest
import yaml
from hypothesis import HealthCheck, Phase, given, settings
from hypothesis import strategies as st
from stored import THEIRS, a_cell, a_record, store

from navbench.analysis.stored import StoredResults
from navbench.cli import main as cli
from navbench.cli.catalogue import CONF
from navbench.cli.configuration import compose_cell
from navbench.cli.errors import CONFIGURATION_ERRORS, one_line
from navbench.experiments import parts
from navbench.experiments.store import Results
from navbench.validation import DescriptionError

CPU_S = 60.0  # that one example may take
EXAMPLES = int(os.environ.get("NAVBENCH_FUZZ", "25"))
fuzz = settings(
    max_examples=EXAMPLES,
    deadline=None,  # by the clock, which other processes hold up
    phases=[Phase.generate],
    suppress_health_check=list(HealthCheck),
    derandomize="NAVBENCH_FUZZ" not in os.environ,
    database=None,
)
HOSTILE = [
    "${oc.env:HOME}",
    "${",
    "???",
    "!!python/object:os.system",
    "1e400",
    "nan",
    "~",
    "[",
    "../x",
    "\x1b[2J",
    "é" * 9999,
]
VALUES = st.recursive(
    st.one_of(
        st.none(),
        st.booleans(),
        st.integers(-(2**70), 2**70),
        st.integers(-3, 30),
        st.floats(),
        st.text(max_size=12),
        st.sampled_from(HOSTILE),
    ),
    lambda inner: st.lists(inner, max_size=4) | st.dictionaries(st.text(max_size=8), inner, max_size=3),
    max_leaves=6,
)
GROUPS = {
    "world": "controller=go_to_goal",
    "robot": "world=deadlock",
    "sensors": "world=deadlock",
    "controller": "world=deadlock",
}


def places(tree: Any, path: tuple[Any, ...] = ()) -> Iterator[tuple[Any, ...]]:
    """Yield the way to each value of a tree of mappings and lists."""
    inner = tree.items() if isinstance(tree, dict) else enumerate(tree) if isinstance(tree, list) else ()
    for key, value in inner:
        yield (*path, key)
        yield from places(value, (*path, key))


def changed(tree: Any, data: st.DataObject) -> Any:
    """Return a tree with one to three values replaced, left out, added or doubled."""
    found = copy.deepcopy(tree)
    for _ in range(data.draw(st.integers(1, 3))):
        if not (ways := list(places(found))):
            break
        *way, last = data.draw(st.sampled_from(ways))
        inner = found
        for key in way:
            inner = inner[key]
        match data.draw(st.sampled_from(["replace", "leave out", "add", "double"])):
            case "replace":
                inner[last] = data.draw(VALUES)
            case "leave out":
                del inner[last]
            case "add" if isinstance(inner, dict):
                inner[data.draw(st.text(max_size=8))] = data.draw(VALUES)
            case _ if isinstance(inner, list):
                inner.extend(copy.deepcopy(inner))
    return found


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(gc, "freeze", lambda: None)  # what ends with a command's process would stay in this one
    return tmp_path


@fuzz
@given(st.data())
def test_a_configuration_describes_something_or_is_refused_in_one_line(data: st.DataObject) -> None:
    began_s = time.process_time()
    group = data.draw(st.sampled_from(list(GROUPS)))
    file = data.draw(st.sampled_from(sorted((CONF / group).glob("[!_]*.yaml"))))
    text = file.read_text(encoding="utf-8")
    head = "".join(line for line in text.splitlines(keepends=True) if line.startswith("# @"))
    tree = changed(yaml.safe_load(text), data)
    with tempfile.TemporaryDirectory() as folder:
        made = Path(folder, group, "fuzzed.yaml")
        made.parent.mkdir()
        made.write_text(head + yaml.safe_dump(tree, allow_unicode=True), encoding="utf-8")
        told: list[str] = []
        words = [f"{group}=fuzzed", GROUPS[group], "simulator=planar", "episodes=1"]
        try:
            with compose_cell(*words, config_dir=folder).runner() as runner:
                runner.draw(0)
        except (*CONFIGURATION_ERRORS, ValueError) as error:  # which the command line tells in one line
            told.append(one_line(error))
        assert all(map(str.strip, told))
    assert time.process_time() - began_s < CPU_S


@fuzz
@given(data=st.data())
def test_a_manifest_is_read_or_refused_in_one_line(
    data: st.DataObject, folder: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    began_s, theirs = time.process_time(), folder / "theirs"
    if not theirs.exists():
        store(theirs, [(a_cell(), [a_record(), a_record("collided")])], study=THEIRS)
        shutil.copy(theirs / "manifest.json", folder)
    manifest = changed(json.loads((folder / "manifest.json").read_text(encoding="utf-8")), data)
    (theirs / "manifest.json").write_text(json.dumps(manifest), encoding="utf-8")
    before = {path for path in folder.rglob("*") if "out" not in path.parts}
    for words in (["verify", "theirs"], ["report", "theirs", "out=out"]):
        sys.argv = ["navbench", *words]
        with pytest.raises(SystemExit) as end:
            cli.main()
        out, err = capfd.readouterr()
        assert end.value.code in (0, 2, 3), (out, err)
        assert end.value.code != 2 or len(err.splitlines()) == 1
        assert "\x1b" not in out + err
    shutil.rmtree(folder / "out", ignore_errors=True)
    assert {path for path in folder.rglob("*") if "out" not in path.parts} == before
    assert time.process_time() - began_s < CPU_S


@fuzz
@given(data=st.data())
def test_a_part_is_read_or_refused_in_one_line(data: st.DataObject, folder: Path) -> None:
    began_s, theirs = time.process_time(), folder / "theirs"
    if not theirs.exists():
        store(theirs, [(a_cell(), [a_record(), a_record("collided")])], study=THEIRS)
        shutil.copytree(theirs, folder / "whole")
    shutil.rmtree(theirs)
    shutil.copytree(folder / "whole", theirs)
    file = data.draw(st.sampled_from(sorted(theirs.rglob("*.parquet"))))
    name = str(file.relative_to(theirs))
    if data.draw(st.booleans()):  # bytes as an accident leaves them
        content = bytearray(file.read_bytes())
        for _ in range(data.draw(st.integers(1, 4))):
            content[data.draw(st.integers(0, len(content) - 1))] = data.draw(st.integers(0, 255))
        file.write_bytes(content[: data.draw(st.integers(0, len(content)))] if data.draw(st.booleans()) else content)
    else:  # a whole part of another content, as an attacker seals it
        rows = [changed(row, data) for row in parts.read(theirs, name).to_pylist()]
        try:
            parts.write(theirs, name, pa.Table.from_pylist(rows), {})
        except (pa.ArrowException, NotImplementedError, OverflowError, AttributeError, UnicodeError):
            return  # no table at all
    errors: list[str] = []
    try:
        stored = StoredResults(Results(theirs))
        for told in (stored.episodes, stored.missing, stored.labels, stored.planned):
            assert told is not None
        for run_id in stored.cells["run_id"]:
            assert stored.trajectories(run_id) is not None
            stored.world(run_id)
    except DescriptionError as error:
        errors.append(str(error))
    assert all(map(str.strip, errors))
    assert time.process_time() - began_s < CPU_S
