from pathlib import Path

import pytest

from navbench.analysis.resolving import resolve
from navbench.analysis.stored import reached
from navbench.validation import DescriptionError

HOME = "navbench.analysis.stored"


def test_a_short_name_is_a_function_of_its_home() -> None:
    assert resolve("measure", "reached", HOME, trust=False) is reached


def test_a_dotted_name_within_navbench_needs_no_trust() -> None:
    assert resolve("measure", "navbench.analysis.stored.reached", "navbench.records", trust=False) is reached


def test_a_module_from_outside_is_run_only_where_it_is_trusted(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "outsider.py").write_text("def one():\n    return 1\n")
    monkeypatch.syspath_prepend(tmp_path)
    with pytest.raises(DescriptionError, match=r"measure=outsider\.one: lies outside navbench; --trust"):
        resolve("measure", "outsider.one", HOME, trust=False)
    assert resolve("measure", "outsider.one", HOME, trust=True)() == 1


@pytest.mark.parametrize("name", ["json.dumps", "os.remove", "navbenchmark.remove", "navbench.outputs.evil.run"])
def test_what_lies_outside_is_refused(name: str) -> None:
    with pytest.raises(DescriptionError, match="outside navbench"):
        resolve("measure", name, HOME, trust=False)


@pytest.mark.parametrize("name", ["navbench.analysis.resolving.get_close_matches", "navbench.analysis.stored._PAIR"])
def test_what_our_modules_only_import_or_hide_is_refused(name: str) -> None:
    with pytest.raises(DescriptionError, match="there is no such function"):
        resolve("measure", name, HOME, trust=False)


def test_a_slip_is_told_the_nearest_name() -> None:
    with pytest.raises(DescriptionError, match="measure=reachd: there is no such function; did you mean reached?"):
        resolve("measure", "reachd", HOME, trust=True)


def test_a_module_that_fails_is_told_in_one_line(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "broken.py").write_text("1 / 0\n")
    monkeypatch.syspath_prepend(tmp_path)
    with pytest.raises(DescriptionError, match=r"cannot be imported: ZeroDivisionError: division by zero \(broken"):
        resolve("measure", "broken.one", HOME, trust=True)
