"""Train the project's policy: `python -m drl_meshgen.rl.train --out out/train`; see docs/learning.md.

Interrupted, the same command goes on from the last checkpoint and ends with the same weights.
"""

import json
import time
from collections.abc import Mapping, Sequence
from importlib.metadata import version
from multiprocessing import get_context
from pathlib import Path
from typing import Annotated, Any

import pandas as pd
import torch
import typer
from safetensors.numpy import load_file

from drl_meshgen.errors import InputError
from drl_meshgen.export import read_table, write_table
from drl_meshgen.progress import counter
from drl_meshgen.rl.agent import TRANSITIONS
from drl_meshgen.rl.c_learning import TransitionLearnOptions
from drl_meshgen.rl.checkpoint import read_checkpoint, write_checkpoint
from drl_meshgen.rl.console import run
from drl_meshgen.rl.datasets import DataSet, Sample, read_samples, samples_of, write_samples
from drl_meshgen.rl.learning import Bank, Learner, LearnOptions, examine
from drl_meshgen.rl.networks import weights_of
from drl_meshgen.rl.policy_file import read_card, read_weights, write_policy
from drl_meshgen.rl.train_transitions import train_transitions, transitions_in
from drl_meshgen.templates.domain import Domain

EXAMINED = 60
"""Domains of each validation set that the curve is taken on."""
EVERY = 500
"""Steps between rows of the curve, and checkpoints."""
REWARD = f"{DataSet.VALIDATION.key} reward"
"""Column of the curve that tells how good the policy is."""
EARLY = 0.1
"""Share of training, its end left out, after which the policy is kept for comparison (paper Fig. 11)."""


def drawn(path: Path, sets: Sequence[DataSet], count: int) -> dict[str, list[Domain]]:
    """Return the first `count` domains of each set by its name, kept in a file between runs."""
    wanted = {data.key: min(count, data.size) for data in sets}
    samples: list[Sample] = read_samples(path) if path.is_file() else []
    found = {key: [one.domain for one in samples if one.set == key] for key in wanted}
    if any(len(found[key]) != size for key, size in wanted.items()):
        samples = [one for data in sets for one in samples_of(data, range(wanted[data.key]))]
        write_samples(path, samples)
        found = {key: [one.domain for one in samples if one.set == key] for key in wanted}
    return found


def card_of(learner: Learner, domains: int, last: dict[str, float]) -> dict[str, Any]:
    """Return the model card: data, seed, versions and scores on the validation sets."""
    o = learner.options
    return {
        "about": "templates of plane domains: values of corners, placement of singular points and lines",
        "data": f"{domains} domains each of the sets train and train-hard",
        "seed": o.seed,
        "steps": learner.step,
        "layers": o.nominal,
        "versions": {name: version(name) for name in ("drl-meshgen", "numba", "numpy", "torch")},
        "validation": {key: round(value, 4) for key, value in last.items()},
    }


def row_of(learner: Learner, worth: float, error: float, validation: dict[str, list[Domain]]) -> dict[str, float]:
    """Return a row of the curve."""
    row: dict[str, float] = {"step": learner.step, "episodes": learner.episodes, "worth": worth, "value_error": error}
    for key, domains in validation.items():
        means = examine(learner.policy(), domains).mean()
        row |= {f"{key} {name}": value for name, value in means.to_dict().items()}
    return row


def train(  # noqa: PLR0917 - options of a command
    out: Annotated[Path, typer.Option(help="Folder of checkpoints, curve and policy.")] = Path("out/train"),
    steps: Annotated[int, typer.Option(min=1, help="Steps from nothing to the end.")] = LearnOptions.steps,
    seed: Annotated[int, typer.Option(help="Seed of weights and draws.")] = LearnOptions.seed,
    domains: Annotated[int, typer.Option(min=2, help="Training domains of each kind.")] = DataSet.TRAIN.size,
    transition_steps: Annotated[
        int, typer.Option(min=1, help="Steps of the placement of C-type meshes, in a process beside.")
    ] = TransitionLearnOptions.steps,
    threads: Annotated[int, typer.Option(min=1, help="Threads; weights are the same for the same number.")] = 1,
    minutes: Annotated[
        float | None, typer.Option(min=0, help="End after so long; the same command goes on from there.")
    ] = None,
) -> bool:
    """Train the policy and write `agent.safetensors`, its early self, and the learning curves.

    Returns whether the training came to its end. Where it ended early, the curve has a row more.
    """
    due = float("inf") if minutes is None else time.monotonic() + 60 * minutes
    torch.set_num_threads(threads)
    out.mkdir(parents=True, exist_ok=True)
    beside = get_context("spawn").Process(target=train_transitions, args=(out, transition_steps, seed), daemon=True)
    beside.start()
    training = drawn(out / "domains.parquet", (DataSet.TRAIN, DataSet.TRAIN_HARD), domains)
    validation = drawn(out / "validation.parquet", (DataSet.VALIDATION, DataSet.VALIDATION_HARD), EXAMINED)
    options = LearnOptions(seed=seed, steps=steps, polish=steps * LearnOptions.polish // LearnOptions.steps)
    learner = Learner(Bank(*training.values()), options)
    rows, seconds, checkpoint = [], [], out / "checkpoint.safetensors"
    if checkpoint.is_file():
        read_checkpoint(checkpoint, learner)
        rows = read_table(out / "curve.parquet").to_dict("records")
        seconds = read_table(out / "curve-seconds.parquet").to_dict("records")
    # imported here because its import takes a second
    from torch.utils.tensorboard import SummaryWriter

    early = max(1, int(EARLY * (options.steps - options.polish)))
    with SummaryWriter(str(out / "tensorboard"), purge_step=learner.step) as board:
        begin = time.process_time() - (seconds[-1]["cpu_seconds"] if seconds else 0.0)
        advance, reward = counter("training steps", steps, learner.step), _reward(rows)
        while learner.step < steps and (time.monotonic() < due or not rows):
            worth, error = learner.advance()
            advance(reward)
            if learner.step % EVERY and learner.step not in {steps, early} and time.monotonic() < due:
                continue
            rows.append(row_of(learner, worth, error, validation))
            reward = _reward(rows)
            seconds.append({"step": learner.step, "cpu_seconds": time.process_time() - begin})
            for name, value in rows[-1].items():
                board.add_scalar(name, value, learner.step)
            write_table(out / "curve.parquet", pd.DataFrame(rows))
            write_table(out / "curve-seconds.parquet", pd.DataFrame(seconds))
            write_checkpoint(checkpoint, learner)
            last = {key: value for key, value in rows[-1].items() if key.startswith("validation")}
            name = "early" if learner.step == early else "agent"
            card = card_of(learner, len(training[DataSet.TRAIN.key]), last)
            write_policy(out / f"{name}.safetensors", weights_of(learner.networks), card)
            typer.echo(f"step {learner.step}: " + json.dumps(card["validation"]))
    if learner.step < steps:
        beside.terminate()  # it goes on from its own checkpoint
        beside.join()
        return False
    beside.join()
    if beside.exitcode:
        raise InputError("training", "the placement of C-type meshes ended early", "run the same command again")
    complete(out)
    typer.echo(out / "agent.safetensors")
    return True


def _reward(rows: Sequence[Mapping[str, float]]) -> str:
    """Return the reward of the last row of the curve in words; empty where there is none."""
    return f"reward {rows[-1][REWARD]:.4f} on the validation set" if rows else ""


def complete(out: Path) -> None:
    """Add the weights for C-type meshes to the policy."""
    path = out / "agent.safetensors"
    own = {key: value for key, value in load_file(transitions_in(out)).items() if key.startswith(TRANSITIONS)}
    last = read_table(out / "curve-transitions.parquet").iloc[-1].to_dict()
    told = {"steps": int(last["step"]), "validation": {key: round(last[key], 4) for key in ("reward", "valid")}}
    write_policy(path, read_weights(path) | own, read_card(path) | {"transitions": told})


if __name__ == "__main__":
    run(train)
