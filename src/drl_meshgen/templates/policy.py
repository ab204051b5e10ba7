"""Who chooses a template's parameters: the protocol and the rule-based policy."""

from dataclasses import dataclass, field
from typing import Protocol, runtime_checkable

import numpy as np
from jaxtyping import Float

from drl_meshgen.templates.c_type import CCounts, CParameters, CSides, rule_c
from drl_meshgen.templates.corners import best_per_count, corner_pairs, rank_corners
from drl_meshgen.templates.domain import Domain
from drl_meshgen.templates.o_type import OParameters
from drl_meshgen.templates.options import PlacementOptions, Size
from drl_meshgen.templates.placement import Placement, place, start_of
from drl_meshgen.templates.sketch import Sketch


class Policy(Protocol):
    """Chooses the parameters of an O-type mesh: a rule, an optimiser or a learned agent."""

    def choose(
        self,
        domain: Domain,
        *,
        layers: int | None = None,
        size: Size | None = None,
        corners: tuple[int, int] | None = None,
    ) -> OParameters:
        """Return parameters for `domain`; `size` is the wanted edge length at points of the plane.

        `layers` fixes k, `corners` fixes `(i0, m)`.
        """
        ...


@runtime_checkable
class TemplatePolicy(Policy, Protocol):
    """Chooses the parameters of C-type meshes as well."""

    def transition(self, domain: Domain, start: int, cells: CSides | CCounts) -> CParameters:
        """Return parameters for a domain whose node `start` is the bottom left corner.

        `cells` are those of its sides, or all counts where these are settled.
        """
        ...


@dataclass(frozen=True)
class RulePolicy:
    """Corners by exhaustive search on coarse meshes, then singular points, bows and layers by descent.

    Deterministic; turning, mirroring, scaling or renumbering the domain gives the same mesh up to that map.
    """

    counts: int = 10
    """Values of m that are tried, evenly spaced up to L / 4, at most."""
    shortlist: int = 4
    """Positions of the corners for each m that are scored a second time with the exact wanted size."""
    spread: tuple[float, ...] = (1.0, 0.75, 0.5)
    """Shares of the best m whose best corners have their singular points optimised; the least energy wins.

    Coarse meshes find the best position for each m well, but favour square cores.
    """
    divisions: int = 6
    """Cells per side of the coarse mesh of that descent, at most."""
    placement: PlacementOptions = field(default_factory=PlacementOptions)
    """Options of the descent."""

    def choose(
        self,
        domain: Domain,
        *,
        layers: int | None = None,
        size: Size | None = None,
        corners: tuple[int, int] | None = None,
    ) -> OParameters:
        """Return the best parameters found; raises `InputError` for an odd number of boundary nodes."""
        domain.require_even()
        frame = domain.frame
        local = Domain(frame.to_local(domain.nodes))
        wanted = boundary_size(local) if size is None else lambda p: size(frame.to_world(p)) / frame.scale
        choices = [corners] if corners else self._finalists(local, wanted)
        sketches = [Sketch.of(local, i0, m, self.divisions, 3) for i0, m in choices]
        start = start_of(sketches[0], wanted, layers, self.placement)
        placed = [(place(sketch, wanted, layers, self.placement, start), sketch) for sketch in sketches]
        best_placement, sketch = min(placed, key=lambda pair: pair[0].energy)
        return parameters_of(best_placement, sketch, frame.to_world(best_placement.singular))

    def transition(self, domain: Domain, start: int, cells: CSides | CCounts) -> CParameters:
        """Return balanced counts where they are open, straight edges, and Tutte's singular points."""
        return rule_c(domain, start, cells if isinstance(cells, CCounts) else CCounts.between(cells))

    def _finalists(self, domain: Domain, size: Size) -> list[tuple[int, int]]:
        """Return the choices of corners worth a descent, by two rounds on coarse meshes; the best comes first."""
        choices, score = corner_pairs(len(domain), self.counts), np.zeros(0)
        for keep, sizes in ((self.shortlist, size(domain.nodes)), (1, size)):
            score = rank_corners(domain.nodes, choices, (4, 2), sizes, self.placement)
            kept = best_per_count(choices[1], score, keep)
            choices, score = (choices[0][kept], choices[1][kept]), score[kept]
        best = int(choices[1][np.argmin(score)])
        nearest = [int(np.abs(choices[1] - share * best).argmin()) for share in self.spread]
        return [(int(choices[0][c]), int(choices[1][c])) for c in dict.fromkeys(nearest)]


def parameters_of(placement: Placement, sketch: Sketch, singular: Float[np.ndarray, "4 2"]) -> OParameters:
    """Return the parameters of a placement whose singular points lie at `singular` in the plane."""
    k = placement.layers
    bulges = np.c_[placement.bows, np.zeros(8)]
    grading = placement.ratio ** (1 / max(k - 1, 1))
    return OParameters(sketch.i0, sketch.m, sketch.n, k, singular, bulges, grading)


def boundary_size(domain: Domain) -> Size:
    """Return a size field that continues the boundary spacing inwards.

    Its logarithm is averaged with weights `ds / d^2`: on a disk that is Poisson's kernel, so the size is the scale
    factor of the conformal metric in which the boundary nodes are evenly spaced and the interior is flat.
    """
    nodes, spacing = domain.nodes, domain.spacing
    share = np.stack([spacing, spacing * np.log(spacing)], axis=1)
    squared = (nodes**2).sum(axis=1) + (0.1 * spacing) ** 2

    def size(points: np.ndarray) -> np.ndarray:
        distance = points @ (-2 * nodes.T) + squared + (points**2).sum(axis=1)[:, None]
        total, log = (1 / distance @ share).T
        return np.exp(log / total)

    return size
