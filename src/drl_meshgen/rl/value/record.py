"""What a training run leaves behind: learning curve, checkpoints to go on from, and when to stop."""

import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Protocol

import numpy as np
import pandas as pd

from drl_meshgen.errors import InputError
from drl_meshgen.export import read_table, write_table
from drl_meshgen.rl.checkpoint import Snapshot, read_tensors, write_tensors
from drl_meshgen.rl.value.episodes import play
from drl_meshgen.rl.value.networks import ActionNetwork
from drl_meshgen.rl.vector import VectorEnvironment

CURVE, SECONDS, CHECKPOINT, TENSORBOARD = (
    "curve.parquet",
    "curve-seconds.parquet",
    "checkpoint.safetensors",
    "tensorboard",
)


class Learner(Protocol):
    """What can be recorded."""

    steps: int
    episodes: int
    rng: np.random.Generator

    @property
    def network(self) -> ActionNetwork:
        """Network whose best-scored actions are the policy."""
        ...

    def figures(self) -> dict[str, float]:
        """Return loss and epsilon."""
        ...

    def snapshot(self) -> Snapshot:
        """Return everything that changes."""
        ...

    def restore(self, kept: Snapshot) -> None:
        """Go on where `snapshot` was taken."""
        ...


@dataclass(frozen=True)
class RecordOptions:
    """How often, how long."""

    every: int = 7_000
    """Environment steps between points of the curve (count)."""
    minutes: float = 60.0
    """CPU time of the whole run, resumed parts included."""
    steps: int | None = None
    """Environment steps at which it ends; None: none."""
    growth: tuple[float, int] = (0.01, 50_000)
    """The paper's convergence rule: the validation reward grows by less than this share in so many steps."""
    past: bool = False
    """Whether to go on after that rule is met."""


def converged(steps: Sequence[int], rewards: Sequence[float], growth: tuple[float, int]) -> bool:
    """Return whether the reward grew by less than a share of itself in the last so many steps (paper section 6.1)."""
    earlier = [reward for step, reward in zip(steps, rewards, strict=True) if step <= steps[-1] - growth[1]]
    return bool(earlier) and rewards[-1] - earlier[-1] < growth[0] * abs(earlier[-1])


@dataclass
class Record:
    """The record of a run in `folder`; call it whenever all episodes are over: it says whether to stop."""

    learner: Learner
    validation: VectorEnvironment
    """Its domains are those that points of the curve are taken on."""
    folder: Path
    options: RecordOptions
    say: Callable[[str], None] = print
    rows: list[dict[str, Any]] = field(default_factory=list)
    seconds: list[float] = field(default_factory=list)

    def __post_init__(self) -> None:
        from torch.utils.tensorboard import SummaryWriter  # heavy, and only needed here

        self._before = 0.0
        self._began = time.process_time()
        if (self.folder / CHECKPOINT).exists():
            self._resume()
        self._board = SummaryWriter(str(self.folder / TENSORBOARD), purge_step=self.learner.steps + 1)

    @property
    def spent(self) -> float:
        """CPU seconds so far, of interrupted parts too."""
        return self._before + time.process_time() - self._began

    def __call__(self) -> bool:
        """Add a point to the curve where one is due; return whether the run is over."""
        o, learner = self.options, self.learner
        ended = self.spent >= 60 * o.minutes or (o.steps is not None and learner.steps >= o.steps)
        due = not self.rows or learner.steps - self.rows[-1]["steps"] >= o.every
        if (due or ended) and not (self.rows and self.rows[-1]["steps"] == learner.steps):
            self._measure()
        return ended or (bool(self.rows[-1]["converged"]) and not o.past)

    def _measure(self) -> None:
        learner, domains = self.learner, np.arange(self.validation.count)
        gained = play(learner.network, self.validation, domains)
        row = {"steps": learner.steps, "episodes": learner.episodes, "mean_return": float(gained.mean())}
        row |= {"reward": float(self.validation.reward.mean()), "valid": float(self.validation.valid.mean())}
        row |= learner.figures()
        self.rows.append(row)
        steps, returns = ([one[key] for one in self.rows] for key in ("steps", "mean_return"))
        row["converged"] = converged(steps, returns, self.options.growth)
        self.seconds.append(self.spent)
        for key, value in row.items():
            self._board.add_scalar(key, float(value), learner.steps)
        self._board.flush()
        self._save()
        self.say(" ".join(f"{key} {value:.6g}" for key, value in row.items()) + f" cpu {self.spent:.0f} s")

    def _save(self) -> None:
        write_table(self.folder / CURVE, pd.DataFrame(self.rows))
        steps = [row["steps"] for row in self.rows]
        write_table(self.folder / SECONDS, pd.DataFrame({"steps": steps, "cpu_seconds": np.round(self.seconds, 1)}))
        tensors, counts = self.learner.snapshot()
        state = {"counts": counts, "rng": self.learner.rng.bit_generator.state, "spent": self.spent}
        write_tensors(self.folder / CHECKPOINT, tensors, "state", state)

    def _resume(self) -> None:
        tensors, state = read_tensors(self.folder / CHECKPOINT, "state")
        try:
            self.learner.restore((tensors, state["counts"]))
            self.learner.rng.bit_generator.state = state["rng"]
            self._before = float(state["spent"])
        except (RuntimeError, KeyError, ValueError) as error:
            raise InputError(
                str(self.folder / CHECKPOINT), f"does not fit this run ({error})", "choose another folder or remove it"
            ) from error
        curve, seconds = (read_table(self.folder / name) for name in (CURVE, SECONDS))
        points = sum(step <= self.learner.steps for step in curve["steps"].tolist())
        columns = {str(name): curve[name].tolist() for name in curve}
        self.rows = [{name: column[i] for name, column in columns.items()} for i in range(points)]
        self.seconds = seconds["cpu_seconds"].tolist()[:points]
