"""What there is to choose from: each group's files with the first line of each."""

from collections.abc import Sequence
from pathlib import Path

GROUPS = ("controller", "world", "robot", "sensors", "simulator")


def groups_in(folders: Sequence[Path]) -> list[str]:
    """Return the groups that have a file in any of the folders, in the order of a run's words."""
    return [group for group in GROUPS if any((folder / group).is_dir() for folder in folders)]


def files_of(group: str, folders: Sequence[Path]) -> dict[str, str]:
    """Return the names in a group with their first comment line, sorted; one that begins with _ is a part of others."""
    files = {file.stem: file for folder in folders for file in sorted((folder / group).glob("*.yaml"))}
    return {name: _title(files[name]) for name in sorted(files) if not name.startswith("_")}


def print_catalogue(folders: Sequence[Path], groups: Sequence[str]) -> None:
    """Print the groups, a line a file."""
    for group in groups:
        print(group)
        names = files_of(group, folders)
        width = max(map(len, names), default=0)
        for name, title in names.items():
            print(f"  {name:<{width}}  {title}".rstrip())


def _title(file: Path) -> str:
    with file.open() as lines:
        first = lines.readline()
    return first.removeprefix("#").strip() if first.startswith("#") else ""
