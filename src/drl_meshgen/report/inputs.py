"""What the report is made from."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np
import pandas as pd
from jaxtyping import Float, Int

from drl_meshgen.mesh import BlockMesh, QuadMesh, TriMesh

OURS = "drl-meshgen"
"""Our name in the `method` column."""


@dataclass(frozen=True, eq=False)
class ModelRun:
    """One model, meshed by us and by rivals. Everything comes from stored files; nothing is computed anew."""

    name: str
    """Name of the model, fit for a file name."""
    surface: TriMesh
    """The cleaned surface."""
    cut_surface: TriMesh
    """The surface refined along the contours."""
    depth: Float[np.ndarray, " c"]
    """Depth per vertex of `cut_surface`."""
    region: Int[np.ndarray, " d"]
    """Region of each triangle of `cut_surface`."""
    contours: Sequence[Float[np.ndarray, "k 3"]]
    """Closed contours as polylines, first point repeated at the end."""
    mesh: BlockMesh
    """Our mesh."""
    quality: pd.DataFrame
    """One row per method as `quality_row` makes it; ours has the method `OURS`."""
    timings: pd.DataFrame
    """Columns `stage` and `seconds`, in the order the stages ran."""
    rivals: Mapping[str, QuadMesh] = field(default_factory=dict)
    """Meshes of rivals by the name in `quality`; a rival without a mesh is left out."""
    rival_triangles: Mapping[str, Int[np.ndarray, "t 3"]] = field(default_factory=dict)
    """Faces of rivals that are not quads, by the same names."""
