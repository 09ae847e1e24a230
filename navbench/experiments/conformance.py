"""Whether a controller keeps the contract: each check drives a cell in some ways, and says in a line what it found."""

import math
import statistics
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from operator import attrgetter
from typing import Any, Literal, NamedTuple

import numpy as np

from navbench.contract import AnyRing
from navbench.episode.similarity import DEFAULT_PERIOD_S, Native, Similarity, period_s
from navbench.episode.starts import Jitter
from navbench.experiments.cells import Cell, Records
from navbench.experiments.engines import in_processes
from navbench.experiments.rerunning import Acts, difference, drive, ended, watch
from navbench.experiments.workers import MachineError
from navbench.policy import CompiledController
from navbench.records import NOT_DRIVEN
from navbench.sensors import Mount, Odometry, Ring, Sensors
from navbench.validation import DescriptionError
from navbench.world.layout import Layout
from navbench.world.mirrored import mirrored

ALIKE_RADII = 0.01  # by which a mirrored path may miss the first one: more is no rounding
PERIOD_CHANGE = 0.05  # relative, of time and path: more than a small controller's discretisation
EXACT: dict[str, Any] = {"noise_std_m": 0.0, "dropout_probability": 0.0, "odometry": Odometry()}
TIMED = 5  # episodes, of which the quickest counts: another one may have shared its core


class Finding(NamedTuple):
    """What a check found.

    Attributes:
        verdict: "ok"; "note" for what a user should know, but may want; "FAIL" for what breaks the contract.
        name: of the check.
        said: one line.
    """

    verdict: Literal["ok", "note", "FAIL"]
    name: str
    said: str


def findings(cell: Cell) -> Iterator[Finding]:
    """Check a cell's controller, and yield what each check found as soon as it is known."""
    driven = drive(cell)
    watched, acts = watch(cell)
    yield _finite(driven, acts)
    yield _within_limits(acts)
    yield _repeats(cell, driven)
    if cell.loop == "compiled":
        yield _compiled_as_act(driven, watched)
    yield _sensors(cell)
    yield _mirrored(cell)
    yield _any_period(cell)
    yield _speed(cell, acts)


def _finite(driven: Records, acts: Acts) -> Finding:
    failed = [(episode, record) for episode, record in driven if record.outcome == "controller_error"]
    lost = [(episode, record) for episode, record in driven if record.outcome in NOT_DRIVEN]
    if failed or lost:
        episode, record = (failed or lost)[0]
        return Finding("FAIL", "commands", f"episode {episode}, robot {record.robot_index}: {record.reason}")
    reached = sum(record.outcome == "reached" for _, record in driven)
    many = f"{len(acts.commands)} commands are finite; {reached} of {len(driven)} robots reached their goal"
    return Finding("ok" if reached else "note", "commands", many)


def _within_limits(acts: Acts) -> Finding:
    if acts.setup is None or not acts.commands:
        return Finding("note", "limits", "nothing was asked for")
    _, track_m, limit_mps, _ = acts.setup.robot
    beyond = sum(abs(v) + 0.5 * track_m * abs(w) > limit_mps * (1.0 + 1e-9) for v, w in acts.commands)
    if not beyond:
        return Finding("ok", "limits", f"the wheels can do what it asks for, {limit_mps:.3g} m/s each")
    share = f"in {100.0 * beyond / len(acts.commands):.1f} % of the periods"
    return Finding("note", "limits", f"asks for more than the wheels can {share}; the loop scales it down")


def _repeats(cell: Cell, driven: Records) -> Finding:
    """Run the same again in ways that must not matter, and name the first difference."""
    ways: dict[str, Callable[[], Records]] = {
        "run again": lambda: drive(cell),
        "in another order": lambda: drive(cell, back=True),
        "in another process": lambda: in_processes(drive, [cell], 1, attrgetter("foreign"))[0],
    }
    apart = {way: found for way, run in ways.items() if (found := _apart(driven, run))}
    if not apart:
        return Finding("ok", "repeats", f"to the last bit: {', '.join(ways)}")
    return Finding("FAIL", "repeats", f"differs {', '.join(apart)}: {next(iter(apart.values()))}")


def _apart(driven: Records, run: Callable[[], Records]) -> str:
    """Return the first difference of another run, or what ended the process in which it ran; empty for none."""
    try:
        return difference(driven, run())
    except MachineError:
        raise
    except DescriptionError as error:
        return str(error).partition(", at its work")[0]


def _compiled_as_act(driven: Records, watched: Records) -> Finding:
    apart = difference(driven, watched)
    if apart:
        return Finding("FAIL", "compiled", f"act answers otherwise than the compiled policy: {apart}")
    return Finding("ok", "compiled", "act and the compiled policy answer the same to the last bit, trace included")


def _sensors(cell: Cell) -> Finding:
    """Run it with the least suites that it says it needs."""
    controller = cell.make_controller()
    roles, kind = getattr(controller, "sensor_roles", None), getattr(controller, "sensor_kind", None)
    if roles is not None:
        return Finding("ok", "sensors", f"needs these {len(roles)} range sensors, and others are refused")
    if kind is not None and not isinstance(kind, AnyRing):
        return Finding("ok", "sensors", f"needs {kind}, and others are refused")
    if kind is None:
        reason = _reason_with(cell, ())
        if not reason:
            return Finding("ok", "sensors", "states none, and drives without range sensors")
        said = "states none, but without range sensors"
        return Finding("note", "sensors", f"{said}: {reason}; sensor_roles or sensor_kind would refuse such a suite")
    rim_m = cell.sensors.drawn_for_radius_m
    for count, fov_deg in ((kind.rays, kind.fov_deg), (math.ceil(2.0 * kind.rays * 360.0 / kind.fov_deg), 360.0)):
        reason = _reason_with(cell, Ring(count=count, fov_deg=fov_deg, radius_m=rim_m).mounts())
        if reason:
            return Finding("FAIL", "sensors", f"takes {kind}, but with {count} over {fov_deg:g} degrees: {reason}")
    return Finding("ok", "sensors", f"drives with {kind}")


def _reason_with(cell: Cell, mounts: tuple[Mount, ...]) -> str:
    """Return why a controller fails with other range sensors, or nothing."""
    records = drive(replace(cell, sensors=replace(cell.sensors, mounts=mounts), episodes=1))
    return next((record.reason for _, record in records if record.outcome == "controller_error"), "")


@dataclass(frozen=True)
class _Mirrored:
    """A source of the mirror images of what another one draws."""

    source: Any

    def draw(self, rng: np.random.Generator, episode: int) -> Layout:
        return mirrored(self.source.draw(rng, episode))

    def __getattr__(self, name: str) -> Any:
        return getattr(self.source, name)  # of robots and movers there are as many as there


def _mirrored(cell: Cell) -> Finding:
    """Drive in the world and in its mirror image, without noise."""
    if not _is_symmetric(cell.sensors):
        return Finding("note", "mirrored", "not compared: the range sensors are not the same to the left and right")
    exact = _without_chance(cell)
    image = replace(exact, world=replace(cell.world, source=_Mirrored(cell.world.source)))
    apart_m, since_s = 0.0, math.inf
    for (_, one), (_, other) in zip(drive(exact), drive(image), strict=True):
        count = min(len(one.states), len(other.states))
        x, y = one.states[:count, 1] - other.states[:count, 1], one.states[:count, 2] + other.states[:count, 2]
        away = np.hypot(x, y)
        apart_m = max(apart_m, float(away.max(initial=0.0)))
        late = away > ALIKE_RADII * cell.robot.radius_m
        if late.any():
            since_s = min(since_s, float(one.states[int(np.argmax(late)), 0]))
        elif one.outcome != other.outcome:
            return Finding("note", "mirrored", f"{ended(one)}; in the mirrored world {ended(other)}")
    if since_s == math.inf:
        return Finding("ok", "mirrored", f"in the mirrored world it drives the mirrored path, within {apart_m:.2g} m")
    said = f"from {since_s:.2f} s on it leaves the mirrored path, by up to {apart_m:.2g} m: left and right differ"
    return Finding("note", "mirrored", said)


def _is_symmetric(sensors: Sensors) -> bool:
    def rows(side: float) -> list[tuple[float, ...]]:
        return sorted(
            (round(m.x_m, 9), round(side * m.y_m, 9) + 0.0, round(math.cos(m.heading_rad), 9),
             round(side * math.sin(m.heading_rad), 9) + 0.0, m.min_range_m or 0.0, m.max_range_m or 0.0,
             m.cone_half_angle_rad or 0.0, m.rays or 1)
            for m in sensors.complete_mounts()
        )  # fmt: skip

    return rows(1.0) == rows(-1.0)


def _without_chance(cell: Cell) -> Cell:
    """Return a cell with exact sensors and unperturbed starts; a fixed world is then the same in each episode."""
    tracker = cell.sensors.tracker and replace(cell.sensors.tracker, position_noise_std_m=0.0)
    sensors = replace(cell.sensors, **EXACT, tracker=tracker)
    is_fixed = isinstance(cell.world.source, Layout)
    return replace(cell, sensors=sensors, jitter=Jitter(), episodes=1 if is_fixed else cell.episodes)


def _any_period(cell: Cell) -> Finding:
    """Drive with half the control period."""
    exact = _without_chance(cell)
    native = cell.native or Native(cell.robot, DEFAULT_PERIOD_S)
    halved = replace(exact, native=native._replace(period_s=0.5 * native.period_s))
    changes = []
    for (_, one), (_, other) in zip(drive(exact), drive(halved), strict=True):
        if one.outcome != other.outcome:
            return Finding("note", "period", f"{ended(one)}; with half the control period {ended(other)}")
        if one.outcome == "reached":
            names = ("time_s", "path_length_m")
            changes.append([abs(other.metrics[name] / one.metrics[name] - 1.0) for name in names])
    if not changes:
        return Finding("note", "period", "not compared: it does not reach its goal")
    time_by, path_by = (max(column) for column in zip(*changes, strict=True))
    said = f"half the control period changes its time by {100.0 * time_by:.1f} %, its path by {100.0 * path_by:.1f} %"
    return Finding("ok" if max(time_by, path_by) <= PERIOD_CHANGE else "note", "period", said)


def _speed(cell: Cell, acts: Acts) -> Finding:
    if not acts.times_s:
        return Finding("note", "speed", "not measured: it never acted")
    act_s, period = statistics.median(acts.times_s), period_s(cell.native, Similarity.between(cell.robot, cell.native))
    if act_s > period:
        return Finding("note", "speed", f"{act_s:.3g} s per act, more than its control period of {period:g} s")
    if cell.loop != "compiled":
        is_policy = isinstance(cell.make_controller(), CompiledController)
        kind = "compiled, but the simulator is not" if is_policy else "Python; compiled policies are far quicker"
        return Finding("ok", "speed", f"{1e6 * act_s:.1f} us per act: {kind}")
    each_s = math.inf
    with cell.runner() as runner:
        for _ in range(TIMED):  # the first of which compiles
            begin = time.perf_counter()
            steps = sum(len(record.states) - 1 for record in runner.run(cell.first_episode))
            each_s = min(each_s, (time.perf_counter() - begin) / max(steps, 1))
    return Finding("ok", "speed", f"compiled: {1e6 * each_s:.2f} us a control period, sensing and motion included")
