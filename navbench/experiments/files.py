"""Files that are written whole or not at all, and directories that are not left behind empty."""

import os
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

TEMPORARY = ".*.tmp"  # what temporary files are called


@contextmanager
def replacing(file: Path) -> Iterator[Path]:
    """Give a temporary file beside the wanted one, and rename it when all went well."""
    file.parent.mkdir(parents=True, exist_ok=True)
    temporary = file.with_name(f".{file.name}.{os.getpid()}.tmp")
    try:
        yield temporary
        os.replace(temporary, file)
    finally:
        temporary.unlink(missing_ok=True)


def existing(path: Path) -> Path:
    """Return the nearest directory at or above a path that is there."""
    path = path.absolute()
    return next(folder for folder in (path, *path.parents) if os.path.isdir(folder))


def discard_empty(path: Path, there: Path) -> None:
    """Remove a directory that holds nothing, and those above it that then hold nothing, below one that was there."""
    path = path.absolute()
    while path != there and there in path.parents and path.is_dir() and not any(path.iterdir()):
        path.rmdir()
        path = path.parent
