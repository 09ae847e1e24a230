"""Compile functions with numba, and keep their machine code under a digest of every source that it may inline.

numba's own cache watches a function's own file alone: machine code in which a changed function of another file was
inlined would live on. Here every function's code is kept under the digest of all that the packages up to the episode
and the controllers hold; a user's function also under that of the sources beside its own file.

The files lie in ``NAVBENCH_CACHE_DIR``, else in the user's cache directory, else in a temporary directory of this user.
What ``NAVBENCH_CACHE_DIR`` holds is read also where it cannot be written, as in an image. Where no place can be
written, functions are compiled anew in each process.
"""

import hashlib
import os
import pickle
import shutil
import stat
import sys
import tempfile
from collections.abc import Callable, Collection, Iterator
from contextlib import contextmanager, suppress
from functools import cache
from importlib.util import find_spec
from pathlib import Path
from typing import Any, TypeVar, cast

import llvmlite.binding
import numba
import platformdirs
from numba.core import serialize
from numba.core.caching import NullCache
from numba.core.codegen import JITCodeLibrary
from numba.core.compiler import CompileResult
from numba.core.dispatcher import Dispatcher

Function = TypeVar("Function", bound=Callable[..., Any])

_dumps: Callable[[Any], bytes] = serialize.dumps  # pickles what a closure and machine code hold
COMPILES: bool = not getattr(numba.config, "DISABLE_JIT", 0)  # else ``compiled`` leaves functions as they are
ABOVE = ("experiments", "analysis", "report", "cli", "gym")  # packages that nothing compiled imports
CHECKSUM_BYTES = hashlib.sha256().digest_size  # before the machine code in its file
FOLDERS_MAX = 40  # states of the sources whose machine code is kept, the last used ones


def compiled(function: Function, **options: Any) -> Function:
    """Compile a function at its first call with arguments of new types.

    ``NUMBA_DISABLE_JIT=1`` leaves it Python, for a debugger; episodes need all of them compiled.

    Args:
        function: takes and returns what numba can type; it may call other compiled functions, of any file.
        options: of ``numba.njit``.
    """
    dispatcher: Any = numba.njit(**options)(function)
    if isinstance(dispatcher, Dispatcher) and os.path.isfile(function.__code__.co_filename):
        dispatcher._cache = _SourceCache(function)  # type: ignore[attr-defined,unused-ignore]
    return cast(Function, dispatcher)


def compiled_for_vectors(function: Function) -> Function:
    """Compile a function whose divisions by 0 give infinity or NaN, as numpy's do, so that its loops become vectors."""
    return compiled(function, error_model="numpy")


def compiled_inline(function: Function) -> Function:
    """Compile a function into each of its callers, where handing over many arrays would take longer than its work."""
    return compiled(function, forceinline=True)


def compiled_without_lock(function: Function) -> Function:
    """Compile a function that lets other threads run Python meanwhile."""
    return compiled(function, nogil=True)


def direct(function: Function, *arguments: Any) -> Function:
    """Return a compiled function for arguments of the types of these, which are not looked up again at each call.

    They must stay the same, and arrays contiguous: nothing checks that.
    """
    if not isinstance(function, Dispatcher):
        return function
    return cast(Function, function.compile(tuple(map(numba.typeof, arguments))))  # type: ignore[no-untyped-call,unused-ignore]


@cache
def digest_of_sources(beside: str | None = None) -> str:
    """Return the digest of the sources that compiled functions may inline, and of what compiles them.

    Args:
        beside: the folder of a user's own sources, which are then part of it.
    """
    digest = hashlib.sha256(repr((sys.version, numba.__version__, llvmlite.__version__)).encode())
    controllers = find_spec("navbench.controllers")  # beside this folder in the source tree
    roots = [Path(__file__).parent, *map(Path, (controllers and controllers.submodule_search_locations) or ())]
    files = {file for root in roots for file in root.rglob("*.py") if file.relative_to(root).parts[0] not in ABOVE}
    for file in sorted(files | set(Path(beside).glob("*.py") if beside else ())):
        try:
            digest.update(file.read_bytes())
        except OSError:  # what cannot be read cannot be imported either
            continue
    return digest.hexdigest()[:32]


def cache_folder() -> Path:
    """Return the folder in which compiled functions are kept, for all states of the sources.

    Raises:
        OSError: no place can be written.
    """
    return _folder(digest_of_sources()).parent


class _SourceCache(NullCache):  # type: ignore[misc,unused-ignore]
    """The machine code of one function: a file for each signature, checksum first, only ever replaced as a whole."""

    def __init__(self, function: Callable[..., Any]) -> None:
        self._function = function
        own = function.__module__.startswith("navbench.")
        self._beside = None if own else os.path.dirname(os.path.abspath(function.__code__.co_filename))
        self._digest = digest_of_sources(self._beside)

    def load_overload(self, sig: Any, target_context: Any) -> Any:
        """Return what was kept for a signature, or None."""
        target_context.refresh()
        for folder in (_given, _folder):
            with suppress(Exception):  # nothing is kept, or another version of a package pickled it
                kept = (folder(self._digest) / self._name(sig, target_context.codegen())).read_bytes()
                checksum, code = kept[:CHECKSUM_BYTES], kept[CHECKSUM_BYTES:]
                if checksum == hashlib.sha256(code).digest():  # else it may end the process or compute wrongly
                    defined, parts = pickle.loads(code)
                    with _lazily(target_context.codegen(), defined):
                        return CompileResult._rebuild(target_context, *parts)  # type: ignore[no-untyped-call,unused-ignore]
        return None

    def save_overload(self, sig: Any, cres: Any) -> None:
        """Keep what was compiled, unless it holds addresses of this process or a source has changed meanwhile."""
        changed = digest_of_sources.__wrapped__(self._beside) != self._digest
        if changed or cres.library.has_dynamic_globals or " at 0x" in repr(sig):
            return
        with suppress(Exception):  # no room, no right to write, or nothing to pickle: the next process compiles again
            file = _folder(self._digest) / self._name(sig, cres.codegen)
            temporary = file.with_name(f".{file.name}.{os.getpid()}")
            try:
                code = _dumps((_defined_by(cres.library), cres._reduce()))
                temporary.write_bytes(hashlib.sha256(code).digest() + code)
                os.replace(temporary, file)
            finally:
                temporary.unlink(missing_ok=True)

    def _name(self, sig: Any, codegen: Any) -> str:
        code = self._function.__code__
        closed = tuple(cell.cell_contents for cell in self._function.__closure__ or ())
        name = (self._function.__module__, self._function.__qualname__, code.co_firstlineno)
        key = repr((*name, code.co_code, _dumps(closed), sig, codegen.magic_tuple()))
        return f"{self._function.__name__}-{hashlib.sha256(key.encode()).hexdigest()[:32]}"


class _Library(JITCodeLibrary):  # type: ignore[misc,unused-ignore]
    """Machine code that was kept, with bitcode that is parsed when it is linked into another function, if ever.

    To parse it takes a fifth of a second for the loop alone, in each process.
    """

    bitcode = b""

    def _get_module_for_linking(self) -> Any:
        if self._shared_module is None:
            self._shared_module = llvmlite.binding.parse_bitcode(self.bitcode)  # type: ignore[no-untyped-call,unused-ignore]
        return self._shared_module


@contextmanager
def _lazily(codegen: Any, defined: Collection[str]) -> Iterator[None]:
    """Let numba read machine code as ``_Library`` does, of which these symbols are known."""

    def read(state: tuple[str, str, tuple[bytes, bytes]]) -> Any:
        name, _, (code, bitcode) = state
        library: Any = _Library(codegen, name)  # type: ignore[no-untyped-call,unused-ignore]
        library.bitcode = bitcode
        library.enable_object_caching()
        library._set_compiled_object(code)
        library._finalize_final_module()
        codegen._engine._defined_symbols.update(defined)
        return library

    codegen.unserialize_library = read
    try:
        yield
    finally:
        del codegen.unserialize_library


def _defined_by(library: Any) -> list[str]:
    """Return the symbols that a library's bitcode defines."""
    module = library._get_module_for_linking()
    return [
        symbol.name
        for kind in (module.functions, module.global_variables)
        for symbol in kind
        if not symbol.is_declaration
    ]


def _given(digest: str) -> Path:
    """Return the folder of one state of the sources in the place that is given, which need not be there or writable."""
    return Path(os.environ.get("NAVBENCH_CACHE_DIR") or os.devnull, "compiled", digest)


@cache
def _folder(digest: str) -> Path:
    """Return the folder of one state of the sources, made in the first place that can be written.

    Raises:
        OSError: no place can be written.
    """
    for place in _places():
        folder = place / "compiled" / digest
        try:
            folder.mkdir(parents=True, exist_ok=True)
            os.utime(folder)
        except OSError:
            continue
        if os.access(folder, os.W_OK):
            _drop_unused(folder.parent)
            return folder
    raise OSError("no folder for compiled functions can be written")


def _places() -> Iterator[Path]:
    """Yield where compiled functions may lie, best first."""
    yield from (Path(place).absolute() for place in (os.environ.get("NAVBENCH_CACHE_DIR"),) if place)
    with suppress(RuntimeError):  # the user has no home, not even in the system's list of users
        user = platformdirs.user_cache_path("navbench", appauthor=False)
        if user.is_absolute():  # else the user has no home
            yield user
    temporary = Path(tempfile.gettempdir(), f"navbench-{getattr(os, 'getuid', str)()}")
    temporary.mkdir(mode=0o700, exist_ok=True)
    found = temporary.lstat()
    if stat.S_ISDIR(found.st_mode) and (os.name == "nt" or found.st_uid == os.getuid() and not found.st_mode & 0o022):
        yield temporary  # nobody else can have placed machine code there


def _drop_unused(folder: Path) -> None:
    try:
        for old in sorted(folder.iterdir(), key=os.path.getmtime)[:-FOLDERS_MAX]:
            shutil.rmtree(old, ignore_errors=True)
    except OSError:  # another process drops them just now
        return
