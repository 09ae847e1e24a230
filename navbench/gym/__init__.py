"""Environments to learn in: one robot (``make``), many environments at once (``make_vec``), a fleet (``make_fleet``).

They need gymnasium and pettingzoo: ``pip install 'navbench[gym]'``.
"""

try:
    from navbench.gym.environments import NavigationEnv, NavigationVectorEnv
    from navbench.gym.fleet import FleetEnv
except ModuleNotFoundError as error:
    if error.name not in ("gymnasium", "pettingzoo"):
        raise
    raise ModuleNotFoundError(
        f"navbench.gym needs {error.name}: pip install 'navbench[gym]'", name=error.name
    ) from None
from navbench.gym.reward import Period, progress

__all__ = [
    "FleetEnv", "NavigationEnv", "NavigationVectorEnv", "Period", "make", "make_fleet", "make_vec", "progress",
]  # fmt: skip

make, make_vec, make_fleet = NavigationEnv, NavigationVectorEnv, FleetEnv
