"""The cache of compiled functions: what it notices, where it lies, and what it survives.

Each process here compiles two small functions of a copy of the tree: ``turn`` of a controller calls ``wrap`` of another
file, and prints its value and how often its machine code came from the cache. They are forked from one that has
imported numba, and nothing of navbench: that takes ten times as long as all else that they do.
"""

import json
import os
import re
import shutil
import stat
import subprocess
import sys
import time
from collections.abc import Iterator
from itertools import count
from pathlib import Path
from typing import Any, NamedTuple

import pytest

import navbench.controllers
from navbench.compiled import ABOVE

PACKAGE = Path(navbench.__file__).parent
WRAP = "from navbench.compiled import compiled\n\n@compiled\ndef wrap(x):\n    return x + {}\n"
TURN = """
from navbench.compiled import compiled
from {} import wrap

@compiled
def turn(x):
    return 10.0 * wrap(x)
"""
CALL = "from {} import turn; print(turn(1.0), sum(getattr(turn, 'stats').cache_hits.values()))"
OURS = "navbench.controllers.paper.turning"


@pytest.fixture
def tree(tmp_path: Path) -> Path:
    """A working tree as an editable install has it: controllers behind a link."""
    tree = tmp_path / "tree"
    for name in ("navbench/mathematics", "controllers/paper"):
        (tree / name).mkdir(parents=True)
        (tree / name / "__init__.py").touch()
    for name in ("__init__.py", "compiled.py"):
        shutil.copy(PACKAGE / name, tree / "navbench")
    (tree / "controllers/__init__.py").touch()
    (tree / "navbench/controllers").symlink_to("../controllers")
    (tree / "navbench/mathematics/wrapping.py").write_text(WRAP.format(1.0))
    (tree / "controllers/paper/turning.py").write_text(TURN.format("navbench.mathematics.wrapping"))
    return tree


READY = """
import json, os, signal, sys, tempfile, traceback
import numba

numba.njit(lambda x: x + 1.0)(1.0)
signal.signal(signal.SIGCHLD, signal.SIG_IGN)
for line in sys.stdin:
    place, environment, program = json.loads(line)
    if os.fork():
        continue
    for descriptor, name in ((1, "out"), (2, "err")):
        os.dup2(os.open(f"{place}.{name}", os.O_WRONLY | os.O_CREAT), descriptor)
    os.environ.clear()
    os.environ.update(environment)
    os.chdir(os.path.dirname(place))
    sys.path[1:1], tempfile.tempdir = environment["PYTHONPATH"].split(":"), None
    try:
        exec(program, {})
    except BaseException:
        traceback.print_exc()
    sys.stdout.flush()
    open(f"{place}.done", "x").close()
    os._exit(0)
"""
NUMBERS = count()


class Process(NamedTuple):
    """A process that was started; beside this path lies what it says, and that it is done."""

    place: Path


@pytest.fixture(scope="module", autouse=True)
def ready() -> Iterator[None]:
    """Have a process that others are forked from."""
    global forking
    with subprocess.Popen([sys.executable, "-B", "-c", READY], stdin=subprocess.PIPE, text=True) as forking:
        yield


forking: "subprocess.Popen[str]"


def environment_of(tree: Path, settings: dict[str, str | None]) -> dict[str, str]:
    """Return what a process that sees the tree finds; a setting of None is no variable."""
    given = {"PYTHONPATH": f"{tree}:{tree.parent}", "NAVBENCH_CACHE_DIR": str(tree.parent / "cache")} | settings
    return {name: value for name, value in (dict(os.environ) | given).items() if value is not None}


def start(tree: Path, program: str = CALL.format(OURS), **settings: str | None) -> Process:
    """Start a process that sees the tree."""
    process = Process(tree.parent / f"process-{next(NUMBERS)}")
    assert forking.stdin
    print(json.dumps([str(process.place), environment_of(tree, settings), program]), file=forking.stdin, flush=True)
    return process


def said(process: Process) -> str:
    while not process.place.with_suffix(".done").exists():
        assert forking.poll() is None
        time.sleep(0.005)
    assert process.place.with_suffix(".err").read_text() == ""
    return process.place.with_suffix(".out").read_text().strip()


def kept(cache: Path) -> list[Path]:
    return sorted(path for path in cache.rglob("*") if path.is_file())


def test_a_second_process_takes_what_the_first_has_compiled_and_nothing_lies_beside_the_sources(tree: Path) -> None:
    before = kept(tree)
    assert [said(start(tree)), said(start(tree))] == ["20.0 0", "20.0 1"]
    assert kept(tree) == before
    assert len(kept(tree.parent / "cache" / "compiled")) == 2


def test_a_changed_function_of_another_file_is_compiled_into_all_that_call_it(tree: Path) -> None:
    assert said(start(tree)) == "20.0 0"
    (tree / "navbench/mathematics/wrapping.py").write_text(WRAP.format(2.0))
    assert said(start(tree)) == "30.0 0"
    (tree / "navbench/mathematics/wrapping.py").write_text(WRAP.format(1.0))
    assert said(start(tree)) == "20.0 1"


def test_what_is_kept_is_compiled_into_a_new_caller(tree: Path) -> None:
    said(start(tree))
    (caller,) = (path for path in kept(tree.parent / "cache") if path.name.startswith("turn-"))
    caller.unlink()
    again = "; from navbench.mathematics.wrapping import wrap; print(*wrap.stats.cache_hits.values())"
    assert said(start(tree, CALL.format(OURS) + again)) == "20.0 0\n1"
    assert said(start(tree)) == "20.0 1"


def test_a_users_function_notices_ours_and_the_files_beside_it(tree: Path) -> None:
    mine = tree.parent / "mine.py"
    mine.write_text(TURN.format("helper"))
    helper = "import navbench.mathematics.wrapping as ours\n" + WRAP.replace("x + {}", "ours.wrap(x) + {}")
    (tree.parent / "helper.py").write_text(helper.format(1.0))
    call = CALL.format("mine")
    assert [said(start(tree, call)), said(start(tree, call))] == ["30.0 0", "30.0 1"]
    (tree.parent / "helper.py").write_text(helper.format(2.0))
    assert said(start(tree, call)) == "40.0 0"
    (tree / "navbench/mathematics/wrapping.py").write_text(WRAP.format(2.0))
    assert said(start(tree, call)) == "50.0 0"


def test_a_source_that_changes_after_its_import_leaves_nothing_in_the_cache(tree: Path) -> None:
    edit = f"import pathlib; pathlib.Path({str(tree / 'navbench/mathematics/wrapping.py')!r}).write_text('')"
    assert said(start(tree, CALL.format(OURS).replace(";", f"; {edit};"))) == "20.0 0"
    assert kept(tree.parent / "cache") == []


def test_eight_processes_may_start_at_once(tree: Path) -> None:
    assert {said(process) for process in [start(tree) for _ in range(8)]} <= {"20.0 0", "20.0 1"}
    assert len(kept(tree.parent / "cache")) == 2
    assert said(start(tree)) == "20.0 1"


@pytest.mark.parametrize("length", [0, 100, -1])
def test_what_was_cut_off_is_compiled_and_kept_again(tree: Path, length: int) -> None:
    said(start(tree))
    for path in kept(tree.parent / "cache"):
        path.write_bytes(path.read_bytes()[:length])
    assert [said(start(tree)), said(start(tree))] == ["20.0 0", "20.0 1"]


@pytest.mark.parametrize("place", [0.0, 0.1, 0.5, 0.9])
def test_machine_code_of_which_a_bit_has_changed_is_never_run(tree: Path, place: float) -> None:
    said(start(tree))
    for path in kept(tree.parent / "cache"):
        code = bytearray(path.read_bytes())
        code[int(place * len(code))] ^= 1
        path.write_bytes(code)
    assert [said(start(tree)), said(start(tree))] == ["20.0 0", "20.0 1"]


def test_the_cache_lies_in_the_users_cache_directory(tree: Path) -> None:
    home = tree.parent / "home"
    home.mkdir()
    said(start(tree, NAVBENCH_CACHE_DIR=None, XDG_CACHE_HOME=str(home / "xdg")))
    assert len(kept(home / "xdg/navbench/compiled")) == 2


def test_without_a_home_the_cache_is_a_temporary_directory_that_only_this_user_may_write(tree: Path) -> None:
    nowhere = tree / "navbench/compiled.py/home"  # below a file, where not even root can make a folder
    settings: dict[str, Any] = {
        "NAVBENCH_CACHE_DIR": str(nowhere), "HOME": str(nowhere), "XDG_CACHE_HOME": None, "TMPDIR": str(tree.parent),
    }  # fmt: skip
    assert [said(start(tree, **settings)), said(start(tree, **settings))] == ["20.0 0", "20.0 1"]
    folder = tree.parent / f"navbench-{os.getuid()}"
    assert stat.S_IMODE(folder.stat().st_mode) == 0o700
    folder.chmod(0o777)  # as another user might have left it: what lies there is not trusted
    assert said(start(tree, **settings)) == "20.0 0"


def test_what_is_kept_where_nothing_can_be_written_is_used_all_the_same(tree: Path) -> None:
    said(start(tree))
    before = kept(tree.parent / "cache")
    assert said(start(tree, f"import os; os.access = lambda *_: False; {CALL.format(OURS)}")) == "20.0 1"
    assert kept(tree.parent / "cache") == before


def test_where_nothing_can_be_written_functions_are_compiled_without_a_cache(tree: Path) -> None:
    nowhere = str(tree / "navbench/compiled.py/home")
    program = f"import tempfile; tempfile.tempdir = {nowhere!r}; {CALL.format(OURS)}"
    settings: dict[str, Any] = {"NAVBENCH_CACHE_DIR": nowhere, "HOME": nowhere, "XDG_CACHE_HOME": None}
    assert [said(start(tree, program, **settings)) for _ in range(2)] == ["20.0 0", "20.0 0"]


@pytest.mark.parametrize(
    "failing",
    [
        "import os; os.replace = lambda *_: 1 / 0",
        "import pathlib; write = pathlib.Path.write_bytes; "
        "pathlib.Path.write_bytes = lambda path, content: (write(path, content[:9]), 1 / 0)",
        "import navbench.compiled; navbench.compiled._dumps = lambda _: 1 / 0",
    ],
    ids=["rename", "write", "pickle"],
)
def test_code_that_cannot_be_kept_is_run_all_the_same_and_leaves_no_file(tree: Path, failing: str) -> None:
    assert said(start(tree, f"{failing}; {CALL.format(OURS)}")) == "20.0 0"
    assert kept(tree.parent / "cache") == []


def test_only_the_last_used_states_of_the_sources_are_kept(tree: Path) -> None:
    folder = tree.parent / "cache/compiled"
    for number in range(45):
        (folder / f"old{number:02d}").mkdir(parents=True)
        os.utime(folder / f"old{number:02d}", (number, number))
    said(start(tree))
    left = sorted(path.name for path in folder.iterdir())
    assert len(left) == 40
    assert left[-39:] == [f"old{number:02d}" for number in range(6, 45)]


def test_python_can_step_through_a_function_that_is_not_compiled(tree: Path) -> None:
    program = f"from {OURS} import turn; print(turn(1.0), type(turn).__name__)"
    environment = environment_of(tree, {"NUMBA_DISABLE_JIT": "1"})
    command = [sys.executable, "-B", "-c", program]
    done = subprocess.run(command, env=environment, cwd=tree.parent, capture_output=True, text=True, check=True)
    assert (done.stdout, done.stderr) == ("20.0 function\n", "")
    assert kept(tree.parent / "cache") == []


def test_nothing_is_compiled_in_a_way_that_the_cache_does_not_watch() -> None:
    for root in (PACKAGE, Path(navbench.controllers.__path__[0])):
        for path in root.rglob("*.py"):
            text = path.read_text()
            above = path.relative_to(root).parts[0] in ABOVE
            assert path.name == "compiled.py" or "import numba" not in text, path
            named = re.findall(r"from navbench\.compiled import (.*)", text)
            assert not above or set(named) <= {"cache_folder", "COMPILES"}, path
