"""What an agreement with a claim is worth, told from the sources of the values that its cells use.

- *fitted*: a value was fitted to this very claim.
- *selected*: a value was selected in a world of the claim's cells, or fitted in one to another claim. A value of a
  world was fitted in that world, any other in the worlds of the claims that it was fitted to.
- *layout_unknown*: what stands in a world, or its starts or goals, is assumed.
- *free*: none of these.

The first that holds counts. What was measured on a table that a controller offers of itself depends on that
controller's values alone.
"""

from collections.abc import Iterable, Iterator, Mapping, Set
from typing import Any, NamedTuple

from navbench.analysis.stored import Used

EVIDENCE = ("free", "selected", "fitted", "layout_unknown")
STRENGTH = ("fitted", "selected", "layout_unknown")
PARTS = ("controller", "world", "robot", "sensors", "simulator")
LAYOUT = ("boxes", "discs", "polygons", "walls", "movers", "starts", "goals")


class Value(NamedTuple):
    """A value that was chosen here.

    Attributes:
        name: its thing's and its own, such as "deadlock.boxes".
        world: the world that it is of, or empty.
        kind: "fitted", "selected" or, of what stands in a world, "assumed".
        where: the ids of the claims that it was fitted to, or the worlds in which it was selected.
    """

    name: str
    world: str
    kind: str
    where: frozenset[str]


def evidence_of(manifest: Mapping[str, Any], used: Mapping[str, Used]) -> dict[str, tuple[str, str]]:
    """Return for each claim what an agreement is worth, and which values make it so.

    Args:
        manifest: of the results.
        used: by the claims' ids what they were measured on.
    """
    cells = {cell["run_id"]: cell for cell in manifest["cells"]}
    runs = {claim: {run_id for _, _, run_id in of.cells if run_id} for claim, of in used.items()}
    worlds = {claim: {cells[run_id]["world"] for run_id in of} for claim, of in runs.items()}
    values = {run_id: set(_values(cell, manifest)) for run_id, cell in cells.items()}
    found = {}
    for claim, of in used.items():
        own = {value for run_id in runs[claim] for value in values[run_id]}
        described = {cell["controller"]: cell for cell in cells.values() for t in of.tables if _offers(cell, t)}
        own |= {value for cell in described.values() for value in _of_part(cell, "controller", manifest)}
        reasons = [reason for value in own if (reason := _reason(claim, value, worlds))]
        strongest = next((kind for kind in STRENGTH if any(kind == one for one, _, _ in reasons)), "free")
        found[claim] = strongest, _told((how, name) for kind, how, name in reasons if kind == strongest)
    return found


def _values(cell: Mapping[str, Any], manifest: Mapping[str, Any]) -> Iterator[Value]:
    """Yield what was chosen of a cell's values, and of the tuner and objective that searched them."""
    for part in PARTS:
        yield from _of_part(cell, part, manifest)
    for tuning in manifest["tunings"]:
        if tuning["name"] == cell["tuning"]:
            for part, sources in (tuning.get("sources") or {}).items():
                yield from _chosen(tuning[part], "", sources, manifest)


def _of_part(cell: Mapping[str, Any], part: str, manifest: Mapping[str, Any]) -> Iterator[Value]:
    return _chosen(cell[part], cell[part] if part == "world" else "", cell["sources"].get(part) or {}, manifest)


def _chosen(
    name: str, world: str, sources: Mapping[str, Mapping[str, Any]], manifest: Mapping[str, Any]
) -> Iterator[Value]:
    own = f"{(manifest.get('study') or {}).get('name', '')}."
    for key, source in sources.items():
        of = f"{name}.{key.removeprefix('build.')}"
        if "fitted" in source:
            yield Value(of, world, "fitted", frozenset(one.removeprefix(own) for one in source.get("claims", ())))
        elif "selected" in source:
            yield Value(of, world, "selected", frozenset(source.get("worlds", ())))
        elif "assumed" in source and world and key.split(".")[0] in LAYOUT:
            yield Value(of, world, "assumed", frozenset())


def _offers(cell: Mapping[str, Any], table: str) -> bool:
    return table.startswith(f"{cell['controller']}-")


def _reason(claim: str, value: Value, worlds: Mapping[str, Set[str]]) -> tuple[str, str, str] | None:
    """Return what a value makes of a claim, how, and the value's name; None where it does not touch it."""
    if value.kind == "assumed":
        return "layout_unknown", "assumed", value.name
    if value.kind == "fitted" and claim in value.where:
        return "fitted", "fitted to it", value.name
    chosen_in = (
        value.where if value.kind == "selected" else {value.world}.union(*(worlds.get(c, ()) for c in value.where))
    )
    there = sorted(worlds[claim] & chosen_in)
    return ("selected", f"{value.kind} in {', '.join(there)}", value.name) if there else None


def _told(reasons: Iterable[tuple[str, str]]) -> str:
    """Return the names of values by what was done with them, as words."""
    names: dict[str, list[str]] = {}
    for how, name in sorted(reasons):
        names.setdefault(how, []).append(name)
    return "; ".join(f"{', '.join(of)} {how}" for how, of in names.items())
