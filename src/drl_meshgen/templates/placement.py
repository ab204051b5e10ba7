"""Singular points, bows and number of layers of an O-type mesh by descent on a coarse mesh."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Final

import numpy as np
from jaxtyping import Float
from scipy.optimize import minimize

from drl_meshgen.templates.corners import reference
from drl_meshgen.templates.energy import Corners, corner_energy, corner_operator, total_energy
from drl_meshgen.templates.sketch import Sketch

Size = Callable[[Float[np.ndarray, "p 2"]], Float[np.ndarray, " p"]]
"""Wanted edge length at points of the domain, in its units."""

MAX_LAYERS = 60

#: Chords of internal edges 0-7 from the singular points (less the corners for 0-3); a row vector's +90 degree turn.
CHORD: Final[np.ndarray] = np.concatenate([np.eye(4), np.roll(np.eye(4), 1, axis=1) - np.eye(4)])
TURN: Final[np.ndarray] = np.array([[0.0, 1.0], [-1.0, 0.0]])


@dataclass(frozen=True)
class PlacementOptions:
    """How singular points are placed."""

    size_weight: float = 0.3
    """Weight of equal size against shape (dimensionless)."""
    bow_weight: float = 0.02
    """Weight of the squared bows of the internal edges: keeps lines calm where they matter little (dimensionless)."""
    epsilon: float = 0.1
    """Determinant, relative to the wanted cell's, below which a cell counts as nearly folded (dimensionless)."""
    iterations: int = 15
    """L-BFGS steps per round."""
    rounds: int = 2
    """Rounds; wanted sizes, layers and grading are renewed before each."""


@dataclass(frozen=True, eq=False)
class Placement:
    """Continuous parameters of a sketch and the energy they reach."""

    singular: Float[np.ndarray, "4 2"]
    bows: Float[np.ndarray, " 8"]
    layers: int
    ratio: float
    energy: float


def controls(sketch: Sketch, x: Float[np.ndarray, "16"]) -> Float[np.ndarray, "12 2"]:
    """Return singular points and bow vectors of the unknowns `x`: 4 points, then 8 bows relative to the chords."""
    singular = x[:8].reshape(4, 2)
    return np.concatenate([singular, x[8:, None] * _normals(sketch, singular)])


def pulled_back(
    sketch: Sketch, x: Float[np.ndarray, "16"], slope: Float[np.ndarray, "12 2"]
) -> Float[np.ndarray, "16"]:
    """Return the gradient in `x` of a function whose gradient in `controls(sketch, x)` is `slope`."""
    in_singular = slope[:4] + CHORD.T @ (x[8:, None] * slope[4:]) @ TURN.T
    in_bows = np.einsum("ij,ij->i", slope[4:], _normals(sketch, x[:8].reshape(4, 2)))
    return np.concatenate([in_singular.ravel(), in_bows])


def _normals(sketch: Sketch, singular: Float[np.ndarray, "4 2"]) -> Float[np.ndarray, "8 2"]:
    """Return the chords of internal edges 0-7 turned by +90 degrees."""
    chords = CHORD @ singular
    chords[:4] -= sketch.corners
    return chords @ TURN


def tutte(sketch: Sketch) -> Float[np.ndarray, "4 2"]:
    """Return singular points by Tutte's embedding of a coarse grid graph on the sketch's corners."""
    divisions, layers = 4, 2
    matrix, _ = reference(divisions, layers)
    _, a, b = sketch.coarse
    t = np.arange(divisions) / divisions
    index = np.concatenate([s + c * t for s, c in zip((0, a, a + b, 2 * a + b), (a, b, a, b), strict=True)])
    loop = np.concatenate([sketch.rim, sketch.rim[:1]])
    rim = np.stack([np.interp(index, np.arange(len(loop)), axis) for axis in loop.T], axis=1)
    return matrix[4 * divisions * layers + divisions * np.arange(4)] @ rim


def thickness_ratio(sketch: Sketch, singular: Float[np.ndarray, "4 2"]) -> float:
    """Return spacing along the core over spacing along the boundary: layers graded so stay about square."""
    core = np.linalg.norm(np.roll(singular, -1, axis=0) - singular, axis=1).sum()
    return float(core / np.linalg.norm(np.roll(sketch.rim, -1, axis=0) - sketch.rim, axis=1).sum())


def place(sketch: Sketch, size: Size, layers: int | None, options: PlacementOptions) -> Placement:
    """Return the parameters of least energy found by L-BFGS from Tutte's singular points and straight edges.

    `size` is in the units of the sketch; `layers` fixes k, None leaves it free.
    """
    o = options
    x = np.concatenate([tutte(sketch).ravel(), np.zeros(8)])
    operator = corner_operator(sketch.quads, sketch.n_points)
    ratio, k, energy = 1.0, layers or 1, np.inf
    for _ in range(o.rounds):
        ratio = thickness_ratio(sketch, x[:8].reshape(4, 2))
        fixed, basis = sketch.linear(ratio)
        moved = controls(sketch, x)
        h = size(fixed + basis @ moved)[sketch.quads]
        fixed, basis = operator @ fixed, operator @ basis
        if layers is None:
            k = _best_layers(sketch, fixed + basis @ moved, h, o)
        corners, weights = sketch.wanted(h, k), sketch.weights(k)

        def objective(
            x: np.ndarray,
            fixed: np.ndarray = fixed,
            basis: np.ndarray = basis,
            corners: Corners = corners,
            weights: np.ndarray = weights,
        ) -> tuple[float, np.ndarray]:
            edges = fixed + basis @ controls(sketch, x)
            value, slope = total_energy(edges, corners, weights, o.size_weight, o.epsilon)
            gradient = pulled_back(sketch, x, basis.T @ slope)
            gradient[8:] += 2 * o.bow_weight * x[8:]
            return value + o.bow_weight * float(x[8:] @ x[8:]), gradient

        found = minimize(objective, x, jac=True, method="L-BFGS-B", options={"maxiter": o.iterations})
        x, energy = found.x, float(found.fun)
    return Placement(x[:8].reshape(4, 2), x[8:], k, ratio, energy)


def _best_layers(sketch: Sketch, edges: np.ndarray, h: np.ndarray, options: PlacementOptions) -> int:
    """Return the number of layers of least energy for given positions."""
    k = np.arange(1, MAX_LAYERS + 1)
    stacked = k[:, None, None].astype(float)
    energy = corner_energy(edges, sketch.wanted(h, stacked), options.size_weight, options.epsilon)
    return int(k[(sketch.weights(stacked) * energy).sum(axis=-1).argmin()])
