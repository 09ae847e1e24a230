"""The code that makes rows: the modules that an episode runs through, from import to import, and their digests."""

import hashlib
import importlib.util
import os
import re
import subprocess
import sys
import sysconfig
from collections.abc import Iterable, Iterator, Mapping
from functools import cache, lru_cache
from pathlib import Path
from typing import Any

EPISODE = "navbench.episode.loop"  # which imports all that makes an episode
IMPORT = re.compile(r"^[ \t]*(?:from[ \t]+([\w.]+)[ \t]+import[ \t]+(\([^)]*\)|[^\n]*)|import[ \t]+([^\n]*))", re.M)
STANDARD = sysconfig.get_paths()["stdlib"]


def roots_of(configuration: Any) -> tuple[str, ...]:
    """Return the modules of the classes that a configuration names by ``_target_``, at any depth."""
    return tuple(sorted({target.rpartition(".")[0] for target in _targets(configuration)}))


def foreign_of(*configurations: Any) -> frozenset[str]:
    """Return the classes that configurations name and that are not navbench's own."""
    return frozenset(target for target in _targets(configurations) if not target.startswith("navbench."))


def code_of(roots: Iterable[str]) -> dict[str, str]:
    """Return a digest of each module that decides what rows an episode gives, by its dotted name.

    They are those of an episode, some more, and what these import; without the standard library and installed ones,
    whose versions stand in the manifest.

    Args:
        roots: those of a configuration's classes.
    """
    todo = [EPISODE, *roots]
    own = {name.partition(".")[0] for name in todo}
    code: dict[str, str] = {}
    seen: set[str] = set()
    while todo:
        name = todo.pop()
        file = None if name in seen else _file_of(name)
        seen.add(name)
        if file is None or not (name.partition(".")[0] in own or _is_users(file)):
            continue
        stat = file.stat()
        code[name], imported = _read(file, name, stat.st_mtime_ns, stat.st_size)
        todo += imported
    return dict(sorted(code.items()))


def digest_now(name: str) -> str | None:
    """Return the digest of a module's source as it lies here; None where there is none. Nothing is imported."""
    *packages, last = name.split(".")
    folders = [*sys.path, os.getcwd()]
    if packages[:1] == ["navbench"]:
        folders, packages = list(sys.modules["navbench"].__path__), packages[1:]
    inner = [Path(folder, *packages) for folder in folders]
    files = (file for folder in inner for file in (folder / f"{last}.py", folder / last / "__init__.py"))
    found = next((file for file in files if file.is_file()), None)
    return None if found is None else digest_of(found.read_bytes())


def loaded() -> dict[str, str]:
    """Return of each module of the user's that this process has imported the digest of what would be imported now."""
    found = {}
    for name, module in list(sys.modules.items()):
        file = getattr(module, "__file__", None)
        if isinstance(file, str) and not name.startswith(("navbench.", "__m")) and _is_loaded(file):
            found[name] = digest_now(name)
    return {name: digest for name, digest in found.items() if digest}


def changed(code: Mapping[str, str]) -> str:
    """Return which of some modules lie here with another source than their digests say, as one line; empty for none."""
    return ", ".join(name for name, digest in code.items() if digest_now(name) not in (None, digest))


def commit() -> str | None:
    """Return the git commit of navbench's own sources; None where they are not under git."""
    folder = Path(__file__).parent
    try:
        words = ["git", "-C", str(folder), "rev-parse", "HEAD", "HEAD:./"]  # the latter only where git knows the folder
        done = subprocess.run(words, capture_output=True, text=True, check=False)
    except OSError:
        return None
    return done.stdout.split()[0] if done.returncode == 0 else None


def _targets(value: Any) -> Iterator[str]:
    """Yield every class that plain values name."""
    if isinstance(value, dict):
        yield from (str(inner) for key, inner in value.items() if key == "_target_")
    for inner in value.values() if isinstance(value, dict) else value if isinstance(value, list | tuple) else ():
        yield from _targets(inner)


def _file_of(name: str) -> Path | None:
    """Return a module's source; None for what is no module, has no source, or would only lead to the command line."""
    parent, _, last = name.rpartition(".")
    if name in ("", "navbench"):
        return None
    if name in sys.modules:
        found = getattr(sys.modules[name], "__file__", None)
        return Path(found) if found and found.endswith(".py") else None
    for folder in getattr(sys.modules.get(parent), "__path__", ()):  # imported later, inside a function
        file = Path(folder, f"{last}.py")
        if file.is_file():
            return file
    return None


@cache
def _is_loaded(file: str) -> bool:
    return file.endswith(".py") and _is_users(Path(file))


def _is_users(file: Path) -> bool:
    return not ({"site-packages", "dist-packages"} & set(file.parts)) and not str(file).startswith(STANDARD)


@lru_cache(maxsize=1000)
def _read(file: Path, name: str, *_: int) -> tuple[str, list[str]]:
    """Return the digest of a module's source and the names that it may import, as its file stands now."""
    source = file.read_bytes()
    return digest_of(source), list(_imports(source.decode(errors="replace"), name, file))


def digest_of(source: bytes) -> str:
    """Return sixteen digits of the SHA-256 of a source."""
    return hashlib.sha256(source).hexdigest()[:16]


def _imports(source: str, name: str, file: Path) -> Iterable[str]:
    package = name if file.name == "__init__.py" else name.rpartition(".")[0]
    found: dict[str, None] = {}
    for module, names, modules in IMPORT.findall(source):
        if module.startswith("."):
            module = importlib.util.resolve_name(module, package) if package else module.lstrip(".")
        written = re.sub(r"#[^\n]*", "", names or modules).split(",")
        listed = [part.split(" as ")[0].strip(" ()\t\n\\") for part in written]
        found |= dict.fromkeys([module, *(f"{module}.{part}" if module else part for part in listed)])
    parents = [prefix for one in found for prefix in _parents(one)]
    return dict.fromkeys([*found, *parents])


def _parents(name: str) -> list[str]:
    words = name.split(".")
    return [".".join(words[:count]) for count in range(1, len(words))]
