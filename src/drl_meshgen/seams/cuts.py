"""One cut at a time: around a handle, around a closed surface."""

import numpy as np

from drl_meshgen.mesh import TriMesh
from drl_meshgen.seams.features import bridges
from drl_meshgen.seams.insertion import Incision
from drl_meshgen.seams.levels import smooth_loop
from drl_meshgen.seams.loops import Loop, edge_ids, thinnest_loop
from drl_meshgen.seams.options import SeamOptions
from drl_meshgen.seams.waist import waist

#: Rounds of refinement where a cut has no room.
ROUNDS = 5
#: Fewest edges around a handle and fewest nodes of a seam; triangles are split where there are fewer.
NODES = 12


def cut_handle(incision: Incision, known: list[Loop], options: SeamOptions) -> tuple[Incision | None, list[Loop]]:
    """Cut around the thinnest handle; None where no loop is found that leaves the mesh in one piece.

    `known` are loops found for earlier handles; those found now come second. Where there are few edges around the
    handle, or boundaries leave no room, triangles are split first.
    """
    loop = None
    for _ in range(ROUNDS):
        loop, known = thinnest_loop(incision.mesh, known, options.sources)
        if loop is not None:
            break
        incision, _ = incision.refined(incision.mesh.topology.on_boundary, [])
    return (None if loop is None else _around(incision, loop, options)), known


def _around(incision: Incision, loop: Loop, options: SeamOptions) -> Incision:
    """Cut along the best smooth curve around the same handle as `loop`; along the loop where there is none."""
    for _ in range(ROUNDS):
        curve = smooth_loop(incision.mesh, loop, options.levels, NODES) if len(loop) >= NODES else None
        if curve is not None:
            return incision.across(curve)
        incision, (loop,) = incision.refined(_at(incision.mesh, [loop]), [loop])
    return incision.along(loop)


def cut_waist(incision: Incision, options: SeamOptions) -> Incision | None:
    """Cut a closed mesh of genus 0 in two; None where it is too coarse."""
    curve = waist(incision.mesh, options.levels, options.share)
    return None if curve is None else incision.across(curve)


def cut_features(surface: TriMesh, loops: list[Loop]) -> Incision:
    """Cut along closed curves of edges, which do not meet, wherever they keep off the boundary.

    Edges that leave no room between curves are split first, and the triangles at curves of few edges.
    """
    incision = Incision.none(surface)
    loops = [loop for loop in loops if not surface.topology.on_boundary[loop].any()]
    if not loops:
        return incision
    while min(map(len, loops)) < NODES:
        incision, loops = incision.refined(_at(incision.mesh, [v for v in loops if len(v) < NODES]), loops)
    topology = incision.mesh.topology
    on_curve = np.zeros(len(topology.edges), bool)
    for loop in loops:
        on_curve[edge_ids(topology, np.c_[loop, np.roll(loop, -1)])] = True
    incision, loops = incision.split(bridges(incision.mesh, on_curve), loops)
    for loop in loops:
        incision = incision.along(loop)
    return incision


def _at(mesh: TriMesh, loops: list[Loop]) -> np.ndarray:
    """Boolean per vertex: on one of the loops."""
    flag = np.zeros(len(mesh.vertices), bool)
    for loop in loops:
        flag[loop] = True
    return flag
