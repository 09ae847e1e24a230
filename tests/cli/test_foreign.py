"""Results, configurations and files that came from somebody else: they are data, and do nothing."""

import json
import math
import os
import re
import subprocess
import sys
from pathlib import Path
from typing import Any

import pyarrow as pa
import pyarrow.parquet as pq
import pytest
from commands import Command, in_a_process
from stored import THEIRS, a_cell, a_record, store

from benchmarks.kill import WORLD
from navbench.experiments import parts
from navbench.experiments.store import Results
from navbench.reading import check_name, flat, printable
from navbench.report import latex, markdown
from navbench.report.document import Block, Column, Document, Finding, Heading, Lines, Paragraph, Plot, Table
from navbench.validation import DescriptionError

ESC = "\x1b]0;owned\x07"
RUN = "controller=go_to_goal world=empty world.time_limit_s=0.5 simulator=planar episodes=2 workers=1".split()


@pytest.fixture
def theirs(tmp_path: Path) -> Path:
    """Results of a study, in the folder ``theirs`` of the working directory."""
    store(tmp_path / "theirs", [(a_cell(), [a_record(), a_record("collided")])], study=THEIRS)
    return tmp_path / "theirs"


def write(theirs: Path, *place: Any, value: Any) -> None:
    """Change a manifest in one place."""
    manifest = json.loads((theirs / "manifest.json").read_text())
    inner = manifest
    for key in place[:-1]:
        inner = inner[key]
    inner[place[-1]] = value
    (theirs / "manifest.json").write_text(json.dumps(manifest))


def files_in(folder: Path) -> set[str]:
    return {str(file.relative_to(folder)) for file in folder.rglob("*")}


# Where a report is written


@pytest.mark.parametrize(
    ("place", "value"),
    [
        (("study", "name"), "../outside"),
        (("study", "name"), "/tmp/outside"),
        (("study", "name"), ".."),
        (("study", "report", 1, "file"), "../../outside"),
        (("study", "report", 1, "file"), "/tmp/outside"),
        (("study", "report", 1, "file"), "..\\outside"),
        (("cells", 0, "run_id"), "../*"),
        (("cells", 0, "run_id"), "*"),
    ],
)
def test_a_name_that_leads_elsewhere_is_refused_in_one_line(
    theirs: Path, command: Command, tmp_path: Path, place: tuple[Any, ...], value: str
) -> None:
    write(theirs, *place, value=value)
    before = files_in(tmp_path)
    done = command("report", "theirs")
    assert (done.code, len(done.err.splitlines())) == (2, 1)
    assert f"{value!r}: must be a name of a file" in done.err
    assert files_in(tmp_path) == before


def test_a_name_that_a_section_makes_of_data_leads_nowhere_else(command: Command, tmp_path: Path) -> None:
    cells = [a_cell(label) for label in "AB"]
    cells = [cell._replace(names=cell.names._replace(world="/../../../../outside")) for cell in cells]
    study = {**THEIRS, "report": [{"name": "comparison", "file": "c"}]}
    store(tmp_path / "both", [(cell, [a_record()] * 3) for cell in cells], study=study)
    done = command("report", "both", "out=one/two")
    assert (done.code, len(done.err.splitlines())) == (2, 1)
    assert "must lie in" in done.err
    assert not [name for name in files_in(tmp_path) if "outside" in name]


def test_a_link_in_the_results_is_not_followed_to_write(command: Command, tmp_path: Path) -> None:
    assert command(*RUN, "hydra.run.dir=here").code == 0
    (tmp_path / "private").mkdir()
    (tmp_path / "here/report").symlink_to(tmp_path / "private")
    done = command("report", "here")
    assert (done.code, done.err) == (
        2,
        "navbench: here/report: is a link; name where the report is to go, as out=DIR\n",
    )
    assert not list((tmp_path / "private").iterdir())


# What is read


@pytest.mark.parametrize(
    ("place", "value", "said"),
    [
        (("cells",), 3, "cells: must be a valid"),
        (("cells", 0, "episodes"), 10**9, "cells[0].episodes: must be less than or equal to 1000000"),
        (("cells", 0, "label"), ["a"], "cells[0].label: must be a valid string"),
        (("cells", 0, "label"), "a" * 2000, "cells[0].label: String should have at most 1000 characters"),
        (("cells", 0, "configuration"), {}, "cells[0].configuration.controller: Field required"),
        (("cells", 0, "sources"), {"robot": {"radius_m": 3}}, "cells[0].sources.robot.radius_m: must be"),
        (("planned",), {}, "planned.episodes: Field required"),
        (("versions",), {"numpy": 1}, "versions.numpy: must be a valid string"),
        (("study", "report"), [3], "study.report[0]"),
        (("study", "claims"), {"a": 1}, "study.claims"),
        (("ended",), 3, "ended: must be a valid string"),
        (("metrics",), [{"name": "a"}], "metrics[0]"),
    ],
)
@pytest.mark.parametrize("verb", ["report", "verify"])
def test_a_manifest_of_another_form_is_refused_by_its_key(
    theirs: Path, command: Command, place: tuple[Any, ...], value: Any, said: str, verb: str
) -> None:
    write(theirs, *place, value=value)
    done = command(verb, "theirs")
    assert (done.code, done.out, len(done.err.splitlines())) == (2, "", 1)
    assert f"theirs/manifest.json: {said}" in done.err


@pytest.mark.parametrize("text", ["[" * 100_000, '{"schema_version": 1, "cells": ' + "[" * 5000, "\x00", "9" * 10_000])
def test_a_manifest_that_would_break_a_reader_is_refused(theirs: Path, command: Command, text: str) -> None:
    (theirs / "manifest.json").write_text(text)
    done = command("report", "theirs")
    assert (done.code, done.err) == (2, "navbench: theirs/manifest.json: is no manifest of navbench\n")


def test_a_manifest_that_is_too_long_is_not_read(theirs: Path, command: Command) -> None:
    with (theirs / "manifest.json").open("a") as file:
        file.truncate(2**30)  # a file with a hole, which takes no room
    done = command("report", "theirs")
    assert done.code == 2
    assert "theirs/manifest.json: holds 1073741824 bytes, and must hold at most" in done.err


@pytest.mark.parametrize("kind", ["manifest.json", "episodes/part-a-000000-000000.parquet", "layouts/part-b.parquet"])
@pytest.mark.parametrize("verb", ["report", "verify"])
def test_a_pipe_or_device_among_results_is_not_read(tmp_path: Path, theirs: Path, kind: str, verb: str) -> None:
    (theirs / kind).unlink(missing_ok=True)
    if "layouts" in kind:
        (theirs / kind).symlink_to("/dev/zero")
    else:
        os.mkfifo(theirs / kind)
    words = [sys.executable, "-m", "navbench", verb, "theirs"]
    done = subprocess.run(words, cwd=tmp_path, capture_output=True, text=True, check=False, timeout=60)
    assert done.returncode in (2, 3) or "layouts" in kind  # which this report does not read
    assert "Traceback" not in done.stderr


@pytest.mark.parametrize(
    ("column", "values", "said"),
    [
        ("time_s", None, "must have a column time_s of numbers"),
        ("episode", ["a", "b"], "must have a column episode of whole numbers"),
        ("outcome", [1, 2], "must have a column outcome of words"),
    ],
)
def test_a_table_of_another_form_is_refused(
    theirs: Path, command: Command, column: str, values: list[Any] | None, said: str
) -> None:
    (file,) = (theirs / "episodes").iterdir()
    table = pq.read_table(file)
    place = table.schema.names.index(column)
    table = table.remove_column(place)
    table = table if values is None else table.add_column(place, column, pa.array(values))
    parts.write(theirs, f"episodes/{file.name}", table, {})
    done = command("report", "theirs")
    assert (done.code, len(done.err.splitlines())) == (2, 1)
    assert f"theirs/episodes/{file.name}: {said}" in done.err


def test_rows_that_the_manifest_does_not_know_are_left_out(theirs: Path, command: Command) -> None:
    (file,) = (theirs / "episodes").iterdir()
    table = pq.read_table(file)
    other = table.set_column(0, "run_id", pa.array(["other"] * len(table)))
    parts.write(theirs, "episodes/part-other-000000-000001.parquet", other, {})
    assert command("report", "theirs", "out=out").code == 0


@pytest.mark.parametrize("change", ["another", "without"])
def test_a_manifest_that_was_changed_is_reported_as_that(theirs: Path, command: Command, change: str) -> None:
    manifest = json.loads((theirs / "manifest.json").read_text())
    if change == "without":
        del manifest["seal"]
    (theirs / "manifest.json").write_text(json.dumps(manifest))
    done = command("report", "theirs", "out=out")
    assert (done.code, done.err.count("\n")) == (3, 1)
    assert done.err.startswith("navbench: theirs: manifest.json: changed since it was written")


# What is imported


def test_what_lies_in_the_working_directory_is_not_imported_unless_it_is_named(
    tmp_path: Path, command: Command
) -> None:
    assert command(*RUN, "hydra.run.dir=here").code == 0
    for name in ("numexpr", "bottleneck", "hydra_plugins/evil", "hydra_plugins/__init__", "sitecustomize"):
        file = tmp_path / f"{name}.py"
        file.parent.mkdir(exist_ok=True)
        file.write_text(f"open({str(tmp_path / 'executed')!r}, 'a').write(__name__)\n")
    words = (["report", "here"], ["verify", "here"], [*RUN, "episodes=3", "hydra.run.dir=here"], ["list", "robot"])
    for verb in words:
        assert in_a_process(tmp_path, *verb).code == 0
    module = subprocess.run([sys.executable, "-m", "navbench", "report", "here"], cwd=tmp_path, check=True)
    assert module.returncode == 0
    assert not (tmp_path / "executed").exists()


def test_what_is_called_as_our_packages_are_is_not_imported_by_workers_either(tmp_path: Path) -> None:
    for name in ("numpy", "navbench", "socket", "signal"):
        (tmp_path / f"{name}.py").write_text(f"open({str(tmp_path / 'executed')!r}, 'a').write(__name__)\n")
    done = in_a_process(tmp_path, *RUN, "workers=1", "hydra.run.dir=here")
    assert (done.code, (tmp_path / "executed").exists()) == (0, False), done.err


def test_a_file_that_names_a_function_of_the_standard_library_runs_nothing(tmp_path: Path, command: Command) -> None:
    (tmp_path / "conf/world").mkdir(parents=True)
    evil = f"source: {{_target_: os.system, command: touch {tmp_path}/executed}}"
    (tmp_path / "conf/world/evil.yaml").write_text(f"{WORLD}{evil}\n")
    done = command("controller=go_to_goal", "world=evil", "simulator=planar", "--config-dir", "conf")
    assert (done.code, done.err.count("\n")) == (2, 1)
    assert "os.system" in done.err
    assert not (tmp_path / "executed").exists()


ABSURD: list[tuple[str, dict[str, Any]]] = [
    ("trajectories", {"t_s": 1e300}),
    ("trajectories", {"x_m": math.inf}),
    ("episodes", {"robot_index": 2**40}),
    ("episodes", {"outcome": "evil"}),
]


@pytest.mark.parametrize(("kind", "values"), ABSURD, ids=str)
def test_rows_that_no_robot_left_are_told_in_one_line(
    kind: str, values: dict[str, Any], tmp_path: Path, command: Command
) -> None:
    assert command(*RUN, "hydra.run.dir=here").code == 0
    for part in Results(tmp_path / "here").parts(kind):
        rows = parts.read(tmp_path / "here", f"{kind}/{part}").to_pylist()
        parts.write(tmp_path / "here", f"{kind}/{part}", pa.Table.from_pylist([row | values for row in rows]), {})
    for words in (("show", "here", "episode=0"), ("replay", "here", "episode=0", "--video", "out.gif")):
        done = command(*words)
        assert (done.code, done.err.count("\n")) == (2, 1), done.err
        assert done.err.startswith("navbench: here")
    assert not list(tmp_path.glob("*.gif"))


def test_a_sweep_reaches_ones_own_controller_also_when_its_processes_run_already(tmp_path: Path) -> None:
    (tmp_path / "conf/controller").mkdir(parents=True)
    (tmp_path / "conf/controller/mine.yaml").write_text("# Straight on\nbuild: {_target_: mine.Mine}\n")
    code = "class Mine:\n    def reset(self, setup, rng): pass\n    def act(self, seen): return 0.1, 0.0\n"
    (tmp_path / "mine.py").write_text(code)
    words = ("controller=go_to_goal,mine", "world=empty", "world.time_limit_s=0.5", "episodes=12", "workers=2")
    done = in_a_process(tmp_path, "-m", *words, "--config-dir", "conf", "hydra.sweep.dir=here")
    assert done.code == 0, done.err
    assert "controller_error" not in (tmp_path / "here/episodes.csv").read_text()


# What is shown


HOSTILE = [
    "<script>alert(1)</script>",
    "<img src=x onerror=alert(1)>",
    "[a](javascript:alert(1))",
    "[a](  JavaScript:alert(1))",
    "[a](java&#115;cript:alert(1))",
    "[a](<javascript:alert(1)>)",
    "[a](data:text/html;base64,x)",
    "<javascript:alert(1)>",
    "![a](https://example.org/seen.png)",
    "a\n\n# b\n\n<b>c",
    "a\n[a]: javascript:alert(1)",
    f"a{ESC}b",
    "a\u202eb",
    "a | b",
]


def rendered(text: str) -> str:
    table = Table("", [Column(text), Column("b")], [[text, text]])
    blocks: list[Block] = [Heading(text), Paragraph(text), Lines([text]), Finding(re.sub(r"[{}]", "", text), {}), table]
    return markdown.render(Document(text, [*blocks, Plot("a", text)], text))


@pytest.mark.parametrize("text", HOSTILE)
def test_markdown_shows_what_is_hostile_and_does_nothing(text: str) -> None:
    page = rendered(text)
    assert not re.search(r"<[a-zA-Z/!]", page)
    assert not re.search(r"\]\(\s*<?[a-z&#0-9;]*:(?!//)", page, re.I)
    assert not re.search(r"^[\s>*+-]*\[[^\]]*\]:", page, re.M)
    assert page.count("![") == 1  # the plot's own
    assert not re.search("[\x00-\x08\x0b-\x1f\x7f-\x9f\u202a-\u202e]", page)
    rows = [line for line in page.splitlines() if line.startswith("| ") and "---" not in line]
    assert len(rows) == 2
    assert {len(re.findall(r"(?<!\\)\|", row)) for row in rows} == {3}


def test_what_markdown_shows_of_harmless_words_is_as_it_stands() -> None:
    text = "**0.5** [0.3, 0.7] of `a < b`, [doi:10.1/x](https://doi.org/10.1/x), [Report](a/report.md), x_m: 3 < 4 > 2!"
    assert markdown.words(text) == text


@pytest.mark.parametrize("text", HOSTILE)
def test_latex_shows_what_is_hostile_on_one_line(text: str) -> None:
    table = latex.render(Table("", [Column("a"), Column("b")], [[text + r"\input{/etc/passwd}", "$x$ ^^41"]]))
    assert len(table.splitlines()) == 7
    assert r"\textbackslash{}input\{/etc/passwd\}" in table
    assert r"\$x\$ \textasciicircum{}\textasciicircum{}41" in table
    assert not re.search("[\x00-\x09\x0b-\x1f\x7f-\x9f\u202a-\u202e]", table)


def test_a_terminal_obeys_nothing_in_a_controllers_reason(command: Command, tmp_path: Path) -> None:
    (tmp_path / "mine.py").write_text(
        "class Mine:\n    def reset(self, setup, rng): pass\n"
        f"    def act(self, seen): raise ValueError({ESC!r} + chr(10) + 'and more')\n"
    )
    words = (*RUN, "controller.build._target_=mine.Mine", "~controller.build.speed_mps", "~controller.build.turn_per_s")
    done = command("controller=mine", *RUN[1:], *_config(tmp_path))
    assert "controller_error" in done.out, words
    assert "\x1b" not in done.out + done.err
    assert "\\x1b]0;owned\\x07" in done.out


def _config(folder: Path) -> tuple[str, ...]:
    (folder / "conf/controller").mkdir(parents=True)
    (folder / "conf/controller/mine.yaml").write_text("# Raises\nbuild: {_target_: mine.Mine}\n")
    return ("--config-dir", "conf")


def test_a_terminal_obeys_nothing_in_a_label_that_is_drawn(command: Command, tmp_path: Path) -> None:
    assert command(*RUN, "hydra.run.dir=here").code == 0
    write(tmp_path / "here", "cells", 0, "label", value=ESC)
    done = in_a_process(tmp_path, "show", "here", "out=drawn.png")
    assert (done.code, done.err) == (0, "")
    assert "\x1b" not in done.out
    assert (tmp_path / "drawn.png").is_file()


@pytest.mark.parametrize("name", ["\x1b[31m", "\u202ex", "\udcff"])
def test_a_terminal_obeys_nothing_in_the_name_of_a_directory(command: Command, tmp_path: Path, name: str) -> None:
    """Nor is a name of bytes that are no text an error, after all has run."""
    done = command(*RUN, f"hydra.run.dir='{name}'")
    assert done.code == 0, done.err
    assert f"results: {name.encode('unicode_escape').decode()}" in done.out
    done = command("report", name, "out=report")
    assert done.code == 0, done.err
    assert name not in command("verify", name).out


def test_an_output_without_the_characters_shows_escapes(tmp_path: Path) -> None:
    environment = {**os.environ, "PYTHONIOENCODING": "ascii"}
    done = subprocess.run(
        [sys.executable, "-m", "navbench", *RUN, "hydra.run.dir='ü'"],
        cwd=tmp_path,
        env=environment,
        capture_output=True,
        check=False,
    )
    assert done.returncode == 0, done.stderr
    assert b"results: \\xfc\n" in done.stdout


def test_words_are_printed_with_what_a_terminal_would_obey_as_escapes() -> None:
    assert printable("a\x1b[31m\tb\nc\ud800 – ≥ é") == "a\\x1b[31m\tb\nc\\ud800 – ≥ é"
    assert flat("a \r\n b\u2028c") == "a b c"


@pytest.mark.parametrize("name", ["..", "../a", "/a", "a/b", "a\\b", "~", ".a", "a\nb", "a:b", "*", "a" * 200, "a\x00"])
def test_a_name_of_a_file_is_no_path(name: str) -> None:
    with pytest.raises(DescriptionError, match="must be a name of a file"):
        check_name(name)


# Configurations


BOMB = "a: &a [1, 2, 3, 4, 5, 6, 7, 8, 9]\n" + "".join(
    f"{name}: &{name} [{', '.join([f'*{before}'] * 9)}]\n" for before, name in zip("abcdefgh", "bcdefghi", strict=True)
)


@pytest.mark.parametrize(
    ("text", "said"),
    [
        (BOMB, "must hold at most 1000000 values"),
        ("a: " + "[" * 200 + "]" * 200, "must be at most 100 mappings and lists deep"),
        ("a: " + "[" * 100_000, "must be at most 100 mappings and lists deep"),
        ("# " + "a" * 2**23, "holds 8388610 bytes, and must hold at most 4194304"),
    ],
)
def test_a_configuration_that_would_break_a_reader_is_refused(
    command: Command, tmp_path: Path, text: str, said: str
) -> None:
    (tmp_path / "conf/controller").mkdir(parents=True)
    (tmp_path / "conf/controller/mine.yaml").write_text(text)
    done = command("controller=mine", "--config-dir", "conf")
    assert (done.code, done.err) == (2, f"navbench: conf/controller/mine.yaml: {said}\n")


def test_a_pipe_among_configurations_is_refused(tmp_path: Path) -> None:
    (tmp_path / "conf/world").mkdir(parents=True)
    os.mkfifo(tmp_path / "conf/world/mine.yaml")
    words = [sys.executable, "-m", "navbench", "world=mine", "--config-dir", "conf"]
    done = subprocess.run(words, cwd=tmp_path, capture_output=True, text=True, check=False, timeout=60)
    assert done.returncode == 2
    assert done.stderr == "navbench: conf/world/mine.yaml: must be a file, and no directory, pipe or device\n"
