"""Settings and verdicts of the seams."""

from dataclasses import dataclass
from enum import Enum


class Outcome(Enum):
    """Verdicts of opening a surface."""

    DONE = "every component has genus 0 and a boundary"
    NOT_OPENED = "a component with handles or without a boundary could not be opened"


@dataclass(frozen=True)
class SeamOptions:
    """Settings of the seams."""

    levels: int = 32
    """Isocontours that compete for each seam."""
    sources: int = 6
    """Places from which loops around handles are sought."""
    share: float = 0.15
    """Share of the area that must lie on either side of the seam around a closed surface."""
    feature_angle: float = 0.0
    """Angle between normals (degrees) above which an edge is sharp and kept; 0 keeps none."""
    feature_length: float = 0.03
    """Sharp curves with a free end, and networks of them, are noise below this size (share of the diagonal)."""
    feature_corner: float = 60.0
    """Turn of a sharp curve (degrees) above which it has a corner there."""
