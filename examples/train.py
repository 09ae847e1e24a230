"""Train a policy for about a minute, write it as ONNX, and rank it with the papers' controllers in random worlds.

    pip install 'navbench[train]'
    python examples/train.py            # writes trained.onnx and the report in ranked/
    navbench controller=policy controller.build.path=trained.onnx world=random_discs

It learns by stable-baselines3's PPO in many environments of ``navbench.gym`` at once, and sees what controllers see.
A minute is not much: what it reaches tells how a policy is brought in, not how well one can be learned.
"""

import argparse
import time
from pathlib import Path
from typing import Any

import numpy as np
import onnx
import torch
from numpy.typing import NDArray
from onnx import TensorProto, helper, numpy_helper
from stable_baselines3 import PPO
from stable_baselines3.common.callbacks import BaseCallback
from stable_baselines3.common.vec_env import VecEnv

import navbench
import navbench.gym

CONTROLLERS = ("go_to_goal", "oa_to", "oa_to_ga", "dual_layer")  # those that drive the worlds' robot with 16 rays
WORLDS = ("random_discs", "random_single_mover")


class Environments(VecEnv):
    """Environments of ``navbench.gym`` as stable-baselines3 wants them.

    An episode that is over begins anew in the next step, which so learns nothing: its reward is 0.
    """

    def __init__(self, envs: navbench.gym.NavigationVectorEnv) -> None:
        self.envs = envs
        super().__init__(envs.num_envs, envs.single_observation_space, envs.single_action_space)

    def reset(self) -> NDArray[np.float32]:
        observations: NDArray[np.float32] = self.envs.reset()[0]
        return observations

    def step_async(self, actions: NDArray[np.float32]) -> None:
        self.actions = actions

    def step_wait(self) -> Any:
        seen, rewards, terminated, truncated, _ = self.envs.step(self.actions)
        infos: list[dict[str, Any]] = [{} for _ in range(self.num_envs)]
        for place in np.flatnonzero(terminated | truncated).tolist():
            infos[place] = {"terminal_observation": seen[place], "TimeLimit.truncated": bool(truncated[place])}
        return seen, rewards, terminated | truncated, infos

    def close(self) -> None:
        self.envs.close()

    def get_attr(self, attr_name: str, indices: Any = None) -> list[Any]:
        return [getattr(self.envs, attr_name, None)] * self.num_envs

    def set_attr(self, attr_name: str, value: Any, indices: Any = None) -> None:
        raise NotImplementedError

    def env_method(self, method_name: str, *args: Any, indices: Any = None, **kwargs: Any) -> list[Any]:
        raise NotImplementedError

    def env_is_wrapped(self, wrapper_class: Any, indices: Any = None) -> list[bool]:
        return [False] * self.num_envs


class Minute(BaseCallback):
    """Ends the training after some time."""

    def __init__(self, seconds: float) -> None:
        super().__init__()
        self.end = time.monotonic() + seconds

    def _on_step(self) -> bool:
        return time.monotonic() < self.end


def train(seconds: float, words: tuple[str, ...], envs: int = 64, seed: int = 0) -> PPO:
    """Return a policy that learned for some time in the worlds that the words describe."""
    torch.set_num_threads(1)  # of layers this small, more only wait for each other
    environments = Environments(navbench.gym.make_vec(*words, num_envs=envs, layouts=256, metrics=False))
    learner = PPO("MlpPolicy", environments, n_steps=128, batch_size=2048, n_epochs=5, gamma=0.99, ent_coef=0.001,
                  learning_rate=1e-3, seed=seed, device="cpu")  # fmt: skip
    environments.reset()
    environments.envs.step(np.zeros((envs, 2), np.float32))  # compiles, before the clock runs
    learner.learn(10**9, callback=Minute(seconds))
    print(f"trained for {learner.num_timesteps} steps in {seconds:g} s")
    return learner


def write_onnx(learner: PPO, file: Path) -> None:
    """Write what a policy does without exploring: the layers from the observation to the mean of its actions."""
    layers = [*learner.policy.mlp_extractor.policy_net, learner.policy.action_net]
    nodes, weights, flow = [], [], "observation"
    for i, layer in enumerate(layers):
        out = "action" if i == len(layers) - 1 else f"hidden_{i}"
        if isinstance(layer, torch.nn.Linear):
            for name in ("weight", "bias"):
                weights.append(numpy_helper.from_array(getattr(layer, name).detach().numpy(), f"{name}_{i}"))
            nodes.append(helper.make_node("Gemm", [flow, f"weight_{i}", f"bias_{i}"], [out], transB=1))
        else:
            nodes.append(helper.make_node("Tanh", [flow], [out]))
        flow = out
    ends = [
        helper.make_tensor_value_info(name, TensorProto.FLOAT, ["batch", size])
        for name, size in (("observation", learner.observation_space.shape[0]), ("action", 2))
    ]
    graph = helper.make_graph(nodes, "policy", ends[:1], ends[1:], weights)
    model = helper.make_model(graph, opset_imports=[helper.make_opsetid("", 17)], ir_version=9)
    onnx.checker.check_model(model)
    onnx.save(model, file)


def main() -> None:
    """Train, write and rank."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--seconds", type=float, default=60.0, help="how long to train")
    parser.add_argument("--episodes", type=int, default=50, help="of each controller in each world")
    parser.add_argument("--out", type=Path, default=Path("."), help="where trained.onnx and ranked/ go")
    given = parser.parse_args()
    given.out.mkdir(parents=True, exist_ok=True)
    write_onnx(train(given.seconds, ("world=random_discs",)), given.out / "trained.onnx")
    ranked = navbench.sweep(
        controller=[given.out / "trained.onnx", *CONTROLLERS],
        world=WORLDS,
        seed=1,  # the policy learned from layouts of seed 0
        episodes=given.episodes,
        simulator="planar",
    )
    print(ranked)
    print(f"report: {ranked.report(given.out / 'ranked')}")


if __name__ == "__main__":
    main()
