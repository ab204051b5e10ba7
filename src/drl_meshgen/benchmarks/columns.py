"""The columns in which meshes are compared."""

from dataclasses import dataclass


@dataclass(frozen=True)
class Figure:
    """A metric and how it is read."""

    head: str
    """Head of its column in Markdown."""
    digits: int
    """Digits after the point; figures that read the same are equal."""
    more_is_better: bool | None = False
    """Which end is the better one; None: neither."""


FIGURES = {
    "quads": Figure("quads", 0, None),
    "min_angle": Figure("min angle", 1, more_is_better=True),
    "max_angle": Figure("max angle", 1),
    "warp": Figure("warp", 1),
    "area_ratio": Figure("area ratio", 2),
    "orthogonality": Figure("orthogonality", 3, more_is_better=True),
    "irregular": Figure("irregular", 0),
    "blocks": Figure("base complex", 0),
    "named_blocks": Figure("named blocks", 0, None),
    "surface_deviation": Figure("surface", 4),
    "boundary_deviation": Figure("boundary", 4),
}
"""Metrics by name, in the order of the tables; deviations are fractions of the diagonal."""
RANKED = tuple(name for name, figure in FIGURES.items() if figure.more_is_better is not None)
"""Those with a better end."""
