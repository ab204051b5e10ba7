"""Policies as safetensors files: weights by name and a card; nothing in them is ever executed."""

import json
from collections.abc import Mapping
from functools import cache
from pathlib import Path
from typing import Any, Final

import torch
from safetensors import SafetensorError, safe_open
from safetensors.torch import save

from drl_meshgen.errors import InputError
from drl_meshgen.export.atomic import replacing
from drl_meshgen.rl.agent import AgentOptions, AgentPolicy
from drl_meshgen.rl.corner_value import CornerValue
from drl_meshgen.rl.placer import Placer

FORMAT: Final = "drl-meshgen policy"
VERSION: Final = 1
SHIPPED: Final = Path(__file__).parent / "policies" / "agent.safetensors"


def weights_of(corner: CornerValue, placer: Placer) -> dict[str, torch.Tensor]:
    """Return the weights of both networks by name."""
    parts = {"corner": corner.state_dict(), "placer": placer.state_dict()}
    return {f"{part}.{name}": value.contiguous() for part, state in parts.items() for name, value in state.items()}


def write_policy(path: Path | str, corner: CornerValue, placer: Placer, card: Mapping[str, Any]) -> None:
    """Write both networks and what there is to say about them; same weights and card, same bytes."""
    sizes = {"corner_width": corner.width, "width": placer.width, "answered": placer.answered}
    told = {"format": FORMAT, "version": VERSION, **sizes, **card}
    # one key, because the order of several is not fixed
    data = save(weights_of(corner, placer), {"card": json.dumps(told, sort_keys=True)})
    with replacing(path) as part:
        Path(part).write_bytes(data)


def read_policy(path: Path | str, options: AgentOptions | None = None) -> AgentPolicy:
    """Return the policy of a file; raises `InputError` for one that is damaged, foreign, or of another version."""
    weights, card = _read(Path(path))
    name = Path(path).name
    try:
        corner = CornerValue(int(card["corner_width"]))
        placer = Placer(int(card["width"]), answered=int(card["answered"]))
    except (KeyError, TypeError, ValueError):
        raise InputError(name, "is a policy file without its size", "take a file written by training") from None
    expected = {key: tuple(value.shape) for key, value in weights_of(corner, placer).items()}
    found = {key: tuple(value.shape) for key, value in weights.items()}
    for key in sorted(expected.keys() | found.keys()):
        if expected.get(key) != found.get(key):
            what = f"weight {key} has shape {found.get(key, 'none')}, not {expected.get(key, 'none')}"
            raise InputError(name, what, "take a file written by this version")
    for part, network in (("corner.", corner), ("placer.", placer)):
        network.load_state_dict({key.removeprefix(part): v for key, v in weights.items() if key.startswith(part)})
    return AgentPolicy(corner, placer, options)


def read_card(path: Path | str) -> dict[str, Any]:
    """Return what a policy file says about itself."""
    return _read(Path(path))[1]


@cache
def shipped_policy() -> AgentPolicy:
    """Return the policy that comes with the package; read once."""
    return read_policy(SHIPPED)


def _read(path: Path) -> tuple[dict[str, torch.Tensor], dict[str, Any]]:
    if not path.is_file():
        raise InputError(path.name, "no such policy file", "give the path of a .safetensors file")
    try:
        with safe_open(path, framework="pt") as file:
            card = json.loads((file.metadata() or {}).get("card", "{}"))
            weights = {key: file.get_tensor(key) for key in file.keys()}  # noqa: SIM118 - it is no mapping
    except (SafetensorError, ValueError) as error:
        raise InputError(path.name, f"is not a whole safetensors file ({error})", "copy it again") from None
    if not isinstance(card, dict) or card.get("format") != FORMAT:
        raise InputError(path.name, "is a safetensors file but no policy", "take a file written by training")
    if card.get("version") != VERSION:
        what = f"is a policy of version {card.get('version')}, this program reads version {VERSION}"
        raise InputError(path.name, what, "train it again, or take the one that comes with the program")
    return weights, card
