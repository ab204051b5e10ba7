"""Necks between groups of loops: where an isocontour around several loops is much longer than need be.

Two bodies that touch are joined by a bridge far thinner than they are. It is too short for the depth to fall much
along it, so the isocontour between their loops passes through one of the bodies. A function that is 1 on
the loops of one and 0 on those of the other and harmonic in between, falls where there is least room: at the bridge.
"""

import numpy as np
from jaxtyping import Bool

from drl_meshgen.lift.harmonic import corner_weights, dirichlet, stiffness
from drl_meshgen.partition.cutting import CutSurface, cut, superlevel
from drl_meshgen.partition.levels import arc_lengths

SAMPLES = 49
"""Levels that are compared."""


def at_neck(surface: CutSurface, inside: Bool[np.ndarray, " v"], longest: float, contour: int) -> CutSurface | None:
    """Cut the shortest level between the curves `inside` and those outside, boundary loops and earlier contours.

    None where it is longer than `longest` (model units), or where fewer than two boundary loops of the component are
    on either side: a single loop would be the shortest level around itself. The new curve gets the number `contour`.
    """
    mesh = surface.mesh
    here = mesh.vertex_components == mesh.vertex_components[np.argmax(inside)]
    among = [inside[loop[0]] for loop in mesh.topology.loops if here[loop[0]]]
    if not 1 < sum(among) < len(among) - 1:
        return None
    on_curve = here & (mesh.topology.on_boundary | (surface.contour >= 0))
    known = np.nonzero(on_curve | ~here)[0]
    function = dirichlet(stiffness(mesh, corner_weights(mesh)), known, inside[known, None].astype(float))[:, 0]
    values = np.linspace(1, 0, SAMPLES + 2)[1:-1]
    lengths = arc_lengths(mesh, function, here[mesh.triangles[:, 0]], values)
    tip, root = (int(np.argmax(on_curve & side)) for side in (inside, ~inside))
    for k in np.argsort(lengths, kind="stable"):
        if lengths[k] > longest:
            break
        level = float(values[k])
        within = superlevel(mesh, function > level, tip, root)
        if (within == inside)[on_curve].all():
            return cut(surface, within, level, contour, function)
    return None
