"""Modules that a user names: installed ones, or those in the working directory, where nothing else is imported from."""

import os
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from importlib import import_module
from importlib.util import find_spec
from pathlib import Path
from types import ModuleType
from typing import NoReturn

from navbench.validation import DescriptionError

_NAMED: dict[str, set[str]] = {}  # modules that a user named, and the folders that each added to what is imported from


def import_named(name: str) -> ModuleType:
    """Import a module that a configuration, or a user, names.

    A console script does not look into the working directory, and must not: libraries import what they find there by
    chance. Only where a module of the user's own is named that lies there, it becomes a place to import from.

    Args:
        name: the module's dotted name.

    Raises:
        Exception: whatever the module raises.
    """
    top, here = name.partition(".")[0], os.getcwd()
    if top and here not in sys.path and _lies_in(Path(here), top) and not (top in sys.modules or find_spec(top)):
        sys.path.append(here)
    before = set(sys.path)
    try:
        with without_exit():
            return import_module(name)
    finally:
        if not name.startswith("navbench."):
            _NAMED.setdefault(name, set()).update(set(sys.path) - before)


def check_apart() -> None:
    """Check that no two modules that a user named can get each other's helpers, imported by one name from two folders.

    Raises:
        DescriptionError: which helper, and from where.
    """
    added = {folder: name for name, folders in _NAMED.items() for folder in folders if os.path.isdir(folder)}
    if not added or len(_NAMED) < 2:
        return
    loaded = {name.partition(".")[0] for name in sys.modules}
    for folder, adder in added.items():
        held = loaded & {file.name.partition(".")[0] for file in Path(folder).iterdir()}
        for top in sorted(held):
            places = [place for place in dict.fromkeys(sys.path) if _lies_in(Path(place), top)]
            if len(places) > 1:
                raise DescriptionError(
                    f"{top}: lies in {places[0]} and in {places[1]}, of which {adder} adds {folder} to sys.path; "
                    "another module would import the wrong one: give one of them another name"
                )


@contextmanager
def without_exit() -> Iterator[None]:
    """Let ``os._exit`` of a user's code, which would end this process without a word, raise ``SystemExit``."""
    end, process = os._exit, os.getpid()

    def refuse(status: int) -> NoReturn:
        if os.getpid() != process:  # a fork ends as it means to
            end(status)
        raise SystemExit(f"os._exit({status})")

    os._exit = refuse
    try:
        yield
    finally:
        os._exit = end


def _lies_in(folder: Path, top: str) -> bool:
    if not folder.is_dir():  # an archive
        return False
    return (folder / top).is_dir() or any(file.name.startswith(f"{top}.") for file in folder.iterdir())
