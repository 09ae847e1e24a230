"""Files that are written whole or not at all, that tell whether they still are, and the directory that holds them."""

import errno
import glob
import hashlib
import os
import platform
import sys
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from datetime import UTC, datetime
from pathlib import Path
from typing import IO

from navbench.validation import DescriptionError

LOCK = "lock"
PART_TEMPORARIES = (".*.parquet.[0-9]*.tmp", "*/.*.parquet.[0-9]*.tmp")  # what parts are called that are being written
MARK = b"sha256:"
OPEN = MARK + b"0" * 64  # stands in a file where its seal will, and while the seal is computed


@contextmanager
def replacing(file: Path) -> Iterator[Path]:
    """Give a temporary file beside the wanted one, and rename it when all went well.

    What a process that was killed had begun to write in its place is removed.

    Raises:
        OSError: it cannot be written, such as on a full disk; it names the wanted file.
    """
    file.parent.mkdir(parents=True, exist_ok=True)
    temporary = file.with_name(f".{file.name}.{os.getpid()}.tmp")
    for left in file.parent.glob(f".{glob.escape(file.name)}.[0-9]*.tmp"):
        if _has_ended(left):
            left.unlink(missing_ok=True)
    try:
        yield temporary
        os.replace(temporary, file)
    except OSError as error:
        if error.filename in (None, str(temporary), temporary):
            error.filename = str(file)
        raise
    finally:
        temporary.unlink(missing_ok=True)


def keep(file: Path, data: bytes) -> None:
    """Write a file so that after a power cut there is the old one or the new one, whole."""
    with replacing(file) as temporary:
        temporary.write_bytes(data)
        _sync(temporary, os.O_RDWR)
    if sys.platform != "win32":  # which opens no directories
        _sync(file.parent, os.O_RDONLY)


def discard_half_written(folder: Path) -> None:
    """Remove the parts that a run of this directory, which was killed, had begun to write."""
    for pattern in PART_TEMPORARIES:
        for left in folder.glob(pattern):
            left.unlink(missing_ok=True)


def sealed(name: str, data: bytes) -> bytes:
    """Return a file's bytes with a SHA-256 of them and of the file's name where ``OPEN`` stands in them last."""
    place = data.rindex(OPEN)
    return data[:place] + _seal(name, data, place) + data[place + len(OPEN) :]


def is_whole(name: str, data: bytes) -> bool | None:
    """Return whether a file's bytes are those that were sealed under its name; None where they bear no seal."""
    place = data.rfind(MARK)
    return None if place < 0 else data[place : place + len(OPEN)] == _seal(name, data, place)


@contextmanager
def locked(folder: Path) -> Iterator[None]:
    """Hold a directory, so that no other run writes into it; a lock ends with the process that holds it.

    Raises:
        DescriptionError: another run holds it; the message says which one, where and since when.
    """
    with _held(folder / LOCK) as file:
        try:
            file.truncate(0)
            since = datetime.now(UTC).isoformat(timespec="seconds")
            file.write(f"process {os.getpid()} on {platform.node()} since {since}")
            file.flush()
            yield
        finally:
            with suppress(OSError):  # Windows removes no open file
                (folder / LOCK).unlink()


def inside(folder: Path, name: str) -> Path:
    """Return a file's path below a directory.

    Raises:
        DescriptionError: it would lie outside, by its name or by a link.
    """
    file = folder / name
    if ".." in Path(name).parts or "\\" in name or not file.parent.resolve().is_relative_to(folder.resolve()):
        raise DescriptionError(f"{name}: must lie in {folder}, and is written nowhere else")
    return file


def existing(path: Path) -> Path:
    """Return the nearest directory at or above a path that is there."""
    path = path.absolute()
    return next(folder for folder in (path, *path.parents) if os.path.isdir(folder))


def discard_empty(path: Path, there: Path) -> None:
    """Remove a directory that holds nothing, and those above it that then hold nothing, below one that was there."""
    path = path.absolute()
    with suppress(OSError):  # it holds something, or another run has removed it
        while path != there and there in path.parents:
            path.rmdir()
            path = path.parent


def _has_ended(temporary: Path) -> bool:
    """Return whether the process whose number stands in a temporary file's name is no more."""
    number = temporary.name.split(".")[-2]
    if sys.platform == "win32" or not number.isdecimal():  # where asking would interrupt it
        return False
    try:
        os.kill(int(number), 0)
    except (ProcessLookupError, OverflowError):
        return True
    except OSError:  # another user's
        return False
    return False


def _sync(path: Path, flags: int) -> None:
    opened = os.open(path, flags)
    try:
        os.fsync(opened)
    except OSError as error:
        if error.errno != errno.EINVAL:  # of a file system that cannot
            raise
    finally:
        os.close(opened)


def _seal(name: str, data: bytes, place: int) -> bytes:
    view = memoryview(data)
    digest = hashlib.sha256(name.encode() + b"\n")
    for piece in (view[:place], OPEN, view[place + len(OPEN) :]):
        digest.update(piece)
    return MARK + digest.hexdigest().encode()


@contextmanager
def _held(path: Path) -> Iterator[IO[str]]:
    """Give a locked file; one that its holder removed meanwhile is not the one that the next run finds there."""
    while True:
        path.parent.mkdir(parents=True, exist_ok=True)
        try:
            opened = _opened(path)
        except FileNotFoundError:  # the directory went meanwhile
            continue
        with opened as file:
            try:
                _lock(file)
            except (BlockingIOError, PermissionError):
                file.seek(0)
                raise DescriptionError(
                    f"{path.parent}: a run goes on here: {file.read(200)}; wait for it, or choose another directory"
                ) from None
            if _is_at(path, file):
                yield file
                return


def _is_at(path: Path, file: IO[str]) -> bool:
    """Return whether an open file is the one at a path: asked at once, since it may go at any moment."""
    try:
        return os.path.samestat(os.fstat(file.fileno()), path.stat())
    except FileNotFoundError:
        return False


def _opened(path: Path) -> IO[str]:
    """Open a file of this directory's own, which is made where it is not there: a link would lead elsewhere."""
    flags = os.O_RDWR | os.O_CREAT | getattr(os, "O_NOFOLLOW", 0)
    try:
        file = open(os.open(path, flags, 0o666), "r+", encoding="utf-8")
    except (OSError, ValueError) as error:
        if path.is_symlink() or (path.exists() and not path.is_file()):
            raise DescriptionError(f"{path}: must be a file, and no link, directory, pipe or device") from error
        raise
    return file


def _lock(file: IO[str]) -> None:
    if sys.platform == "win32":
        import msvcrt

        file.seek(1 << 20)  # beyond what is read
        msvcrt.locking(file.fileno(), msvcrt.LK_NBLCK, 1)
    else:
        import fcntl

        try:
            fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except OSError as error:
            if error.errno not in (errno.ENOLCK, errno.ENOTSUP, errno.ENOSYS):  # of a file system without locks
                raise
