"""A template of one's own: a commented configuration, code where it needs some, and a test; it runs as it is."""

import importlib.util
import keyword
import os
import re
import shlex
from collections.abc import Mapping, Sequence
from pathlib import Path
from string import Template

import navbench
from navbench.cli.catalogue import CONF
from navbench.cli.words import sort_words
from navbench.experiments.files import replacing
from navbench.validation import DescriptionError, instead

HELP = """navbench new controller|world|robot|sensors|study NAME: write a template that runs, to change into your own

  --config-dir DIR                                  the folder of your configurations; default conf, made where missing
  compiled=true                                     a controller as a compiled policy, many times as fast in planar

It writes DIR/GROUP/NAME.yaml and test_GROUP_NAME.py, for a controller NAME.py as well, and prints how to run and to
test them. What is there is never overwritten.
"""
RUN = {  # the words that run what was written
    "controller": "controller=$name world=corner",
    "world": "controller=sflc world=$name",
    "robot": "controller=sflc world=empty robot=$name",
    "sensors": "controller=dual_layer world=deadlock sensors=$name",
    "study": "study $name",
}
RESERVED = {  # what is no name on a command line, or no name of a file on Windows
    *("null", "nan", "inf", "con", "prn", "aux", "nul"),
    *(f"{port}{number}" for port in ("com", "lpt") for number in range(10)),
}
TEMPLATES = Path(navbench.__file__).parent / "templates"


def new(arguments: Sequence[str]) -> int:
    """Write the files of one template and print how to run them."""
    words = sort_words(arguments)
    compiled = words.overrides == ["compiled=true"] and words.names[:1] == ["controller"]
    if words.overrides and not compiled:
        raise DescriptionError(f"{words.overrides[0]}: the only such word is compiled=true, of a controller")
    if len(words.names) != 2 or words.names[0] not in RUN:
        given = words.names[0] if words.names else ""
        which = instead(given, RUN, "there are") if given not in RUN else f"such as `navbench new {given} mine`"
        raise DescriptionError(f"{' '.join(['new', *words.names])}: name a group and a name; {which}")
    group, name = words.names
    conf = words.config_dir or "conf"
    _check_name(group, name, Path(conf))
    fills = {"name": name, "Class": name.title().replace("_", ""), "conf": Path(os.path.relpath(conf)).as_posix()}
    places = {
        "conf.yaml": Path(conf, group, f"{name}.yaml"),
        "compiled.py" if compiled else "code.py": Path(f"{name}.py"),
    }
    places["test.py"] = Path(f"test_{group}_{name}.py")
    files = {TEMPLATES / group / f"{kind}.txt": place for kind, place in places.items()}
    _write({place: _filled(file, fills) for file, place in files.items() if file.is_file()})
    navbench_in = f"navbench --config-dir {shlex.quote(conf)}"
    print(f"run it:    {navbench_in} {Template(RUN[group]).substitute(fills)}")
    if group == "controller":
        print(f"check it:  {navbench_in} check controller={name} world=corner")
    print(f"test it:   python -m pytest {places['test.py']}")
    return 0


def _check_name(group: str, name: str, conf: Path) -> None:
    """Check that a name is free, and that Python, Hydra and every file system take it."""
    words = keyword.iskeyword(name) or keyword.iskeyword(name.title())  # of the class
    if not re.fullmatch(r"[a-z][a-z0-9_]*", name) or words or name in RESERVED:
        raise DescriptionError(
            f"{name}: must be a Python name of small letters, digits and _ that begins with a letter"
        )
    if (
        CONF / group / f"{name}.yaml"
    ).exists() and conf.resolve() != CONF.resolve():  # of which is said that it is there
        raise DescriptionError(f"{name}: navbench has a {group} of that name; choose another one")
    found = importlib.util.find_spec(name) if group == "controller" else None
    if found is not None and not Path(f"{name}.py").exists():  # of which is said that it is there
        raise DescriptionError(f"{name}: there is a Python module of that name; choose another one")


def _filled(file: Path, fills: Mapping[str, str]) -> str:
    return Template(file.read_text(encoding="utf-8")).substitute(fills)


def _write(texts: Mapping[Path, str]) -> None:
    """Write all files, or none of them, and print their names.

    Raises:
        DescriptionError: one of them is there already.
        OSError: one cannot be written.
    """
    for place in texts:
        if os.path.lexists(place):  # also as a link that leads nowhere
            raise DescriptionError(f"{place}: is there already; choose another name")
    written: list[Path] = []
    try:
        for place, text in texts.items():
            with replacing(place) as temporary:
                temporary.write_text(text, encoding="utf-8", newline="\n")
            written.append(place)
    except BaseException:  # of an interrupt, too
        for place in written:
            place.unlink()
        raise
    for place in texts:
        print(f"wrote:     {place}")
