"""What may be wrong with a configuration, each as one short line."""

import re
from collections.abc import Iterable, Iterator, Sequence
from contextlib import contextmanager
from operator import itemgetter
from pathlib import Path
from typing import Any

import yaml
from hydra.core.override_parser.overrides_parser import OverridesParser
from hydra.errors import HydraException, MissingConfigException, OverrideParseException
from omegaconf import DictConfig, ListConfig, OmegaConf
from omegaconf.errors import ConfigAttributeError, ConfigKeyError, OmegaConfBaseException

from navbench.cli.catalogue import elsewhere
from navbench.raised import shortened
from navbench.validation import HERE, DescriptionError, instead

CONFIGURATION_ERRORS = (
    *(DescriptionError, HydraException, OmegaConfBaseException, OSError, yaml.YAMLError),
    *(OverflowError, RecursionError),  # of a number beyond what a float holds, of lists in lists
)

ALLOWED = {  # what OmegaConf says, and what it means to a reader
    "converted to Integer": "must be a whole number",
    "converted to Float": "must be a number",
    "not a valid bool": "must be true or false",
    "is not Optional|Incompatible value 'None'": "must not be null",
    "is not a ListConfig": "must be a list",
    "is not a subclass of|Cannot assign .* to Dict": "must be a mapping",
    "Cannot convert .* to string": "must be a word",
    "does not support deletion": "cannot be removed",
    "Missing mandatory value": "missing; a value is needed",
}


def one_line(error: BaseException) -> str:
    """Return an error as one short line that names the key and what is allowed."""
    cause = error if isinstance(error, OmegaConfBaseException) else error.__cause__ or error.__context__
    if isinstance(error, MissingConfigException) and error.options and error.missing_cfg_file:
        group, _, name = error.missing_cfg_file.rpartition("/")
        choices = [option for option in error.options if not option.startswith("_")]
        return f"{group}={name}: unknown choice; {elsewhere(group, name) or instead(name, choices)}"
    if isinstance(error, OverrideParseException):
        return f"{error.override}: cannot be read; a word is key=value, and a value of unusual characters needs quotes"
    if several := re.match(r"Ambiguous value for argument '([^=]*)=(.*)'", str(error)):
        return (
            f"{several[1]}={several[2]}: must be one value; only a sweep, with --multirun, takes several, "
            f"and a list is {several[1]}=[{several[2]}]"
        )
    if isinstance(error, OSError) and error.strerror:
        return f"{shortened(str(error.filename), 200)}: {error.strerror}" if error.filename else error.strerror
    if isinstance(error, OverflowError) and (key := re.search(r"full_key: (\S+)", str(error))):
        return f"{key[1]}: must be a number, and is too large for one"
    if isinstance(error, RecursionError):
        return "lists and mappings are nested too deeply"
    if isinstance(error, yaml.MarkedYAMLError) and error.problem_mark is not None:
        return f"{error.problem_mark.name}, line {error.problem_mark.line + 1}: {error.problem}"
    if not isinstance(error, DescriptionError) and isinstance(cause, OmegaConfBaseException):
        return _wrong_value(str(error), cause, getattr(error, "__notes__", ()))
    dropped = ("Config search path", "provider=", "See https:", "Set the environment variable")
    lines = [line.strip() for line in str(error).splitlines()]
    kept = " ".join(line for line in lines if line and not line.startswith(dropped))
    return kept or " ".join(lines) or type(error).__name__


@contextmanager
def one_line_errors() -> Iterator[None]:
    """Turn what is wrong with a configuration, a file or a path into a ``DescriptionError`` of one line."""
    try:
        yield
    except (*CONFIGURATION_ERRORS, ValueError) as error:
        raise DescriptionError(" ".join(one_line(error).split())) from None


def texts(words: Sequence[object]) -> list[str]:
    """Return words that a program gives; raises ``DescriptionError`` where one is none."""
    for word in words:
        if not isinstance(word, str):
            raise DescriptionError(f"{word!r:.80}: must be a word, such as 'episodes=10'")
    return [str(word) for word in words]


def path_of(key: str, given: object) -> Path:
    """Return a path that a program gives; raises ``DescriptionError`` where it is none."""
    if not isinstance(given, str | Path) or str(given) == "" or "\0" in str(given):
        raise DescriptionError(f"{key}={given!r:.80}: must be a path")
    return Path(given)


def check_flags(**flags: object) -> None:
    """Check what a program says yes or no to; raises ``DescriptionError`` where it says neither."""
    for key, given in flags.items():
        if not isinstance(given, bool):
            raise DescriptionError(f"{key}={given!r:.80}: must be True or False")


def _wrong_value(text: str, cause: OmegaConfBaseException, folders: Iterable[str]) -> str:
    """Return what is wrong with one value, from what Hydra says of the word or file and OmegaConf of the value."""
    word = re.search(r"Error merging override ([^\n]+)|To append to your config use \+([^\n]+)", text)
    file = re.match(r"In '([^']+)'", text)
    key, unknown = str(cause.full_key or ""), isinstance(cause, ConfigAttributeError | ConfigKeyError)
    if file and not key:  # OmegaConf says of a wrong kind inside a file neither which key nor, rightly, which kind
        return f"{file[1]}.yaml: {str(cause).splitlines()[0]}; a list stands where a mapping belongs, or the reverse"
    given = word[1] or word[2] if word else ""
    place = next(iter(_places_of(given, cause) if given else _places_in(file[1], folders, cause) if file else ()), None)
    if unknown and isinstance(cause.key, str):
        allowed = [str(name) for name in cause.parent_node or () if name not in ("hydra", "sources")]
        parent = (place or key).rpartition(".")[0]
        whole = f"{parent} is null here; set the whole mapping, as {parent}={{{cause.key}: {given.partition('=')[2]}}}"
        last = given.partition("=")[0].rpartition(".")[2] or str(cause.key)
        meant = [f"did you mean {parent and parent + '.'}{name}?" for name in _inside(cause, last)[:1]]
        other = instead(cause.key, allowed, HERE) if allowed else whole
        complaint = f"{place or key}: unknown key; {meant[0] if meant else other}"
    else:
        value = re.match(r"Value '([^'\n]+)' of type", str(cause)) if file else None
        complaint = f"{place or given or key}{f'={value[1]}' if value else ''}: {_allowed(cause)}"
    return f"{file[1]}.yaml: {complaint}" if file else complaint


def _places_of(word: str, cause: OmegaConfBaseException) -> list[str]:
    """Return the places, in the lists and mappings of a word, of a value that OmegaConf names by its last key alone."""
    override = OverridesParser.create().parse_override(word)
    whole: Any = OmegaConf.to_container(OmegaConf.create({"": override.value()}))
    return _places(override.key_or_group, whole[""], cause)


def _places_in(file: str, folders: Iterable[str], cause: OmegaConfBaseException) -> list[str]:
    """Return the same of a file of the catalogue, where it lies in one of some folders."""
    found = [path for folder in folders if (path := Path(folder, f"{file}.yaml")).is_file()]
    if not found or "." in str(cause.full_key):
        return []
    return [
        place.partition("=")[0]
        for place in _places(file.partition("/")[0], yaml.safe_load(found[0].read_text(encoding="utf-8")), cause)
    ]


def _places(top: str, whole: Any, cause: OmegaConfBaseException) -> list[str]:
    """Return the places of such a value below a key, those first whose neighbours are what OmegaConf knows."""
    known = [str(key) for key in cause.parent_node or ()]
    inside: list[tuple[str, Any, int]] = [(top, whole, 0)]
    places: list[tuple[int, str]] = []
    for place, value, strangers in inside:  # which grows
        if isinstance(value, dict):
            count = len(set(map(str, value)).difference(known))
            inside += [(f"{place}.{key}", inner, count) for key, inner in value.items()]
        elif isinstance(value, list):
            inside += [(f"{place}[{key}]", inner, 0) for key, inner in enumerate(value)]
        if place.endswith(f".{cause.key}") and "." in place.removeprefix(top):
            if isinstance(cause, ConfigKeyError | ConfigAttributeError):
                places.append((strangers, place))
            elif isinstance(value, str) and repr(value) in str(cause):
                places.append((strangers, f"{place}={value!r}"))
    return [place for _, place in sorted(places, key=itemgetter(0))]


def _inside(cause: OmegaConfBaseException, last: str) -> list[str]:
    """Return the places below the mapping with an unknown key that end with a name, the nearest first."""
    node = cause.parent_node
    beside: Any = OmegaConf.to_container(node) if isinstance(node, DictConfig) else {}
    inside: list[tuple[tuple[str, ...], Any]] = [
        ((str(key),), value) for key, value in beside.items() if key not in ("hydra", "sources")
    ]
    for path, value in inside:  # which grows
        if isinstance(value, dict):
            inside += [((*path, str(key)), inner) for key, inner in value.items() if key != "sources"]
    return [".".join(path) for path, _ in inside if len(path) > 1 and path[-1] == last]


def _allowed(cause: OmegaConfBaseException) -> str:
    first = str(cause).splitlines()[0]
    if first.startswith("Cannot merge"):
        return "must be a list" if isinstance(cause.parent_node, ListConfig) else "must be a mapping"
    return next((said for pattern, said in ALLOWED.items() if re.search(pattern, first)), first)
