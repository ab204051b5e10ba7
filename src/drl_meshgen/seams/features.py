"""Sharp edges of a surface, chained into curves between corners."""

import numpy as np
from jaxtyping import Bool, Float, Int

from drl_meshgen.mesh import FeatureCurve, TriMesh
from drl_meshgen.mesh.topology import graph_components
from drl_meshgen.seams.loops import edge_ids
from drl_meshgen.seams.options import SeamOptions

#: Share of the feature angle that suffices for edges connected to sharper ones.
WEAK = 0.6

Chain = tuple[Int[np.ndarray, " k"], bool]


def feature_curves(
    surface: TriMesh, options: SeamOptions, given: Int[np.ndarray, "k 2"] | None = None
) -> list[tuple[FeatureCurve, Int[np.ndarray, " k"]]]:
    """Curves of sharp and `given` edges (vertex pairs) and their vertices, each between corners or closed.

    Corners are vertices where not two sharp edges meet, and sharp turns within a curve. Short curves that end freely
    and small networks are taken for noise, unless given.
    """
    topology = surface.topology
    kept = np.zeros(len(topology.edges), bool)
    if given is not None:
        kept[edge_ids(topology, given)] = True
    sharp = kept | (sharp_edges(surface, options.feature_angle) if options.feature_angle > 0 else False)
    shortest = options.feature_length * surface.diagonal
    sharp &= kept | ~_small(surface, sharp, shortest)
    while True:
        found = chains(topology.edges[sharp])
        count = np.bincount(topology.edges[sharp].ravel(), minlength=len(surface.vertices))
        loose = (count == 1) & ~topology.on_boundary
        stubs = np.zeros(len(sharp), bool)
        for vertices, closed in found:
            if not closed and loose[vertices[[0, -1]]].any() and _length(surface, vertices) < shortest:
                stubs[edge_ids(topology, np.c_[vertices[:-1], vertices[1:]])] = True
        stubs &= ~kept
        if not stubs.any():
            break
        sharp &= ~stubs
    return [_curve(surface, chain, np.radians(options.feature_corner)) for chain in found]


def sharp_edges(surface: TriMesh, angle: float) -> Bool[np.ndarray, " e"]:
    """Inner edges where the normals turn by more than `angle` degrees.

    So do all edges joined to these that turn by more than `WEAK` times as much (hysteresis).
    """
    topology = surface.topology
    inner = topology.edge_count == 2
    one, two = surface.normals[topology.edge_faces].transpose(1, 0, 2)
    turn = np.degrees(np.arctan2(np.linalg.norm(np.cross(one, two), axis=1), np.einsum("ei,ei->e", one, two)))
    weak, strong = inner & (turn > WEAK * angle), inner & (turn > angle)
    label = graph_components(topology.edges[weak], len(surface.vertices))
    hit = np.zeros(len(surface.vertices), bool)
    hit[label[topology.edges[strong].ravel()]] = True
    return weak & hit[label[topology.edges[:, 0]]]


def chains(edges: Int[np.ndarray, "e 2"]) -> list[Chain]:
    """Vertices of the curves that edges form between vertices where not two of them meet, and whether they close.

    A curve from a corner back to the same corner ends with the vertex it starts with; only one without a corner closes.
    """
    around: dict[int, list[int]] = {}
    for a, b in edges.tolist():
        around.setdefault(a, []).append(b)
        around.setdefault(b, []).append(a)
    done: set[tuple[int, int]] = set()
    found: list[Chain] = []
    corners = [v for v in sorted(around) if len(around[v]) != 2]
    for start in [*corners, *sorted(around)]:
        for step in sorted(around[start]):
            if (start, step) in done:
                continue
            path = [start, step]
            done |= {(start, step), (step, start)}
            while len(around[path[-1]]) == 2 and path[-1] != start:
                one, two = around[path[-1]]
                path.append(two if one == path[-2] else one)
                done |= {(path[-2], path[-1]), (path[-1], path[-2])}
            closed = path[-1] == start and len(around[start]) == 2
            found.append((np.array(path[:-1] if closed else path, np.int64), closed))
    return found


def bridges(surface: TriMesh, curves: Bool[np.ndarray, " e"]) -> Bool[np.ndarray, " e"]:
    """Edges from curve to curve (the boundary is one) that are part of none: there is no room between their ends."""
    topology = surface.topology
    on = topology.on_boundary.copy()
    on[topology.edges[curves].ravel()] = True
    return on[topology.edges].all(axis=1) & ~curves & (topology.edge_count == 2)


def _small(surface: TriMesh, sharp: Bool[np.ndarray, " e"], size: float) -> Bool[np.ndarray, " e"]:
    """Edges of connected networks whose bounding box has a diagonal below `size`."""
    label = graph_components(surface.topology.edges[sharp], len(surface.vertices))
    low, high = np.full((label.max() + 1, 3), np.inf), np.full((label.max() + 1, 3), -np.inf)
    np.minimum.at(low, label, surface.vertices)
    np.maximum.at(high, label, surface.vertices)
    return (np.linalg.norm(high - low, axis=1) < size)[label[surface.topology.edges[:, 0]]]


def _length(surface: TriMesh, vertices: Int[np.ndarray, " k"]) -> float:
    return float(np.linalg.norm(np.diff(surface.vertices[vertices], axis=0), axis=1).sum())


def _curve(surface: TriMesh, chain: Chain, corner: float) -> tuple[FeatureCurve, Int[np.ndarray, " k"]]:
    vertices, closed = chain
    points: Float[np.ndarray, "k 3"] = surface.vertices[vertices]
    back, ahead = points - np.roll(points, 1, axis=0), np.roll(points, -1, axis=0) - points
    turn = np.arctan2(np.linalg.norm(np.cross(back, ahead), axis=1), np.einsum("ki,ki->k", back, ahead))
    if not closed:
        turn[[0, -1]] = np.pi
    return FeatureCurve(points, closed, np.nonzero(turn > corner)[0]), vertices
