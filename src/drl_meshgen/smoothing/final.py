"""The result of the last meshing stage."""

from dataclasses import dataclass

from drl_meshgen.mesh import BlockMesh
from drl_meshgen.smoothing.options import SmoothingResult


@dataclass(frozen=True, eq=False)
class FinalMesh:
    """The finished mesh and how its node positions were found."""

    mesh: BlockMesh
    smoothing: SmoothingResult
    feature_share: float = 1.0
    """Length of the sharp curves that mesh lines follow over that of all (1 where there are none)."""
    feature_deviation: float = 0.0
    """Largest distance from such a curve to its mesh line (model units)."""
