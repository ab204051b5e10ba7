"""Parameters of O-type meshes by gradient ascent on the exact reward: what a policy is measured against."""

from dataclasses import dataclass, field
from typing import Final

import numpy as np
from jaxtyping import Float, Int

from drl_meshgen.rl.ascent import Mesh, ascended
from drl_meshgen.rl.boundary import side_samples
from drl_meshgen.rl.controls import PLAIN, SHAPED, parameters_of, parts_of
from drl_meshgen.rl.kernel import judge_o
from drl_meshgen.rl.scene import corner_choices
from drl_meshgen.rl.transitions import ascended_transition
from drl_meshgen.templates.c_type import CCounts, CParameters, CSides
from drl_meshgen.templates.corners import reference
from drl_meshgen.templates.domain import Domain
from drl_meshgen.templates.o_type import EDGES, OParameters
from drl_meshgen.templates.options import PlacementOptions, Size
from drl_meshgen.templates.policy import RulePolicy
from drl_meshgen.templates.score import Weights

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
    counts_tried: int = 10
    """Choices of counts of a C-type mesh that get a short ascent."""
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
        domain.require_even()
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

    def transition(self, domain: Domain, start: int, cells: CSides | CCounts) -> CParameters:
        """Return the best C-type parameters found, valid ones first."""
        kept = self.counts_tried, self.kept
        return ascended_transition(domain, start, cells, kept=kept, iterations=self.iterations, weights=self.weights)

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
