"""The subdomain stage: nodes of every ring and cap in its own chart."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
import pandas as pd
from jaxtyping import Float, Int
from scipy.spatial import KDTree

from drl_meshgen.assembly.align import Alignment, align
from drl_meshgen.assembly.transition import TransitionFill, transition_fill
from drl_meshgen.assembly.turn import turned
from drl_meshgen.decompose import Cap, Layout
from drl_meshgen.decompose.cells import Ring
from drl_meshgen.partition import Partition
from drl_meshgen.progress import counter
from drl_meshgen.sizing import Sizes
from drl_meshgen.templates import Policy, RulePolicy, TemplatePolicy, fill_cap
from drl_meshgen.templates.placement import Size

#: Slices of a ring over which sizes are averaged to place its rows.
HEIGHT_SLOTS = 32


@dataclass(frozen=True)
class SubdomainOptions:
    """How templates are placed."""

    policy: str = "agent"
    """Who chooses the parameters of templates: agent (learned), rule, optimizer, or the path of a .safetensors file."""


@dataclass(frozen=True, eq=False)
class RingFill:
    """Chart coordinates `(theta, h)` of the nodes of a ring, shape `(rows + 1, n, 2)`; row 0 lies on its first curve.

    `first (n,)` is the index on that curve of the node each column meets; for a tube `last (n,)` the same at its other
    curve, for a cell empty.
    """

    chart: Float[np.ndarray, "r n 2"]
    first: Int[np.ndarray, " n"]
    last: Int[np.ndarray, " m"]


@dataclass(frozen=True, eq=False)
class CapFill:
    """O-type mesh of a cap in its disk chart: `chart (p, 2)`, boundary nodes first, then layer after layer, then core.

    `first (n,)` is the index on the curve of each boundary node, `core` the node grid of the core, `corners` the
    columns of the template's corners, `layers` the number of radial cells.
    """

    chart: Float[np.ndarray, "p 2"]
    first: Int[np.ndarray, " n"]
    core: Int[np.ndarray, "m1 n1"]
    corners: tuple[int, ...]
    layers: int


@dataclass(frozen=True, eq=False)
class StripFill:
    """Nodes of a strip in its unit square, `(width + 1, length + 1, 2)`; the first index runs along the mouths."""

    chart: Float[np.ndarray, "w1 l1 2"]


@dataclass(frozen=True, eq=False)
class Subdomains:
    """Fills of all rings (in the order of `Pieces.rings`), caps and strips, and one row per template.

    `rims` has one array per rim, junction after junction: the index on its curve of each node around it.
    """

    rings: tuple[RingFill | TransitionFill, ...]
    caps: tuple[CapFill, ...]
    strips: tuple[StripFill, ...]
    rims: tuple[Int[np.ndarray, " n"], ...]
    templates: pd.DataFrame


def fill(
    partition: Partition, layout: Layout, policy: TemplatePolicy | None = None, sizes: Sizes | None = None
) -> Subdomains:
    """Place the nodes of all pieces in their charts.

    Rings get rows that are equally spaced in `h`, closer where `sizes` are small, and columns that are straight in the
    chart, so cells cannot overlap there.
    Caps get the O-type template with parameters from `policy` (rule-based by default), tubes that lose columns a C-type
    transition.
    """
    policy = policy or RulePolicy()
    sizes = sizes or Sizes.of(partition.surface.mesh, layout.spacing)
    placed, corners = turned(layout, align(partition, layout))
    pieces = layout.pieces
    meshed = counter("pieces meshed", len(pieces.rings) + len(pieces.caps))
    rings = _ring_fills(layout, placed, sizes, policy, meshed)
    caps, rows = [], []
    for cap, wanted in zip(pieces.caps, corners, strict=True):
        one, row = _cap_fill(cap, partition, placed.positions[cap.curve], wanted, policy=policy, sizes=sizes)
        caps.append(one)
        rows.append({"cap": len(rows), "curve": cap.curve, **row})
        meshed()
    for k, one in enumerate(rings[len(rings) - len(pieces.tubes) :]):
        if isinstance(one, TransitionFill):
            absorbed = abs(len(one.first) - len(one.last)) // 2
            rows.append({"curve": pieces.tubes[k].curves[0], "template": "C", "m": absorbed, "n": absorbed})
    columns = ["cap", "curve", "template", "i0", "m", "n", "layers", "grading", "outcome"]
    rims = tuple(rim for one in placed.rims for rim in one)
    return Subdomains(rings, tuple(caps), _strip_fills(layout), rims, pd.DataFrame(rows, columns=columns))


def _strip_fills(layout: Layout) -> tuple[StripFill, ...]:
    return tuple(
        StripFill(strip.nodes(counts))
        for junction, counts in zip(layout.pieces.junctions, layout.edge_counts, strict=True)
        for strip in junction.strips
    )


def _ring_fills(
    layout: Layout, placed: Alignment, sizes: Sizes, policy: TemplatePolicy, meshed: Callable[[], None]
) -> tuple[RingFill | TransitionFill, ...]:
    none = np.empty(0, np.int64)
    fills: list[RingFill | TransitionFill] = []
    for junction, columns, rows in zip(layout.pieces.junctions, placed.cells, layout.cell_rows, strict=True):
        for cell, (foot, outer), r in zip(junction.cells, columns, rows, strict=True):
            heights = row_heights(cell.ring, int(r), sizes)
            fills.append(RingFill(_ruled(foot.theta, outer, heights), foot.nodes(), none))
            meshed()
    for tube, (one, two), r in zip(layout.pieces.tubes, placed.tubes, layout.tube_rows, strict=True):
        if len(one.theta) == len(two.theta):
            heights = row_heights(tube.ring, int(r), sizes)
            fills.append(RingFill(_ruled(one.theta, two.theta, heights), one.nodes(), two.nodes()))
        else:
            fills.append(transition_fill(one, two, int(r), tube.ring.chart.modulus, policy))
        meshed()
    return tuple(fills)


def row_heights(ring: Ring, rows: int, sizes: Sizes) -> Float[np.ndarray, " r1"]:
    """Heights `h` of the rows of a ring, from 0 to 1.

    Equal steps of the chart make square cells where columns are straight; wanted sizes would make the rows as dense as
    their inverse, averaged over the chart at each height. The density is the geometric mean of both.
    """
    if sizes.uniform:
        return np.arange(rows + 1) / rows
    chart = ring.chart
    corner = np.stack([chart.theta_corner, chart.h[ring.mesh.triangles]], axis=-1)
    first, second = corner[:, 1] - corner[:, 0], corner[:, 2] - corner[:, 0]
    area = np.abs(first[:, 0] * second[:, 1] - first[:, 1] * second[:, 0])
    density = (1 / sizes.at(ring.mesh.vertices))[ring.mesh.triangles].mean(axis=1)
    slot = np.minimum((corner[..., 1].mean(axis=1) * HEIGHT_SLOTS).astype(np.int64), HEIGHT_SLOTS - 1)
    weight = np.bincount(slot, area, HEIGHT_SLOTS)
    known = weight > 0
    middle = (np.arange(HEIGHT_SLOTS) + 0.5) / HEIGHT_SLOTS
    mean = np.bincount(slot, area * density, HEIGHT_SLOTS)[known] / weight[known]
    total = np.r_[0.0, np.cumsum(np.sqrt(np.interp(middle, middle[known], mean)))]
    return np.interp(np.linspace(0, total[-1], rows + 1), total, np.linspace(0, 1, HEIGHT_SLOTS + 1))


def _ruled(inner: np.ndarray, outer: np.ndarray, heights: Float[np.ndarray, " r"]) -> Float[np.ndarray, "r n 2"]:
    share = heights[:, None]
    outer = outer + np.round((inner - outer).mean())
    theta = (1 - share) * inner + share * outer
    return np.stack([theta, np.broadcast_to(share, theta.shape)], axis=-1)


def _cap_fill(
    cap: Cap,
    partition: Partition,
    positions: Float[np.ndarray, " n"],
    corners: tuple[int, ...],
    *,
    policy: Policy,
    sizes: Sizes,
) -> tuple[CapFill, dict[str, Any]]:
    curve = partition.curves[cap.curve]
    at, length = curve.arc_length(partition.surface.mesh.vertices)
    place = {int(v): float(s) for v, s in zip(curve.vertices, at, strict=True)}
    start, second = (place[int(v)] for v in cap.origin[cap.loop[:2]])
    forward = (second - start) % 1.0 < 0.5
    share = (positions - start) % 1.0 if forward else (start - positions) % 1.0
    order = np.argsort(share, kind="stable")
    angle = 2 * np.pi * share[order]
    wanted = sorted(int(np.nonzero(order == node)[0][0]) for node in corners)
    fixed = (wanted[0], wanted[1] - wanted[0]) if wanted else None
    size = _size(cap, length / len(positions), sizes)
    filled = fill_cap(np.c_[np.cos(angle), np.sin(angle)], policy, size=size, corners=fixed)
    p = filled.parameters
    row = {"template": "O", "i0": p.i0, "m": p.m, "n": p.n, "layers": p.layers, "grading": p.grading}
    corners = tuple(sorted(int(c) for c in p.corners))
    return CapFill(filled.points, order, filled.grids[0], corners, p.layers), row | {"outcome": filled.outcome.name}


def _size(cap: Cap, spacing: float, sizes: Sizes) -> Size:
    """Wanted edge length in the disk chart: `sizes`, scaled to `spacing` on the curve, times the chart's stretch."""
    wanted = np.full(len(cap.plane), spacing)
    if not sizes.uniform:
        relative = sizes.at(cap.mesh.vertices)
        wanted *= relative / relative[cap.loop].mean()
    edges = cap.mesh.topology.edges
    ratio = np.linalg.norm(cap.plane[edges[:, 1]] - cap.plane[edges[:, 0]], axis=1) / cap.mesh.edge_lengths
    n = len(cap.plane)
    total = np.bincount(edges[:, 0], ratio, n) + np.bincount(edges[:, 1], ratio, n)
    stretch = wanted * total / np.maximum(cap.mesh.topology.valence, 1)
    tree = KDTree(cap.plane)
    return lambda points: stretch[tree.query(points)[1]]
