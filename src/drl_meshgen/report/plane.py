"""Pictures of plane domains and their meshes, drawn by Matplotlib without a display."""

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from jaxtyping import Float, Int

from drl_meshgen.export import replacing
from drl_meshgen.export.layout import block_sides
from drl_meshgen.report import palette
from drl_meshgen.templates.mesh import TemplateMesh
from drl_meshgen.templates.score import angle_defects, jacobians

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure


def new_figure(width: float, height: float) -> "Figure":
    """Return an empty figure of that many inches; it needs no display and is known to nobody else."""
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    figure = Figure(figsize=(width, height), layout="constrained")
    FigureCanvasAgg(figure)
    return figure


def write_figure(path: Path | str, figure: "Figure", dpi: int = 150) -> None:
    """Write a figure in the format of the suffix; same figure, same bytes."""
    metadata = {"Software": None} if Path(path).suffix == ".png" else None
    with replacing(path) as part:
        figure.savefig(part, dpi=dpi, facecolor="white", metadata=metadata)


def show_quads(
    axes: "Axes",
    points: Float[np.ndarray, "p 2"],
    quads: Int[np.ndarray, "m 4"],
    grids: Sequence[Int[np.ndarray, "ni1 nj1"]] = (),
    *,
    by: str = "block",
) -> None:
    """Draw quads with their lines, blocks of `grids` outlined; folded quads are red.

    `by` is what fills show: "block", or "angle", the largest deviation of a corner from 90 degrees.
    """
    from matplotlib.collections import LineCollection, PolyCollection
    from matplotlib.colors import LinearSegmentedColormap

    corner = np.asarray(points)[quads]
    fills: list = [palette.PLAIN] * len(quads)
    if by == "angle":
        ramp = LinearSegmentedColormap.from_list("deviation", list(palette.DEVIATION))
        deviation = np.degrees(angle_defects(points, quads).max(axis=-1))
        fills = list(ramp(np.clip(deviation / palette.DEVIATION_RANGE, 0, 1)))
    elif grids:
        block = np.repeat(np.arange(len(grids)), [(g.shape[0] - 1) * (g.shape[1] - 1) for g in grids])
        fills = [palette.PASTELS[b % len(palette.PASTELS)] for b in block.tolist()]
    for bad in np.nonzero((jacobians(points, quads) <= 0).any(axis=-1))[0].tolist():
        fills[bad] = palette.WORST
    axes.add_collection(PolyCollection(list(corner), facecolors=fills, edgecolors=palette.LINE, linewidths=0.35))
    sides = [np.asarray(points)[side] for grid in grids for side in block_sides(grid)]
    axes.add_collection(LineCollection(sides, colors=palette.INK, linewidths=1.0, capstyle="round"))
    frame_of(axes, corner.reshape(-1, 2))


def frame_of(axes: "Axes", points: Float[np.ndarray, "p 2"]) -> None:
    """Show just these points, undistorted, without axes."""
    low, high = points.min(axis=0), points.max(axis=0)
    margin = 0.03 * float((high - low).max())
    axes.set_xlim(low[0] - margin, high[0] + margin)
    axes.set_ylim(low[1] - margin, high[1] + margin)
    axes.set_aspect("equal")
    axes.set_axis_off()


def draw_template(path: Path | str, mesh: TemplateMesh) -> None:
    """Write a picture of a template's mesh: blocks in colours on the left, angles on the right."""
    figure = new_figure(12, 6)
    for k, by in enumerate(("block", "angle")):
        show_quads(figure.add_subplot(1, 2, k + 1), np.array(mesh.points), np.array(mesh.quads), mesh.grids, by=by)
    write_figure(path, figure)
