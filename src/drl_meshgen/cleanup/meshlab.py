"""The one door to pymeshlab: arrays in, arrays out."""

from importlib import import_module
from typing import Any

import numpy as np
from jaxtyping import Bool, Float, Int

Mesh = tuple[Float[np.ndarray, "v 3"], Int[np.ndarray, "f 3"]]


def remesh_isotropic(
    points: Float[np.ndarray, "v 3"],
    triangles: Int[np.ndarray, "f 3"],
    edge: float,
    *,
    selected: Bool[np.ndarray, " f"] | None = None,
    iterations: int = 6,
    feature_degrees: float = 60.0,
) -> Mesh:
    """Isotropic remeshing (Botsch and Kobbelt 2004) towards edge length `edge` in model units.

    Boundary loops and creases above `feature_degrees` are kept. With `selected` only those triangles change.
    """
    pymeshlab: Any = import_module("pymeshlab")  # heavy, and without type stubs
    meshes = pymeshlab.MeshSet()
    flag = np.ones(len(triangles)) if selected is None else selected.astype(np.float64)
    meshes.add_mesh(pymeshlab.Mesh(points, triangles, f_scalar_array=flag))
    if selected is not None:
        meshes.compute_selection_by_condition_per_face(condselect="fq > 0.5")
    meshes.meshing_isotropic_explicit_remeshing(
        iterations=iterations,
        targetlen=pymeshlab.PureValue(edge),
        featuredeg=feature_degrees,
        checksurfdist=False,
        selectedonly=selected is not None,
    )
    meshes.meshing_remove_unreferenced_vertices()
    mesh = meshes.current_mesh()
    return mesh.vertex_matrix().astype(np.float64), mesh.face_matrix().astype(np.int64)
