"""Turning what the charts aligned to what the layout decided: which columns of bands and caps meet."""

from dataclasses import replace

import numpy as np
from jaxtyping import Int

from drl_meshgen.assembly.align import Alignment, Columns
from drl_meshgen.decompose import Layout
from drl_meshgen.decompose.lines import Lines


def turned(layout: Layout, placed: Alignment) -> tuple[Alignment, tuple[tuple[int, ...], ...]]:
    """Return the alignment with all bands shifted as the layout wants, and the corners of each cap on its curve.

    Corners are four indices of nodes of the curve, empty where the layout leaves the choice to the fill.
    """
    corners: list[tuple[int, ...]] = [()] * len(layout.pieces.caps)
    if layout.turning is None:
        return placed, tuple(corners)
    lines = Lines.of(layout.pieces, len(layout.curve_counts))
    for b, band in enumerate(lines.bands):
        if len(band.ends) == 2:
            placed = _shifted(layout, placed, lines, b, layout.turning.shifts[b])
        elif band.ends and band.cap >= 0:
            nodes, _ = _carried(layout, placed, lines, b)
            (first, m), half = layout.turning.corners[band.cap], len(nodes) // 2
            corners[band.cap] = tuple(int(nodes[(first + step) % len(nodes)]) for step in (0, m, half, half + m))
    return placed, tuple(corners)


def _carried(
    layout: Layout, placed: Alignment, lines: Lines, band: int
) -> tuple[Int[np.ndarray, " n"], list[tuple[int, int]]]:
    """Node of the curve at the far end that each column of the first end meets, and the tubes passed."""
    nodes = _ends(placed)[lines.bands[band].ends[0]]
    path = lines.passed(layout.pieces, band)
    for t, near in path:
        columns = placed.tubes[t]
        nodes = columns[1 - near].nodes()[_inverse(columns[near].nodes())[nodes]]
    return nodes, path


def _shifted(layout: Layout, placed: Alignment, lines: Lines, band: int, wanted: int) -> Alignment:
    """Shift the far end of the last tube of a band, or its second end where it has no tube."""
    nodes, path = _carried(layout, placed, lines, band)
    end = lines.bands[band].ends[1]
    met = _ends(placed)[end]
    n = len(nodes)
    more = (wanted - int(_inverse(met)[nodes[0]])) % n
    if not path:
        return _with_end(placed, end, n - more)
    last, near = path[-1]
    columns, far = placed.tubes[last], 1 - near
    same = (met[1] - met[0]) % n == columns[far].direction % n
    pair = list(columns)
    pair[far] = _rolled(columns[far], more if same else n - more)
    tubes = list(placed.tubes)
    tubes[last] = (pair[0], pair[1])
    return replace(placed, tubes=tuple(tubes))


def _ends(placed: Alignment) -> list[Int[np.ndarray, " n"]]:
    """Node of its curve that each column of each end meets, in the order of `Lines.ends`."""
    return [
        nodes
        for cells, rims in zip(placed.cells, placed.rims, strict=True)
        for nodes in (*(columns.nodes() for columns, _ in cells), *rims)
    ]


def _with_end(placed: Alignment, end: int, more: int) -> Alignment:
    """Roll the columns of one end."""
    cells, rims = [list(one) for one in placed.cells], [list(one) for one in placed.rims]
    for mine, around in zip(cells, rims, strict=True):
        if end < len(mine):
            mine[end] = (_rolled(mine[end][0], more), mine[end][1])
            break
        end -= len(mine)
        if end < len(around):
            around[end] = np.roll(around[end], -more)
            break
        end -= len(around)
    return replace(placed, cells=tuple(map(tuple, cells)), rims=tuple(map(tuple, rims)))


def _rolled(columns: Columns, more: int) -> Columns:
    """Return columns that meet the nodes which those `more` further on met."""
    n = len(columns.theta)
    at = np.arange(n) + more
    return Columns((columns.start + columns.direction * more) % n, columns.direction, columns.theta[at % n] + at // n)


def _inverse(order: Int[np.ndarray, " n"]) -> Int[np.ndarray, " n"]:
    place = np.empty(len(order), np.int64)
    place[order] = np.arange(len(order))
    return place
