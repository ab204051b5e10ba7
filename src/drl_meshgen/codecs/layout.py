"""Files of the decomposition stage.

`pieces.vtu`: the meshes of all rings, then caps, then strips, with cell arrays `piece`, `theta_corner` and point arrays
`piece`, `origin` and `chart`, which is `(theta, h)` on rings and `(x, y)` elsewhere. `spine.vtu`: one polyline per edge
of a junction's graph with cell arrays `junction`, `edge`, `ends`, `count` (absent where no junction is).
`rings.parquet`, `caps.parquet`, `strips.parquet`, `rims.parquet`, `junctions.parquet`, `curves.parquet`: loops, sides
and counts.
"""

from pathlib import Path
from typing import Any

import numpy as np

from drl_meshgen.codecs.files import (
    Codec,
    integers,
    read_facts,
    read_grid,
    read_lines,
    read_rows,
    reals,
    seams_of,
    sewn_to,
    write_facts,
    write_grid,
    write_lines,
    write_rows,
)
from drl_meshgen.decompose import Cap, Junction, Layout, Pieces, Tube
from drl_meshgen.decompose.cells import Cell, Ring
from drl_meshgen.decompose.junction import Rim
from drl_meshgen.decompose.lines import Turning
from drl_meshgen.decompose.spine import Spine
from drl_meshgen.decompose.strips import Strip
from drl_meshgen.export import read_table
from drl_meshgen.lift.harmonic import RingChart
from drl_meshgen.mesh import TriMesh


def write(layout: Layout, folder: Path) -> None:
    """Write all pieces, the spines and the counts."""
    _write_pieces(layout.pieces, folder / "pieces.vtu")
    _write_rings(layout, folder / "rings.parquet")
    write_rows(
        folder / "caps.parquet",
        curve=[cap.curve for cap in layout.pieces.caps],
        loop=[cap.loop for cap in layout.pieces.caps],
        share=[cap.share for cap in layout.pieces.caps],
        corners=[[]] * len(layout.pieces.caps) if layout.turning is None else layout.turning.corners,
    )
    write_rows(folder / "bands.parquet", shift=[] if layout.turning is None else layout.turning.shifts)
    _write_junctions(layout, folder)
    write_rows(
        folder / "curves.parquet",
        curve=range(len(layout.curve_counts)),
        count=layout.curve_counts.tolist(),
        sewn_to=sewn_to(layout.pieces.seams, len(layout.curve_counts)),
    )
    write_facts(folder, spacing=layout.spacing)


def _write_pieces(pieces: Pieces, path: Path) -> None:
    rings, caps, strips = pieces.rings, pieces.caps, pieces.strips
    flat = [*caps, *strips]
    meshes = [*(ring.mesh for ring in rings), *(disk.mesh for disk in flat)]
    sizes = [len(mesh.vertices) for mesh in meshes]
    offsets = np.cumsum([0, *sizes[:-1]])
    number = np.arange(len(meshes))
    origins = [*(piece.origin for piece in (*rings, *caps)), *(np.full(len(s.mesh.vertices), -1) for s in strips)]
    charts = [*(np.c_[ring.chart.theta, ring.chart.h] for ring in rings), *(disk.plane for disk in flat)]
    corners = [*(ring.chart.theta_corner for ring in rings), *(np.zeros(disk.mesh.triangles.shape) for disk in flat)]
    write_grid(
        path,
        np.concatenate([mesh.vertices for mesh in meshes]),
        np.concatenate([mesh.triangles + offset for mesh, offset in zip(meshes, offsets, strict=True)]),
        {
            "piece": np.repeat(number, sizes),
            "origin": np.concatenate(origins),
            "chart": np.concatenate(charts),
        },
        {
            "piece": np.repeat(number, [len(mesh.triangles) for mesh in meshes]),
            "theta_corner": np.concatenate(corners),
        },
    )


def _write_rings(layout: Layout, path: Path) -> None:
    """One row per ring: cells with their junction and sides, tubes with junction -1 and two curves."""
    rows: list[dict[str, Any]] = []
    for j, (junction, counts) in enumerate(zip(layout.pieces.junctions, layout.cell_rows, strict=True)):
        for curve, cell, count in zip(junction.curves, junction.cells, counts.tolist(), strict=True):
            edges, forward = [e for e, _ in cell.sides], [int(f) for _, f in cell.sides]
            sides = {"sides": edges, "forward": forward, "starts": cell.starts}
            rows.append({"junction": j, "curves": [curve], "rows": count, "ring": cell.ring, **sides})
    for tube, count in zip(layout.pieces.tubes, layout.tube_rows.tolist(), strict=True):
        sides = {"sides": [], "forward": [], "starts": []}
        rows.append({"junction": -1, "curves": tube.curves, "rows": count, "ring": tube.ring, **sides})
    plain = ("junction", "curves", "rows", "sides", "forward", "starts")
    write_rows(
        path,
        **{name: [row[name] for row in rows] for name in plain},
        inner=[row["ring"].inner for row in rows],
        outer=[row["ring"].outer for row in rows],
        modulus=[row["ring"].chart.modulus for row in rows],
    )


def _write_junctions(layout: Layout, folder: Path) -> None:
    junctions = layout.pieces.junctions
    spines = [junction.spine for junction in junctions]
    write_rows(
        folder / "junctions.parquet",
        curves=[junction.curves for junction in junctions],
        nodes=[spine.nodes for spine in spines],
        mesh_edges=[len(spine.edge_flags) for spine in spines],
        on_spine=[np.nonzero(spine.edge_flags)[0] for spine in spines],
    )
    strips = [(j, strip) for j, junction in enumerate(junctions) for strip in junction.strips]
    write_rows(folder / "strips.parquet", junction=[j for j, _ in strips], sides=[strip.sides for _, strip in strips])
    rims = [(j, rim) for j, junction in enumerate(junctions) for rim in junction.rims]
    write_rows(
        folder / "rims.parquet",
        junction=[j for j, _ in rims],
        curve=[rim.curve for _, rim in rims],
        sides=[rim.sides for _, rim in rims],
        corners=[rim.corners for _, rim in rims],
    )
    if not junctions:
        return
    sizes = [len(junction.points) for junction in junctions]
    offsets = np.cumsum([0, *sizes[:-1]])
    edges = [len(spine.paths) for spine in spines]
    write_lines(
        folder / "spine.vtu",
        np.concatenate([junction.points for junction in junctions]),
        [path + offset for spine, offset in zip(spines, offsets, strict=True) for path in spine.paths],
        {"junction": np.repeat(np.arange(len(junctions)), sizes)},
        {
            "junction": np.repeat(np.arange(len(junctions)), edges),
            "edge": np.concatenate([np.arange(n) for n in edges]),
            "ends": np.concatenate([np.array(spine.ends, np.int64).reshape(-1, 2) for spine in spines]),
            "count": np.concatenate(layout.edge_counts),
        },
    )


def read(folder: Path) -> Layout:
    """Read all pieces, the spines and the counts."""
    rows = read_rows(folder / "rings.parquet")
    rings, caps, strips = _read_pieces(folder, rows)
    cells: dict[int, list[Cell]] = {}
    counts: dict[int, list[int]] = {}
    tubes, tube_rows = [], []
    for row, ring in zip(rows, rings, strict=True):
        if row.junction < 0:
            first, second = integers(row.curves).tolist()
            tubes.append(Tube((first, second), ring))
            tube_rows.append(row.rows)
        else:
            sides = zip(integers(row.sides).tolist(), (bool(f) for f in row.forward), strict=True)
            cells.setdefault(row.junction, []).append(Cell(ring, tuple(sides), integers(row.starts)))
            counts.setdefault(row.junction, []).append(row.rows)
    junctions, edge_counts = _read_junctions(folder, cells, strips)
    curves = read_table(folder / "curves.parquet")
    return Layout(
        Pieces(junctions, tuple(tubes), caps, seams_of(curves["sewn_to"])),
        edge_counts,
        integers(curves["count"]),
        tuple(integers(counts[j]) for j in range(len(junctions))),
        integers(tube_rows),
        read_facts(folder).spacing,
        _read_turning(folder),
    )


def _read_turning(folder: Path) -> Turning | None:
    shifts = read_table(folder / "bands.parquet")["shift"].tolist()
    corners = [(int(first), int(m)) for first, m in read_table(folder / "caps.parquet")["corners"] if shifts]
    return Turning(tuple(shifts), tuple(corners)) if shifts else None


def _read_pieces(folder: Path, rows: list[Any]) -> tuple[list[Ring], tuple[Cap, ...], list[Strip]]:
    grid = read_grid(folder / "pieces.vtu")
    cap_rows = read_rows(folder / "caps.parquet")
    strip_rows = read_rows(folder / "strips.parquet")
    pieces = np.arange(len(rows) + len(cap_rows) + len(strip_rows) + 1)
    vertex, face = np.searchsorted(grid.point["piece"], pieces), np.searchsorted(grid.cell["piece"], pieces)
    rings, caps, strips = [], [], []
    for k in range(len(pieces) - 1):
        v, f = slice(vertex[k], vertex[k + 1]), slice(face[k], face[k + 1])
        mesh = TriMesh(grid.points[v], grid.cells[f] - vertex[k])
        origin, chart = grid.point["origin"][v], grid.point["chart"][v]
        if k < len(rows):
            row = rows[k]
            theta, h = np.ascontiguousarray(chart.T)
            flat = RingChart(theta, grid.cell["theta_corner"][f], h, row.modulus)
            rings.append(Ring(mesh, origin, integers(row.inner), integers(row.outer), flat))
        elif k < len(rows) + len(cap_rows):
            row = cap_rows[k - len(rows)]
            caps.append(Cap(row.curve, mesh, origin, integers(row.loop), reals(row.share), chart))
        else:
            row = strip_rows[k - len(rows) - len(cap_rows)]
            strips.append(Strip(mesh, _four(row.sides), chart))
    return rings, tuple(caps), strips


def _four(sides: Any) -> tuple[int, int, int, int]:
    a, b, c, d = integers(sides).tolist()
    return a, b, c, d


def _read_junctions(
    folder: Path, cells: dict[int, list[Cell]], strips: list[Strip]
) -> tuple[tuple[Junction, ...], tuple[np.ndarray, ...]]:
    rows = read_rows(folder / "junctions.parquet")
    if not rows:
        return (), ()
    strip_rows, rim_rows = read_rows(folder / "strips.parquet"), read_rows(folder / "rims.parquet")
    points, lines, point, line = read_lines(folder / "spine.vtu")
    start = np.searchsorted(point["junction"], np.arange(len(rows) + 1))
    first = np.searchsorted(line["junction"], np.arange(len(rows) + 1))
    junctions, counts = [], []
    for j, row in enumerate(rows):
        flags = np.zeros(row.mesh_edges, bool)
        flags[integers(row.on_spine)] = True
        own = slice(first[j], first[j + 1])
        paths = tuple(path - start[j] for path in lines[own])
        ends = tuple((a, b) for a, b in line["ends"][own].tolist())
        spine = Spine(integers(row.nodes), paths, ends, flags)
        curves = tuple(integers(row.curves).tolist())
        mine = tuple(strip for one, strip in zip(strip_rows, strips, strict=True) if one.junction == j)
        rims = tuple(
            Rim(one.curve, tuple(integers(one.sides).tolist()), reals(one.corners))
            for one in rim_rows
            if one.junction == j
        )
        junctions.append(Junction(points[start[j] : start[j + 1]], spine, curves, tuple(cells[j]), mine, rims))
        counts.append(line["count"][own])
    return tuple(junctions), tuple(counts)


LAYOUT = Codec(write, read, __name__)
