"""A closed curve around the middle of a surface of genus 0."""

import numpy as np
from jaxtyping import Bool, Float
from scipy.sparse import diags_array
from scipy.sparse.linalg import LinearOperator, SuperLU, eigsh

from drl_meshgen.lift.harmonic import corner_weights, factorised, stiffness
from drl_meshgen.mesh import TriMesh
from drl_meshgen.mesh.splitting import CLEARANCE, crossing
from drl_meshgen.mesh.topology import graph_components
from drl_meshgen.seams.levels import EdgeCurve

#: Eigenfunctions of the Laplacian whose level sets compete.
FUNCTIONS = 4
#: Levels tried between those next to the best one.
REFINED = 8


class _Inverse(LinearOperator):
    """Solves with a factored matrix."""

    def __init__(self, factors: SuperLU, n: int) -> None:
        super().__init__(np.float64, (n, n))
        self.factors = factors

    def _matvec(self, x: np.ndarray) -> np.ndarray:
        return self.factors.solve(x)


def smooth_functions(mesh: TriMesh, count: int) -> Float[np.ndarray, "v k"]:
    """Eigenfunctions `(v, count)` of the lowest non-zero eigenvalues of the Laplacian, largest value positive.

    Solves `K x = lambda M x` with lumped areas M by shift and invert, always from the same start.
    """
    n = len(mesh.vertices)
    area = np.bincount(mesh.triangles.ravel(), np.repeat(mesh.areas / 3, 3), n)
    area = np.maximum(area, 1e-9 * area.mean()) / area.sum()
    root = np.sqrt(area)
    matrix = diags_array(1 / root) @ stiffness(mesh, corner_weights(mesh)) @ diags_array(1 / root)
    shift = -1.0
    operator = _Inverse(factorised((matrix - shift * diags_array(np.ones(n))).tocsc()), n)
    middle = mesh.vertices - mesh.vertices.mean(axis=0)
    start = root * (middle @ (1.0, 0.7, 0.4) / mesh.diagonal + 0.1)
    values, vectors = eigsh(matrix, k=count + 1, sigma=shift, which="LM", v0=start, OPinv=operator)
    functions = vectors[:, np.argsort(values)[1:]] / root[:, None]
    return functions * np.sign(functions[np.abs(functions).argmax(axis=0), np.arange(count)])


def waist(mesh: TriMesh, levels: int, share: float) -> EdgeCurve | None:
    """Find the closed curve of least length per area of the smaller side, at least `share` of the area on both sides.

    Candidates are level sets of the lowest eigenfunctions of the Laplacian with their holes filled: `levels` of them
    spread over all functions, then some more next to the best. None where the mesh is too coarse for any.
    """
    area = np.bincount(mesh.triangles.ravel(), np.repeat(mesh.areas / 3, 3), len(mesh.vertices))
    area /= area.sum()
    functions = smooth_functions(mesh, FUNCTIONS)
    order = np.argsort(functions, axis=0, kind="stable")
    found: list[tuple[float, int, float, EdgeCurve]] = []

    def attempt(k: int, target: float) -> None:
        f = functions[:, k]
        below = np.cumsum(area[order[:, k]])
        level = float(f[order[min(int(np.searchsorted(below, target)), len(f) - 1), k]])
        inside = halves(mesh, f > level)
        smaller = min(area[inside].sum(), area[~inside].sum())
        if smaller >= share:
            curve = contour(mesh, f, level, inside)
            found.append((curve.length / smaller, k, target, curve))

    step = (1 - 2 * share) / (levels // FUNCTIONS)
    for k in range(FUNCTIONS):
        for n in range(levels // FUNCTIONS):
            attempt(k, share + (n + 0.5) * step)
    if not found:
        return None
    _, k, target, _ = min(found, key=lambda item: item[:3])
    for n in range(1, REFINED):
        attempt(k, target + (2 * n / REFINED - 1) * step)
    return min(found, key=lambda item: item[:3])[3]


def halves(mesh: TriMesh, above: Bool[np.ndarray, " v"]) -> Bool[np.ndarray, " v"]:
    """Largest part of `above` with all but the largest part of the rest filled in: both sides are connected."""
    inside = _largest(mesh, above)
    return ~_largest(mesh, ~inside)


def _largest(mesh: TriMesh, flag: Bool[np.ndarray, " v"]) -> Bool[np.ndarray, " v"]:
    edges = mesh.topology.edges[flag[mesh.topology.edges].all(axis=1)]
    label = graph_components(edges, len(flag))
    return flag & (label == np.argmax(np.bincount(label[flag], minlength=1)))


def contour(mesh: TriMesh, f: Float[np.ndarray, " v"], level: float, inside: Bool[np.ndarray, " v"]) -> EdgeCurve:
    """Curve between `inside` and the rest, where `f` passes `level` if it does there."""
    topology = mesh.topology
    crossed = inside[topology.edges[:, 0]] != inside[topology.edges[:, 1]]
    a, b = topology.edges[crossed].T
    share = np.clip(crossing(f[a], f[b], level), CLEARANCE, 1 - CLEARANCE)
    points = np.zeros((len(crossed), 3))
    points[crossed] = mesh.vertices[a] + share[:, None] * (mesh.vertices[b] - mesh.vertices[a])
    through = crossed[topology.face_edges]
    mixed = through.any(axis=1)
    chord = points[topology.face_edges[mixed][through[mixed]]].reshape(-1, 2, 3)
    return EdgeCurve(crossed, share, float(np.linalg.norm(chord[:, 1] - chord[:, 0], axis=1).sum()))
