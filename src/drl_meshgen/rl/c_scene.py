"""What the placement policy of C-type meshes sees: the twelve parts of the rim in a frame, counts, and a reference.

The only other way to name the parts of the same four-sided domain is its mirror image. `SEEN_COLUMNS`, `SEEN_SIGNS`,
`ANSWER_COLUMNS` and `ANSWER_SIGNS` say what that does, as signed permutations of what the policy sees and answers.
"""

from collections.abc import Callable, Sequence
from functools import cache
from itertools import pairwise
from typing import Any, Final

import numba
import numpy as np
from jaxtyping import Float, Int

from drl_meshgen.rl.boundary import sample_run, signed_permutation, square_frame
from drl_meshgen.rl.scene import MOST_BULGE, Scene
from drl_meshgen.templates.c_type import BLOCK_CELLS, EDGES, RIM, SINGULAR, CCounts, layout

PER_PART: Final = 4
"""Samples of each part of the rim that the policy sees."""
SAMPLES: Final = len(RIM) * PER_PART
COUNTS: Final = ("q0", "p", "n", "q1", "below", "above")
SEEN: Final = 2 * SAMPLES + 8 + 2 * len(COUNTS) + 1
"""Inputs: samples, the reference's singular points, counts as shares of L and their logarithms, and log L."""
ANSWERED: Final = 8 + 2 * len(EDGES)
"""Answers: displacements of four singular points and two amplitudes of each internal edge."""

#: Columns of the counts of cells along `i` and `j` of each block.
CELLS: Final[np.ndarray] = np.array([[COUNTS.index(kind) for kind in pair] for pair in BLOCK_CELLS])
#: What the mirror image calls the same: vertices of the rim, singular points, counts.
MIRRORED: Final[dict[str, str]] = dict(
    zip((*RIM, *SINGULAR), [*(RIM[(5 - i) % len(RIM)] for i in range(len(RIM))), "F1", "F0", "B1", "B0"], strict=True)
)


@numba.njit(cache=True)
def part_samples(nodes: np.ndarray, start: np.ndarray, rims: np.ndarray, per_part: int) -> np.ndarray:
    """Return `(b, 12 per_part, 2)` points at equal arc length along each part of the rim, its first vertex among them.

    `nodes (b, l, 2)` or `(1, l, 2)` for all, `start (b,)` the bottom left corners, `rims (b, 12)` as `CCounts.rim`.
    """
    size, parts = nodes.shape[1], rims.shape[1]
    result = np.empty((len(rims), parts * per_part, 2))
    run = np.empty(size + 1)
    for b in range(len(rims)):
        loop = nodes[b if len(nodes) > 1 else 0]
        for s in range(parts):
            first = start[b] + rims[b, s]
            cells = (rims[b, s + 1] if s < parts - 1 else size) - rims[b, s]
            sample_run(loop, first, cells, run, result[b, s * per_part : (s + 1) * per_part])
    return result


@cache
def _stiffness(divisions: int) -> tuple[Float[np.ndarray, "18 u p"], int]:
    """Return what lines along `i`, then along `j`, of each block of a coarse C-grid add to a Laplacian of unit squares.

    Rows of its unknown nodes; and the number of known ones, the rim.
    """
    plan = layout(0, CCounts(*[divisions] * len(COUNTS)))
    known, parts = len(RIM) * divisions, []
    for across in (False, True):
        for grid in plan.grids:
            lines = grid.T if not across else grid
            laplacian = np.zeros((plan.size, plan.size))
            for at, line in enumerate(lines):
                weight = 0.5 if at in {0, divisions} else 1.0
                for a, b in pairwise(line):
                    laplacian[[a, b], [a, b]] += weight
                    laplacian[[a, b], [b, a]] -= weight
            parts.append(laplacian[known:])
    return np.array(parts), known


def reference(rim: Float[np.ndarray, "b r 2"], counts: Int[np.ndarray, "b 6"]) -> Float[np.ndarray, "b 4 2"]:
    """Return singular points as Tutte's embedding of the mesh puts them, on a grid of 2 x 2 cells a block.

    Lines of a coarse block pull as its lines of the mesh do together; `rim` as `part_samples` gives it.
    """
    parts, known = _stiffness(2)
    ni, nj = counts[:, CELLS[:, 0]], counts[:, CELLS[:, 1]]
    pull = np.concatenate([nj / ni, ni / nj], axis=1)
    laplacian = np.tensordot(pull, parts, 1)
    every = rim.shape[1] // known
    return np.linalg.solve(laplacian[:, :, known:], -laplacian[:, :, :known] @ rim[:, ::every])[:, :4]


def parts_of(x: Any) -> dict[str, Any]:
    """Return answers (..., `ANSWERED`) as fields of `CParameters`; an array gives arrays, a tensor tensors."""
    lead = x.shape[:-1]
    return {"singular": x[..., :8].reshape(*lead, 4, 2), "bulges": x[..., 8:].reshape(*lead, len(EDGES), 2)}


class CScene(Scene):
    """What the policy sees of `b` four-sided domains with given counts, and how its answers return from there."""

    @classmethod
    def of(cls, rim: Float[np.ndarray, "b r 2"], counts: Int[np.ndarray, "b 6"]) -> "CScene":  # type: ignore[override]
        """Look at domains of unit scale with counts in the order of `COUNTS`; `rim` by `part_samples`, 4 a part."""
        z = rim[..., 0] + 1j * rim[..., 1]
        corners = z[:, [PER_PART * RIM.index(name) for name in ("BL", "BR", "TR", "TL")]]
        _, direction = square_frame(corners)
        origin = z.mean(axis=1, keepdims=True)
        z = (z - origin) / direction
        samples = np.stack([np.real(z), np.imag(z)], axis=-1)
        singular = reference(samples, counts)
        size = 2 * counts.sum(axis=1)
        share = counts / size[:, None]
        extras = share, np.log(12 * share) / 3, np.log(np.maximum(size, 24) / 100)[:, None]
        seen = np.concatenate([samples.reshape(len(z), -1), singular.reshape(-1, 8), *extras], axis=1)
        c, s = np.real(direction[:, 0]), np.imag(direction[:, 0])
        rotation = np.stack([np.stack([c, s], axis=1), np.stack([-s, c], axis=1)], axis=1)
        return cls(seen, singular, np.concatenate([np.real(origin), np.imag(origin)], axis=1), rotation)

    def placed(self, answer: Float[Any, "b c"], tanh: Callable[[Any], Any] = np.tanh) -> dict[str, Any]:
        """Return what was answered as fields of `CParameters`, in the plane; `tanh` for the kind of array."""
        parts = parts_of(answer)
        singular = (self.singular + parts["singular"]) @ self.rotation + self.origin[:, None]
        return {"singular": singular, "bulges": MOST_BULGE * tanh(parts["bulges"] / MOST_BULGE)}


def counts_of(all_counts: Sequence[CCounts]) -> Int[np.ndarray, "b 6"]:
    """Return counts as rows in the order of `COUNTS`."""
    return np.array([[getattr(one, name) for name in COUNTS] for one in all_counts])


def _mirror_points(unit: Float[np.ndarray, "u k 2"], order: Sequence[int]) -> Float[np.ndarray, "u m"]:
    return (unit[:, order] * np.array([-1.0, 1.0])).reshape(len(unit), -1)


def _seen() -> np.ndarray:
    unit = np.eye(SEEN)
    samples, points, extras = np.split(unit, [2 * SAMPLES, 2 * SAMPLES + 8], axis=1)
    turned = [(5 * PER_PART - k) % SAMPLES for k in range(SAMPLES)]
    swapped = [3, 1, 2, 0, 4, 5]
    order = [*swapped, *(6 + i for i in swapped), 12]
    return np.concatenate(
        [
            _mirror_points(samples.reshape(SEEN, -1, 2), turned),
            _mirror_points(points.reshape(SEEN, 4, 2), [1, 0, 3, 2]),
            extras[:, order],
        ],
        axis=1,
    ).T


def _answered() -> np.ndarray:
    """Mirroring turns left into right, and running an edge backwards does so again and turns its S around."""
    unit = np.eye(ANSWERED)
    part = parts_of(unit)
    ends: list[tuple[str, str]] = [(a, b) for a, b, _ in EDGES]
    bulged = []
    for a, b in ends:
        one, other = MIRRORED[a], MIRRORED[b]
        backwards = (one, other) not in ends
        edge = ends.index((other, one) if backwards else (one, other))
        bulged.append(part["bulges"][:, edge] * (np.array([1.0, -1.0]) if backwards else -1.0))
    points = _mirror_points(part["singular"], [1, 0, 3, 2])
    return np.concatenate([points, np.concatenate(bulged, axis=1)], axis=1).T


SEEN_COLUMNS, SEEN_SIGNS = signed_permutation(_seen())
ANSWER_COLUMNS, ANSWER_SIGNS = signed_permutation(_answered())
