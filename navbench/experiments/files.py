"""Files that are written whole or not at all, and directories that are not left behind empty."""

import os
from pathlib import Path


class Replacing:
    """Gives a temporary file beside the wanted one, and renames it when all went well."""

    def __init__(self, file: Path) -> None:
        """Note which file is wanted."""
        self._file = file
        self._temporary = file.with_name(f".{file.name}.{os.getpid()}.tmp")

    def __enter__(self) -> Path:
        """Return the temporary file."""
        self._file.parent.mkdir(parents=True, exist_ok=True)
        return self._temporary

    def __exit__(self, kind: type[BaseException] | None, *_: object) -> None:
        """Rename it, or remove it when something went wrong."""
        if kind is None:
            os.replace(self._temporary, self._file)
        else:
            self._temporary.unlink(missing_ok=True)


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
