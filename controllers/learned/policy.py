"""A trained network, as ONNX: one input, one output, as the environments of ``navbench.gym`` show and take them.

The input is (1, n_sensors + 4) of float32, the output (1, 2), which is clipped to [-1, 1]; either may leave its first
number open. What they hold stands in ``navbench.learning``. The network keeps nothing from one control period to the
next. It runs on one core, so that the same observation gives the same command in any process.
"""

import hashlib
from collections.abc import Sequence
from functools import lru_cache
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from navbench.contract import Command, Observation, RangeSensor, Setup
from navbench.learning import BESIDE, Scales
from navbench.reading import bounded
from navbench.validation import DescriptionError, NotInstalledError

BYTES_MAX = 2**28  # of a network


class Count(NamedTuple):
    """A ring of so many range sensors."""

    sensors: int

    def __str__(self) -> str:
        """Return it in words."""
        return f"{self.sensors} range sensors, as its network was trained with"

    def lack(self, sensors: Sequence[RangeSensor]) -> str:
        """Return what a suite lacks, empty where it lacks nothing."""
        return "" if len(sensors) == self.sensors else f"this suite has {len(sensors)}"


class Policy:
    """A network that drives.

    Args:
        path: an ONNX file.

    Attributes:
        sensor_kind: how many sensors it needs; None where the network does not say.
        digest: of the file.

    Raises:
        DescriptionError: there is no such file, it is no network of this form, or onnxruntime is missing.
    """

    digest: str = ""

    def __init__(self, path: str) -> None:
        self.path = path
        try:
            data = bounded(Path(path), BYTES_MAX)
        except OSError as error:
            raise DescriptionError(f"path={path}: {error.strerror}") from None
        self.digest = hashlib.sha256(data).hexdigest()[:16]
        self._network = _network(path, data)
        wanted = self._network.inputs
        self.sensor_kind = None if wanted is None else Count(wanted - BESIDE)

    def __reduce__(self) -> tuple[Any, ...]:
        """Travel to another process as the path and what is known of the episode."""
        return Policy, (self.path,), {name: vars(self)[name] for name in ("_scales",) if name in vars(self)}

    def reset(self, setup: Setup, rng: np.random.Generator) -> None:
        """Begin an episode."""
        self._scales = Scales.of(setup)

    def act(self, observation: Observation) -> Command:
        """Return what the network answers."""
        _, pose, goal, v_mps, w_radps, ranges_m, *_ = observation
        seen = self._scales.observed(ranges_m, pose, goal, (v_mps, w_radps))
        (answer,) = self._network.session.run([self._network.answer], {self._network.given: seen[None]})
        v, w = np.clip(answer.reshape(2).astype(np.float64), -1.0, 1.0)
        return Command(float(v * self._scales.v_mps), float(w * self._scales.w_radps))


class _Network(NamedTuple):
    """A network that is ready to run, the names of its input and its output, and how many numbers go in."""

    session: Any
    given: str
    answer: str
    inputs: int | None


@lru_cache(maxsize=8)
def _network(path: str, data: bytes) -> _Network:
    """Return a network, after looking at its form."""
    try:
        import onnxruntime
    except ModuleNotFoundError as error:
        raise NotInstalledError(f"path={path}", error, "onnx") from None
    options = onnxruntime.SessionOptions()
    options.intra_op_num_threads = options.inter_op_num_threads = 1
    options.log_severity_level = 4  # what is wrong is said below
    try:
        session = onnxruntime.InferenceSession(data, options, providers=["CPUExecutionProvider"])
    except Exception as error:  # of onnxruntime's many kinds
        first = " ".join(str(error).split())
        raise DescriptionError(f"path={path}: is no network that onnxruntime reads: {first:.100}") from None
    if len(session.get_inputs()) != 1:
        raise DescriptionError(f"path={path}: must have one input, and has {len(session.get_inputs())}")
    given, answer = session.get_inputs()[0], session.get_outputs()[0]
    if given.type != "tensor(float)" or len(given.shape) != 2:
        raise DescriptionError(f"path={path}: its input must be (1, n_sensors + 4) of float32, and is {_form(given)}")
    count = given.shape[1] if isinstance(given.shape[1], int) else None
    if count is not None and count < BESIDE:
        raise DescriptionError(f"path={path}: its input must be (1, n_sensors + 4) of float32, and is {_form(given)}")
    if answer.type not in ("tensor(float)", "tensor(double)") or answer.shape[-1:] not in ([2], [None]):
        raise DescriptionError(f"path={path}: its output must be (1, 2) of float32, and is {_form(answer)}")
    return _Network(session, given.name, answer.name, count)


def _form(side: Any) -> str:
    return f"{side.type.removeprefix('tensor').strip('()')} of ({', '.join(map(str, side.shape))})"
