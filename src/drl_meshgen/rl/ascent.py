"""Template meshes as functions of their continuous parameters, and gradient ascent on their exact reward."""

from dataclasses import dataclass
from typing import Final

import numpy as np
from jaxtyping import Float, Int
from scipy.optimize import minimize

from drl_meshgen.rl.slope import worth_and_slope
from drl_meshgen.templates import c_type
from drl_meshgen.templates.c_type import CCounts
from drl_meshgen.templates.curves import SWELLS, WAVES, left_normal
from drl_meshgen.templates.domain import Domain
from drl_meshgen.templates.mesh import grid_quads
from drl_meshgen.templates.o_type import EDGES, grids, positions, rim_fractions
from drl_meshgen.templates.score import Weights

#: Ends of the internal edges of an O-type mesh: its four corners, then the singular points.
O_ENDS: Final[np.ndarray] = np.array([*((s, 4 + s) for s in range(4)), *((4 + s, 4 + (s + 1) % 4) for s in range(4))])


@dataclass(frozen=True, eq=False)
class Mesh:
    """The nodes of a template mesh as a function of its continuous parameters: `fixed + basis @ controls`.

    Controls are the singular points, then two bulge vectors of each internal edge, then all else. Parameters are the
    same, but for bulges by their amplitudes; those of the end may be left out.
    """

    vertex: Float[np.ndarray, "v 2"]
    """Vertices of the boundary."""
    ends: Int[np.ndarray, "e 2"]
    """First and last vertex of each internal edge; singular points count on from `v`."""
    fixed: Float[np.ndarray, "p 2"]
    basis: Float[np.ndarray, "p c"]
    quads: Int[np.ndarray, "q 4"]

    @classmethod
    def of(cls, domain: Domain, corners: tuple[int, int], layers: int) -> "Mesh":
        """Set up the O-type mesh of a domain with corners `(i0, m)`; controls end with waves and swells."""
        i0, m = corners
        n = len(domain) // 2 - m
        boundary, controls = _controls(domain.nodes, 4 + 2 * EDGES + WAVES * EDGES + 4 * SWELLS)
        singular, bulge, wave, swell = np.split(controls, np.cumsum([4, 2 * EDGES, WAVES * EDGES]))
        both = positions(
            boundary,
            singular,
            np.concatenate([part.reshape(EDGES, -1, boundary.shape[1]) for part in (bulge, wave)], axis=1),
            corners=(i0, m, n),
            radial=np.linspace(0, 1, layers + 1),
            fractions=rim_fractions(domain.nodes, i0, m, n),
            swells=swell.reshape(4, SWELLS, -1),
        )
        at = (i0 + np.array([0, m, m + n, 2 * m + n])) % len(domain)
        quads = grid_quads(grids(i0, m, n, layers))
        return cls(domain.nodes[at], O_ENDS, both[:, :2].copy(), both[:, 2:].copy(), quads)

    @classmethod
    def of_transition(cls, domain: Domain, start: int, counts: CCounts) -> "Mesh":
        """Set up the C-type mesh of a domain whose node `start` is the bottom left corner."""
        boundary, controls = _controls(domain.nodes, 4 + 2 * len(c_type.EDGES))
        bulge = controls[4:].reshape(len(c_type.EDGES), 2, -1)
        plan = c_type.layout(start, counts)
        both = c_type.positions(boundary, controls[:4], bulge, plan, c_type.rim_parts(domain.nodes, start, counts))
        at = (start + counts.rim) % len(domain)
        quads = grid_quads(plan.grids)
        return cls(domain.nodes[at], c_type.ENDS, both[:, :2].copy(), both[:, 2:].copy(), quads)

    def worth(self, x: Float[np.ndarray, " c"], weights: Weights) -> tuple[float, Float[np.ndarray, " c"]]:
        """Return reward less penalty, and its gradient in the parameters."""
        rim, edges = len(self.vertex), len(self.ends)
        singular, bulges = x[:8].reshape(4, 2), x[8 : 8 + 2 * edges].reshape(edges, 2)
        vertex = np.concatenate([self.vertex, singular])
        normal = left_normal(vertex[self.ends[:, 1]] - vertex[self.ends[:, 0]])
        bulged = (bulges[..., None] * normal[:, None]).reshape(-1, 2)
        controls = np.concatenate([singular, bulged, x[8 + 2 * edges :].reshape(-1, 2)])
        basis = self.basis[:, : len(controls)]
        value, slope = worth_and_slope((self.fixed + basis @ controls)[None], self.quads, weights=weights)
        in_controls = basis.T @ slope[0]
        in_offset = in_controls[4 : 4 + 2 * edges].reshape(edges, 2, 2)
        in_bulges = (in_offset * normal[:, None]).sum(axis=-1)
        in_chord = -left_normal((bulges[..., None] * in_offset).sum(axis=1))
        in_vertex = np.zeros_like(vertex)
        np.add.at(in_vertex, self.ends[:, 1], in_chord)
        np.subtract.at(in_vertex, self.ends[:, 0], in_chord)
        in_singular, in_rest = in_controls[:4] + in_vertex[rim:], in_controls[4 + 2 * edges :]
        return float(value[0]), np.concatenate([in_singular.ravel(), in_bulges.ravel(), in_rest.ravel()])


def _controls(nodes: Float[np.ndarray, "l 2"], count: int) -> tuple[np.ndarray, Float[np.ndarray, "c d"]]:
    """Return nodes with a dimension for every control behind their own two, and the controls as units of these."""
    return np.concatenate([nodes, np.zeros((len(nodes), count))], axis=1), np.eye(count, 2 + count, 2)


def ascended(
    mesh: Mesh, start: Float[np.ndarray, " c"], iterations: int, weights: Weights
) -> tuple[float, Float[np.ndarray, " c"]]:
    """Return the worth found by L-BFGS from `start`, and its parameters."""

    def descent(x: np.ndarray) -> tuple[float, np.ndarray]:
        value, slope = mesh.worth(x, weights)
        return -value, -slope

    found = minimize(descent, start, jac=True, method="L-BFGS-B", options={"maxiter": iterations, "maxcor": 20})
    return -float(found.fun), found.x
