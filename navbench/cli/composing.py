"""From the words of a command line to composed configurations, by Hydra."""

import gc
import itertools
import os
import re
from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from contextvars import ContextVar
from dataclasses import fields
from functools import cache
from pathlib import Path
from threading import RLock
from typing import Any, NamedTuple

import yaml
from hydra import compose, initialize_config_module
from hydra.core.config_search_path import ConfigSearchPath
from hydra.core.config_store import ConfigStore
from hydra.core.global_hydra import GlobalHydra
from hydra.core.hydra_config import HydraConfig
from hydra.core.override_parser.overrides_parser import OverridesParser
from hydra.core.override_parser.types import Override, ValueType
from hydra.core.plugins import Plugins
from hydra.errors import HydraException
from hydra.plugins.search_path_plugin import SearchPathPlugin
from omegaconf import DictConfig, OmegaConf, open_dict
from omegaconf.errors import OmegaConfBaseException

from navbench.cli import schema
from navbench.cli.catalogue import CONF, GROUPS, LISTED, check_folder
from navbench.validation import HERE, DescriptionError, instead

KINDS = {"run": schema.Run, "tune": schema.Tune}  # the primary configs with a schema
CONTROLLER_SIDE = ("controller", "sensors")  # a controller chooses sensors,
WORLD_SIDE = ("world", "robot", "simulator")  # a world a robot
NO_NAME = r"(?i:null|nan|true|false|[-+]?inf)|[-+\d.e]*"  # what Hydra reads as no word
COMPOSING = RLock()
BEGUN = itertools.count(1)  # how often it was begun to compose
COLLECTED_EVERY = 20  # times; each leaves some 2 MB of garbage, and to look for it takes as long as one
FOLDER: ContextVar[str | Path | None] = ContextVar("FOLDER", default=None)


class Composed(NamedTuple):
    """A composed configuration, as plain values, which several may share: nobody changes them.

    Attributes:
        values: all of it.
        choices: which file was chosen in each group.
    """

    values: Mapping[str, Any]
    choices: Mapping[str, Any]


class UserFolder(SearchPathPlugin):
    """Lets Hydra look into the folder after ``--config-dir``, too."""

    def manipulate_search_path(self, search_path: ConfigSearchPath) -> None:
        """Append the folder."""
        folder = FOLDER.get()
        if folder is not None:
            search_path.append("navbench", f"file://{os.path.abspath(folder)}")


@contextmanager
def composing(
    config_dir: str | Path | None = None,
    things: Sequence[tuple[str, str, Mapping[str, Any]]] = (),
    *,
    in_halves: bool = True,
) -> Iterator["Composer"]:
    """Give what composes from navbench's own files, and from those of a folder, as after ``--config-dir``.

    Threads take turns, because Hydra knows one configuration at a time.

    Args:
        config_dir: the folder.
        things: what stands in no file: of each its group, its name, and what its file would hold.
        in_halves: as of ``Composer``.

    Raises:
        DescriptionError: there is no such directory, or a file in it cannot be used.
    """
    if config_dir is not None:
        check_folder(Path(config_dir))
    with COMPOSING:
        schema.register()
        Plugins.instance().register(UserFolder)
        token, hydra, config = FOLDER.set(config_dir), GlobalHydra.instance().hydra, HydraConfig.instance().cfg
        GlobalHydra.instance().clear()  # a program that has Hydra compose something of its own may call navbench
        if next(BEGUN) % COLLECTED_EVERY == 0:
            gc.collect()  # which freezing, as it sets the counts back, would keep from ever beginning by itself
        gc.freeze()  # Hydra leaves much garbage, and a third of its time would go into looking through all else
        store = ConfigStore.instance()
        for group, name, values in things:
            store.store(group=group, name=name, node=values)
        try:
            with initialize_config_module("navbench.conf", job_name="navbench", version_base="1.3"):
                yield Composer(in_halves=in_halves)
        except (HydraException, OmegaConfBaseException) as error:
            for folder in (config_dir, CONF):  # where the file may lie of which it speaks
                error.add_note(str(folder or CONF))
            raise
        finally:
            for group, name, _ in things:
                del store.repo[group][f"{name}.yaml"]
            gc.unfreeze()
            FOLDER.reset(token)
            GlobalHydra.instance().hydra, HydraConfig.instance().cfg = hydra, config


class Composer:
    """Composes, while ``composing``.

    Args:
        in_halves: whether runs are put together from halves, each of which is composed once: of many it is faster.
    """

    def __init__(self, *, in_halves: bool = True) -> None:
        self._side, self._in_halves = cache(self._compose_side), in_halves

    def command(self, name: str, words: Sequence[str], *, sweep: bool = False) -> tuple[Iterator[Composed], Path]:
        """Return what a command line asks for, in the order of a sweep, and where its results are to go.

        The first is composed at once, each other when its turn comes.

        Args:
            name: the primary config: run or tune.
            words: the command line's, with ``hydra.run.dir`` or, in a sweep, ``hydra.sweep.dir``.
            sweep: whether commas, choice(), range() and glob() stand for several values, as after ``-m``.

        Raises:
            hydra.errors.HydraException: an unknown choice or key.
            omegaconf.errors.OmegaConfBaseException: a value is missing, of a wrong type, or does not resolve.
            DescriptionError: a word chooses no name, or sets what cannot be set.
        """
        place = "hydra.sweep.dir" if sweep else "hydra.run.dir"
        for word in words:
            if key_of(word).startswith("hydra") and key_of(word) != place:
                raise DescriptionError(f"{key_of(word)}: unknown key; the only one of Hydra's own here is {place}")
            for other, kind in KINDS.items():
                if _top(word) in _keys_of(kind) and _top(word) not in _keys_of(KINDS[name]):
                    raise DescriptionError(f"{word}: is a key of `navbench {other}`, not of a {name}")
        check_words(words)
        _check_once(words)
        jobs = combinations(words) if sweep else [list(words)]
        first = self._whole(name, jobs[0])
        told = HydraConfig.get()
        path = Path(told.sweep.dir if sweep else told.run.dir)
        return itertools.chain([first], (self.values(name, job) for job in jobs[1:])), path

    def values(self, name: str, words: Sequence[str]) -> Composed:
        """Return one composed configuration; arguments and errors as above.

        A run is composed in two halves where these have nothing to do with each other, as nearly always: of many runs
        each half stands in several.
        """
        return (self._halves(words) if name == "run" and self._in_halves else None) or self._whole(name, words)

    def text(self, name: str, words: Sequence[str]) -> str:
        """Return a composed configuration as YAML, as it is before it is checked."""
        return OmegaConf.to_yaml(self._config(name, words))

    def study(self, name: str) -> dict[str, Any]:
        """Return what a study's files say; where they name no package, it stands below the names of their folders."""
        values: dict[str, Any] = OmegaConf.to_container(self._config(f"study/{name}", []), resolve=True)  # type: ignore[assignment]
        for folder in ("study", name):
            inner = values.pop(folder, {})
            for key in inner:
                if key in values:
                    raise DescriptionError(f"study/{name}.{key}: stands in several of the study's files")
            values.update(inner)
        return values

    def _whole(self, name: str, words: Sequence[str]) -> Composed:
        config = self._config(name, words)
        return Composed(_checked(name, _plain(config)), _choices())

    def _config(self, name: str, words: Sequence[str]) -> DictConfig:
        check_words(words)
        try:
            config = compose(name, list(words), return_hydra_config=True)  # which the resolver ``hydra`` reads
        except AssertionError:  # Hydra's own, of entries that mean nothing, such as those of a group without a name
            of = " ".join(words) or name
            raise DescriptionError(f"{of}: defaults: each must be a name or `group: name`, of letters") from None
        HydraConfig.instance().set_config(config)
        with open_dict(config):
            del config["hydra"]
        return config

    def _halves(self, words: Sequence[str]) -> Composed | None:
        """Return a run put together from its halves, or None where only the whole tells what it is."""
        check_words(words)
        of_controller = [word for word in words if _top(word) in CONTROLLER_SIDE]
        others = [word for word in words if _top(word) not in CONTROLLER_SIDE]
        try:
            controller, world = self._side(CONTROLLER_SIDE, *of_controller), self._side(WORLD_SIDE, *others)
            if controller.beside != self._side(()).beside:
                return None
        except (HydraException, OmegaConfBaseException):
            return None  # of what is wrong the whole speaks
        values = _checked("run", {**controller.values, **world.values, **world.beside})
        return Composed(values, {**controller.choices, **world.choices})

    def _compose_side(self, side: Sequence[str], *words: str) -> "_Side":
        """Return some groups of a run, composed without the others."""
        run = yaml.safe_load((CONF / "run.yaml").read_text(encoding="utf-8"))
        without = [group for group in GROUPS if group not in side]
        run["defaults"] = [entry for entry in run["defaults"] if not set(entry).intersection(without)]
        ConfigStore.instance().store(name="side", node=run)
        config = self._config("side", words)
        if not all(OmegaConf.is_missing(config, group) for group in without):
            raise HydraException(f"{', '.join(side)}: set what is not theirs")
        beside = [str(key) for key in config if key not in GROUPS]
        return _Side(
            _plain(OmegaConf.masked_copy(config, list(side))), _plain(OmegaConf.masked_copy(config, beside)), _choices()
        )


class _Side(NamedTuple):
    values: dict[str, Any]
    beside: dict[str, Any]
    choices: dict[str, Any]


def combinations(words: Sequence[str]) -> list[list[str]]:
    """Return every combination of the values over which the words of a sweep go, the last word's first.

    Raises:
        hydra.errors.HydraException: a word cannot be read, or goes over what has no end.
        DescriptionError: a glob finds nothing.
    """
    parsed = OverridesParser.create(GlobalHydra.instance().config_loader()).parse_overrides(list(words))
    return [list(job) for job in itertools.product(*map(_single, parsed))]


def _single(override: Override) -> list[str]:
    """Return the words that a word of a sweep stands for."""
    if not override.is_sweep_override():
        return [str(override.input_line)]
    values = list(override.sweep_string_iterator())
    if override.value_type is ValueType.GLOB_CHOICE_SWEEP:
        values = [value for value in values if not value.startswith("_")]  # these are parts of others
        if not values:
            raise DescriptionError(f"{override.input_line}: no name is like that")
    return [f"{override.get_key_element()}={value}" for value in values]


def check_words(words: Iterable[str]) -> None:
    """Check the words that choose a file: Hydra takes a null, a number, a flag or a list for a slip in the program.

    A name with .yaml Hydra would take, and results would then bear it.

    Raises:
        DescriptionError: a word chooses no name.
    """
    for word in words:
        if re.match(rf"({'|'.join(LISTED)})=.*[\ud800-\udfff]", word):
            raise DescriptionError(f"{word!a}: cannot be read in this locale; set PYTHONUTF8=1")
        group = re.fullmatch(rf"({'|'.join(LISTED)})(?:@[\w.]+)?=(?:[\[{{].*|{NO_NAME}|.*\.yaml)", word, re.DOTALL)
        if group:
            raise DescriptionError(f"{word}: must be one name; `navbench list {group[1]}` prints them")


def _check_once(words: Iterable[str]) -> None:
    """Check that no choice speaks against another one: Hydra would take the last, where both may be meant.

    Raises:
        DescriptionError: one does.
    """
    given: dict[str, str] = {}
    for word in words:
        key, _, value = word.partition("=")
        if key in LISTED and given.get(key, value) != value:
            raise DescriptionError(
                f"{word}: {key}={given[key]} is there, too; a sweep is -m {key}={given[key]},{value}"
            )
        given[key] = value
    if {"episode", "episodes"} <= {*given}:
        raise DescriptionError(f"episode={given['episode']}: runs it alone; leave out episodes={given['episodes']}")


def key_of(word: str) -> str:
    """Return the key of a word of the command line, such as controller.build.kp."""
    return re.split(r"[=@]", word.lstrip("+~"))[0]


def _top(word: str) -> str:
    """Return the key at the top of the configuration that a word changes."""
    place = word.lstrip("+~").split("=")[0]
    return place.rpartition("@")[2].split(".")[0]


def _choices() -> dict[str, Any]:
    """Return which file was chosen in each group of what was composed last."""
    choices = HydraConfig.get().runtime.choices.items()
    return {group: choice for group, choice in choices if not group.startswith("hydra/")}


def _plain(config: DictConfig) -> dict[str, Any]:
    values: dict[str, Any] = OmegaConf.to_container(config, resolve=True, throw_on_missing=True)  # type: ignore[assignment]
    return values


def _keys_of(kind: type[schema.Run]) -> list[str]:
    return [field.name for field in fields(kind)]


def _checked(name: str, values: Mapping[str, Any]) -> dict[str, Any]:
    """Return a configuration in the order of its keys, which are those of its kind, each there."""
    known = _keys_of(KINDS[name])
    for key in values:
        if key not in known:
            raise DescriptionError(f"{key}: unknown key; {instead(key, known, HERE)}")
    for key in known:
        if key not in values:
            raise DescriptionError(f"{key}: missing; a value is needed")
    return {key: values[key] for key in known}
