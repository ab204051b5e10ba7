"""The result of the last meshing stage."""

from dataclasses import dataclass

from drl_meshgen.mesh import BlockMesh
from drl_meshgen.smoothing.options import SmoothingResult


@dataclass(frozen=True, eq=False)
class FinalMesh:
    """The finished mesh and how its node positions were found."""

    mesh: BlockMesh
    smoothing: SmoothingResult
