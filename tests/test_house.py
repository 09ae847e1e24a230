"""The shape of the house: floors, packaging, and what may import what."""

import ast
import os
import re
import subprocess
import sys
import tomllib
import zipfile
from pathlib import Path

import pytest
from hatchling.build import build_wheel

ROOT = Path(__file__).parents[1]
PACKAGE = ROOT / "navbench"

FLOORS = {
    "compiled": 0,  # floor 0: the contract and mathematics
    "memory": 0,
    "contract": 0,
    "mathematics": 0,
    "fuzzy": 0,
    "policy": 0,
    "learning": 0,
    "raised": 0,
    "output": 0,
    "reading": 0,
    "importing": 0,
    "tuning": 0,
    "validation": 0,
    "world": 1,  # descriptions
    "robot": 1,
    "sensors": 1,
    "records": 1,
    "metrics": 1,
    "sources": 1,
    "simulation": 2,
    "episode": 3,
    "experiments": 4,
    "analysis": 5,
    "report": 5,
    "cli": 6,
    "gym": 6,
    "navbench": 6,  # the package itself, with the one function of its Python interface
}
MODULES = {
    ".".join(("navbench", *path.relative_to(PACKAGE).with_suffix("").parts)): path
    for path in sorted(PACKAGE.rglob("*.py"))
}


def place_of(module: str) -> str:
    """The key of a module in FLOORS: its package, or its own name where it stands at the top."""
    top = module.split(".")[1] if "." in module else ""
    return "navbench" if top in ("", "__init__", "__main__") else top


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
    names = {name for name in imports_of(MODULES[module]) if name.split(".")[0] == "navbench" and "." in name}
    return {name for name in names if name in MODULES or name.rpartition(".")[0] not in MODULES}


def test_every_module_stands_on_a_floor() -> None:
    assert {place_of(module) for module in MODULES} == set(FLOORS)


@pytest.mark.parametrize("module", MODULES)
def test_an_import_only_goes_down(module: str) -> None:
    for other in own_imports(module):
        if other not in ("navbench.__version__", "navbench.conf"):
            assert FLOORS[place_of(other)] <= FLOORS[place_of(module)], f"{module} imports {other}, which stands above"


def test_analysis_and_report_need_nothing_that_runs() -> None:
    store = [f"navbench.experiments.{name}" for name in ("store", "rows", "files", "manifest", "parts", "schema")]
    for module in [*store, *(module for module in MODULES if place_of(module) in ("analysis", "report"))]:
        below = {other for other in own_imports(module) if not other.startswith(tuple(store))}
        assert {FLOORS[place_of(other)] for other in below} <= {0, 1, 5}, f"{module} imports {below}"


@pytest.mark.parametrize(
    ("library", "allowed"),
    [("pybullet", "navbench.simulation.bullet"), ("hydra", "navbench.cli"), ("omegaconf", "navbench.cli")],
)
def test_a_library_stands_behind_one_door(library: str, allowed: str) -> None:
    users = {m for m, path in MODULES.items() if any(n.split(".")[0] == library for n in imports_of(path))}
    assert users
    assert all(f"{user}.".startswith(f"{allowed}.") for user in users), users


def test_only_one_file_knows_the_engine() -> None:
    """Not its limits, its package or its name: another simulator would have others."""
    known = {module for module, path in MODULES.items() if "pybullet" in path.read_text().lower()}
    assert known == {"navbench.simulation.bullet"}


def test_the_framework_never_imports_a_controller() -> None:
    for path in MODULES.values():
        assert not any(name.startswith("navbench.controllers") for name in imports_of(path))


def test_a_controller_sees_only_the_contract_and_mathematics() -> None:
    for path in (ROOT / "controllers").rglob("*.py"):
        if path.name in ("measures.py", "sections.py"):  # of a paper's report: they see results, not the controller
            continue
        own = [name for name in imports_of_controller(path) if name.startswith("navbench.")]
        for name in own:
            place = name.split(".")[1]
            allowed = {0, 1, 5} if path.name in ("measures.py", "sections.py") else {0}  # they read what is stored
            assert place == "controllers" or FLOORS[place] in allowed, f"{path.name}: {name}"


def imports_of_controller(path: Path) -> set[str]:
    return {
        node.module
        for node in ast.walk(ast.parse(path.read_text()))
        if isinstance(node, ast.ImportFrom) and node.level == 0 and node.module
    }


def test_a_wheel_holds_the_whole_package_and_finds_its_configuration(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(ROOT)
    wheel = zipfile.ZipFile(tmp_path / build_wheel(str(tmp_path)))
    wheel.extractall(tmp_path / "site")
    kept = {name for name in wheel.namelist() if ".dist-info/" not in name}
    files = [path for top in ("navbench", "conf", "controllers") for path in (ROOT / top).rglob("*") if path.is_file()]
    inside = {path.relative_to(ROOT).as_posix() for path in files if "__pycache__" not in path.parts}
    assert kept == {name if name.startswith("navbench/") else f"navbench/{name}" for name in inside}
    found = import_in(tmp_path, "navbench.conf, navbench.controllers.aouf2019.sflc as sflc", tmp_path / "site")
    assert found.splitlines() == [
        f"['{tmp_path}/site/navbench']",
        f"{tmp_path}/site/navbench/controllers/aouf2019/sflc.py",
    ]


def test_a_script_beside_a_clone_imports_the_package_and_not_the_folder(tmp_path: Path) -> None:
    (tmp_path / "navbench").symlink_to(ROOT)
    found = import_in(tmp_path, "navbench.controllers.aouf2019.sflc as sflc")
    assert found.splitlines() == [str([str(PACKAGE), str(ROOT)]), str(ROOT / "controllers/aouf2019/sflc.py")]


def import_in(folder: Path, what: str, path: Path | None = None) -> str:
    """Run a script of a folder that imports something and prints where navbench and ``sflc`` lie."""
    script = folder / "script.py"
    script.write_text(f"import navbench, {what}\nprint(navbench.__path__)\nprint(sflc.__file__)\n")
    environment = {**os.environ, **({"PYTHONPATH": str(path)} if path else {})}
    done = subprocess.run([sys.executable, script], env=environment, capture_output=True, text=True, check=True)
    return done.stdout


def test_no_file_is_a_link_which_git_would_write_as_text_on_windows() -> None:
    tops = (path for path in ROOT.iterdir() if path.name[0] != "." and path.name != "build")
    assert [path for top in tops for path in (top, *top.rglob("*")) if path.is_symlink()] == []


def test_no_module_is_longer_than_400_lines() -> None:
    for path in [*MODULES.values(), *(ROOT / "controllers").rglob("*.py")]:
        assert len(path.read_text().splitlines()) <= 400, path.name


def test_the_version_is_the_same_everywhere() -> None:
    version = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]["version"]
    assert f'__version__ = "{version}"' in (PACKAGE / "__init__.py").read_text()
    assert re.search(rf"^version: {re.escape(version)}$", (ROOT / "CITATION.cff").read_text(), re.M)
    assert f"## {version}" in (ROOT / "CHANGELOG.md").read_text()
