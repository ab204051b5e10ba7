"""Discrete Ricci flow: the flat metric of a surface and its charts."""

from drl_meshgen.ricci.flow import FlatTriangulation, Outcome, RicciOptions, RicciResult, distortion, solve

__all__ = ["FlatTriangulation", "Outcome", "RicciOptions", "RicciResult", "distortion", "solve"]
