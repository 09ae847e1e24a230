"""Composes from parts: what the files of a group say together is merged once, for every run that chooses them."""

import copy
import re
from collections.abc import Mapping, Sequence
from dataclasses import replace
from functools import cache, cached_property
from typing import Any, NamedTuple

from hydra._internal.config_loader_impl import ConfigLoaderImpl
from hydra._internal.config_repository import CachingConfigRepository, ConfigRepository, IConfigRepository
from hydra._internal.defaults_list import DefaultsList, create_defaults_list
from hydra.core.config_search_path import ConfigSearchPath
from hydra.core.default_element import GroupDefault, ResultDefault
from hydra.core.override_parser.overrides_parser import OverridesParser
from hydra.core.override_parser.types import Override
from hydra.plugins.config_source import ConfigResult
from hydra.types import RunMode
from omegaconf import DictConfig, ListConfig, OmegaConf

PRIMARY = ("run", "tune")  # what is composed here
ANGLE = r"\$\{deg:[^${}]*\}"


class UnusualError(Exception):
    """Something that Hydra itself must compose, such as its own settings, or a value that refers to another place."""


class Parts(NamedTuple):
    """A composed configuration.

    Attributes:
        config: the keys beside the groups, and the groups in which a word changes a value; the other groups are empty.
        whole: those others, as plain values.
        choices: which file was chosen in each group.
    """

    config: DictConfig
    whole: dict[str, Any]
    choices: Mapping[str, Any]


class PartsLoader(ConfigLoaderImpl):
    """Composes as Hydra does, but for Hydra's own settings.

    Hydra merges the files of all groups one after another. But a group's files set values below the group's key, and
    where no value refers to another place, nothing that another group's files set has a part in them.
    """

    def __init__(self, search_path: ConfigSearchPath) -> None:
        """Begin with nothing read."""
        super().__init__(search_path)
        self._files = CachingConfigRepository(_Files(search_path))
        self._parsed = cache(OverridesParser.create().parse_override)
        self._found = cache(self._find)
        self._parts: dict[tuple[Any, ...], _Part] = {}

    def compose(self, name: str, words: Sequence[str]) -> Parts:
        """Return one of ``PRIMARY``, composed with these words.

        Raises:
            Exception: a word or a file is wrong, or Hydra itself must compose this.
        """
        if any("hydra" in word or "${" in word for word in words):
            raise UnusualError("a word about Hydra, or one that refers to another place")
        parsed = [self._parsed(word) for word in words]
        self.validate_sweep_overrides_legal(parsed, RunMode.RUN, from_shell=False)
        found = self._found(name, tuple(word for word in words if self._chooses(self._parsed(word))))
        changes = [override for override in parsed if not self._chooses(override)]
        groups: dict[str, list[ResultDefault]] = {}
        for file in found.defaults:
            groups.setdefault(str(file.package).split(".")[0], []).append(file)
        config, whole = copy.deepcopy(self._part(groups.pop("")).merged), {}
        changed = {override.key_or_group.split(".")[0] for override in changes}
        for group, files in groups.items():
            if not OmegaConf.is_missing(config, group):
                raise UnusualError(f"{group}: no group, or one that is also set beside its files")
            part = self._part(files)
            if group in changed:
                config[group] = part.merged[group]  # OmegaConf puts a copy there
            else:
                config[group], whole[group] = {}, copy.deepcopy(part.values[group])
        OmegaConf.set_struct(config, True)
        self._apply_overrides_to_config(changes, config)
        return Parts(config, whole, found.overrides.known_choices)

    def _chooses(self, override: Override) -> bool:
        """Return whether a word chooses a file, and changes no value."""
        return self._files.group_exists(override.key_or_group) and not isinstance(override.value(), dict)

    def _find(self, name: str, choices: tuple[str, ...]) -> DefaultsList:
        """Return which files these words choose."""
        parsed = [self._parsed(word) for word in choices]
        return create_defaults_list(self._files, name, parsed, prepend_hydra=False, skip_missing=False)

    def _part(self, files: Sequence[ResultDefault]) -> "_Part":
        key = tuple((file.config_path, file.package) for file in files)
        if key not in self._parts:
            self._parts[key] = _Part(self._compose_config_from_defaults_list(list(files), self._files))
        return self._parts[key]

    def _load_single_config(self, default: ResultDefault, repo: IConfigRepository) -> ConfigResult:
        """Return a file's content as a copy: what has no package, Hydra would merge as it was read."""
        result = super()._load_single_config(default, repo)
        return result if default.package else replace(result, config=copy.deepcopy(result.config))


class _Part:
    """What some files say together."""

    def __init__(self, merged: DictConfig) -> None:
        self.merged = merged

    @cached_property
    def values(self) -> Any:
        """The same as plain values."""
        return OmegaConf.to_container(self.merged, throw_on_missing=True)


class _Files(ConfigRepository):
    """The configuration's files, without what they say to Hydra, and with their angles in radians."""

    def load_config(self, config_path: str) -> ConfigResult | None:
        """Return a file's content, or None if there is none.

        Raises:
            UnusualError: a value refers to another place.
        """
        result = super().load_config(config_path)
        if result is None or result.is_schema_source:
            return result
        if config_path in PRIMARY:
            result.config.pop("hydra")  # type: ignore[attr-defined]
            result.defaults_list = [item for item in result.defaults_list or () if not _is_hydras(item)]
        text = str(OmegaConf.to_container(result.config, resolve=False))
        if "${" in re.sub(ANGLE, "", text):
            raise UnusualError(f"{config_path}: a value that refers to another place")
        if "${" in text:
            _settle(result.config)
        return result


def _is_hydras(item: Any) -> bool:
    return isinstance(item, GroupDefault) and str(item.group).startswith("hydra/")


def _settle(node: Any) -> None:
    """Put each angle's value in its place."""
    for key in range(len(node)) if isinstance(node, ListConfig) else list(node):
        if OmegaConf.is_interpolation(node, key):
            node[key] = node[key]
        elif not OmegaConf.is_missing(node, key) and OmegaConf.is_config(node[key]):
            _settle(node[key])
