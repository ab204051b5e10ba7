"""Singular points, bows and number of layers of an O-type mesh by descent on a coarse mesh."""

from dataclasses import dataclass
from functools import cached_property
from typing import Final

import numpy as np
from jaxtyping import Float
from scipy.optimize import minimize
from scipy.sparse import csr_matrix

from drl_meshgen.templates.corners import reference
from drl_meshgen.templates.domain import cross
from drl_meshgen.templates.energy import Corners, corner_energy, corner_operator, total_energy
from drl_meshgen.templates.options import PlacementOptions, Size
from drl_meshgen.templates.sketch import Sketch

MAX_LAYERS = 200
MAX_BOW = 0.25
#: Sizes of the core tried at the start, relative to Tutte's.
SCALES = (1.25, 1.0, 0.8, 0.64, 0.5, 0.35, 0.22, 0.12)

#: Chords of internal edges 0-7 from the singular points (less the corners for 0-3); a row vector's +90 degree turn.
CHORD: Final[np.ndarray] = np.concatenate([np.eye(4), np.roll(np.eye(4), 1, axis=1) - np.eye(4)])
TURN: Final[np.ndarray] = np.array([[0.0, 1.0], [-1.0, 0.0]])


Shape = tuple[Float[np.ndarray, "4 2"], Float[np.ndarray, " 8"]]
"""Singular points and bows."""


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


def tutte(sketch: Sketch) -> Shape:
    """Return singular points and bows read off Tutte's embedding of a coarse grid graph on the sketch's corners."""
    divisions, layers = 4, 2
    matrix, _ = reference(divisions, layers)
    _, a, b = sketch.coarse
    t = np.arange(divisions) / divisions
    index = np.concatenate([s + c * t for s, c in zip((0, a, a + b, 2 * a + b), (a, b, a, b), strict=True)])
    loop = np.concatenate([sketch.rim, sketch.rim[:1]])
    rim = np.stack([np.interp(index, np.arange(len(loop)), axis) for axis in loop.T], axis=1)
    core = matrix[4 * divisions * layers :][: 4 * divisions] @ rim
    singular, middle = core[::divisions], core[divisions // 2 :: divisions]
    ahead = np.roll(singular, -1, axis=0)
    normal = (ahead - singular) @ TURN
    height = ((middle - (singular + ahead) / 2) * normal).sum(axis=1) / (normal**2).sum(axis=1)
    return singular, np.concatenate([np.zeros(4), height.clip(-MAX_BOW, MAX_BOW)])


def thickness_ratio(sketch: Sketch, singular: Float[np.ndarray, "4 2"]) -> float:
    """Return spacing along the core over spacing along the boundary: layers graded so stay about square."""
    core = np.linalg.norm(np.roll(singular, -1, axis=0) - singular, axis=1).sum()
    return float(core / np.linalg.norm(np.roll(sketch.rim, -1, axis=0) - sketch.rim, axis=1).sum())


def place(
    sketch: Sketch,
    size: Size,
    layers: int | None,
    options: PlacementOptions,
    start: tuple[float, float],
    *,
    shape: Shape | None = None,
) -> Placement:
    """Return the parameters of least energy found by L-BFGS from `shape`, Tutte's embedding if None.

    `size` is in the units of the sketch; `layers` fixes k, None leaves it free. `start` is the core's size relative to
    the shape's and the number of layers to start from, see `start_of`.
    """
    o = options
    trial = _Trial(sketch, size, corner_operator(sketch.quads, sketch.n_points), o, shape)
    scale, k = start
    x = trial.scaled(scale)
    ratio, energy = 1.0, np.inf
    for _ in range(o.rounds):
        ratio = thickness_ratio(sketch, x[:8].reshape(4, 2))
        fixed, basis, h = trial.state(x, ratio)
        if layers is None:
            near = np.unique((k * np.linspace(0.7, 1.4, 15)).round().clip(1, MAX_LAYERS))
            k, _ = trial.best_layers(fixed + basis @ controls(sketch, x), h, near)
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
    return Placement(x[:8].reshape(4, 2), x[8:], int(k), ratio, energy)


@dataclass(frozen=True, eq=False)
class _Trial:
    """A sketch with the wanted sizes: what its energy needs."""

    sketch: Sketch
    size: Size
    operator: csr_matrix
    options: PlacementOptions
    shape: Shape | None = None
    """Singular points and bows to scale; Tutte's if None."""

    def state(self, x: np.ndarray, ratio: float) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Return corner edges as `fixed + basis @ controls` and the wanted size at each corner, (q, 4)."""
        fixed, basis = self.sketch.linear(ratio)
        h = self.size(fixed + basis @ controls(self.sketch, x))[self.sketch.quads]
        return self.operator @ fixed, self.operator @ basis, h

    def best_layers(self, edges: np.ndarray, h: np.ndarray, counts: np.ndarray) -> tuple[float, float]:
        """Return the number of layers of least energy among `counts`, and that energy."""
        stacked = counts[:, None, None]
        o = self.options
        energy = corner_energy(edges, self.sketch.wanted(h, stacked), o.size_weight, o.epsilon)
        energy = (self.sketch.weights(stacked) * energy).sum(axis=-1)
        best = int(energy.argmin())
        return float(counts[best]), float(energy[best])

    def scaled(self, scale: float) -> Float[np.ndarray, "16"]:
        """Return the singular points and bows, scaled about and moved to the place of most cells.

        That place is the mean of the points weighted by the number of wanted cells around them.
        """
        singular, bows = self.shape or self._tutte
        return np.concatenate([(self._centre + scale * (singular - singular.mean(axis=0))).ravel(), bows])

    @cached_property
    def _tutte(self) -> Shape:
        return tutte(self.sketch)

    @cached_property
    def _centre(self) -> Float[np.ndarray, "2"]:
        fixed, basis = self.sketch.linear(1.0)
        corner = (fixed + basis[:, :4] @ (self.shape or self._tutte)[0])[self.sketch.quads]
        diagonals = corner[:, 2:] - corner[:, :2]
        middle = corner.mean(axis=1)
        cells = np.abs(cross(diagonals[:, 0], diagonals[:, 1])) / self.size(middle) ** 2
        return cells @ middle / cells.sum()


def start_of(
    sketch: Sketch, size: Size, layers: int | None, options: PlacementOptions, shape: Shape | None = None
) -> tuple[float, float]:
    """Return the relative size of the core, one of `SCALES`, and the number of layers of least energy together."""
    trial = _Trial(sketch, size, corner_operator(sketch.quads, sketch.n_points), options, shape)
    counts = np.unique(np.geomspace(1, MAX_LAYERS, 20).round()) if layers is None else np.array([float(layers)])
    best, start = np.inf, (1.0, 1.0)
    for scale in SCALES:
        x = trial.scaled(scale)
        fixed, basis, h = trial.state(x, thickness_ratio(sketch, x[:8].reshape(4, 2)))
        k, energy = trial.best_layers(fixed + basis @ controls(sketch, x), h, counts)
        if energy < best:
            best, start = energy, (scale, k)
    return start
