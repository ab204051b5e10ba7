"""Discrete Ricci flow: the flat metric of a surface and its charts."""

from drl_meshgen.ricci.chart import Chart, faces_around, lay_out
from drl_meshgen.ricci.flow import FlatTriangulation, Outcome, RicciOptions, RicciResult, distortion, solve
from drl_meshgen.ricci.pinches import separating_triangles

__all__ = [
    "Chart",
    "FlatTriangulation",
    "Outcome",
    "RicciOptions",
    "RicciResult",
    "distortion",
    "faces_around",
    "lay_out",
    "separating_triangles",
    "solve",
]
