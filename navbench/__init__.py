"""Compare reactive navigation controllers of wheeled robots in simulated worlds.

From Python: ``run``, ``sweep``, ``load`` and ``check``, see their docstrings.
"""

from importlib import import_module
from pathlib import Path
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from navbench.cli.interface import check, load, run, sweep
    from navbench.cli.result import Result
    from navbench.validation import DescriptionError

if not (Path(__file__).parent / "conf").is_dir():  # in the source tree conf and controllers stand beside this folder
    __path__.append(str(Path(__file__).parents[1]))

__all__ = ["DescriptionError", "Result", "check", "load", "run", "sweep"]
__version__ = "0.1.0"

PLACES = {"DescriptionError": "navbench.validation", "Result": "navbench.cli.result"}


def __getattr__(name: str) -> Any:
    """Import what the interface offers when it is first asked for, so that ``import navbench`` is quick."""
    if name not in __all__:
        raise AttributeError(f"module 'navbench' has no attribute '{name}'")
    return getattr(import_module(PLACES.get(name, "navbench.cli.interface")), name)


def __dir__() -> list[str]:
    return [*globals(), *__all__]
