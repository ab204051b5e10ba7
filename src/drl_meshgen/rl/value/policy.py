"""Greedy policies from trained networks: files without pickles, checked before use."""

import json
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np
import safetensors
import safetensors.torch

from drl_meshgen.errors import InputError
from drl_meshgen.export.atomic import replacing
from drl_meshgen.rl.environment import EnvironmentOptions
from drl_meshgen.rl.value.episodes import play
from drl_meshgen.rl.value.networks import ActionNetwork, Encoder, NetworkOptions, network
from drl_meshgen.rl.vector import VectorEnvironment
from drl_meshgen.templates.domain import Domain
from drl_meshgen.templates.o_type import OParameters
from drl_meshgen.templates.score import Weights

FORMAT = "drl-meshgen value policy 1"


@dataclass(frozen=True, eq=False)
class ValuePolicy:
    """Takes the action of highest score at every step; deterministic."""

    network: ActionNetwork
    """Scores of actions."""
    environment: EnvironmentOptions
    """Action space it was trained in."""

    def choose(self, domain: Domain) -> OParameters:
        """Return the parameters of an O-type mesh, which may have folded quads; `InputError` for a domain too large."""
        return self.choose_all([domain])[0]

    def choose_all(self, domains: Sequence[Domain]) -> list[OParameters]:
        """Return those of many domains, found side by side."""
        episodes = VectorEnvironment(domains, len(domains), self.environment)
        play(self.network, episodes, np.arange(len(domains)))
        return [episodes.parameters(i) for i in range(len(domains))]


def save_value_policy(path: Path | str, policy: ValuePolicy, options: NetworkOptions, origin: dict[str, Any]) -> None:
    """Write a policy as safetensors in float32, with what it takes to set it up and where it comes from."""
    shape = asdict(options) | {"encoder": options.encoder.value}
    header = {"network": shape, "environment": asdict(policy.environment), "origin": origin}
    metadata = {"format": FORMAT} | {key: json.dumps(value, sort_keys=True) for key, value in header.items()}
    weights = {key: value.contiguous() for key, value in policy.network.state_dict().items()}
    with replacing(path) as part:
        safetensors.torch.save_file(weights, part, metadata)


def load_value_policy(path: Path | str) -> ValuePolicy:
    """Read what `save_value_policy` wrote; raises `InputError` for a file that is truncated, of another kind or misfit.

    Nothing is unpickled.
    """
    name = str(path)
    try:
        with safetensors.safe_open(path, "pt") as file:
            metadata = file.metadata() or {}
            weights = {key: file.get_tensor(key) for key in file.keys()}  # noqa: SIM118 - no mapping
    except (OSError, safetensors.SafetensorError) as error:
        raise InputError(name, f"cannot be read ({error})", "train it again or fetch it anew") from error
    if metadata.get("format") != FORMAT:
        raise InputError(name, "is no value policy of this version", f'its format must be "{FORMAT}"')
    try:
        shape, given = json.loads(metadata["network"]), json.loads(metadata["environment"])
        options = NetworkOptions(**shape | {"encoder": Encoder(shape["encoder"])})
        given |= {"layers": tuple(given["layers"]), "weights": Weights(**given["weights"])}
        environment = EnvironmentOptions(**given)
        model = network(environment.actions, options, environment, 0)
        model.load_state_dict(weights)
    except (KeyError, TypeError, ValueError, RuntimeError) as error:
        raise InputError(name, f"its weights do not fit its description ({error})", "train it again") from error
    return ValuePolicy(model.requires_grad_(requires_grad=False), environment)
