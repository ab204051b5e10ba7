"""Files of the subdomain stage.

`nodes.vtu`: nodes and quads of every piece in its own chart, as (x, y, 0), with the point array `piece` (rings, then
caps, then strips). `rings.parquet`, `caps.parquet`, `rims.parquet`: how their nodes meet the curves. `strips.parquet`:
their sizes. `templates.parquet`: template and parameters of each cap
and each transition.
"""

from itertools import chain, islice, pairwise
from pathlib import Path

import numpy as np
from jaxtyping import Int

from drl_meshgen.assembly import CapFill, RingFill, StripFill, Subdomains, TransitionFill
from drl_meshgen.codecs.files import Codec, integers, read_grid, read_rows, write_blocks, write_rows
from drl_meshgen.export import read_table, write_table


def write(result: Subdomains, folder: Path) -> None:
    """Write the nodes of all pieces."""
    rings, caps, strips = result.rings, result.caps, result.strips
    charts = [*(ring.chart.reshape(-1, 2) for ring in rings), *(cap.chart for cap in caps)]
    charts += [strip.chart.reshape(-1, 2) for strip in strips]
    sizes = [len(chart) for chart in charts]
    offsets = np.cumsum([0, *sizes[:-1]]).tolist()
    of_rings = [[start + g for g in _ring_grids(ring)] for ring, start in zip(rings, offsets, strict=False)]
    grids = list(chain(*of_rings))
    for cap, start in zip(caps, offsets[len(rings) :], strict=False):
        layers = np.arange(len(cap.first) * (cap.layers + 1)).reshape(-1, len(cap.first))
        grids += [start + np.c_[layers, layers[:, 0]], start + cap.core]
    for strip, start in zip(strips, offsets[len(rings) + len(caps) :], strict=True):
        grids.append(start + np.arange(strip.chart.shape[0] * strip.chart.shape[1]).reshape(strip.chart.shape[:2]))
    piece = np.repeat(np.arange(len(charts)), sizes)
    write_blocks(folder / "nodes.vtu", np.concatenate(charts), grids, {"piece": piece})
    write_rows(
        folder / "rings.parquet",
        columns=[0 if isinstance(ring, TransitionFill) else ring.chart.shape[1] for ring in rings],
        blocks=[len(one) for one in of_rings],
        first=[ring.first for ring in rings],
        last=[ring.last for ring in rings],
    )
    write_rows(
        folder / "caps.parquet",
        layers=[cap.layers for cap in caps],
        corners=[cap.corners for cap in caps],
        first=[cap.first for cap in caps],
        core=[cap.core.ravel() for cap in caps],
        core_columns=[cap.core.shape[1] for cap in caps],
    )
    write_rows(folder / "strips.parquet", columns=[strip.chart.shape[1] for strip in strips])
    write_rows(folder / "rims.parquet", first=list(result.rims))
    write_table(folder / "templates.parquet", result.templates)


def _ring_grids(ring: RingFill | TransitionFill) -> tuple[Int[np.ndarray, "ni1 nj1"], ...]:
    if isinstance(ring, TransitionFill):
        return ring.grids
    rows, columns = ring.chart.shape[:2]
    return (np.arange(rows * columns).reshape(rows, columns),)


def read(folder: Path) -> Subdomains:
    """Read the nodes of all pieces."""
    grid = read_grid(folder / "nodes.vtu")
    ring_rows, cap_rows = read_rows(folder / "rings.parquet"), read_rows(folder / "caps.parquet")
    strip_rows = read_rows(folder / "strips.parquet")
    start = np.searchsorted(grid.point["piece"], np.arange(len(ring_rows) + len(cap_rows) + len(strip_rows) + 1))
    charts = [np.ascontiguousarray(grid.points[a:b, :2]) for a, b in pairwise(start)]
    rings, blocks = [], iter(grid.grids() if any(row.columns == 0 for row in ring_rows) else ())
    for row, chart, offset in zip(ring_rows, charts, start.tolist(), strict=False):
        own = tuple(one - offset for one in islice(blocks, row.blocks))
        first, last = integers(row.first), integers(row.last)
        if row.columns:
            rings.append(RingFill(chart.reshape(-1, row.columns, 2), first, last))
        else:
            rings.append(TransitionFill(chart, first, last, own))
    caps = [
        CapFill(
            chart,
            integers(row.first),
            integers(row.core).reshape(-1, row.core_columns),
            tuple(integers(row.corners).tolist()),
            row.layers,
        )
        for row, chart in zip(cap_rows, charts[len(ring_rows) :], strict=False)
    ]
    strips = [
        StripFill(chart.reshape(-1, row.columns, 2))
        for row, chart in zip(strip_rows, charts[len(ring_rows) + len(cap_rows) :], strict=True)
    ]
    rims = tuple(integers(row.first) for row in read_rows(folder / "rims.parquet"))
    return Subdomains(tuple(rings), tuple(caps), tuple(strips), rims, read_table(folder / "templates.parquet"))


SUBDOMAINS = Codec(write, read, __name__)
