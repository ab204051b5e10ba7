"""Policies as safetensors files: weights by name and a card; nothing in them is ever executed."""

import json
from collections.abc import Mapping, Sequence
from itertools import pairwise
from pathlib import Path
from typing import Any, Final

import numpy as np
from safetensors import SafetensorError, safe_open
from safetensors.numpy import save

from drl_meshgen.errors import InputError
from drl_meshgen.export.atomic import replacing
from drl_meshgen.rl import c_scene
from drl_meshgen.rl.agent import TRANSITIONS, AgentOptions, AgentPolicy
from drl_meshgen.rl.controls import PLAIN, SHAPED
from drl_meshgen.rl.inference import Weights
from drl_meshgen.rl.scene import SEEN, VIEWED

FORMAT: Final = "drl-meshgen policy"
VERSION: Final = 1
NAME: Final = "policy"
"""What errors are about; a run puts its surface there, so the file is named in the sentence as well."""


def write_policy(path: Path | str, weights: Weights, card: Mapping[str, Any]) -> None:
    """Write the weights of the networks and what there is to say of them; same weights and card, same bytes."""
    told = {"format": FORMAT, "version": VERSION, **card}
    # one key, because the order of several is not fixed
    data = save(dict(weights), {"card": json.dumps(told, sort_keys=True)})
    with replacing(path) as part:
        part.write_bytes(data)


def read_policy(path: Path | str, options: AgentOptions | None = None) -> AgentPolicy:
    """Return the policy of a file; raises `InputError` for one that is damaged, foreign, or of another version."""
    weights = read_weights(path)
    for name, shape in _shapes(weights).items():
        found = weights[name].shape if name in weights else "none"
        if found != shape or weights[name].dtype != np.float32:
            what = f"{Path(path).name}: weight {name} has shape {found}, not {shape}, or another type"
            raise InputError(NAME, what, "take a file written by this version")
    return AgentPolicy(weights, options)


def _shapes(weights: Weights) -> dict[str, tuple[int, ...]]:
    """Return the weights that there must be, with their shapes, in a policy with hidden layers as wide as these."""
    shapes: dict[str, tuple[int, ...]] = {}

    def perceptron(prefix: str, sizes: Sequence[int]) -> None:
        for i, (a, b) in enumerate(pairwise(sizes)):
            shapes.update({f"{prefix}.{2 * i}.weight": (b, a), f"{prefix}.{2 * i}.bias": (b,)})

    def width(name: str) -> int:
        return len(weights[name]) if name in weights and weights[name].ndim else 1

    node, last = width("corner.node.0.bias"), width("corner.node.4.bias")
    perceptron("corner.node", (VIEWED, node, node, max(3, last // 3 * 3)))
    perceptron("corner.choice", (2 * (last // 3) + 2, width("corner.choice.0.bias"), 1))
    hidden, answered = width("placer.body.0.bias"), width("placer.body.6.bias")
    perceptron("placer.body", (SEEN, hidden, hidden, hidden, PLAIN if answered == PLAIN else SHAPED))
    if any(name.startswith(TRANSITIONS) for name in weights):
        beside = width(f"{TRANSITIONS}.body.0.bias")
        perceptron(f"{TRANSITIONS}.body", (c_scene.SEEN, beside, beside, beside, c_scene.ANSWERED))
    return shapes


def read_weights(path: Path | str) -> dict[str, np.ndarray]:
    """Return the weights of a policy file by name, unchecked; raises `InputError` for a file that is none."""
    return _read(Path(path))[0]


def read_card(path: Path | str) -> dict[str, Any]:
    """Return what a policy file says about itself."""
    return _read(Path(path))[1]


def _read(path: Path) -> tuple[dict[str, np.ndarray], dict[str, Any]]:
    if not path.is_file():
        raise InputError(NAME, f"{path.name}: no such file", "give the path of a .safetensors file")
    try:
        with safe_open(path, framework="numpy") as file:
            card = json.loads((file.metadata() or {}).get("card", "{}"))
            weights = {key: file.get_tensor(key) for key in file.keys()}  # noqa: SIM118 - it is no mapping
    except (SafetensorError, ValueError) as error:
        raise InputError(NAME, f"{path.name} is not a whole safetensors file ({error})", "copy it again") from None
    if not isinstance(card, dict) or card.get("format") != FORMAT:
        raise InputError(NAME, f"{path.name} is a safetensors file but no policy", "take a file written by training")
    if card.get("version") != VERSION:
        what = f"{path.name} is a policy of version {card.get('version')}, this program reads version {VERSION}"
        raise InputError(NAME, what, "train it again, or take the one that comes with the program")
    return weights, card
