"""From the words of a command line to a composed configuration, by Hydra, and for the runs of a study quickly."""

import os
import re
from collections.abc import Hashable, Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import fields, is_dataclass
from functools import lru_cache
from pathlib import Path
from typing import Any, NamedTuple

from hydra import compose, version
from hydra._internal.config_loader_impl import ConfigLoaderImpl
from hydra._internal.hydra import Hydra
from hydra._internal.utils import create_config_search_path
from hydra.core.global_hydra import GlobalHydra
from hydra.core.hydra_config import HydraConfig
from omegaconf import DictConfig, OmegaConf, open_dict

from navbench.cli import schema
from navbench.cli.catalogue import CONF, LISTED
from navbench.cli.parts import PartsLoader
from navbench.validation import DescriptionError

OWN = "pkg://navbench.conf"


class Composed(NamedTuple):
    """A composed configuration, as plain values.

    Attributes:
        values: all of it.
        keys: those that may stand at its top.
        choices: which file was chosen in each group.
    """

    values: dict[str, Any]
    keys: Sequence[str]
    choices: Mapping[str, Any]


def plain(config: DictConfig, choices: Mapping[str, Any]) -> Composed:
    """Return a composed configuration as plain values.

    Raises:
        omegaconf.errors.OmegaConfBaseException: a value is missing or an interpolation does not resolve.
    """
    values: dict[str, Any] = OmegaConf.to_container(config, resolve=True, throw_on_missing=True)  # type: ignore[assignment]
    kind = OmegaConf.get_type(config)
    return Composed(values, [item.name for item in fields(kind)] if is_dataclass(kind) else list(values), choices)


class Composer(NamedTuple):
    """Composes from one search path, while ``composing``."""

    parts: PartsLoader

    def config(self, name: str, words: Sequence[str]) -> tuple[DictConfig, Mapping[str, Any]]:
        """Return a primary config composed with these words, and which file was chosen in each group.

        Raises:
            hydra.errors.HydraException: an unknown choice or key.
            DescriptionError: a word chooses no name.
        """
        check_words(words)
        config = compose(name, list(words), return_hydra_config=True)
        HydraConfig.instance().set_config(config)
        choices = dict(config.hydra.runtime.choices)
        with open_dict(config):
            del config["hydra"]
        return config, choices

    def values(self, name: str, words: Sequence[str]) -> Composed:
        """Return a run or a tuning composed with these words; as ``config``, but as plain values, and quickly.

        Raises:
            hydra.errors.HydraException: an unknown choice or key.
            DescriptionError: a word chooses no name.
            omegaconf.errors.OmegaConfBaseException: as ``plain``.
        """
        check_words(words)
        try:
            config, whole, choices = self.parts.compose(name, words)
            composed = plain(config, choices)
        except Exception:  # what is unusual Hydra composes itself, and of what is wrong it speaks in its own words
            return plain(*self.config(name, words))
        composed.values.update(whole)
        return composed


@contextmanager
def composing(config_dir: str | None = None) -> Iterator[Composer]:
    """Give what composes from navbench's own files, and from those of a folder, as after ``--config-dir``."""
    schema.register()
    search_path = create_config_search_path(OWN)
    if config_dir is not None:
        folder = f"file://{os.path.abspath(config_dir)}"
        search_path.prepend("command-line", folder, anchor="schema")  # the schemas must stand last
    version.setbase("1.3")
    GlobalHydra.instance().initialize(Hydra("navbench", ConfigLoaderImpl(search_path)))
    try:
        yield Composer(PartsLoader(search_path) if config_dir is not None else _own_parts(_state(CONF)))
    finally:
        GlobalHydra.instance().clear()


@lru_cache(maxsize=1)
def _own_parts(state: Hashable) -> PartsLoader:
    """Return what composes from navbench's own files, the same as long as these stay as they are."""
    return PartsLoader(create_config_search_path(OWN))


def _state(folder: Path) -> Hashable:
    """Return what is another one when a file has changed."""
    stats = ((file, file.stat()) for file in sorted(folder.rglob("*.yaml")) if file.is_file())
    return tuple((file, stat.st_mtime_ns, stat.st_size) for file, stat in stats)


def check_words(words: Iterable[str]) -> None:
    """Check the words that choose a file: Hydra takes a null, a number or a list for a slip in the program.

    Raises:
        DescriptionError: a word chooses no name.
    """
    for word in words:
        group = re.fullmatch(rf"({'|'.join(LISTED)})(?:@[\w.]+)?=(?:[\[{{].*|null|[-+\d.e]*)", word, re.DOTALL)
        if group:
            raise DescriptionError(f"{word}: must be one name; `navbench list {group[1]}` prints them")


def key_of(word: str) -> str:
    """Return the key of a word of the command line, such as controller.build.kp."""
    return re.split(r"[=@]", word.lstrip("+~"))[0]
