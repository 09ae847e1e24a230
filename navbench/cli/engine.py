"""Where work runs: an engine of the configuration, and how many workers."""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, TypedDict

from navbench.cli.building import made
from navbench.cli.composing import composing, key_of
from navbench.experiments.engines import Engine
from navbench.validation import DescriptionError, instead

KEYS = ("engine", "workers")


class Where(TypedDict):
    """An engine and how many workers, as ``run_plan`` takes them."""

    engine: Engine
    workers: int | None


def where_of(values: Mapping[str, Any]) -> Where:
    """Return where the work of a composed run is to run.

    Raises:
        DescriptionError: one line that names the key and what is allowed, or the package that an engine needs.
    """
    workers = values["workers"]
    if workers is not None and workers < 0:
        raise DescriptionError(f"workers={workers}: must be at least 0")
    return {"engine": made("engine", values["engine"], ("open(workers)",)), "workers": workers}


def where(words: Sequence[str], config_dir: str | Path | None, verb: str, others: Sequence[str] = ()) -> Where:
    """Return where work is to run by the words of a command line that has no others.

    Args:
        words: such as "engine=dask", "engine.address=tcp://host:8786", "workers=4".
        config_dir: a folder with further engines, as after ``--config-dir``.
        verb: of the command line, for the error message.
        others: further keys that it has, for the error message.

    Raises:
        DescriptionError: another word stands there; and as ``where_of``.
        hydra.errors.HydraException: an unknown choice or key.
    """
    for word in words:
        if key_of(word).partition(".")[0] not in KEYS:
            allowed = instead(key_of(word), (*KEYS, *others), f"allowed with a {verb}")
            raise DescriptionError(f"{word}: unknown key; {allowed}")
    with composing(config_dir) as composer:
        return where_of(composer.values("run", words).values)
