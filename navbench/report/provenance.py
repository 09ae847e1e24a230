"""The section of a report that lists every parameter with its value and where it comes from."""

import json
import re
from collections import Counter
from collections.abc import Iterable, Iterator, Mapping
from typing import Any

from navbench.analysis.stored import leaves_of
from navbench.report.document import MISSING, Blocks, Column, Data, Paragraph
from navbench.report.page import Page
from navbench.sources import KINDS

PARTS = ("controller", "world", "robot", "sensors", "simulator")
COLUMNS = tuple(
    map(Column, ("part", "name", "parameter", "value", "source", "which, or why", "another reader might take"))
)
LONGEST = 60  # of a value in the printed table; the CSV holds it whole


def sources(page: Page) -> Blocks:
    """Return every parameter of every controller, world, robot, sensor suite, simulator and tuner that was used."""
    manifest = page.stored.manifest
    raw = _joined([*_parts(manifest), *_tuners(manifest)])
    counts = Counter(row["source"] for row in raw)
    told = ", ".join(f"{counts[kind]} {kind}" for kind in (*KINDS, MISSING) if kind in counts)
    rows = [[_shown(row) if key == "value" else row[key] for key in row if key != "also"] for row in raw]
    data = Data(list(raw[0]), [list(row.values()) for row in raw])
    return [Paragraph(f"{len(raw)} parameters by source: {told}."), page.table(COLUMNS, rows, data)]


def _shown(row: Mapping[str, str]) -> str:
    """Return a value as it is printed: short, with the others that it takes."""
    value = re.sub(r"\d+\.\d{7,}", lambda digits: f"{float(digits[0]):.6g}", row["value"])
    value = value if len(value) <= LONGEST else value[: LONGEST - 1] + "…"
    return value + (f" (also {row['also']})" if row["also"] else "")


def _parts(manifest: Mapping[str, Any]) -> Iterator[dict[str, str]]:
    """Yield a row a parameter of the cells' parts, in the order of the parts and names."""
    for part in PARTS:
        for name in sorted({cell[part] for cell in manifest["cells"]}):
            cells = [cell for cell in manifest["cells"] if cell[part] == name]
            for key in dict.fromkeys(key for cell in cells for key in cell["sources"].get(part) or {}):
                source = next(cell["sources"][part][key] for cell in cells if key in (cell["sources"].get(part) or {}))
                tuned = {cell["tuning"] for cell in cells if cell["tuning"]} if _is_tuned(manifest, key) else set()
                kept = [cell["configuration"][part] for cell in cells if not (tuned and cell["tuning"])]
                if part == "controller":  # what a tuning searches stands with the tunings
                    kept += [t["configuration"] for t in manifest["tunings"] if t["controller"] == name]
                values = dict.fromkeys(_value(configuration, key) for configuration in kept)
                if set(values) - {MISSING}:
                    yield _row(part, name, key, [value for value in values if value != MISSING], source)
                if tuned:
                    where = f"this study's tunings {', '.join(sorted(tuned))}"
                    yield _row(part, name, key, ["see the tunings"], {"tuned": where})


def _tuners(manifest: Mapping[str, Any]) -> Iterator[dict[str, str]]:
    """Yield a row a parameter of the tuners and objectives, once each."""
    seen: set[tuple[str, str]] = set()
    for tuning in manifest["tunings"]:
        for part in ("tuner", "objective"):
            if (part, tuning[part]) in seen:
                continue
            seen.add((part, tuning[part]))
            values = tuning["configuration"][part]
            given = (tuning.get("sources") or {}).get(part) or {}
            for key in (key for key, _ in leaves_of(values) if key.rpartition(".")[2] != "_target_"):
                source: Mapping[str, Any] = next((given[k] for k in given if key == k or key.startswith(f"{k}.")), {})
                yield _row(part, tuning[part], key, [_value(values, key)], source)


def _joined(rows: Iterable[dict[str, str]]) -> list[dict[str, str]]:
    """Return the rows with those joined that differ in their things' names alone, as those of a shared part do."""
    joined: dict[tuple[str, ...], dict[str, str]] = {}
    for row in rows:
        same = joined.setdefault(tuple(row[key] for key in ("part", "parameter", "value", "source", "why")), row)
        if same is not row:
            same["name"] = ", ".join((same["name"], row["name"]))
            same["also"] = ", ".join(dict.fromkeys(word for word in (same["also"], row["also"]) if word))
    return list(joined.values())


def _row(part: str, name: str, key: str, values: list[str], source: Mapping[str, Any]) -> dict[str, str]:
    kind = next((kind for kind in KINDS if kind in source), MISSING)
    chosen, varied = source.get("claims") or source.get("worlds"), source.get("range") or source.get("choices")
    return {
        "part": part,
        "name": name,
        "parameter": key,
        "value": values[0],
        "also": ", ".join(values[1:]),
        "source": kind,
        "why": str(source.get(kind, "")) + (f" ({', '.join(chosen)})" if chosen else ""),
        "range": json.dumps(varied) if varied else "",
    }


def _is_tuned(manifest: Mapping[str, Any], key: str) -> bool:
    return any(key == f"build.{name}" for t in manifest["tunings"] for name in t["configuration"].get("tunable", {}))


def _value(values: Any, key: str) -> str:
    """Return a parameter's value as words; a dash where the cells do not hold it."""
    for word in key.split("."):
        if not isinstance(values, Mapping) or word not in values:
            return MISSING
        values = values[word]
    if isinstance(values, str):
        return values
    return json.dumps(values, ensure_ascii=False).replace('"', "")
