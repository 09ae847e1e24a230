"""Engines of the configuration: what is wrong with one is said in one line, and nothing is begun."""

import sys
from pathlib import Path

import pytest
from commands import Command

CLUSTERS = {"dask": "distributed", "ray": "ray", "slurm": "submitit"}


@pytest.mark.parametrize(("engine", "package"), CLUSTERS.items())
@pytest.mark.parametrize(
    "verb", [("controller=sflc",), ("tune", "controller=pid"), ("study", "aouf2019"), ("multiverse", "aouf2019")]
)
def test_an_engine_that_is_not_installed_is_named_with_its_extra(
    command: Command, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, engine: str, package: str, verb: tuple[str, ...]
) -> None:
    monkeypatch.setitem(sys.modules, package, None)
    monkeypatch.delitem(sys.modules, f"navbench.experiments.clusters.{engine}", raising=False)
    done = command(*verb, f"engine={engine}")
    assert (done.code, done.out) == (2, "")
    assert done.err == f"navbench: engine={engine}: needs {package}; pip install 'navbench[{engine}]'\n"
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize("verb", [("controller=sflc",), ("study", "aouf2019"), ("multiverse", "aouf2019")])
@pytest.mark.parametrize(
    ("word", "said"),
    [
        ("engine=cloud", "engine=cloud: unknown choice; allowed: dask, local, ray, slurm"),
        ("engine.address=here", "engine.address: unknown key"),
        ("workers=-1", "workers=-1: must be at least 0"),
        ("workers=many", "workers=many: must be a whole number"),
    ],
)
def test_a_wrong_engine_is_refused(
    command: Command, tmp_path: Path, verb: tuple[str, ...], word: str, said: str
) -> None:
    done = command(*verb, word)
    assert (done.code, done.out) == (2, "")
    assert said in done.err
    assert not list(tmp_path.iterdir())
