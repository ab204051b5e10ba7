"""The `layout` command: the layout of every input, without a mesh."""

import time
import warnings

import typer

from drl_meshgen.commands.meshing import Request, bar, for_all, settled, tell
from drl_meshgen.commands.output import complete, write_layout_curves, write_layout_file
from drl_meshgen.decompose import Layout
from drl_meshgen.decompose.stage import predicted_quads
from drl_meshgen.errors import FINE
from drl_meshgen.pipeline import STAGES
from drl_meshgen.store import execute


def layout_all(request: Request) -> int:
    """Lay out all inputs and return the exit code; a failed input does not stop the others."""
    return for_all(request, _layout_one)


def _layout_one(request: Request, source: str, name: str) -> int:
    start = time.perf_counter()
    with warnings.catch_warnings(record=True) as caught, bar(name) as show:
        warnings.simplefilter("always")
        options = settled(request, source)
        given = options.by_stage(source, request.triangles)
        done = execute(STAGES, given, targets=["decompose"], store=request.store, progress=show)
        with complete(request.out / name) as folder:
            write_layout_curves(folder, done, options)
            write_layout_file(folder, done, source, request.triangles, options)
    tell(caught)
    typer.echo(_line(name, done["decompose"], time.perf_counter() - start))
    return FINE


def _line(name: str, layout: Layout, seconds: float) -> str:
    parts = layout.pieces
    return (
        f"{name:<16} {predicted_quads(layout):6.0f} quads or so  {len(parts.junctions):3d} junctions  "
        f"{len(parts.tubes):3d} tubes  {len(parts.caps):3d} caps  {seconds:6.1f} s"
    )
