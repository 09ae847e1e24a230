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
    with without_exit():
        return import_module(name)


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
    return (folder / top).is_dir() or any(file.name.startswith(f"{top}.") for file in folder.iterdir())
