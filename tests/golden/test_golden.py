"""Every cell and tuning of the golden set, to the last bit."""

import json
from pathlib import Path
from typing import Any

import pytest
from golden import FILE, JOBS, differences, machine, one

GOLDEN = json.loads(FILE.read_text())


def test_the_golden_set_holds_every_job_and_no_other() -> None:
    assert list(GOLDEN["jobs"]) == [" ".join(job) for job in JOBS]


@pytest.mark.skipif(machine() != GOLDEN["machine"], reason=f"the golden set was made on {GOLDEN['machine']}")
@pytest.mark.parametrize("job", JOBS, ids=" ".join)
def test_a_job_gives_the_golden_numbers(job: tuple[str, str], tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    name, found = one(job)
    wanted: dict[str, Any] = GOLDEN["jobs"][name]
    assert differences(wanted, found) == []
