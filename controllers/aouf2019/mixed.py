"""The behaviours of Aouf, Boussaid and Sakly under mixed laws, to tell what each part of their controller does.

Their S.F.L.C. turns and drives by one fuzzy controller in both behaviours; the PIDs that they compare it with turn by a
PID law and drive at a constant speed. Here each behaviour takes either law for its turning and either for its speed.
So the fuzzy law can serve one behaviour only, and a PID can drive at the fuzzy controller's own speed, so that only
the turning differs. Nothing of this is in the paper; see ``sflc``, ``pid`` and ``equations`` for the parts.
"""

from pydantic.dataclasses import dataclass

from navbench.contract import FloatArray, Setup
from navbench.policy import Policy, compiled, pack, part
from navbench.validation import STRICT

from .behaviors import BEHAVIOR, CHOICE, LAW, LAW_MEMORY, SECOND_LAW, TRACE, active_heading_error
from .pid import FRESH, SPEED, TERMS, Pid, pid_turn
from .sflc import Fuzzy, fuzzy_law

BEHAVIORS = ("go_to_goal", "follow_wall")  # in the order of their numbers in the trace


@compiled
def step(
    state: FloatArray,
    parameters: FloatArray,
    ranges_m: FloatArray,
    discs: FloatArray,
    pose: tuple[float, float, float],
    goal: tuple[float, float],
    speed: tuple[float, float],
    trace: FloatArray,
) -> tuple[float, float]:
    """Return the answer of the active behaviour's laws to its heading error; a step of ``navbench.policy``."""
    law, is_fuzzy = part(parameters, LAW), part(parameters, CHOICE).reshape(2, 2)
    error = active_heading_error(state, parameters, ranges_m, pose, goal, trace)
    active = int(trace[BEHAVIOR])
    pid_radps = pid_turn(law, part(state, LAW_MEMORY), error, trace[BEHAVIOR], trace)
    speed_mps, turn_radps = fuzzy_law(part(parameters, SECOND_LAW), error)
    fuzzy_turns, fuzzy_drives = is_fuzzy[0, active] > 0.0, is_fuzzy[1, active] > 0.0
    return speed_mps if fuzzy_drives else law[SPEED], turn_radps if fuzzy_turns else pid_radps


@dataclass(kw_only=True, config=STRICT)
class Mixed(Pid, Fuzzy):
    """Two behaviours, a law of choice for each.

    Attributes:
        fuzzy_turn_in: behaviours, of ``BEHAVIORS``, that turn by the fuzzy controller; the others by the PID law.
        fuzzy_speed_in: behaviours that drive at the fuzzy controller's speed; the others at the constant one.
    """

    fuzzy_turn_in: list[str]
    fuzzy_speed_in: list[str]

    def __post_init__(self) -> None:
        """Check the names of the behaviours."""
        super().__post_init__()
        for name, chosen in (("fuzzy_turn_in", self.fuzzy_turn_in), ("fuzzy_speed_in", self.fuzzy_speed_in)):
            if not set(chosen) <= set(BEHAVIORS):
                raise ValueError(f"{name}={list(chosen)}: must be a list of any of {', '.join(BEHAVIORS)}")

    def make_policy(self, setup: Setup) -> Policy:
        """Return the policy for a robot and its ring.

        Raises:
            ValueError: the ring's sensors are not ``sensor_roles``.
        """
        state, parameters = self.behaviors.begin(setup)
        choice = [[name in chosen for name in BEHAVIORS] for chosen in (self.fuzzy_turn_in, self.fuzzy_speed_in)]
        return Policy(
            step=step,
            state=pack(*state, FRESH),
            parameters=pack(*parameters, self.law(setup.period_s), self.inference.base, choice),
            trace_names=(*TRACE, *TERMS),
        )
