"""Whether results are what was planned and written, by the code and packages that are installed; nothing is run."""

from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from navbench.cli.limits import check_directory
from navbench.cli.progress import UNFINISHED
from navbench.cli.words import sort_words
from navbench.reading import printable
from navbench.validation import DescriptionError

if TYPE_CHECKING:
    from navbench.experiments.samples import Samples
    from navbench.experiments.store import Results

HELP = """navbench verify DIR...: say whether results are whole, complete, and of the installed code; run nothing

It looks at the manifest, the checksum of every part, the planned episodes and evaluations, the code that made the parts
and the versions of packages, and prints a line for each thing that is missing or other; of a multiverse's
reconstructions it looks at the checksums. What people read (CSV files, tables, pictures) is not looked at: `navbench
report` makes it from the parts.

exit code: 0 if all is well, 3 if something is missing or other, 2 where there are no results
"""
SHOWN_MAX = 8  # names in a line; of more, how many


def verify(arguments: Sequence[str]) -> int:
    """Print what is missing or other in results directories, and return the exit code."""
    words = sort_words(arguments, ())
    from navbench.experiments.parts import KINDS
    from navbench.experiments.samples import PRIOR, Samples
    from navbench.experiments.store import Results

    for word in words.overrides:
        raise DescriptionError(f"{word}: unknown key; verify takes directories alone")
    if not words.names:
        raise DescriptionError("verify: name at least one results directory")
    code = 0
    for name in words.names:
        check_directory(f"verify {name}", Path(name))
        if (Path(name) / PRIOR).is_file():
            code = _verify_samples(Samples(Path(name))) or code
            continue
        results = Results(Path(name))
        problems = list(problems_of(results))
        for problem in problems:
            print(printable(f"{name}: {problem}"))
        if not problems:
            count = sum(len(results.parts(kind, "[!.]")) for kind in KINDS)
            episodes = sum(map(len, results.finished().values()))
            print(printable(f"{name}: all well: {episodes} episodes in {count} parts"))
        code = UNFINISHED if problems else code
    return code


def _verify_samples(samples: "Samples") -> int:
    """Print what is wrong with a multiverse's reconstructions, and return the exit code."""
    from navbench.experiments.samples import PUBLISHED

    faults = samples.faults()
    for file, fault in faults.items():
        print(printable(f"{samples.path}: {file}: {fault}"))
    if faults:
        return UNFINISHED
    count = samples.count()
    said = f"all well: {count} reconstructions" if count else f"{PUBLISHED}: missing, and there is no block either"
    print(printable(f"{samples.path}: {said}"))
    return 0 if count else UNFINISHED


def problems_of(results: "Results") -> Iterator[str]:
    """Yield what is missing or other in a results directory, a line each.

    Raises:
        DescriptionError: its manifest cannot be read.
    """
    from navbench.experiments.parts import DAMAGED, UNSEALED

    manifest, faults = results.manifest(), results.faults()
    whole = results.manifest_is_whole()
    if not whole:
        yield f"manifest.json: {'no checksum' if whole is None else 'changed since it was written'}"
    if manifest["ended"] is None:
        yield f"manifest.json: the work that began {manifest['began']} has not ended"
    yield from (f"{name}: {fault}" for name, fault in faults.items() if fault == DAMAGED)
    without = Counter(name.partition("/")[0] for name, fault in faults.items() if fault == UNSEALED)
    yield from (f"{kind}: no checksum in {count} parts, of an older navbench" for kind, count in without.items())
    sound = [name for name in results.parts("episodes") if faults.get(f"episodes/{name}") != DAMAGED]
    yield from _episodes(results, manifest, sound)
    yield from _tunings(results, manifest, faults)
    yield from _code(results, manifest, faults)
    yield from _versions(manifest)


def _episodes(results: "Results", manifest: Mapping[str, Any], sound: Sequence[str]) -> Iterator[str]:
    """Yield which episodes are missing of each cell, which are not planned, and what is missing beside them."""
    from navbench.experiments.parts import episodes_of

    planned: dict[str, set[range]] = {}
    told = {}
    for cell in manifest["cells"]:
        indices = range(cell["first_episode"], cell["first_episode"] + cell["episodes"])
        planned.setdefault(cell["run_id"], set()).add(indices)
        told[cell["run_id"]] = f"{cell['label']} in {cell['world']}, seed {cell['seed']}"
    there: dict[str, set[int]] = {}
    for name in sound:
        run_id, episodes = episodes_of(name)
        there.setdefault(run_id, set()).update(episodes)
        if run_id not in planned or not episodes:
            yield f"episodes/{name}: not planned"
        yield from (f"{one}: missing" for one in results.lacking(name))
    count = 0
    for run_id, ranges in planned.items():
        wanted, found = set().union(*ranges), there.get(run_id, set())
        count += len(wanted)
        if missing := wanted - found:
            yield f"{told[run_id]}: {len(missing)} of {len(wanted)} episodes missing, the first is {min(missing)}"
        if more := found - wanted:
            yield f"{told[run_id]}: {len(more)} episodes not planned, the first is {min(more)}"
    if manifest["tunings"] and count < manifest["planned"]["episodes"]:
        yield f"{manifest['planned']['episodes'] - count} planned episodes wait for their tuning"


def _tunings(results: "Results", manifest: Mapping[str, Any], faults: Mapping[str, str]) -> Iterator[str]:
    """Yield which evaluations are missing of each tuning."""
    from navbench.experiments import parts

    for tuning in manifest["tunings"]:
        name, title = f"part-{tuning['tuning_id']}.parquet", f"tuning {tuning['name']}, seed {tuning['seed']}"
        if not results.has("evaluations", name):
            yield f"{title}: evaluations/{name}: missing"
        elif f"evaluations/{name}" not in faults:
            count = parts.read(results.path, f"evaluations/{name}").num_rows
            if count != tuning["budget"]:
                yield f"{title}: {count} of {tuning['budget']} evaluations"
        if manifest.get("checksums") and not results.has("checks", name):
            yield f"{title}: checks/{name}: missing"


def _code(results: "Results", manifest: Mapping[str, Any], faults: Mapping[str, str]) -> Iterator[str]:
    """Yield which modules are not those that made the parts."""
    from navbench.experiments.code import digest_now
    from navbench.experiments.parts import DAMAGED

    codes: Counter[str] = Counter()
    for kind in ("episodes", "evaluations"):
        for name in results.parts(kind):
            if faults.get(f"{kind}/{name}") != DAMAGED:
                codes[results.code_of(kind, name)] += 1
    other: dict[str, int] = {}
    for code, count in codes.items():
        if code not in manifest.get("codes", {}):
            yield f"{count} parts are of code that the manifest does not name"
        for module, digest in manifest.get("codes", {}).get(code, {}).items():
            if digest_now(module) != digest:
                other[module] = other.get(module, 0) + count
    if other:
        names = [*list(other)[:SHOWN_MAX], *([f"{len(other) - SHOWN_MAX} more"] if len(other) > SHOWN_MAX else [])]
        yield f"{max(other.values())} parts are of other code than is here: {', '.join(names)}"


def _versions(manifest: Mapping[str, Any]) -> Iterator[str]:
    """Yield which versions are not those that made the parts."""
    import platform
    from importlib.metadata import PackageNotFoundError, version

    here = {"Python": platform.python_version()}
    for name in manifest["versions"]:
        try:
            here[name] = version(name)
        except (PackageNotFoundError, ValueError):
            here[name] = "none"
    for name, made in {"Python": manifest["python"], **manifest["versions"]}.items():
        if here[name] != made:
            yield f"{name}: made with {made}, here is {here[name]}"
