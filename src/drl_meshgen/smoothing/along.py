"""Node positions with mesh lines on feature curves, as many as the quads allow."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float, Int

from drl_meshgen.mesh import FeatureCurve, QuadMesh, TriMesh
from drl_meshgen.quality.closest import closest_on_segments
from drl_meshgen.smoothing.curves import CurveTrack
from drl_meshgen.smoothing.features import chains_along
from drl_meshgen.smoothing.nodes import Chain, NodeSpace
from drl_meshgen.smoothing.optimise import optimise
from drl_meshgen.smoothing.options import SmoothingOptions, SmoothingOutcome, SmoothingResult
from drl_meshgen.smoothing.verdict import Referee, outer_angles
from drl_meshgen.smoothing.walk import SurfaceWalker

ROUNDS = 3
"""Most trials, each without the curves that spoiled quads in the one before."""
ON_CURVE = 1e-6
"""A row of nodes this close to a feature curve lies on it (fraction of the diagonal)."""
SAMPLES = 4
"""Points per segment of a feature curve whose distance from the mesh lines is measured."""


@dataclass(frozen=True, eq=False)
class AlongResult:
    """Node positions and how well mesh lines follow the feature curves."""

    smoothing: SmoothingResult
    chains: tuple[Chain, ...]
    """Nodes along each curve that is kept."""
    share: float
    """Length of the kept curves over that of all (1 where there are none)."""
    deviation: float
    """Largest distance from a kept curve to its mesh line (model units; 0 where there are none)."""


def optimise_along(
    surface: TriMesh,
    mesh: QuadMesh,
    triangle: Int[np.ndarray, " n"],
    features: Sequence[FeatureCurve],
    options: SmoothingOptions | None = None,
    *,
    fixed: Bool[np.ndarray, " n"] | None = None,
    sizes: Float[np.ndarray, " v"] | None = None,
) -> AlongResult:
    """Optimise freely, lay mesh lines on the feature curves (see `chains_along`), optimise on with these sliding.

    Curves that have a row of nodes from the start keep it. A curve is given up where a quad at its line is folded or
    has an angle outside `options.feature_angles` although the free mesh has not. Raises `InputError` like `optimise`.
    """
    options = options or SmoothingOptions()
    track = CurveTrack(SurfaceWalker(surface), features)
    near = ON_CURVE * surface.diagonal
    rows = chains_along(mesh, track, features)
    held = tuple(row for row in rows if _away(track, mesh, row).max() < near)
    free = optimise(surface, mesh, triangle, options, fixed, sizes=sizes, features=features, chains=held)
    if held and free.outcome is SmoothingOutcome.INVALID:
        free = optimise(surface, mesh, triangle, options, fixed, sizes=sizes)
    start = QuadMesh(free.points, mesh.quads)
    chains = chains_along(start, track, features)
    spoiled_before = _spoiled(surface, start, free, options)
    found = free
    for _ in range(ROUNDS):
        if not chains:
            found = free
            break
        found = optimise(surface, start, free.triangle, options, fixed, sizes=sizes, features=features, chains=chains)
        spoiled = _spoiled(surface, start, found, options) & ~spoiled_before
        near = np.zeros(len(mesh.points), bool)
        near[mesh.quads[spoiled]] = True
        good = tuple(chain for chain in chains if not near[chain.nodes].any())
        if len(good) == len(chains):
            break
        chains, found = good, free
    else:
        chains = ()
    lengths = track.length[track.n_loops :]
    kept = lengths[[chain.feature for chain in chains]].sum()
    share = float(kept / lengths.sum()) if len(lengths) else 1.0
    away = [_distance(features[chain.feature], found.points[chain.nodes]) for chain in chains]
    return AlongResult(found, chains, share, max(away, default=0.0))


def _spoiled(
    surface: TriMesh, mesh: QuadMesh, found: SmoothingResult, options: SmoothingOptions
) -> Bool[np.ndarray, " m"]:
    """Quads that are folded or have an angle outside the limits for feature curves."""
    moved = QuadMesh(found.points, mesh.quads)
    shape = Referee(surface, moved, options).shape(NodeSpace(surface, moved).start(found.triangle), exact=True)
    angle, (low, high) = outer_angles(shape), options.feature_angles
    return ~shape.valid | (angle < low).any(axis=0) | (angle > high).any(axis=0)


def _away(track: CurveTrack, mesh: QuadMesh, chain: Chain) -> Float[np.ndarray, " k"]:
    """Distance of the nodes of a chain from its curve."""
    return track.project(mesh.points[chain.nodes], np.array([track.n_loops + chain.feature]))[2]


def _distance(feature: FeatureCurve, nodes: Float[np.ndarray, "k 3"]) -> float:
    """Largest distance from a feature curve to the polyline through the nodes of its chain."""
    ends = np.roll(feature.points, -1, axis=0), np.roll(nodes, -1, axis=0)
    last = None if feature.closed else -1
    tail, head = feature.points[:last], ends[0][:last]
    share = np.arange(SAMPLES)[:, None, None] / SAMPLES
    samples = ((1 - share) * tail + share * head).reshape(-1, 3)[:, None]
    a, b = (np.broadcast_to(p[:last], (len(samples), len(p[:last]), 3)) for p in (nodes, ends[1]))
    closest = closest_on_segments(np.broadcast_to(samples, a.shape), a, b)
    return float(np.linalg.norm(closest - samples, axis=2).min(axis=1).max())
