"""Train the placement of C-type meshes: `python -m drl_meshgen.rl.train_transitions`; `rl.train` does so as well.

Interrupted, the same command goes on from the last checkpoint and ends with the same weights.
"""

import time
from pathlib import Path
from typing import Annotated, Final

import numpy as np
import pandas as pd
import torch
import typer

from drl_meshgen.export import read_table, write_table
from drl_meshgen.rl.agent import TRANSITIONS
from drl_meshgen.rl.c_domains import four_sided
from drl_meshgen.rl.c_learning import TransitionLearner, TransitionLearnOptions
from drl_meshgen.rl.checkpoint import read_checkpoint, write_checkpoint
from drl_meshgen.rl.console import run
from drl_meshgen.rl.inference import Placements
from drl_meshgen.rl.kernel import judge_c
from drl_meshgen.rl.networks import weights_of
from drl_meshgen.rl.symmetry import of_transition
from drl_meshgen.rl.transitions import best_transition

VALIDATION: Final = (8, 40)
"""Seed and number of four-sided domains that the curve is taken on."""
EVERY: Final = 500
"""Steps between rows of the curve, and checkpoints."""


def examine(learner: TransitionLearner) -> dict[str, float]:
    """Return means over validation domains of reward, orthogonality and Jacobian ratio, and the share that is valid."""
    placement = Placements(weights_of(learner.networks), TRANSITIONS, of_transition())
    rows = []
    for one in four_sided(VALIDATION[0], range(VALIDATION[1])):
        found = best_transition(placement, one.domain, 0, one.sides, learner.options.weights)
        if found is None:
            rows.append((0.0, 0.0, 0.0, 0.0))
            continue
        judged = judge_c(one.domain.nodes, [found])
        rows.append((judged.reward[0], judged.orthogonality[0], judged.jacobian[0], 1.0))
    return dict(zip(("reward", "orthogonality", "jacobian", "valid"), np.mean(rows, axis=0).tolist(), strict=True))


def train_transitions(
    out: Annotated[Path, typer.Option(help="Folder of checkpoint and curve.")] = Path("out/train"),
    steps: Annotated[int, typer.Option(min=1, help="Steps from nothing.")] = TransitionLearnOptions.steps,
    seed: Annotated[int, typer.Option(help="Seed of weights and draws.")] = TransitionLearnOptions.seed,
) -> None:
    """Train and write `transitions.safetensors`, a checkpoint, and the learning curve."""
    torch.set_num_threads(1)
    out.mkdir(parents=True, exist_ok=True)
    learner, checkpoint = TransitionLearner(TransitionLearnOptions(seed=seed, steps=steps)), transitions_in(out)
    rows, seconds = [], []
    if checkpoint.is_file():
        read_checkpoint(checkpoint, learner)
        rows = read_table(out / "curve-transitions.parquet").to_dict("records")
        seconds = read_table(out / "curve-transitions-seconds.parquet").to_dict("records")
    # imported here because its import takes a second
    from torch.utils.tensorboard import SummaryWriter

    with SummaryWriter(str(out / "tensorboard" / "transitions"), purge_step=learner.step) as board:
        begin = time.process_time() - (seconds[-1]["cpu_seconds"] if seconds else 0.0)
        while learner.step < steps:
            worth = learner.advance()
            if learner.step % EVERY and learner.step != steps:
                continue
            rows.append({"step": learner.step, "worth": worth} | examine(learner))
            seconds.append({"step": learner.step, "cpu_seconds": time.process_time() - begin})
            for name, value in rows[-1].items():
                board.add_scalar(name, value, learner.step)
            write_table(out / "curve-transitions.parquet", pd.DataFrame(rows))
            write_table(out / "curve-transitions-seconds.parquet", pd.DataFrame(seconds))
            write_checkpoint(checkpoint, learner)
            typer.echo(f"transitions, step {learner.step}: reward {rows[-1]['reward']:.4f}")


def transitions_in(folder: Path) -> Path:
    """Return the file of weights and moments that training leaves in a folder."""
    return folder / "transitions.safetensors"


if __name__ == "__main__":
    run(train_transitions)
