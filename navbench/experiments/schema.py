"""The form of a manifest: it may come from anybody, and is held against this before it is believed."""

import json
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Annotated, Any

from pydantic import AfterValidator, BaseModel, ConfigDict, Field, ValidationError

from navbench.metrics import Metric
from navbench.reading import bounded, check_name
from navbench.validation import DescriptionError

SCHEMA_VERSION = 1
LONGEST = 2**28  # bytes of a manifest
WORD_MAX = 1000  # characters
ENTRIES_MAX = 10**5  # cells, tunings
EPISODES_MAX = 10**6  # of a cell
WHOLE_MAX = 2**63 - 1  # what a column of whole numbers holds

Word = Annotated[str, Field(max_length=WORD_MAX)]
Name = Annotated[str, Field(max_length=WORD_MAX), AfterValidator(check_name)]  # of a file
Whole = Annotated[int, Field(ge=-1, le=WHOLE_MAX)]
Episodes = Annotated[int, Field(ge=0, le=EPISODES_MAX)]
Values = Mapping[str, Any]
Sources = Mapping[str, Mapping[str, Values] | None]
Claims = Mapping[str, Values] | Sequence[Values] | None  # a list in older results: who reads it refuses it


class ResultsError(DescriptionError):
    """A results directory that cannot be read or must not be written to."""


class _Form(BaseModel):
    model_config = ConfigDict(strict=True)


class _World(_Form):
    goal_tolerance_m: float
    time_limit_s: float


class _Configuration(_Form):
    controller: Values
    world: _World
    robot: Values
    sensors: Values
    simulator: Values


class _Cell(_Form):
    name: Word
    label: Word
    controller: Word
    world: Word
    robot: Word
    sensors: Word
    simulator: Word
    config_hash: Word
    run_id: Name
    seed: Whole
    episodes: Episodes
    first_episode: Episodes
    tuning: Word
    tuning_seed: Whole
    configuration: _Configuration
    sources: Sources


class _Searched(_Form):
    tuner: Values
    objective: Values
    tunable: Mapping[str, Values] = {}


class _Tuning(_Form):
    name: Word
    tuner: Word
    objective: Word
    controller: Word
    worlds: Sequence[Word]
    config_hash: Word
    tuning_id: Name
    seed: Whole
    budget: Whole
    configuration: _Searched
    sources: Sources | None = None


class _Study(_Form):
    name: Name
    title: str = ""
    summary: str | None = None
    config_dir: str | None = None
    claims: Claims = None
    checks: Claims = None
    questions: Claims = None
    report: Sequence[Values | str] | None = None


class _Planned(_Form):
    episodes: Whole


class _Manifest(_Form):
    schema_version: int
    study: _Study | None
    planned: _Planned
    cells: Annotated[Sequence[_Cell], Field(max_length=ENTRIES_MAX)]
    tunings: Annotated[Sequence[_Tuning], Field(max_length=ENTRIES_MAX)]
    versions: Mapping[str, Word]
    python: Word
    platform: Word
    began: Word
    ended: Word | None
    metrics: Sequence[Metric] = ()
    commit: Word | None = None
    code: Mapping[str, Word] = {}
    codes: Mapping[str, Mapping[str, Word]] = {}
    resumed: Sequence[Values] = ()
    checksums: bool = False


def read_manifest(file: Path) -> dict[str, Any]:
    """Return what a manifest says, as plain values.

    Raises:
        ResultsError: it is none, of another version of the format, or wrong; the message names the key.
    """
    data = bounded(file, LONGEST)
    try:
        manifest: dict[str, Any] = json.loads(data)
        found = manifest["schema_version"]
    except (ValueError, KeyError, TypeError, RecursionError):
        raise ResultsError(f"{file}: is no manifest of navbench") from None
    if found != SCHEMA_VERSION:
        raise ResultsError(f"{file}: schema_version={found}, but this navbench reads {SCHEMA_VERSION}")
    if "began" not in manifest and (file.parent / "report.md").is_file():
        raise ResultsError(f"{file.parent}: a study's report without its episodes; `navbench study NAME` runs them")
    try:
        _Manifest.model_validate_json(data)
    except ValidationError as error:
        first = error.errors(include_url=False)[0]
        place = "".join(f"[{part}]" if isinstance(part, int) else f".{part}" for part in first["loc"])
        said = first["msg"].replace("Input should be", "must be").removeprefix("Value error, ")
        raise ResultsError(f"{file}: {place.lstrip('.')}: {said}") from None
    manifest.pop("seal", None)
    return manifest
