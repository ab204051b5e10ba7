"""Parameters of O-type meshes by gradient ascent on the exact reward: what a policy is measured against."""

from dataclasses import dataclass, field
from typing import Final

import numpy as np
from jaxtyping import Float, Int
from scipy.optimize import minimize

from drl_meshgen.errors import InputError
from drl_meshgen.rl.boundary import side_samples
from drl_meshgen.rl.controls import PLAIN, SHAPED, parameters_of, parts_of
from drl_meshgen.rl.kernel import judge_o
from drl_meshgen.rl.scene import corner_choices
from drl_meshgen.rl.slope import worth_and_slope
from drl_meshgen.templates.corners import reference
from drl_meshgen.templates.curves import SWELLS, WAVES, left_normal
from drl_meshgen.templates.domain import Domain
from drl_meshgen.templates.mesh import grid_quads
from drl_meshgen.templates.o_type import EDGES, OParameters, grids, positions, rim_fractions
from drl_meshgen.templates.options import PlacementOptions, Size
from drl_meshgen.templates.policy import RulePolicy
from drl_meshgen.templates.score import Weights

NEXT: Final = (1, 2, 3, 0)
THOROUGH: Final = RulePolicy(
    counts=20,
    shortlist=8,
    spread=(1.0, 0.9, 0.75, 0.6, 0.5, 0.35),
    divisions=8,
    placement=PlacementOptions(iterations=60, rounds=4),
)


def tutte_points(nodes: Float[np.ndarray, "l 2"], corners: Int[np.ndarray, "b 2"]) -> Float[np.ndarray, "b 4 2"]:
    """Return the singular points of Tutte's embedding of a coarse O-grid on each choice of corners."""
    divisions, layers = 8, 3
    matrix, _ = reference(divisions, layers)
    at = 4 * divisions * layers + divisions * np.arange(4)
    return matrix[at] @ side_samples(np.ascontiguousarray(nodes)[None], corners, divisions)


@dataclass(frozen=True, eq=False)
class Mesh:
    """The nodes of an O-type mesh as a function of its continuous parameters: `fixed + basis @ controls`.

    Controls are the singular points, then bulge vectors, waves and swells. Parameters are the same, but for bulges by
    their amplitudes: `PLAIN` numbers without waves and swells, `SHAPED` with them.
    """

    corner: Float[np.ndarray, "4 2"]
    fixed: Float[np.ndarray, "p 2"]
    basis: Float[np.ndarray, "p c"]
    quads: Int[np.ndarray, "q 4"]

    @classmethod
    def of(cls, domain: Domain, corners: tuple[int, int], layers: int) -> "Mesh":
        """Set up the mesh of a domain with corners `(i0, m)`."""
        i0, m = corners
        n = len(domain) // 2 - m
        count = 4 + 2 * EDGES + WAVES * EDGES + 4 * SWELLS
        boundary = np.concatenate([domain.nodes, np.zeros((len(domain), count))], axis=1)
        singular, bulge, wave, swell = np.split(np.eye(count, 2 + count, 2), np.cumsum([4, 2 * EDGES, WAVES * EDGES]))
        both = positions(
            boundary,
            singular,
            np.concatenate([part.reshape(EDGES, -1, 2 + count) for part in (bulge, wave)], axis=1),
            corners=(i0, m, n),
            radial=np.linspace(0, 1, layers + 1),
            fractions=rim_fractions(domain.nodes, i0, m, n),
            swells=swell.reshape(4, SWELLS, -1),
        )
        at = (i0 + np.array([0, m, m + n, 2 * m + n])) % len(domain)
        quads = grid_quads(grids(i0, m, n, layers))
        return cls(domain.nodes[at], both[:, :2].copy(), both[:, 2:].copy(), quads)

    def worth(self, x: Float[np.ndarray, " c"], weights: Weights) -> tuple[float, Float[np.ndarray, " c"]]:
        """Return reward less penalty, and its gradient in the parameters."""
        singular, bulges = x[:8].reshape(4, 2), x[8:PLAIN].reshape(EDGES, 2)
        chord = np.concatenate([singular - self.corner, singular[list(NEXT)] - singular])
        normal = left_normal(chord)
        bulged = (bulges[..., None] * normal[:, None]).reshape(-1, 2)
        controls = np.concatenate([singular, bulged, x[PLAIN:].reshape(-1, 2)])
        basis = self.basis[:, : len(controls)]
        value, slope = worth_and_slope((self.fixed + basis @ controls)[None], self.quads, weights=weights)
        in_controls = basis.T @ slope[0]
        in_offset = in_controls[4 : 4 + 2 * EDGES].reshape(EDGES, 2, 2)
        in_bulges = (in_offset * normal[:, None]).sum(axis=-1)
        in_chord = -left_normal((bulges[..., None] * in_offset).sum(axis=1))
        in_singular = in_controls[:4] + in_chord[:4] - in_chord[4:] + in_chord[4:][[3, 0, 1, 2]]
        in_rest = in_controls[4 + 2 * EDGES :]
        return float(value[0]), np.concatenate([in_singular.ravel(), in_bulges.ravel(), in_rest.ravel()])


def ascended(
    mesh: Mesh, start: Float[np.ndarray, " c"], iterations: int, weights: Weights
) -> tuple[float, Float[np.ndarray, " c"]]:
    """Return the worth found by L-BFGS from `start`, and its parameters."""

    def descent(x: np.ndarray) -> tuple[float, np.ndarray]:
        value, slope = mesh.worth(x, weights)
        return -value, -slope

    found = minimize(descent, start, jac=True, method="L-BFGS-B", options={"maxiter": iterations, "maxcor": 20})
    return -float(found.fun), found.x


@dataclass(frozen=True)
class OptimizerPolicy:
    """Corners by trying all of them on Tutte's embedding, then gradient ascent from the best; a second a domain.

    It maximises the reward of the paper less the validity penalty.
    """

    tried: int = 24
    """Choices of corners that get a short ascent."""
    kept: int = 4
    """Of these, choices that get a long one with every number of layers."""
    layers: tuple[int, ...] = (3, 4, 6, 10)
    """Numbers of layers that are tried."""
    iterations: tuple[int, int] = (20, 200)
    """Steps of a short and of a long ascent."""
    shaped: bool = True
    """Whether internal edges may have waves and outer blocks swells, beyond the line types of the paper."""
    weights: Weights = field(default_factory=Weights)
    """Weights of the reward."""

    def choose(
        self,
        domain: Domain,
        *,
        layers: int | None = None,
        size: Size | None = None,
        corners: tuple[int, int] | None = None,
    ) -> OParameters:
        """Return the best parameters found, valid ones first; raises `InputError` for an odd number of nodes.

        The reward knows no sizes: with `size`, the descent of `RulePolicy` is taken much further instead.
        """
        if size is not None:
            return THOROUGH.choose(domain, layers=layers, size=size, corners=corners)
        if len(domain) % 2:
            raise InputError("O-type template", f"boundary has an odd number of nodes ({len(domain)})", "make it even")
        frame = domain.frame
        local = Domain(frame.to_local(domain.nodes))
        counts = self.layers if layers is None else (layers,)
        pairs = np.array([corners]) if corners else self._corners(local, counts[0])
        starts = tutte_points(local.nodes, pairs)
        found = []
        for pair, singular in zip(pairs.tolist(), starts, strict=True):
            start = np.concatenate([singular.ravel(), np.zeros(2 * EDGES)])
            worth, x = ascended(Mesh.of(local, pair, counts[0]), start, self.iterations[0], self.weights)
            found.append((worth, pair, x))
        found.sort(key=lambda one: -one[0])
        finals = [self._final(local, pair, k, x) for _, pair, x in found[: self.kept] for k in counts]
        _, _, pair, k, x = max(finals, key=lambda one: one[:2])
        return parameters_of(domain, pair, k, x)

    def _corners(self, domain: Domain, layers: int) -> Int[np.ndarray, "t 2"]:
        pairs, _ = corner_choices(len(domain), 3000)
        straight = np.zeros((len(pairs), EDGES, 2))
        counts = np.full(len(pairs), layers)
        judged = judge_o(domain.nodes, pairs, counts, tutte_points(domain.nodes, pairs), straight, self.weights)
        order = np.argsort(judged.penalty - judged.reward, kind="stable")
        return pairs[order[: self.tried]]

    def _final(
        self, domain: Domain, pair: tuple[int, int], layers: int, start: np.ndarray
    ) -> tuple[bool, float, tuple[int, int], int, np.ndarray]:
        start = np.concatenate([start, np.zeros(SHAPED - PLAIN if self.shaped else 0)])
        worth, x = ascended(Mesh.of(domain, pair, layers), start, self.iterations[1], self.weights)
        judged = judge_o(domain.nodes, np.array([pair]), np.array([layers]), **parts_of(x[None]))
        return bool(judged.valid[0]), worth, pair, layers, x
