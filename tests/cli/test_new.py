"""Templates: each is written, runs with the command that is printed, and passes its own test."""

import re
from pathlib import Path

import pytest
import yaml
from commands import Command, typed

from navbench.cli import new as module
from navbench.cli.catalogue import CONF
from navbench.sources import check_sources

WRITTEN = {
    "controller": ["conf/controller/mine.yaml", "mine.py", "test_controller_mine.py"],
    "world": ["conf/world/mine.yaml", "test_world_mine.py"],
    "robot": ["conf/robot/mine.yaml", "test_robot_mine.py"],
    "sensors": ["conf/sensors/mine.yaml", "test_sensors_mine.py"],
    "study": ["conf/study/mine.yaml", "test_study_mine.py"],
}


def files_in(folder: Path) -> list[str]:
    return sorted(file.relative_to(folder).as_posix() for file in folder.rglob("*") if file.is_file())


MADE = [*((group, ()) for group in WRITTEN), ("controller", ("compiled=true",))]


@pytest.mark.parametrize(("group", "more"), MADE)
def test_a_template_runs_with_the_printed_command(
    group: str, more: tuple[str, ...], tmp_path: Path, command: Command
) -> None:
    done = command("new", group, "mine", *more)
    assert done.code == 0, done.err
    assert files_in(tmp_path) == sorted(WRITTEN[group])
    printed = dict(re.findall(r"^(\w+) it: +(.*)$", done.out, re.M))
    assert set(printed) == {"run", "test", *(["check"] if group == "controller" else [])}
    assert printed.pop("test") == f"python -m pytest test_{group}_mine.py"
    for line in printed.values():
        ran = typed(command, tmp_path, line)
        assert ran.code == 0, ran.out + ran.err
        assert "controller_error" not in ran.out
        assert "FAIL" not in ran.out


def test_every_template_passes_its_own_test(tmp_path: Path, command: Command) -> None:
    for group, more in MADE:
        assert command("new", group, "quick" if more else "mine", *more).code == 0
    tests = sorted(file.name for file in tmp_path.glob("test_*.py"))
    assert len(tests) == len(MADE)
    ran = typed(command, tmp_path, f"python -m pytest {' '.join(tests)}")
    assert ran.code == 0, ran.out + ran.err
    assert all(f"{name} ." in ran.out for name in tests), ran.out
    assert "skipped" not in ran.out


@pytest.mark.parametrize("group", [group for group in WRITTEN if group != "study"])
def test_every_value_of_a_template_has_its_source(group: str, tmp_path: Path, command: Command) -> None:
    assert command("new", group, "mine").code == 0
    values = yaml.safe_load((tmp_path / WRITTEN[group][0]).read_text())
    sources = values.pop("sources")
    check_sources(group, sources)
    leaves = [name for key in ("defaults", "tunable") if key in values for name in [values.pop(key)] if not name]
    leaves += [f"{key}.{leaf}" for key in ("build", "native") for leaf in values.pop(key, {}) if leaf != "_target_"]
    for leaf in [*leaves, *values]:
        assert any(leaf == key or key.startswith(f"{leaf}.") for key in sources), leaf


def test_all_templates_stand_side_by_side_in_any_folder(tmp_path: Path, command: Command) -> None:
    (tmp_path / "my own/conf").mkdir(parents=True)
    for group in WRITTEN:
        done = command("new", group, "left_hand2", "--config-dir", "my own/conf")
        assert done.code == 0, done.err
        assert "navbench --config-dir 'my own/conf' " in done.out
        assert '/ "my own/conf"' in (tmp_path / f"test_{group}_left_hand2.py").read_text()
    assert "class LeftHand2:" in (tmp_path / "left_hand2.py").read_text()
    assert "$" not in "".join((tmp_path / file).read_text() for file in files_in(tmp_path))
    done = command("list", "controller", "--config-dir", "my own/conf")
    assert "left_hand2" in done.out


@pytest.mark.parametrize("file", WRITTEN["controller"])
def test_what_is_there_is_not_overwritten_and_nothing_is_written_beside_it(
    file: str, tmp_path: Path, command: Command
) -> None:
    (tmp_path / file).parent.mkdir(parents=True, exist_ok=True)
    (tmp_path / file).write_text("mine\n")
    done = command("new", "controller", "mine")
    assert (done.code, done.err) == (2, f"navbench: {Path(file)}: is there already; choose another name\n")
    assert files_in(tmp_path) == [file]
    assert (tmp_path / file).read_text() == "mine\n"


def test_a_file_that_cannot_be_written_leaves_none_behind(tmp_path: Path, command: Command) -> None:
    (tmp_path / "mine.py").symlink_to(tmp_path / "nowhere" / "mine.py")
    done = command("new", "controller", "mine")
    assert (done.code, done.out) == (2, "")
    assert done.err.startswith("navbench: mine.py: ")
    assert files_in(tmp_path) == []


@pytest.mark.parametrize(
    ("words", "message"),
    [
        ((), "new: name a group and a name; there are: controller, world, robot, sensors, study"),
        (("controler", "mine"), "new controler mine: name a group and a name; did you mean controller?"),
        (("world",), "new world: name a group and a name; such as `navbench new world mine`"),
        (("world", "a", "b"), "new world a b: name a group and a name; "),
        (("world", "mine", "robot=disc4"), "robot=disc4: the only such word is compiled=true, of a controller\n"),
        (("world", "mine", "compiled=true"), "compiled=true: the only such word is compiled=true, of a controller\n"),
        (("controller", "mine", "compiled=1"), "compiled=1: the only such word is compiled=true, of a controller\n"),
        (("world", "3d"), "3d: must be a Python name of small letters, digits and _"),
        (("world", "../up"), "../up: must be a Python name"),
        (("world", "Ünder"), "Ünder: must be a Python name"),
        (("world", "_part"), "_part: must be a Python name"),
        (("controller", "class"), "class: must be a Python name"),
        (("world", "null"), "null: must be a Python name"),
        (("controller", "none"), "none: must be a Python name"),
        (("robot", "con"), "con: must be a Python name"),
        (("controller", "sflc"), "sflc: navbench has a controller of that name; choose another one"),
        (
            ("world", "corner", "--config-dir", str(CONF)),
            f"{CONF}/world/corner.yaml: is there already; choose another name",
        ),
        (("controller", "numpy"), "numpy: there is a Python module of that name; choose another one"),
        (("world", "mine", "--config-dir", "nowhere"), "--config-dir=nowhere: there is no such directory"),
        (("world", "mine", "--force"), "--force: unknown flag; allowed: --config-dir, --help"),
    ],
)
def test_what_cannot_be_named_is_refused_in_one_line(
    words: tuple[str, ...], message: str, tmp_path: Path, command: Command
) -> None:
    done = command("new", *words)
    assert done.code == 2
    assert done.err.startswith(f"navbench: {message}")
    assert done.err.count("\n") == 1
    assert files_in(tmp_path) == []


def test_help_names_every_group(command: Command) -> None:
    done = command("new", "--help")
    assert done.code == 0
    assert all(group in done.out for group in module.RUN)
