"""A trained network drives as in the environments in which it learned, and what is no such network is refused."""

import pickle
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from commands import Command

import navbench

onnx = pytest.importorskip("onnx", reason="needs the extra train")
pytest.importorskip("onnxruntime", reason="needs the extra onnx")
gym = pytest.importorskip("navbench.gym", reason="needs the extra gym")
helper, FLOAT, DOUBLE = onnx.helper, onnx.TensorProto.FLOAT, onnx.TensorProto.DOUBLE


def write(
    file: Path,
    inputs: int | None = 20,
    outputs: int = 2,
    seed: int = 0,
    kind: int = FLOAT,
    ends: int = 1,
    rank: int = 2,
) -> Path:
    """Write a linear network with random weights, which turns to its goal and slows before what is ahead."""
    weights = np.random.default_rng(seed).normal(0.0, 0.05, (inputs or 20, outputs))
    weights[0, 0] = 0.3
    weights[-3, -1] = 1.0
    values = onnx.numpy_helper.from_array(weights.astype(np.float32 if kind == FLOAT else np.float64), "weights")
    sides = ["batch", inputs if inputs else "open"][2 - rank :]
    given = [helper.make_tensor_value_info(f"x{i}", kind, sides) for i in range(ends)]
    answer = helper.make_tensor_value_info("y", kind, ["batch", outputs][2 - rank :])
    nodes = [helper.make_node("MatMul", ["x0", "weights"], ["y"])]
    graph = helper.make_graph(nodes, "policy", given, [answer], [values])
    onnx.save(helper.make_model(graph, opset_imports=[helper.make_opsetid("", 17)], ir_version=9), file)
    return file


@pytest.mark.parametrize("world", ["random_discs", "deadlock"])
def test_it_drives_as_in_the_environment_where_it_learned_to_the_last_bit(world: str, tmp_path: Path) -> None:
    import onnxruntime

    file = write(tmp_path / "mine.onnx")
    noise = "sensors.noise_std_m=0.01"
    ran = navbench.run(noise, controller=file, world=world, simulator="planar", seed=3, episodes=2, workers=1)
    session = onnxruntime.InferenceSession(str(file))
    environment = gym.make_fleet(noise, world=world, seed=3)
    for episode in range(2):
        seen, _ = environment.reset(options={"episode": episode})
        told: dict[str, Any] = {}
        while environment.agents:
            answers = {name: session.run(None, {"x0": one[None]})[0][0] for name, one in seen.items()}
            seen, _, _, _, infos = environment.step({name: np.clip(a, -1.0, 1.0) for name, a in answers.items()})
            told |= {name: info for name, info in infos.items() if info}
        rows = ran.episodes[ran.episodes["episode"] == episode]
        for i, row in enumerate(rows.to_dict("records")):
            info = told[f"robot_{i}"]
            assert row["outcome"] == info["outcome"]
            assert {name: row[name] for name in ("time_s", "path_length_m", "min_clearance_m")} == {
                name: info["metrics"][name] for name in ("time_s", "path_length_m", "min_clearance_m")
            }


def test_it_drives_in_other_processes_and_under_its_own_name(tmp_path: Path) -> None:
    file = write(tmp_path / "mine.onnx")
    one, two = (
        navbench.sweep(controller=[file, "go_to_goal"], world="empty", simulator="planar", episodes=6, workers=workers)
        for workers in (1, 2)
    )
    assert list(one.table["controller"]) == ["mine", "go_to_goal"]
    assert one.episodes.equals(two.episodes)


def test_it_can_be_sent_to_another_process_while_it_drives(tmp_path: Path) -> None:
    from navbench.cli.interface import cells_of

    (cell,) = cells_of([], {"controller": write(tmp_path / "mine.onnx")}).cells
    assert pickle.loads(pickle.dumps(cell.make_controller())).sensor_kind.sensors == 16


def test_another_network_in_the_same_file_is_other_work(command: Command, tmp_path: Path) -> None:
    words = ("controller=policy", "controller.build.path=mine.onnx", "world=empty", "simulator=planar",
             "hydra.run.dir=here")  # fmt: skip
    write(tmp_path / "mine.onnx")
    assert command(*words).code == 0
    assert command(*words).code == 0
    write(tmp_path / "mine.onnx", seed=1)
    refused = command(*words)
    assert refused.code == 2
    assert "holds the results of other work" in refused.err


WRONG = [
    ({"outputs": 3}, "its output must be (1, 2) of float32, and is float of (batch, 3)"),
    ({"inputs": 3}, "its input must be (1, n_sensors + 4) of float32, and is float of (batch, 3)"),
    ({"kind": DOUBLE}, "its input must be (1, n_sensors + 4) of float32, and is double of (batch, 20)"),
    ({"ends": 2}, "must have one input, and has 2"),
    (
        {"inputs": 14},
        "sensors=ring16: policy needs 10 range sensors, as its network was trained with; this suite has 16",
    ),
]


@pytest.mark.parametrize(("form", "says"), WRONG)
def test_a_network_of_another_form_is_refused_in_one_line(
    form: dict[str, int], says: str, command: Command, tmp_path: Path
) -> None:
    write(tmp_path / "mine.onnx", **form)
    done = command("controller=policy", "controller.build.path=mine.onnx", "world=empty")
    assert done.code == 2
    assert says in done.err
    assert done.err.count("\n") == 1


def test_what_is_no_network_is_refused_in_one_line(command: Command, tmp_path: Path) -> None:
    (tmp_path / "mine.onnx").write_text("nothing of the kind")
    for path, says in (
        ("nope.onnx", "controller.build.path=nope.onnx: No such file or directory"),
        ("mine.onnx", "controller.build.path=mine.onnx: is no network that onnxruntime reads"),
        (".", "controller.build: .: must be a file, and no directory"),
    ):
        done = command("controller=policy", f"controller.build.path={path}", "world=empty")
        assert done.code == 2
        assert says in done.err
        assert done.err.count("\n") == 1
    done = command("controller=policy", "world=empty")
    assert done.code == 2
    assert "controller.build.path: missing; a value is needed" in done.err


def test_without_onnxruntime_it_says_what_to_install(
    command: Command, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    import sys

    from navbench.controllers.learned import policy

    write(tmp_path / "mine.onnx", seed=7)
    policy._network.cache_clear()
    monkeypatch.setitem(sys.modules, "onnxruntime", None)
    done = command("controller=policy", "controller.build.path=mine.onnx", "world=empty")
    assert done.code == 2
    assert "needs onnxruntime; pip install 'navbench[onnx]'" in done.err
