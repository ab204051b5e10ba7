"""Unfold quads: L-BFGS on a shape energy that stays finite for folded corners, made sharper step by step.

The energy of a corner with sides e, f and wedge angle a is `(|J|^2 + c (1 + det^2)) / (2 chi)` with
J = [e, f] W^-1, W the ideal wedge of the quad's size, det measured along the surface's normal at the corner and
`chi = (det + sqrt(eps^2 + det^2)) / 2` (Garanzha et al., Foldover-free maps in 50 lines of code, ACM TOG 40(4), 2021).
"""

import numpy as np
from jaxtyping import Float
from scipy.optimize import minimize

from drl_meshgen.smoothing.energy import QuadEnergy, cross, dot, unit
from drl_meshgen.smoothing.nodes import NodeSpace, NodeState

SIZE_WEIGHT = 0.2
"""c above: weight of the size term."""
SHARPNESS = (1.0, 0.3, 0.1, 0.03)
"""eps of each pass, times the depth of the deepest fold (at least one)."""
ITERATIONS = 30
"""L-BFGS iterations of each pass."""
SMOOTHING_PASSES = 4
"""Averaging passes over edge neighbours that turn areas into target sizes."""


def target_areas(energy: QuadEnergy, area: Float[np.ndarray, " m"]) -> Float[np.ndarray, " m"]:
    """Size each quad should have: its area averaged with those around it, never much below the mean."""
    m = len(area)
    size = np.maximum(np.abs(area), 0.1 * np.abs(area).mean())
    a, b = energy.pairs
    count = 1 + np.bincount(energy.pairs.ravel(), minlength=m)
    for _ in range(SMOOTHING_PASSES):
        size = (size + np.bincount(a, size[b], minlength=m) + np.bincount(b, size[a], minlength=m)) / count
    return size


def untangle(space: NodeSpace, energy: QuadEnergy, state: NodeState, reach: Float[np.ndarray, " n"]) -> NodeState:
    """Return a state in which (if there is room) no corner of the chosen quads is folded.

    Only nodes whose tangents are not zero move, each at most `reach` per pass.
    """
    area = target_areas(energy, energy.shape(state).area)
    for sharpness in SHARPNESS:
        state = _descend(space, energy, state, reach, area=area, sharpness=sharpness)
    return state


def _descend(
    space: NodeSpace,
    energy: QuadEnergy,
    state: NodeState,
    reach: Float[np.ndarray, " n"],
    *,
    area: Float[np.ndarray, " m"],
    sharpness: float,
) -> NodeState:
    ids, quads, n = energy.ids, energy.quads, energy.n_nodes
    origin = state.points[ids].T
    tangents = state.tangents[:, ids].transpose(2, 0, 1)
    normal = unit(state.normals[ids].T)[:, quads]
    cosine, sine = np.cos(energy.ideal), np.sin(energy.ideal)
    det_scale = 1 / (area * sine)
    size_scale = det_scale / sine
    nodes = quads.ravel()
    following, preceding = np.roll(quads, -1, axis=0).ravel(), np.roll(quads, 1, axis=0).ravel()

    def corners(x: Float[np.ndarray, "2 n"]) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        p = (origin + tangents[:, 0] * x[0] + tangents[:, 1] * x[1])[:, quads]
        e = np.roll(p, -1, axis=1) - p
        f = np.roll(p, 1, axis=1) - p
        return e, f, dot(cross(e, f), normal) * det_scale

    zero = np.zeros((2, n))
    eps = sharpness * max(1.0, -float(corners(zero)[2].min()))

    def value_and_gradient(flat: Float[np.ndarray, " u"]) -> tuple[float, Float[np.ndarray, " u"]]:
        e, f, det = corners(flat.reshape(2, n))
        root = np.sqrt(eps**2 + det**2)
        # chi without cancellation for folded corners
        chi = np.where(det > 0, 0.5 * (det + root), 0.5 * eps**2 / (root - np.minimum(det, 0)))
        size = (dot(e, e) + dot(f, f) - 2 * cosine * dot(e, f)) * size_scale
        value = (size + SIZE_WEIGHT * (1 + det**2)) / (2 * chi)
        # chi' = chi / root
        by_det = SIZE_WEIGHT * det / chi - value / root
        c1, c2 = size_scale / chi, by_det * det_scale
        by_e = c1 * (e - cosine * f) + c2 * cross(f, normal)
        by_f = c1 * (f - cosine * e) + c2 * cross(normal, e)
        out = np.empty((3, n))
        for k in range(3):
            ge, gf = by_e[k].ravel(), by_f[k].ravel()
            out[k] = np.bincount(following, ge, minlength=n) + np.bincount(preceding, gf, minlength=n)
            out[k] -= np.bincount(nodes, ge + gf, minlength=n)
        return float(value.sum()), np.stack([dot(out, tangents[:, 0]), dot(out, tangents[:, 1])]).ravel()

    limit = np.tile(reach[ids], 2)
    found = minimize(
        value_and_gradient,
        zero.ravel(),
        jac=True,
        method="L-BFGS-B",
        bounds=np.c_[-limit, limit],
        options={"maxiter": ITERATIONS, "maxcor": 8},
    )
    step = np.zeros((len(reach), 2))
    step[ids] = found.x.reshape(2, n).T
    return space.moved(state, step)
