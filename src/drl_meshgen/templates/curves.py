"""Line types of a template's internal edges (paper section 5.1.1): a chord with a bulge to either side, and waves.

Waves go beyond the paper: sines along the edge that move it by any vector, so that nodes can slide along it as well.
"""

from typing import Final

import numpy as np
from jaxtyping import Float

#: Predefined line types: quadratic (bow) and cubic (S) amplitude as a fraction of the chord, positive to its left.
LINE_TYPES: Final[np.ndarray] = np.array(
    [
        [0.0, 0.0],
        *([s * a, 0.0] for a in (0.06, 0.12, 0.2, 0.3) for s in (1, -1)),
        *([0.0, s * 0.06] for s in (1, -1)),
        *([s * 0.1, t * 0.05] for s in (1, -1) for t in (1, -1)),
    ]
)
LINE_TYPES.setflags(write=False)

STRAIGHT: Final = 0

#: Sines along an internal edge, and along an outer block, by which it may be moved.
WAVES: Final = 2
SWELLS: Final = 3


def shapes(t: Float[np.ndarray, " n"]) -> Float[np.ndarray, "n 4"]:
    """Return bow, S and `WAVES` sines at parameters `t` in 0..1, each of amplitude 1, zero at the ends."""
    bow = 4 * t * (1 - t)
    return np.concatenate([np.stack([bow, 1.5 * np.sqrt(3.0) * bow * (1 - 2 * t)], axis=-1), sines(t, WAVES)], axis=-1)


def sines(t: Float[np.ndarray, " n"], count: int) -> Float[np.ndarray, "n count"]:
    """Return `sin(i pi t)` for i = 1 .. count."""
    return np.sin(np.pi * np.outer(t, np.arange(1, count + 1)))


def left_normal(vectors: Float[np.ndarray, "*n 2"]) -> Float[np.ndarray, "*n 2"]:
    """Return plane vectors turned by +90 degrees."""
    return np.stack([-vectors[..., 1], vectors[..., 0]], axis=-1)


def offsets(
    start: Float[np.ndarray, "*n 2"], end: Float[np.ndarray, "*n 2"], bulge: Float[np.ndarray, "*n 2"]
) -> np.ndarray:
    """Return the displacement vectors, (..., 2 shapes, 2), that `bulge` gives the chords from `start` to `end`."""
    return bulge[..., :, None] * left_normal(end - start)[..., None, :]


def sample(
    start: Float[np.ndarray, " d"],
    end: Float[np.ndarray, " d"],
    offset: Float[np.ndarray, "s d"],
    t: Float[np.ndarray, " n"],
) -> Float[np.ndarray, "n d"]:
    """Return points of an internal edge at parameters `t`, displaced by `offset` times the first of `shapes`."""
    return (1 - t)[:, None] * start + t[:, None] * end + shapes(t)[:, : len(offset)] @ offset


def graded(count: int, ratio: float) -> Float[np.ndarray, " n"]:
    """Return `count + 1` fractions from 0 to 1 whose steps change by the factor `ratio` from each to the next."""
    steps = ratio ** np.arange(count)
    return np.concatenate([[0.0], steps.cumsum() / steps.sum()])
