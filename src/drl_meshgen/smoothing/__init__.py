"""Node positions: move the nodes of a quad mesh over a surface until the quads are well shaped."""

from drl_meshgen.smoothing.along import AlongResult, optimise_along
from drl_meshgen.smoothing.optimise import optimise
from drl_meshgen.smoothing.options import SmoothingOptions, SmoothingOutcome, SmoothingResult

__all__ = ["AlongResult", "SmoothingOptions", "SmoothingOutcome", "SmoothingResult", "optimise", "optimise_along"]
