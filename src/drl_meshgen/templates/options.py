"""What the choice of corners and of singular points have in common: the wanted size and the weights."""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

Size = Callable[[Float[np.ndarray, "p 2"]], Float[np.ndarray, " p"]]
"""Wanted edge length at points of the domain, in its units."""


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
