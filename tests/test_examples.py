"""The examples do what they say."""

import json
import sys
from importlib import import_module
from pathlib import Path

import numpy as np
import pytest

EXAMPLES = Path(__file__).parents[1] / "examples"


@pytest.mark.slow
def test_the_notebook_runs_from_top_to_bottom(tmp_path: Path) -> None:
    nbformat, nbclient = pytest.importorskip("nbformat"), pytest.importorskip("nbclient")
    pytest.importorskip("ipykernel")
    notebook = nbformat.read(EXAMPLES / "first_look.ipynb", as_version=4)
    nbclient.NotebookClient(
        notebook, timeout=900, kernel_name="python3", resources={"metadata": {"path": str(tmp_path)}}
    ).execute()
    told = [output for cell in notebook.cells if cell.cell_type == "code" for output in cell.outputs]
    shown = [output["data"] for output in told if "data" in output]
    assert any("20 of 20 planned episodes" in data.get("text/html", "") for data in shown)
    assert any("image/png" in data for data in shown)
    assert {data["text/plain"] for data in shown if data["text/plain"] in ("True", "np.True_")}
    assert "FAIL" not in "".join(output.get("text", "") for output in told)
    assert (tmp_path / "report/report.html").is_file()


def test_what_the_notebook_imports_of_navbench_is_there() -> None:
    cells = json.loads((EXAMPLES / "first_look.ipynb").read_text())["cells"]
    lines = "".join("".join(cell["source"]) + "\n" for cell in cells if cell["cell_type"] == "code").splitlines()
    named = [line.split() for line in lines if line.startswith("from navbench")]
    assert named
    for _, module, _, *names in named:
        assert all(hasattr(import_module(module), name.rstrip(",")) for name in names)


def test_the_notebook_is_stored_without_what_it_printed() -> None:
    text = (EXAMPLES / "first_look.ipynb").read_text()
    assert '"outputs": []' in text
    assert "image/png" not in text


@pytest.mark.slow
def test_a_policy_that_was_trained_answers_the_same_as_an_onnx_file(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    for module in ("onnx", "onnxruntime", "stable_baselines3", "torch"):
        pytest.importorskip(module, reason="needs the extra train")
    import onnxruntime

    monkeypatch.syspath_prepend(str(EXAMPLES))
    train = import_module("train")
    learner = train.train(1.0, ("world=random_discs",), envs=2)
    train.write_onnx(learner, tmp_path / "trained.onnx")
    session = onnxruntime.InferenceSession(str(tmp_path / "trained.onnx"))
    seen = np.random.default_rng(0).uniform(0.0, 1.0, (5, 20)).astype(np.float32)
    (answers,) = session.run(None, {"observation": seen})
    wanted, _ = learner.predict(seen, deterministic=True)
    np.testing.assert_allclose(np.clip(answers, -1.0, 1.0), wanted, atol=1e-5)
    sys.modules.pop("train")
