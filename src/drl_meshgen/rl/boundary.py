"""Boundaries as policies see them: the four sides between chosen corners, in a frame that turns with the domain.

The eight ways to name the corners of the same four-sided domain (four first corners, two orientations) are the symmetry
group of the square. `SAMPLES`, `SAMPLE_SIGNS`, `CONTROLS` and `CONTROL_SIGNS` are its signed permutations of what
a policy sees and of what it answers, so that answers can be averaged over the group and thereby commute with it.
"""

from typing import Final

import numba
import numpy as np
from jaxtyping import Complex, Float, Int

from drl_meshgen.rl.controls import FREED, parts_of

PER_SIDE: Final = 16
"""Samples of each side that a policy sees."""


@numba.njit(cache=True)
def sample_run(loop: np.ndarray, first: int, cells: int, run: np.ndarray, samples: np.ndarray) -> None:
    """Fill `samples (k, 2)` with points at equal arc length along `cells` edges of a loop, the first node among them.

    `loop (l, 2)`, starting at node `first` modulo l; `run` is room for `cells + 1` arc lengths.
    """
    size, count = len(loop), len(samples)
    run[0] = 0.0
    for i in range(cells):
        tail, head = loop[(first + i) % size], loop[(first + i + 1) % size]
        run[i + 1] = run[i] + np.hypot(head[0] - tail[0], head[1] - tail[1])
    i = 0
    for t in range(count):
        at = run[cells] * t / count
        while i < cells - 1 and run[i + 1] <= at:
            i += 1
        share = (at - run[i]) / (run[i + 1] - run[i])
        tail, head = loop[(first + i) % size], loop[(first + i + 1) % size]
        samples[t] = (1 - share) * tail + share * head


@numba.njit(cache=True)
def side_samples(nodes: np.ndarray, corners: np.ndarray, per_side: int) -> np.ndarray:
    """Return `(b, 4 per_side, 2)` points at equal arc length along each side, the side's first corner among them.

    `nodes (b, l, 2)` or `(1, l, 2)` for all, `corners (b, 2)` the choices `(i0, m)`; 2m + 2n = l.
    """
    size = nodes.shape[1]
    result = np.empty((len(corners), 4 * per_side, 2))
    run = np.empty(size + 1)
    for b in range(len(corners)):
        loop = nodes[b if len(nodes) > 1 else 0]
        first = corners[b, 0] + size
        for s in range(4):
            cells = corners[b, 1] if s % 2 == 0 else size // 2 - corners[b, 1]
            sample_run(loop, first, cells, run, result[b, s * per_side : (s + 1) * per_side])
            first += cells
    return result


def square_frame(
    rim: Complex[np.ndarray, "b r"],
) -> tuple[Complex[np.ndarray, "b 1"], Complex[np.ndarray, "b 1"]]:
    """Return origin and direction of the frame of four-sided domains: the square that fits their corners best.

    `rim` holds samples as complex numbers, `r / 4` a side. A point z becomes `(z - origin) / direction`; the direction
    has length 1. Corners whose best square is a point keep their axes.
    """
    corner = rim[:, :: rim.shape[1] // 4]
    fit = (corner * np.array([-1 + 1j, 1 + 1j, 1 - 1j, -1 - 1j])).sum(axis=1)
    small = np.abs(fit) < 1e-12
    direction = np.where(small, 1.0, fit) / np.where(small, 1.0, np.abs(fit))
    return rim.mean(axis=1, keepdims=True), direction[:, None]


def _turn(points: Complex[np.ndarray, "*k"], quarter: int) -> Complex[np.ndarray, "*k"]:
    return points * (1j) ** quarter


def signed_permutation(act: np.ndarray) -> tuple[Int[np.ndarray, " c"], Float[np.ndarray, " c"]]:
    """Return, for each row of a signed permutation matrix, its column and its sign."""
    column = np.abs(act).argmax(axis=1)
    return column, act[np.arange(len(act)), column]


def _seen(turn: int, mirrored: bool) -> tuple[np.ndarray, np.ndarray]:  # noqa: FBT001
    """Return what one symmetry does to samples (x and y interleaved), then to (m / L, n / L)."""
    size = 4 * PER_SIDE
    unit = np.eye(2 * size)
    z = unit[:, ::2] + 1j * unit[:, 1::2]
    shifted = _turn(np.roll(z, -turn * PER_SIDE, axis=1), -turn)
    if mirrored:
        shifted = -np.conj(shifted[:, (PER_SIDE - np.arange(size)) % size])
    act = np.zeros((2 * size + 2, 2 * size + 2))
    act[: 2 * size : 2, : 2 * size], act[1 : 2 * size : 2, : 2 * size] = np.real(shifted).T, np.imag(shifted).T
    act[2 * size :, 2 * size :] = np.roll(np.eye(2), turn, axis=1)
    return signed_permutation(act)


def _answered(turn: int, mirrored: bool) -> tuple[np.ndarray, np.ndarray]:  # noqa: FBT001
    """Return how answers under one symmetry become answers for the domain as it is; see `controls.parts_of`.

    Bulges are numbers, all else vectors of the frame.
    """
    unit = np.eye(FREED)
    part = parts_of(unit)
    vectors = [part["singular"], part["waves"][:, :4], part["waves"][:, 4:], part["swells"], part["rim"]]
    points, spokes, sides, swells, rim = (v[..., 0] + 1j * v[..., 1] for v in vectors)
    bulged = part["bulges"]
    if mirrored:
        # point and spoke s were those of corner 1 - s, side and outer block s were side -s run backwards
        corner, side = (1 - np.arange(4)) % 4, -np.arange(4) % 4
        points, spokes = -np.conj(points[:, corner]), -np.conj(spokes[:, corner])
        sides, swells, rim = (-np.conj(v[:, side]) * (-1.0) ** np.arange(v.shape[2]) for v in (sides, swells, rim))
        bulged = np.concatenate([-bulged[:, corner], bulged[:, 4 + side] * np.array([1.0, -1.0])], axis=1)
    rolled = [_turn(np.roll(v, turn, axis=1), turn) for v in (points, spokes, sides, swells, rim)]
    bulged = np.concatenate([np.roll(half, turn, axis=1) for half in (bulged[:, :4], bulged[:, 4:])], axis=1)
    flat = [np.stack([np.real(v), np.imag(v)], axis=-1).reshape(FREED, -1) for v in rolled]
    return signed_permutation(np.concatenate([flat[0], bulged.reshape(FREED, -1), *flat[1:]], axis=1).T)


_GROUP: Final = tuple((turn, mirrored) for turn in range(4) for mirrored in (False, True))
SAMPLES, SAMPLE_SIGNS = (np.stack(part) for part in zip(*(_seen(*g) for g in _GROUP), strict=True))
CONTROLS, CONTROL_SIGNS = (np.stack(part) for part in zip(*(_answered(*g) for g in _GROUP), strict=True))
