"""Training that can be interrupted: weights, moments of Adam and the step as one safetensors file."""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Protocol

import torch
from safetensors import SafetensorError, safe_open
from safetensors.torch import save_file
from torch import nn

from drl_meshgen.errors import InputError
from drl_meshgen.export.atomic import replacing
from drl_meshgen.rl.networks import load, weights_of


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


def write_checkpoint(path: Path, learner: Resumable) -> None:
    """Write weights, the optimisers' moments and the step."""
    tensors = {key: torch.as_tensor(value) for key, value in weights_of(learner.networks).items()}
    for i, optimiser in enumerate(learner.optimisers):
        for key, moments in optimiser.state_dict()["state"].items():
            tensors |= {f"adam.{i}.{key}.{name}": value.contiguous() for name, value in moments.items()}
    with replacing(path) as part:
        save_file(tensors, part, {"step": str(learner.step)})


def read_checkpoint(path: Path, learner: Resumable) -> None:
    """Continue a learner from a checkpoint; raises `InputError` where it is damaged or its options were others."""
    try:
        with safe_open(path, framework="pt") as file:
            step = int(file.metadata()["step"])
            tensors = {key: file.get_tensor(key) for key in file.keys()}  # noqa: SIM118
    except (SafetensorError, KeyError, TypeError, ValueError):
        raise InputError(path.name, "is no whole checkpoint", "delete it and begin anew") from None
    here = weights_of(learner.networks)
    if any(key not in tensors or tensors[key].shape != value.shape for key, value in here.items()):
        raise InputError(path.name, "is a checkpoint of other networks", "give another folder, or delete it")
    load(learner.networks, {key: tensors[key].numpy() for key in here})
    for i, optimiser in enumerate(learner.optimisers):
        state: dict[int, dict[str, torch.Tensor]] = {}
        for key in (key for key in tensors if key.startswith(f"adam.{i}.")):
            _, _, index, name = key.split(".")
            state.setdefault(int(index), {})[name] = tensors[key]
        optimiser.load_state_dict({"state": state, "param_groups": optimiser.state_dict()["param_groups"]})
    learner.step = step
