"""Curves on a surface that a mesh has to follow."""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float, Int


@dataclass(frozen=True, eq=False)
class FeatureCurve:
    """A polyline on a surface, such as a sharp edge; every segment lies within one triangle or along an edge.

    A closed curve does not repeat its first point. `corners` are the indices of points that need a node of their own;
    the ends of an open curve always do.
    """

    points: Float[np.ndarray, "k 3"]
    closed: bool
    corners: Int[np.ndarray, " c"]


def closed_length(points: Float[np.ndarray, "n 3"]) -> float:
    """Length of a closed polyline."""
    return float(np.linalg.norm(np.roll(points, -1, axis=0) - points, axis=1).sum())
