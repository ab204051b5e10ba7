"""Train the paper's learner or one of its alternatives: `python -m drl_meshgen.rl.train_value --learner dqn --out DIR`.

Interrupted, the same command goes on from the last point of the curve, to the same weights bit by bit. The folder
gets `curve.parquet`, `curve-seconds.parquet`, `tensorboard/`, `checkpoint.safetensors` and, at the end,
`policy.safetensors`.
"""

import argparse
from collections.abc import Sequence
from dataclasses import dataclass, replace
from enum import Enum
from importlib.metadata import version
from itertools import chain
from pathlib import Path

import numpy as np
import torch

from drl_meshgen.rl.console import code_of
from drl_meshgen.rl.datasets import DataSet, read_samples, samples_of, write_samples
from drl_meshgen.rl.environment import EnvironmentOptions
from drl_meshgen.rl.value.dqn import DQN, RAINBOW, DQNOptions
from drl_meshgen.rl.value.networks import Encoder, NetworkOptions, RelativeNetwork, network
from drl_meshgen.rl.value.policy import ValuePolicy, save_value_policy
from drl_meshgen.rl.value.ppo import PPO, PPOOptions
from drl_meshgen.rl.value.record import Learner, Record, RecordOptions
from drl_meshgen.rl.vector import VectorEnvironment
from drl_meshgen.templates.domain import Domain

VALIDATED = 100
"""Domains of the validation set on which points of the curve are taken: the first."""


@dataclass(frozen=True)
class Recipe:
    """A learner with its network and training domains."""

    network: NetworkOptions
    """Network to train."""
    learner: DQNOptions | PPOOptions
    """Numbers of the learner; their type says which."""
    data: tuple[DataSet, ...]
    """Training sets."""


class Choice(Enum):
    """What can be trained."""

    DQN = "dqn"
    RAINBOW = "rainbow"
    PPO = "ppo"


RELATIVE = NetworkOptions(encoder=Encoder.RELATIVE, nodes=32, rounds=4)
RECIPES = {
    Choice.DQN: Recipe(NetworkOptions(nodes=24), DQNOptions(), (DataSet.TRAIN,)),
    Choice.RAINBOW: Recipe(replace(RELATIVE, dueling=True), RAINBOW, (DataSet.TRAIN, DataSet.TRAIN_HARD)),
    Choice.PPO: Recipe(RELATIVE, PPOOptions(), (DataSet.TRAIN, DataSet.TRAIN_HARD)),
}
"""What each stands for; only the first is the paper's."""


def drawn(data: DataSet, folder: Path, limit: int | None) -> list[Domain]:
    """Return the domains of a set, or the first of them, drawn once and kept in `folder`."""
    size = data.size if limit is None else min(limit, data.size)
    path = folder / f"{data.key}-{size}.parquet"
    if not path.exists():
        write_samples(path, list(samples_of(data, range(size))))
    return [sample.domain for sample in read_samples(path)]


def learner_of(recipe: Recipe, domains: Sequence[Domain], seed: int) -> tuple[DQN | PPO, VectorEnvironment]:
    """Return a learner at its beginning, and what it learns in."""
    options = EnvironmentOptions()
    model = network(options.actions, recipe.network, options, seed)
    environment = VectorEnvironment(domains, recipe.learner.episodes, options)
    rng = np.random.default_rng(seed)
    if isinstance(recipe.learner, DQNOptions):
        target = network(options.actions, recipe.network, options, seed)
        return DQN(model, target, recipe.learner, rng, options.actions), environment
    if not isinstance(model, RelativeNetwork):
        raise TypeError(f"{type(model).__name__} gives no values of states")
    return PPO(model, recipe.learner, rng), environment


def finish(folder: Path, recipe: Recipe, choice: Choice, seed: int, learner: Learner) -> Path:
    """Write the policy; return where."""
    origin = {"learner": choice.value, "seed": seed, "steps": learner.steps, "episodes": learner.episodes}
    origin |= {"torch": torch.__version__, "numpy": np.__version__, "drl-meshgen": version("drl-meshgen")}
    policy = ValuePolicy(learner.network, EnvironmentOptions())
    save_value_policy(path := folder / "policy.safetensors", policy, recipe.network, origin)
    return path


def main(arguments: list[str] | None = None) -> int:
    """Train, or go on training."""
    parser = argparse.ArgumentParser(prog="python -m drl_meshgen.rl.train_value", description=__doc__)
    parser.add_argument("--learner", type=Choice, default=Choice.DQN, metavar="dqn|rainbow|ppo")
    parser.add_argument("--minutes", type=float, default=60.0, metavar="M", help="CPU time, resumed parts included")
    parser.add_argument("--steps", type=int, metavar="N", help="environment steps, if it shall end after those")
    parser.add_argument("--every", type=int, default=RecordOptions.every, metavar="N", help="steps between points")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--past-convergence", action="store_true", help="go on where the paper would stop")
    parser.add_argument("--domains", type=int, metavar="N", help="only the first N domains of each set")
    parser.add_argument("--out", type=Path, required=True, metavar="DIR")
    parser.add_argument("--data", type=Path, metavar="DIR", help="where drawn domains are kept; in --out by default")
    given = parser.parse_args(arguments)
    torch.set_num_threads(1)
    recipe, data = RECIPES[given.learner], given.data or given.out / "domains"
    domains = list(chain.from_iterable(drawn(one, data, given.domains) for one in recipe.data))
    learner, environment = learner_of(recipe, domains, given.seed)
    checked = drawn(DataSet.VALIDATION, data, min(VALIDATED, given.domains or VALIDATED))
    validation = VectorEnvironment(checked, len(checked), environment.options)
    options = RecordOptions(given.every, given.minutes, given.steps, past=given.past_convergence)
    learner.train(environment, Record(learner, validation, given.out, options))
    print(finish(given.out, recipe, given.learner, given.seed, learner))  # noqa: T201 - a command's answer
    return 0


if __name__ == "__main__":
    raise SystemExit(code_of(main))
