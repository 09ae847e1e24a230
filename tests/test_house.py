"""The shape of the house: floors, packaging, and what may import what."""

import ast
import re
import tomllib
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
PACKAGE = ROOT / "navbench"

FLOORS = {
    "0 words and mathematics": (
        "contract fuzzy geometry kinematics memberships metrics search statistics streams tuner_bridge tuners"
    ),
    "1 descriptions": "description record robot sensors simulation world",
    "2 physics": "drive motion rays simulator",
    "3 one episode": "episode perception similarity",
    "4 many episodes": "cells engines running store studies tunings",
    "5 reading": (
        "claims comparison convergence figures markup measures phases provenance reading reports sections "
        "study_figures study_tables tables"
    ),
    "6 door": (
        "__init__ building catalogue cli configuration errors interface schema study_configuration sweeps verbs"
    ),
}
FLOOR = {module: int(floor[0]) for floor, modules in FLOORS.items() for module in modules.split()}
MODULES = sorted(path.stem for path in PACKAGE.glob("*.py"))


def imports_of(path: Path) -> set[str]:
    """Every module that a file imports, anywhere in it."""
    found: set[str] = set()
    for node in ast.walk(ast.parse(path.read_text())):
        if isinstance(node, ast.Import):
            found |= {alias.name for alias in node.names}
        elif isinstance(node, ast.ImportFrom):
            assert node.level == 0, f"{path}: relative import"
            found |= {f"{node.module}.{alias.name}" for alias in node.names} | {str(node.module)}
    return found


def own_imports(module: str) -> set[str]:
    names = {name.split(".")[1] for name in imports_of(PACKAGE / f"{module}.py") if name.startswith("navbench.")}
    return names & set(MODULES)


def test_every_module_stands_on_a_floor() -> None:
    assert sorted(FLOOR) == MODULES


@pytest.mark.parametrize("module", MODULES)
def test_an_import_only_goes_down(module: str) -> None:
    for other in own_imports(module):
        assert FLOOR[other] <= FLOOR[module], f"{module} imports {other}, which stands above it"


def test_reading_needs_nothing_that_runs() -> None:
    for module in [*FLOORS["5 reading"].split(), "store"]:
        below = {other for other in own_imports(module) if other != "store"}
        assert {FLOOR[other] for other in below} <= {0, 1, 5}, f"{module} imports {below}"


@pytest.mark.parametrize(
    ("library", "allowed"),
    [
        ("pybullet", {"simulator"}),
        ("hydra", set(FLOORS["6 door"].split())),
        ("omegaconf", set(FLOORS["6 door"].split())),
    ],
)
def test_a_library_stands_behind_one_door(library: str, allowed: set[str]) -> None:
    users = {m for m in MODULES if any(n.split(".")[0] == library for n in imports_of(PACKAGE / f"{m}.py"))}
    assert users
    assert users <= allowed


def test_the_framework_never_imports_a_controller() -> None:
    for module in MODULES:
        assert not any(name.startswith("navbench.controllers") for name in imports_of(PACKAGE / f"{module}.py"))


def test_a_controller_sees_only_the_contract_and_mathematics() -> None:
    for path in (ROOT / "controllers").glob("*.py"):
        own = [name for name in imports_of_controller(path) if name.startswith("navbench.")]
        for name in own:
            module = name.split(".")[1]
            assert module == "controllers" or FLOOR[module] == 0 or module == "description", f"{path.name}: {name}"


def imports_of_controller(path: Path) -> set[str]:
    return {
        node.module
        for node in ast.walk(ast.parse(path.read_text()))
        if isinstance(node, ast.ImportFrom) and node.level == 0 and node.module
    }


def test_every_subpackage_is_listed_for_the_wheel() -> None:
    listed = set(tomllib.loads((ROOT / "pyproject.toml").read_text())["tool"]["setuptools"]["packages"])
    inside = {path.parent for path in PACKAGE.rglob("__init__.py") if path.parent.name not in ("conf", "controllers")}
    tree = {"navbench", "navbench.conf", "navbench.controllers"}
    tree |= {".".join(folder.relative_to(ROOT).parts) for folder in inside}
    assert listed == tree


def test_no_module_is_longer_than_400_lines() -> None:
    for path in [*PACKAGE.glob("*.py"), *(ROOT / "controllers").glob("*.py")]:
        assert len(path.read_text().splitlines()) <= 400, path.name


def test_the_version_is_the_same_everywhere() -> None:
    version = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]["version"]
    assert f'__version__ = "{version}"' in (PACKAGE / "__init__.py").read_text()
    assert re.search(rf"^version: {re.escape(version)}$", (ROOT / "CITATION.cff").read_text(), re.M)
    assert f"## {version}" in (ROOT / "CHANGELOG.md").read_text()
