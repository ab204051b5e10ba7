"""Transfinite interpolation of four-sided patches (Gordon and Hall 1973; bilinearly blended Coons patch)."""

import numpy as np
from jaxtyping import Float


def arc_fractions(curve: Float[np.ndarray, "n d"]) -> Float[np.ndarray, " n"]:
    """Return the share of a polyline's length that lies before each of its points, from 0 to 1."""
    run = np.concatenate([[0.0], np.linalg.norm(np.diff(curve, axis=0), axis=1).cumsum()])
    return run / run[-1]


def parameters(
    bottom: Float[np.ndarray, " ni1"],
    top: Float[np.ndarray, " ni1"],
    left: Float[np.ndarray, " nj1"],
    right: Float[np.ndarray, " nj1"],
) -> tuple[Float[np.ndarray, "ni1 nj1"], Float[np.ndarray, "ni1 nj1"]]:
    """Return blending parameters `(u, v)` of the grid from the fractions at which its four sides are divided.

    Node `(i, j)` is where the line from `bottom[i]` to `top[i]` meets the line from `left[j]` to `right[j]` in the
    unit square (Soni 1985). Equal fractions on opposite sides give those fractions back.
    """
    shift, tilt = (top - bottom)[:, None], (right - left)[None, :]
    u = (bottom[:, None] + left[None, :] * shift) / (1.0 - shift * tilt)
    return u, left[None, :] + u * tilt


def transfinite(
    bottom: Float[np.ndarray, "ni1 d"],
    top: Float[np.ndarray, "ni1 d"],
    left: Float[np.ndarray, "nj1 d"],
    right: Float[np.ndarray, "nj1 d"],
    fractions: tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray] | None = None,
) -> Float[np.ndarray, "ni1 nj1 d"]:
    """Return the Coons patch of four curves that share their corners; its rim is the curves themselves.

    Corners: `bottom[0] = left[0]`, `bottom[-1] = right[0]`, `top[0] = left[-1]`, `top[-1] = right[-1]`. `fractions`
    divides (bottom, top, left, right), each from 0 to 1; by index (evenly) if None; `arc_fractions` of the four curves
    gives the arc-length form. For fixed fractions the result is linear in the curves, in any dimension `d`.
    """
    if fractions is None:
        i, j = np.linspace(0, 1, len(bottom)), np.linspace(0, 1, len(left))
        fractions = (i, i, j, j)
    u, v = (p[..., None] for p in parameters(*fractions))
    ruled = (1 - v) * bottom[:, None] + v * top[:, None] + (1 - u) * left[None] + u * right[None]
    corners = (1 - u) * ((1 - v) * bottom[0] + v * top[0]) + u * ((1 - v) * bottom[-1] + v * top[-1])
    grid = ruled - corners
    grid[:, 0], grid[:, -1], grid[0], grid[-1] = bottom, top, left, right
    return grid
