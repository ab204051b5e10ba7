"""Training that can be interrupted: weights, moments of Adam and counts as one safetensors file."""

import json
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, Protocol

import torch
from safetensors import SafetensorError, safe_open
from safetensors.torch import save_file
from torch import nn

from drl_meshgen.errors import InputError
from drl_meshgen.export.atomic import replacing
from drl_meshgen.rl.networks import load, weights_of

Snapshot = tuple[dict[str, torch.Tensor], dict[str, int]]
"""Tensors and counts of a learner, by name."""


class Resumable(Protocol):
    """A learner whose draws depend on its step alone."""

    step: int

    @property
    def networks(self) -> Mapping[str, nn.Module]:
        """Return its networks by name."""
        ...

    @property
    def optimisers(self) -> Sequence[torch.optim.Adam]:
        """Return their optimisers."""
        ...


def state_of(networks: Mapping[str, nn.Module], optimisers: Sequence[torch.optim.Adam]) -> dict[str, torch.Tensor]:
    """Return weights, called `network.name`, and the optimisers' moments, called `adam.i.parameter.name`."""
    tensors = {key: torch.as_tensor(value) for key, value in weights_of(networks).items()}
    for i, optimiser in enumerate(optimisers):
        for key, moments in optimiser.state_dict()["state"].items():
            tensors |= {f"adam.{i}.{key}.{name}": value.contiguous() for name, value in moments.items()}
    return tensors


def restore(
    networks: Mapping[str, nn.Module], optimisers: Sequence[torch.optim.Adam], tensors: Mapping[str, torch.Tensor]
) -> None:
    """Give back what `state_of` told; raises `RuntimeError` where weights are of other networks."""
    load(networks, {key: value.numpy() for key, value in tensors.items()})
    for i, optimiser in enumerate(optimisers):
        state: dict[int, dict[str, torch.Tensor]] = {}
        for key in (key for key in tensors if key.startswith(f"adam.{i}.")):
            _, _, index, name = key.split(".")
            state.setdefault(int(index), {})[name] = tensors[key]
        optimiser.load_state_dict({"state": state, "param_groups": optimiser.state_dict()["param_groups"]})


def write_tensors(path: Path, tensors: dict[str, torch.Tensor], key: str, facts: Any) -> None:
    """Write tensors and, as sorted JSON under `key` in the header, whatever else there is to know.

    A header of several entries would have them in any order, and files of the same content would differ.
    """
    with replacing(path) as part:
        save_file(tensors, part, {key: json.dumps(facts, sort_keys=True)})


def read_tensors(path: Path, key: str) -> tuple[dict[str, torch.Tensor], Any]:
    """Return what `write_tensors` wrote under the same `key`; raises `InputError` for a file that is damaged."""
    try:
        with safe_open(path, framework="pt") as file:
            facts = json.loads(file.metadata()[key])
            return {key: file.get_tensor(key) for key in file.keys()}, facts  # noqa: SIM118 - no mapping
    except (SafetensorError, KeyError, TypeError, ValueError):
        raise InputError(path.name, "is no whole checkpoint", "delete it and begin anew") from None


def write_checkpoint(path: Path, learner: Resumable) -> None:
    """Write weights, the optimisers' moments and the step."""
    write_tensors(path, state_of(learner.networks, learner.optimisers), "step", learner.step)


def read_checkpoint(path: Path, learner: Resumable) -> None:
    """Continue a learner from a checkpoint; raises `InputError` where it is damaged or its options were others."""
    tensors, step = read_tensors(path, "step")
    try:
        restore(learner.networks, learner.optimisers, tensors)
    except RuntimeError:
        raise InputError(path.name, "is a checkpoint of other networks", "give another folder, or delete it") from None
    learner.step = step
