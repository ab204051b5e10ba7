"""Who chooses a template's parameters: the protocol and the rule-based policy."""

from dataclasses import dataclass, field
from typing import Protocol

import numpy as np
from jaxtyping import Float

from drl_meshgen.errors import InputError
from drl_meshgen.templates.corners import corner_pairs, rank_corners
from drl_meshgen.templates.domain import Domain
from drl_meshgen.templates.o_type import OParameters
from drl_meshgen.templates.options import PlacementOptions, Size
from drl_meshgen.templates.placement import Placement, place, start_of
from drl_meshgen.templates.sketch import Sketch


class Policy(Protocol):
    """Chooses the parameters of an O-type mesh: a rule, an optimiser or a learned agent."""

    def choose(self, domain: Domain, *, layers: int | None = None, size: Size | None = None) -> OParameters:
        """Return parameters for `domain`; `layers` fixes k; `size` is the wanted edge length at points of the plane."""
        ...


@dataclass(frozen=True)
class RulePolicy:
    """Corners by exhaustive search on coarse meshes, then singular points, bows and layers by descent.

    Deterministic; turning, mirroring, scaling or renumbering the domain gives the same mesh up to that map.
    """

    shortlist: int = 24
    """Choices of corners scored a second time on a finer coarse mesh."""
    finalists: int = 3
    """Choices of corners whose singular points are optimised; the least energy wins."""
    divisions: int = 6
    """Cells per side of the coarse mesh of that descent, at most."""
    placement: PlacementOptions = field(default_factory=PlacementOptions)
    """Options of the descent."""

    def choose(self, domain: Domain, *, layers: int | None = None, size: Size | None = None) -> OParameters:
        """Return the best parameters found; raises `InputError` for an odd number of boundary nodes."""
        if len(domain) % 2:
            raise InputError("O-type template", f"boundary has an odd number of nodes ({len(domain)})", "make it even")
        frame = domain.frame
        local = Domain(frame.to_local(domain.nodes))
        wanted = boundary_size(local) if size is None else lambda p: size(frame.to_world(p)) / frame.scale
        i0, m = corner_pairs(len(local))
        steps = (self.shortlist, (2, 1), wanted(local.nodes)), (self.finalists, (4, 2), wanted)
        for keep, resolution, sizes in steps:
            score = rank_corners(local.nodes, (i0, m), resolution, sizes, self.placement)
            best = np.argsort(score, kind="stable")[:keep]
            i0, m = i0[best], m[best]
        sketches = [Sketch.of(local, a, b, self.divisions, 3) for a, b in zip(i0.tolist(), m.tolist(), strict=True)]
        start = start_of(sketches[0], wanted, layers, self.placement)
        placed = [(place(sketch, wanted, layers, self.placement, start), sketch) for sketch in sketches]
        best_placement, sketch = min(placed, key=lambda pair: pair[0].energy)
        return parameters_of(best_placement, sketch, frame.to_world(best_placement.singular))


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
