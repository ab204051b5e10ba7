"""What the networks see: nodes of the boundary each in its tangent frame, and four-sided domains in theirs."""

from collections.abc import Callable
from dataclasses import dataclass
from functools import cache
from typing import Any, Final

import numba
import numpy as np
from jaxtyping import Float, Int

from drl_meshgen.rl import boundary
from drl_meshgen.rl.boundary import PER_SIDE
from drl_meshgen.rl.controls import parts_of
from drl_meshgen.templates.corners import reference

#: Where a node looks along the boundary, ahead and back, as shares of its nodes.
SHARES: Final = (
    0.01,
    0.02,
    0.03,
    0.045,
    0.06,
    0.08,
    0.105,
    0.13,
    0.16,
    0.19,
    0.22,
    0.25,
    0.29,
    0.33,
    0.37,
    0.41,
    0.455,
)
VIEWED: Final = 4 * len(SHARES) + 2
"""Numbers that a node sees: places ahead and back, its spacing and the size of the domain."""


@cache
def corner_choices(size: int, most: int) -> tuple[Int[np.ndarray, "c 2"], Int[np.ndarray, "c 4"]]:
    """Return distinct choices of corners `(i0, m)`, `m <= n`, of a boundary of `size` nodes, and the four nodes.

    All of them, or where they are more than `most`, those for evenly spaced values of m.
    """
    half = size // 2
    values = np.unique(np.linspace(1, half // 2, min(half // 2, max(2, most // half))).round().astype(np.int64))
    i0, m = (part.ravel() for part in np.meshgrid(np.arange(half), values, indexing="ij"))
    keep = (2 * m < half) | (i0 < m)
    i0, m = i0[keep], m[keep]
    start = np.stack([0 * m, m, 0 * m + half, m + half], axis=1)
    return np.stack([i0, m], axis=1), (i0[:, None] + start) % size


def views(nodes: Float[np.ndarray, "b l 2"]) -> Float[np.ndarray, "b l s"]:
    """Return what each node of domains of unit scale sees."""
    steps = np.maximum(1, np.round(np.array(SHARES) * nodes.shape[1]).astype(np.int64))
    return _views(np.ascontiguousarray(nodes, np.float64), np.concatenate([steps, -steps]))


@numba.njit(cache=True, error_model="numpy")
def _views(nodes: np.ndarray, steps: np.ndarray) -> np.ndarray:
    size, count = nodes.shape[1], len(steps)
    result = np.empty((len(nodes), size, 2 * count + 2))
    for b in range(len(nodes)):
        for i in range(size):
            here, tail, head = nodes[b, i], nodes[b, i - 1], nodes[b, (i + 1) % size]
            tx, ty = head[0] - tail[0], head[1] - tail[1]
            length = np.hypot(tx, ty)
            tx, ty = tx / length, ty / length
            for k in range(count):
                seen = nodes[b, (i + steps[k]) % size]
                dx, dy = seen[0] - here[0], seen[1] - here[1]
                result[b, i, k] = dx * tx + dy * ty
                result[b, i, count + k] = dy * tx - dx * ty
            result[b, i, 2 * count] = np.log(length / 2 * size / 8)
            result[b, i, 2 * count + 1] = np.log(size / 100)
    return result


EXTRAS: Final = 2
"""Numbers that no symmetry changes: those of `log_counts`."""
SEEN: Final = 8 * PER_SIDE + 2 + EXTRAS
"""Inputs: 16 samples a side, m / L and n / L, and the extras."""
MOST_BULGE: Final = 0.6
"""Largest amplitude of a bow or S, in chords."""


@dataclass(frozen=True, eq=False)
class Scene:
    """What the placement policy sees of `b` four-sided domains, in their frames, and how its answers return from there.

    Arrays, or tensors of PyTorch (`each`).
    """

    seen: Float[Any, "b s"]
    singular: Float[Any, "b 4 2"]
    """Tutte's singular points, in the frame."""
    origin: Float[Any, "b 2"]
    rotation: Float[Any, "b 2 2"]
    """Row vectors of the frame times this are vectors of the plane."""

    @classmethod
    def of(
        cls,
        rim: Float[np.ndarray, "b r 2"],
        m: Int[np.ndarray, " b"],
        size: Int[np.ndarray, " b"] | int,
        layers: Int[np.ndarray, " b"] | int,
    ) -> "Scene":
        """Look at domains of unit scale with `size` nodes; `rim` as `side_samples` gives it."""
        z = rim[..., 0] + 1j * rim[..., 1]
        origin, direction = boundary.square_frame(z)
        z = (z - origin) / direction
        samples = np.stack([np.real(z), np.imag(z)], axis=-1)
        share = m / size
        counts = np.broadcast_arrays(2 * share, 1 - 2 * share, *log_counts(size, layers), share)[:-1]
        seen = np.concatenate([samples.reshape(len(z), -1), np.stack(counts, axis=1)], axis=1)
        matrix, _ = reference(PER_SIDE // 2, 3)
        start = 3 * 2 * PER_SIDE
        singular = matrix[start : start + 2 * PER_SIDE : PER_SIDE // 2] @ samples[:, ::2]
        c, s = np.real(direction[:, 0]), np.imag(direction[:, 0])
        rotation = np.stack([np.stack([c, s], axis=1), np.stack([-s, c], axis=1)], axis=1)
        return cls(seen, singular, np.concatenate([np.real(origin), np.imag(origin)], axis=1), rotation)

    def each(self, convert: Callable[[np.ndarray], Any]) -> "Scene":
        """Return the scene with its arrays converted."""
        return type(self)(*map(convert, (self.seen, self.singular, self.origin, self.rotation)))

    def placed(self, answer: Float[Any, "b c"], tanh: Callable[[Any], Any] = np.tanh) -> dict[str, Any]:
        """Return what was answered as fields of `OParameters`, in the plane; `tanh` for the kind of array."""
        parts = parts_of(answer)
        singular = (self.singular + parts["singular"]) @ self.rotation + self.origin[:, None]
        found = {"singular": singular, "bulges": MOST_BULGE * tanh(parts["bulges"] / MOST_BULGE)}
        rest = [name for name in parts if name not in found]
        return found | {name: parts[name] @ self.rotation[:, None] for name in rest}


def log_counts(size: Int[np.ndarray, " b"] | int, layers: Int[np.ndarray, " b"] | int) -> tuple[np.ndarray, np.ndarray]:
    """Return numbers of boundary nodes (at least 24) and layers, on a scale on which networks learn them."""
    return np.log(np.maximum(size, 24) / 100), np.log(np.asarray(layers) / 6)
