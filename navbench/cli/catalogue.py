"""What there is to choose from: each group's files with the first line of each."""

import glob
from collections.abc import Sequence
from pathlib import Path

import yaml

import navbench.conf
from navbench.cli.limits import check_directory, check_file
from navbench.importing import import_named
from navbench.reading import flat
from navbench.validation import DescriptionError

CONF = Path(navbench.conf.__file__).parent

GROUPS = ("controller", "world", "robot", "sensors", "simulator")  # of a run
LISTED = (*GROUPS, "engine", "tuner", "objective", "study")
METRIC = "metric"  # what is listed, too, and has no files


def groups_in(folders: Sequence[Path]) -> list[str]:
    """Return the groups that have a file in any of the folders, in the order of a run's words, and the metrics."""
    return [*(group for group in LISTED if any((folder / group).is_dir() for folder in folders)), METRIC]


def files_of(group: str, folders: Sequence[Path]) -> dict[str, str]:
    """Return the names in a group with their first comment line, sorted; one that begins with _ is a part of others."""
    files = {
        file.stem: file for folder in folders for file in sorted((folder / group).glob("*.yaml")) if file.is_file()
    }
    return {name: _title(files[name]) for name in sorted(files) if not name.startswith(("_", "."))}


def check_folder(folder: Path) -> None:
    """Check that a user's folder is there, that none of its files hides one of navbench's own, and all can be read.

    Raises:
        DescriptionError: there is no such directory, or a file in it has a name that is taken or cannot be read.
    """
    check_directory(f"--config-dir={folder}", folder)
    groups = sorted(path.name for path in CONF.iterdir() if path.is_dir())
    inner = [path.parent for path in sorted(folder.glob("*/controller")) + sorted(folder.glob("*/world"))]
    if inner and not any((folder / group).is_dir() for group in groups):
        raise DescriptionError(f"--config-dir={folder}: holds no {' or '.join(LISTED)}; did you mean {inner[0]}?")
    files = [*folder.glob("*.yaml"), *(file for group in groups for file in (folder / group).rglob("*.yaml"))]
    for file in sorted(file for file in files if not file.name.startswith(".")):  # those are other programs'
        place = file.relative_to(folder)
        if (CONF / place).exists() and not file.samefile(CONF / place):
            what = place.parts[0] if len(place.parts) > 1 else "file"
            raise DescriptionError(f"{file}: navbench has a {what} of that name; choose another one")
        check_file(file)
    if (folder / "schema").exists():
        raise DescriptionError(f"{folder / 'schema'}: the schemas are navbench's own; choose another name")


def elsewhere(group: str, name: str) -> str:
    """Return how to name a file that lies in a folder within the working directory; empty where there is none."""
    found = [file.parents[1] for file in sorted(Path().glob(f"*/{group}/{glob.escape(name)}.yaml"))]
    return f"did you forget --config-dir {found[0]}?" if found else ""


def print_catalogue(folders: Sequence[Path], groups: Sequence[str]) -> None:
    """Print the groups, a line a file."""
    for group in groups:
        print(group)
        names = _metrics() if group == METRIC else files_of(group, folders)
        width = max(map(len, names), default=0)
        for name, title in names.items():
            compiled = " [compiled]" if group == "controller" and _is_compiled(name, folders) else ""
            print(flat(f"  {name:<{width}}  {title}{compiled}".rstrip()))


def _metrics() -> dict[str, str]:
    """Return navbench's own metrics, each with its definition and its unit."""
    from navbench.metrics import DECLARED

    return {one.name: f"{one.definition}{f' [{one.unit}]' if one.unit else ''}" for one in DECLARED}


def _is_compiled(name: str, folders: Sequence[Path]) -> bool:
    """Return whether a controller is a compiled policy, as far as its class can be imported."""
    from navbench.policy import CompiledController

    file = next(
        (
            folder / "controller" / f"{name}.yaml"
            for folder in folders
            if (folder / "controller" / f"{name}.yaml").exists()
        ),
        None,
    )
    try:
        values = yaml.safe_load(file.read_text(encoding="utf-8")) if file else {}
        target = values.get("build", {}).get("_target_")
        if target is None:
            parents = [
                parent for parent in values.get("defaults", ()) if isinstance(parent, str) and parent != "_self_"
            ]
            return any(_is_compiled(parent, folders) for parent in parents)
        module, _, kind = target.rpartition(".")
        return issubclass(getattr(import_named(module), kind), CompiledController)
    except Exception:  # whatever is wrong with it, a run says
        return False


def _title(file: Path) -> str:
    with file.open(encoding="utf-8", errors="replace") as lines:
        first = next((line for line in lines if not line.startswith("# @")), "")
    return first.removeprefix("#").strip() if first.startswith("#") else ""
