"""Metrics of quad meshes, the same for every method, and the quality gate."""

from drl_meshgen.quality.gate import GateOptions, gate
from drl_meshgen.quality.metrics import Quality, measure, quality_row
from drl_meshgen.quality.shape import QuadShape

__all__ = ["GateOptions", "QuadShape", "Quality", "gate", "measure", "quality_row"]
