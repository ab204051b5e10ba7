"""Reading the boundary of a plane domain; whatever is wrong with it is said in one sentence."""

from pathlib import Path

import numpy as np
import pandas as pd
from jaxtyping import Float

from drl_meshgen.errors import InputError
from drl_meshgen.models.reading import vtk_arrays
from drl_meshgen.templates.domain import crossing_edges, signed_area

CURVE = "give one closed polyline"
TABLES, CURVES = (".csv", ".parquet"), (".vtp", ".vtu")
LEAST, MOST = 12, 4000
"""Fewest and most boundary points."""
GAP = 3.0
"""A last edge that many times longer than the longest other one means that the boundary is open."""


def read_outline(path: Path) -> tuple[Float[np.ndarray, "l 2"], bool]:
    """Read a closed simple polygon; return its points anti-clockwise, and whether they had to be turned.

    A table (CSV, Parquet) has columns `x` and `y`, one row per point in their order; a VTK file (VTP, VTU) has one
    closed polyline. In a table the first point may be repeated at the end.

    Raises `InputError` for a file that cannot be read and for points that are not finite, coincide, are fewer than 12,
    odd in number, open, or cross themselves.
    """
    name = path.name or str(path)
    if path.suffix.lower() not in (*TABLES, *CURVES):
        raise InputError(name, "not a type of boundary file that is read", "give CSV, Parquet, VTP or VTU")
    if not path.is_file():
        raise InputError(name, "no such file")
    closed, points = _from_table(path) if path.suffix.lower() in TABLES else _from_curve(path)
    _check(name, points, closed=closed)
    clockwise = signed_area(points) < 0
    return (np.roll(points[::-1], 1, axis=0) if clockwise else points), clockwise


def _from_table(path: Path) -> tuple[bool, np.ndarray]:
    """Return whether the first point is repeated at the end, and the points without that."""
    try:
        table = pd.read_csv(path) if path.suffix.lower() == ".csv" else pd.read_parquet(path)
    except (OSError, ValueError) as error:  # pandas and Arrow raise kinds of these for damaged files
        raise InputError(path.name, f"is not a readable {path.suffix[1:].upper()} file", "write it again") from error
    if not {"x", "y"} <= set(table.columns):
        raise InputError(path.name, "has no columns x and y", "give one row per boundary point")
    try:
        points = table[["x", "y"]].to_numpy(np.float64)
    except (TypeError, ValueError):
        raise InputError(path.name, "has coordinates that are not numbers", "correct them") from None
    closed = len(points) > 1 and bool((points[0] == points[-1]).all())
    return closed, points[:-1] if closed else points


def _from_curve(path: Path) -> tuple[bool, np.ndarray]:
    read = vtk_arrays(path)
    curves = len(read["curve_starts"]) - 1
    if not curves:
        raise InputError(path.name, "holds no polyline", CURVE)
    if curves > 1:
        raise InputError(path.name, f"has {curves} curves", CURVE)
    points = read["curve_points"].astype(np.float64)[read["curve_nodes"]]
    if np.ptp(points[:, 2]) > 1e-9 * np.ptp(points, axis=0).max():
        raise InputError(path.name, "is not in a plane of constant z", "project it")
    if (points[0] != points[-1]).any():
        raise InputError(path.name, "its polyline is open", "close it")
    return True, points[:-1, :2]


def _check(name: str, points: np.ndarray, *, closed: bool) -> None:
    bad = np.nonzero(~np.isfinite(points).all(axis=1))[0]
    if len(bad):
        raise InputError(name, f"row {bad[0]} has a coordinate that is NaN or infinite", "correct or drop it")
    if not LEAST <= len(points) <= MOST:
        raise InputError(name, f"has {len(points)} boundary points", f"give {LEAST} to {MOST}")
    _, first, count = np.unique(points, axis=0, return_index=True, return_counts=True)
    if (count > 1).any():
        where = np.nonzero((points == points[first[count > 1].min()]).all(axis=1))[0]
        raise InputError(name, f"points {where[0]} and {where[1]} coincide", "drop the repeated point")
    length = np.linalg.norm(np.roll(points, -1, axis=0) - points, axis=1)
    if not closed and length[-1] > GAP * length[:-1].max():
        times = length[-1] / length[:-1].max()
        remedy = "close it, or repeat the first point at the end if that edge is meant"
        raise InputError(name, f"is open: from last to first point it is {times:.1f} times the longest edge", remedy)
    if (crossings := crossing_edges(points)).size:
        (a, c), n = crossings[0].tolist(), len(points)
        edges = f"from point {a} to {(a + 1) % n} and from {c} to {(c + 1) % n}"
        raise InputError(name, f"intersects itself: the edges {edges} cross or touch", "give a simple polygon")
    if signed_area(points) == 0:
        raise InputError(name, "encloses no area", "give a polygon")
    if len(points) % 2:
        at = int(length.argmax())
        place = f"for instance halfway between {at} and {(at + 1) % len(points)}, the longest edge"
        raise InputError(name, f"has an odd number of boundary points ({len(points)})", f"add one, {place}")
