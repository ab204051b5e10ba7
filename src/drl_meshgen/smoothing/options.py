"""Options, verdict and result of the node optimiser."""

from dataclasses import dataclass, replace
from enum import Enum

import numpy as np
import pandas as pd
from jaxtyping import Float, Int

from drl_meshgen.decompose.zones import Zone


class SmoothingOutcome(Enum):
    """How an optimisation ended."""

    GOOD = "every quad is valid and within the wanted angle limits"
    VALID = "every quad is valid, but some miss the wanted angle limits"
    INVALID = "some quads stay folded: the layout leaves them no room; refine it or change the node counts there"


@dataclass(frozen=True)
class SmoothingOptions:
    """Weights, limits and effort of the node optimiser."""

    area_weight: float = 0.6
    """Weight of the log ratio of the areas of edge-adjacent quads, relative to a corner angle in radians."""
    size_weight: float = 0.5
    """Weight of the log ratio of the area of a quad to the wanted one, where sizes vary, relative to a corner angle."""
    aspect_weight: float = 0.2
    """Weight of the log ratio of the two mean side lengths of a quad, relative to a corner angle in radians."""
    warp_weight: float = 0.2
    """Weight of the dihedral angle at each diagonal of a quad, relative to a corner angle in radians."""
    wanted_angles: tuple[float, float] = (55.0, 120.0)
    """Limits of corner angles (degrees)."""
    margin: float = 2.0
    """Corner angles within the limits by less than this (degrees), or beyond, are penalised with the hinge weights."""
    wanted_area_ratio: float = 1.5
    """Area ratios of edge-adjacent quads above this are penalised on top."""
    wanted_aspect: float = 4.0
    """Ratios of the mean side lengths of a quad above this are penalised on top."""
    wanted_warp: float = 27.0
    """Dihedral angles at diagonals above this (degrees) are penalised on top."""
    hinge_weights: tuple[float, ...] = (0.0, 3.0, 15.0)
    """Weight of the violation of a limit, relative to a corner angle, one stage of the optimisation after another."""
    corner_turn: float = 35.0
    """Least turn of the boundary (degrees, over half a quad edge to both sides) that a node is put on; 180 for none."""
    feature_angles: tuple[float, float] = (25.0, 155.0)
    """A feature curve is given up where it takes a corner angle at its mesh line outside these limits (degrees)."""
    relax_sweeps: int = 10
    """Local-global sweeps towards well-shaped quads before anything else."""
    newton_steps: tuple[int, ...] = (8, 8, 10)
    """Most Gauss-Newton steps of each stage."""
    repair_angles: tuple[float, float] = (50.0, 130.0)
    """Quads with a corner angle outside these limits (degrees) are repaired together with their surroundings."""
    repair_area_ratio: float = 2.5
    """Edge-adjacent quads whose areas differ by more than this factor are repaired as well."""
    unfold_rounds: int = 3
    """Most rounds of untangling, in growing patches, each time folded quads are looked for."""
    searches: int = 2
    """Most rounds of repair that try places for folded quads, node by node; what two leave folded has no room."""
    repair_rings: int = 4
    """Rings of quads around a bad one that move in its repair."""
    repair_rounds: int = 4
    """Most rounds of repair."""
    repair_steps: int = 12
    """Most Gauss-Newton steps of each round of repair."""
    repair_slack: float = 1.5
    """Factor by which repair widens the limits of warp and of area ratios (its logarithm): angles come first there."""
    repair_hinge: float = 20.0
    """Weight of the violation of a limit during repair, relative to a corner angle."""
    deviation: float = 0.3
    """Nodes move to bumps and creases that are farther than this from the mesh (in mean edge lengths)."""
    settle_rounds: int = 0
    """Most rounds of that; 0: nodes stay."""
    cg_iterations: int = 40
    """Most conjugate-gradient iterations of each Gauss-Newton step."""
    step_limit: float = 0.5
    """Longest step of a node, in mean lengths of the edges at it."""
    zones: tuple[Zone, ...] = ()
    """Zones near which irregular nodes stay where the layout put them; a run takes those of `decompose.zones`."""

    def for_repair(self) -> "SmoothingOptions":
        """Return these options with the limits of repair."""
        area = self.wanted_area_ratio**self.repair_slack
        return replace(self, wanted_warp=self.wanted_warp * self.repair_slack, wanted_area_ratio=area)

    def fast(self) -> "SmoothingOptions":
        """Return these options with fewer steps of each kind."""
        return replace(
            self,
            relax_sweeps=5,
            hinge_weights=(0.0, 6.0),
            newton_steps=(5, 5),
            cg_iterations=25,
            repair_rounds=1,
            searches=1,
        )


@dataclass(frozen=True, eq=False)
class SmoothingResult:
    """Optimised node positions: on the surface, with the surface triangle that carries each node."""

    points: Float[np.ndarray, "n 3"]
    triangle: Int[np.ndarray, " n"]
    outcome: SmoothingOutcome
    history: pd.DataFrame
    """One row per step: `stage`, `cost`, `damping`, `invalid`, `min_angle`, `max_angle`, `area_ratio` (degrees)."""
