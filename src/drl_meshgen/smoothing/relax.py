"""Local-global sweeps: every quad asks for its best rectangle, every node goes to the mean of what it is asked."""

import numpy as np
from jaxtyping import Float

from drl_meshgen.smoothing.energy import QuadEnergy, Shape, cross, dot, unit
from drl_meshgen.smoothing.nodes import NodeSpace, NodeState, shortened

SQUARE = 0.5
"""Share of the best square in the blend with the best rectangle."""


def targets(shape: Shape) -> Float[np.ndarray, "3 4 m"]:
    """Corners of the blend of best-fitting square and best-fitting rectangle of each quad, in its plane.

    With corners as complex numbers z_c about the centroid, the least-squares square is a i^c with
    a = mean(z_c (-i)^c) (turned the right way round even if the quad is folded); the rectangle takes the half
    sides along the axes of this square.
    """
    centre = shape.corners.mean(axis=1, keepdims=True)
    offset = shape.corners - centre
    first = unit(offset[:, 2] - offset[:, 0])
    second = cross(shape.normal, first)
    z = dot(offset, first[:, None]) + 1j * dot(offset, second[:, None])
    turn = np.array([1, -1j, -1, 1j])
    a = (z * turn[:, None]).mean(axis=0)
    # the sides of the square a i^c point along a (1 - i) / |..| and a (1 + i)
    axis = a * (1 - 1j)
    axis /= np.maximum(np.abs(axis), np.finfo(float).tiny)
    local = z * np.conj(axis)
    signs = np.array([[1, 1], [-1, 1], [-1, -1], [1, -1]])
    half = np.stack([(local.real * signs[:, :1]).mean(axis=0), (local.imag * signs[:, 1:]).mean(axis=0)])
    mean = half.mean(axis=0)
    half = np.maximum((1 - SQUARE) * half + SQUARE * mean, 0.2 * np.abs(mean))
    fit = (signs[:, :1] * half[0] + 1j * signs[:, 1:] * half[1]) * axis
    return centre + first[:, None] * fit.real + second[:, None] * fit.imag


def sweep(space: NodeSpace, energy: QuadEnergy, state: NodeState, reach: Float[np.ndarray, " n"]) -> NodeState:
    """Move every node to the mean of its targets, at most `reach`."""
    shape = energy.shape(state)
    wish = (targets(shape) - shape.corners).reshape(3, -1)
    at = energy.quads.ravel()
    count = np.bincount(at, minlength=energy.n_nodes)
    pull = np.stack([np.bincount(at, w, minlength=energy.n_nodes) for w in wish], axis=1) / count[:, None]
    step = np.zeros((len(reach), 2))
    step[energy.ids] = np.einsum("knj,nj->nk", state.tangents[:, energy.ids], pull)
    step = shortened(step, reach)
    return space.moved(state, step)
