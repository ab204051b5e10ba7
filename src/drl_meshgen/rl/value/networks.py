"""Networks that score actions: the paper's graph encoder with one shared head, and one that sees corners relatively.

Both take the observation of `OTypeEnvironment` as tensors with a leading batch axis b, and give one number for each of
the first `width` actions. Masks are the caller's business.
"""

from abc import ABC, abstractmethod
from dataclasses import dataclass
from enum import Enum
from typing import Any

import numpy as np
import torch
from jaxtyping import Float, Int
from torch import nn

from drl_meshgen.errors import InputError
from drl_meshgen.rl.environment import CORNERS, STEPS, EnvironmentOptions
from drl_meshgen.rl.vector import CHOSEN
from drl_meshgen.templates.curves import LINE_TYPES
from drl_meshgen.templates.o_type import EDGES

Batch = dict[str, torch.Tensor]
"""Observation of b states."""


class Encoder(Enum):
    """Which network."""

    GRAPH = "graph"
    RELATIVE = "relative"


@dataclass(frozen=True)
class NetworkOptions:
    """Kind and size of a network."""

    encoder: Encoder = Encoder.GRAPH
    """How it sees the domain."""
    nodes: int = 32
    """Features of a boundary node (count)."""
    rounds: int = 3
    """Rounds of message passing, or of convolution (count)."""
    hidden: int = 256
    """Width of the perceptron's two hidden layers (count)."""
    dueling: bool = False
    """Whether a state's value and the advantages of actions are told apart (Wang et al. 2016)."""


class ActionNetwork(nn.Module, ABC):
    """What learners ask of a network."""

    @abstractmethod
    def forward(self, seen: Batch, width: int) -> Float[torch.Tensor, "b w"]:
        """Return the values of the first `width` actions."""

    def at(self, seen: Batch, actions: Int[torch.Tensor, " b"]) -> Float[torch.Tensor, " b"]:
        """Return the value of one action per state."""
        return self(seen, int(actions.max()) + 1).gather(1, actions[:, None])[:, 0]


class Renumbered(torch.autograd.Function):
    """Rows of a matrix in another order, whose gradient is the opposite reordering instead of a slow scattered sum."""

    @staticmethod
    def forward(ctx: Any, rows: torch.Tensor, order: torch.Tensor, inverse: torch.Tensor) -> torch.Tensor:
        """Return `rows[order]`; `inverse` undoes `order`."""
        ctx.save_for_backward(inverse)
        return rows.index_select(0, order)

    @staticmethod
    def backward(ctx: Any, *grads: torch.Tensor) -> tuple[torch.Tensor, None, None]:
        """Return the gradient by `rows`."""
        return grads[0].index_select(0, ctx.saved_tensors[0]), None, None


class GraphNetwork(ActionNetwork):
    """The paper's (section 5.2.2): h_G of the boundary cycle, joined with step and choices, a perceptron, one head.

    The paper gives neither features, rounds nor widths. Nodes carry their position, the sine and cosine of their place
    in the order (actions name nodes by number, so the network has to know it), and the turn of the boundary. A round
    adds to each node what it makes of itself and its two neighbours; h_G is the mean over the nodes.
    """

    def __init__(self, actions: int, options: NetworkOptions) -> None:
        """Set up for a number of actions."""
        super().__init__()
        d = options.nodes
        self.lift = nn.Linear(6, d)
        self.rounds = nn.ModuleList(nn.Linear(d, 3 * d) for _ in range(options.rounds))
        self.read = nn.Linear(d, 2 * d)
        self.body = nn.Sequential(
            nn.Linear(2 * d + STEPS + CHOSEN, options.hidden),
            nn.ReLU(),
            nn.Linear(options.hidden, options.hidden),
            nn.ReLU(),
        )
        self.head = nn.Linear(options.hidden, actions)

    def encode(self, boundary: Float[torch.Tensor, "b p 2"], count: Float[torch.Tensor, "b 1"]) -> torch.Tensor:
        """Return h_G; the cycles of all domains are one graph, node after node."""
        number = torch.arange(boundary.shape[1])
        place = boundary[there := number < count]
        size = count[:, 0].long()
        last = size.cumsum(0) - 1
        first = last - size + 1
        node = torch.arange(len(place))
        before, after = node - 1, node + 1
        before[first], after[last] = last, first
        angle = (2 * np.pi * number / count)[there]
        ahead, behind = place[after] - place, place - place[before]
        along = torch.linalg.vector_norm(ahead, dim=-1)
        turn = (behind[:, 0] * ahead[:, 1] - behind[:, 1] * ahead[:, 0]) / (along * along[before]).clamp(min=1e-6)
        known = torch.stack([angle.sin(), angle.cos(), turn, along], dim=-1)
        h = self.lift(torch.cat([place, known], dim=-1)).relu()
        for message in self.rounds:
            own, forth, back = message(h).chunk(3, dim=-1)
            h = h + (own + Renumbered.apply(forth, before, after) + Renumbered.apply(back, after, before)).relu()
        row = torch.repeat_interleave(torch.arange(len(size)), size)
        read = self.read(h).relu()
        return torch.zeros(len(size), read.shape[1]).index_add(0, row, read) / count

    def features(self, seen: Batch) -> torch.Tensor:
        """Return the last hidden layer."""
        return self.body(torch.cat([self.encode(seen["boundary"], seen["count"]), seen["step"], seen["chosen"]], dim=1))

    def forward(self, seen: Batch, width: int) -> Float[torch.Tensor, "b w"]:
        """Return the values of the first `width` actions."""
        return nn.functional.linear(self.features(seen), self.head.weight[:width], self.head.bias[:width])

    def at(self, seen: Batch, actions: Int[torch.Tensor, " b"]) -> Float[torch.Tensor, " b"]:
        """Return the value of one action per state, without working out the others."""
        return (self.features(seen) * self.head.weight[actions]).sum(dim=1) + self.head.bias[actions]


RING = 64
"""Points at which the relative network sees the boundary."""
REACHES = (1, 2, 4, 8, 16, 32)
"""How far along the ring a point sees its surroundings."""
SIDE = 16
"""Points on each side between corners."""


class RelativeNetwork(ActionNetwork):
    """Sees what does not change when the domain is turned or its nodes are renumbered.

    Corners: points of the boundary see their surroundings from their tangent; a circular convolution embeds them, and
    a pair `(i0, m)` is scored from the embeddings of its four corners. What follows: the four sides and all choices
    in the frame of the corners, whose x axis points from sides 3 to 1, through a perceptron.
    """

    def __init__(self, actions: int, options: NetworkOptions, environment: EnvironmentOptions | None = None) -> None:
        """Set up for a number of actions, of which all but corners number less than those of `environment`."""
        super().__init__()
        env = environment or EnvironmentOptions()
        d = options.nodes
        self.actions, self.narrow, self.dueling = actions, max(env.positions**2, len(LINE_TYPES)), options.dueling
        self.lift = nn.Linear(4 * len(REACHES), d)
        self.rounds = nn.ModuleList(
            nn.Conv1d(d, d, 3, padding=2**i, dilation=2**i, padding_mode="circular") for i in range(options.rounds)
        )
        self.corner = nn.ModuleList([nn.Linear(d, d), nn.Linear(d, d, bias=False), nn.Linear(4, d, bias=False)])
        self.score = nn.Linear(d, 1)
        self.body = nn.Sequential(
            nn.Linear(8 * SIDE + 8 + 1 + 2 * EDGES + STEPS + 1, options.hidden),
            nn.ReLU(),
            nn.Linear(options.hidden, options.hidden),
            nn.ReLU(),
        )
        self.head = nn.Linear(options.hidden, self.narrow)
        self.ring_value, self.side_value = nn.Linear(d, 1), nn.Linear(options.hidden, 1)
        self.lines: torch.Tensor
        self.register_buffer("lines", torch.tensor(LINE_TYPES, dtype=torch.float32), persistent=False)

    def both(self, seen: Batch, width: int) -> tuple[Float[torch.Tensor, "b w"], Float[torch.Tensor, " b"]]:
        """Return advantages of the first `width` actions and values of the states, separately."""
        cornering = seen["step"][:, CORNERS] > 0
        scores, value = torch.zeros(len(cornering), width), torch.zeros(len(cornering))
        for rows, part in ((cornering, self._pairs), (~cornering, self._placements)):
            if rows.any():
                found, worth = part({key: one[rows] for key, one in seen.items()})
                among = nn.functional.pad(found, (0, max(width - found.shape[1], 0)))[:, :width]
                scores, value = scores.index_put((rows,), among), value.index_put((rows,), worth)
        return scores, value

    def forward(self, seen: Batch, width: int) -> Float[torch.Tensor, "b w"]:
        """Return the values of the first `width` actions."""
        scores, value = self.both(seen, width)
        return value[:, None] + scores if self.dueling else scores

    def _pairs(self, seen: Batch) -> tuple[torch.Tensor, torch.Tensor]:
        """Score all pairs of corners, those of no domain among them; mean 0 over those that there are if dueling."""
        size = seen["count"][:, 0].long()
        nodes = torch.view_as_complex(seen["boundary"].contiguous())
        ring = along(nodes, size, torch.arange(RING) * (size / RING)[:, None])
        h = self.lift(surroundings(ring)).relu().transpose(1, 2)
        for convolution in self.rounds:
            h = h + convolution(h).relu()
        embedded = h.transpose(1, 2)
        half = size // 2
        most = int(half.max())
        number = torch.arange(most) * (RING / size)[:, None]
        opposite = (lerp(embedded, number) + lerp(embedded, number + RING / 2)).relu()
        first, second = self.corner[0](opposite), self.corner[1](opposite)
        action = torch.arange(most * (most - 1))
        i0, m = action // (half[:, None] - 1), action % (half[:, None] - 1) + 1
        there = i0 < half[:, None]
        i0, ahead = torch.where(there, i0, 0), torch.where(there, (i0 + m) % half[:, None], 0)
        row = torch.arange(len(size))[:, None]
        part = m / half[:, None]
        shape = torch.stack([part, part**2, (np.pi * part).sin(), (2 * np.pi * part).cos()], dim=-1)
        found = self.score((first[row, i0] + second[row, ahead] + self.corner[2](shape)).relu())[..., 0]
        if self.dueling:
            found = found - torch.where(there, found, 0.0).sum(dim=1, keepdim=True) / there.sum(dim=1, keepdim=True)
        return found, self.ring_value(embedded.mean(dim=1))[:, 0]

    def _placements(self, seen: Batch) -> tuple[torch.Tensor, torch.Tensor]:
        chosen, size = seen["chosen"], seen["count"][:, 0].long()
        i0, m = (chosen[:, :2] * seen["count"]).round().T
        n = size / 2 - m
        nodes = torch.view_as_complex(seen["boundary"].contiguous())
        t = torch.arange(SIDE) / SIDE
        starts = torch.stack([i0, i0 + m, i0 + m + n, i0 + 2 * m + n], dim=1)
        sides = along(nodes, size, (starts[..., None] + torch.stack([m, n, m, n], dim=1)[..., None] * t).flatten(1))
        corner = sides[:, ::SIDE]
        centre, axis = corner.mean(dim=1, keepdim=True), corner[:, 1:3].sum(dim=1) - corner[:, [0, 3]].sum(dim=1)
        turn = (axis.conj() / axis.abs().clamp(min=1e-6))[:, None]
        placed = torch.view_as_complex(chosen[:, 2:10].reshape(-1, 4, 2).contiguous())
        known = torch.arange(4) < seen["step"].argmax(dim=1)[:, None] - 1
        placed = torch.where(known, (placed - centre) * turn, 0.0)
        lines = self.lines[(chosen[:, 11:] * len(LINE_TYPES)).round().long()]
        parts = [torch.view_as_real((sides - centre) * turn), torch.view_as_real(placed), lines]
        flat = [part.flatten(1) for part in parts]
        told = [chosen[:, 10:11], chosen[:, 1:2] * 2, seen["step"]]
        hidden = self.body(torch.cat([*flat, *told], dim=1))
        found = self.head(hidden)
        if self.dueling:
            found = found - found.mean(dim=1, keepdim=True)
        return found, self.side_value(hidden)[:, 0]


def lerp(values: torch.Tensor, at: Float[torch.Tensor, "b k"]) -> torch.Tensor:
    """Return values (b, r, ...) along rings of r points, linear in between, at places counted in points."""
    low = at.floor()
    share = (at - low).reshape(*at.shape, *[1] * (values.ndim - 2))
    row, first = torch.arange(len(values))[:, None], low.long() % values.shape[1]
    return values[row, first] * (1 - share) + values[row, (first + 1) % values.shape[1]] * share


def along(
    nodes: torch.Tensor, size: Int[torch.Tensor, " b"], at: Float[torch.Tensor, "b k"]
) -> Float[torch.Tensor, "b k"]:
    """Return boundary points (complex) at places counted in nodes, of boundaries of `size` nodes."""
    low = at.floor()
    row, first = torch.arange(len(nodes))[:, None], low.long() % size[:, None]
    return nodes[row, first] * (1 - (at - low)) + nodes[row, (first + 1) % size[:, None]] * (at - low)


def surroundings(ring: torch.Tensor) -> Float[torch.Tensor, "b r f"]:
    """Return what each point (complex) of a ring sees to both sides, from its tangent, and the centre of the frame."""
    tangent = torch.roll(ring, -1, dims=1) - torch.roll(ring, 1, dims=1)
    turn = tangent.conj() / tangent.abs().clamp(min=1e-6)
    views = [torch.roll(ring, sign * s, dims=1) - ring for s in REACHES[:-1] for sign in (-1, 1)]
    views += [torch.roll(ring, REACHES[-1], dims=1) - ring, -ring]
    return torch.view_as_real(torch.stack(views, dim=-1) * turn[..., None]).flatten(2)


def network(actions: int, options: NetworkOptions, environment: EnvironmentOptions, seed: int) -> ActionNetwork:
    """Return a network with random weights; the same for the same seed."""
    with torch.random.fork_rng(devices=[]):
        torch.manual_seed(seed)
        if options.encoder is Encoder.RELATIVE:
            return RelativeNetwork(actions, options, environment)
        if options.dueling:
            raise InputError("network", "the graph network has no dueling head", "take the relative one")
        return GraphNetwork(actions, options)


def tensors(arrays: dict[str, np.ndarray]) -> Batch:
    """Return an observation as tensors."""
    return {key: torch.as_tensor(array) for key, array in arrays.items()}
