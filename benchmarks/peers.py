"""Other projects on the same work, where they are installed."""

import contextlib
import io
import math
import tempfile
from importlib import import_module
from pathlib import Path
from typing import Any

import numpy as np
import yaml

from benchmarks.field import NEAR_M, PERIOD_S, RANGE_M, RAYS, ROBOT, SPEED_MPS, Field, rule
from benchmarks.harness import Side
from navbench.fuzzy.inference import FuzzyInference, Variable

LIMIT_MPS = ROBOT.wheel_speed_max_mps
AT_ONCE = 100  # control periods


def navground_steps(field: Field, *, has_lidar: bool) -> Side:
    """Return navground on a field: with our rule and a lidar, or with its own controller, which knows all discs.

    Its own is the human-like one of Guzzi et al. (2013), on the way to the opposite place of the ring.
    """
    core: Any = import_module("navground.core")
    sim: Any = import_module("navground.sim")
    states = sim.state_estimations

    class Rule(core.Behavior):  # type: ignore[misc]
        """The rule in Python."""

        def __init__(self, kinematics: Any, lidar: Any) -> None:
            core.Behavior.__init__(self, kinematics, ROBOT.radius_m)
            self._state, self._lidar = core.SensingState(), lidar

        def get_environment_state(self) -> Any:
            """Return where the lidar writes."""
            return self._state

        def compute_cmd_internal(self, time_step: float) -> Any:
            """Return a twist."""
            ranges, goal = self._lidar.read_ranges(self._state), self.target.position
            v, w = rule((*self.position, self.orientation), goal, ranges, field.turn_radps)
            return core.Twist2((v, 0.0), w, core.Frame.relative)

    world = sim.World()
    for x, y, heading in field.starts:
        wheels = core.kinematics.TwoWheelsDifferentialDriveKinematics(wheel_axis=ROBOT.track_m, max_speed=LIMIT_MPS)
        if has_lidar:
            sense = states.LidarStateEstimation(RANGE_M, 0.0, math.tau * (RAYS - 1) / RAYS, RAYS)
            behavior, goals = Rule(wheels, sense), [(0.0, 0.0)]
        else:
            sense = states.BoundedStateEstimation(range=RANGE_M)
            behavior, goals = core.behaviors.HLBehavior(wheels, ROBOT.radius_m), [(-x, -y), (x, y)]
            behavior.optimal_speed = SPEED_MPS
        task = sim.tasks.WaypointsTask(waypoints=goals, loop=True, tolerance=NEAR_M)
        agent = sim.Agent(ROBOT.radius_m, behavior, wheels, task, [sense], PERIOD_S)
        agent.pose = core.Pose2((x, y), heading)
        world.add_agent(agent)
    for x, y, radius_m in field.discs:
        world.add_obstacle(sim.Obstacle((x, y), radius_m))

    def run() -> int:
        world.run(AT_ONCE, PERIOD_S)
        return AT_ONCE * len(field.starts)

    return run


def irsim_steps(field: Field) -> Side:
    """Return ir-sim on a field, with our rule and a lidar; contacts end nothing there, and are told."""
    irsim = import_module("irsim")
    circle = {"name": "circle", "radius": ROBOT.radius_m}
    lidar = {"name": "lidar2d", "range_max": RANGE_M, "angle_range": math.tau, "number": RAYS}
    robots = [
        {
            "kinematics": {"name": "diff"}, "shape": circle, "state": list(start), "goal": [0.0, 0.0, 0.0],
            "vel_min": [-LIMIT_MPS, -9.0], "vel_max": [LIMIT_MPS, 9.0], "sensors": [lidar],
        }
        for start in field.starts
    ]  # fmt: skip
    side = 2.0 * field.radius_m + 4.0
    plane = {"width": side, "height": side, "offset": [-0.5 * side] * 2, "step_time": PERIOD_S}
    discs = [{"shape": {"name": "circle", "radius": r}, "state": [x, y]} for x, y, r in field.discs]
    with tempfile.TemporaryDirectory() as folder, contextlib.redirect_stdout(io.StringIO()):
        file = Path(folder, "field.yaml")
        file.write_text(yaml.safe_dump({"world": plane, "robot": robots, "obstacle": discs}))
        world = irsim.make(str(file), display=False, disable_all_plot=True, log_level="ERROR")

    def run() -> int:
        commands = []
        for robot in world.robot_list:
            ranges = robot.get_lidar_scan()["ranges"].tolist()
            commands.append(np.array([rule(tuple(robot.state[:3, 0]), (0.0, 0.0), ranges, field.turn_radps)]).T)
        world.step(commands)
        return len(commands)

    return run


def scikit_fuzzy(inference: FuzzyInference, points: list[dict[str, float]]) -> Side:
    """Return scikit-fuzzy's control system of a rule base, asked for one point after another.

    Its memory of past answers is off, since a robot hardly meets the same input twice.
    """
    from skfuzzy import control, trapmf, trimf

    def described(kind: Any, name: str, variable: Variable) -> Any:
        axis = kind(np.linspace(variable.low, variable.high, 201), name)
        for term_name, term in variable.terms.items():
            axis[term_name] = (trimf if term.shape == "triangle" else trapmf)(axis.universe, term.points)
        return axis

    inputs = [described(control.Antecedent, name, variable) for name, variable in inference.inputs.items()]
    outputs = [described(control.Consequent, name, variable) for name, variable in inference.outputs.items()]
    rules = []
    for rule_row in inference.rules:
        premise = inputs[0][rule_row[0]]
        for axis, term in zip(inputs[1:], rule_row[1:], strict=False):
            premise = premise & axis[term]
        conclusions = zip(outputs, rule_row[len(inputs) :], strict=True)
        rules.append(control.Rule(premise, [axis[term] for axis, term in conclusions]))
    simulation = control.ControlSystemSimulation(control.ControlSystem(rules), cache=False)

    def ask() -> int:
        for name, value in points[0].items():
            simulation.input[name] = value
        simulation.compute()
        points.append(points.pop(0))
        return 1

    return ask
