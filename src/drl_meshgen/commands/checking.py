"""The `check` command: the metric table of a mesh."""

import math
from pathlib import Path

import typer

from drl_meshgen.cleanup import CleanupOptions, clean
from drl_meshgen.errors import BELOW_GATE, FINE
from drl_meshgen.export import read_mesh
from drl_meshgen.models.reading import read_surface
from drl_meshgen.quality import Quality, gate, measure

COUNTS = ("quads", "nodes", "irregular", "blocks", "named_blocks", "t_junctions", "components", "loops", "euler")
DEGREES = ("min_angle", "max_angle", "warp")


def check(mesh_file: Path, surface_file: Path | None) -> int:
    """Print metrics and defects of a quad mesh and return the exit code: 4 below the quality gate, else 0.

    Raises `InputError` where a file is not what it should be.
    """
    mesh, block = read_mesh(mesh_file)
    surface = None
    if surface_file is not None:
        surface = clean(read_surface(surface_file), CleanupOptions(min_triangles=0)).surface
    quality = measure(mesh, surface, block)
    typer.echo(metric_table(quality))
    for sentence in quality.defects:
        typer.echo(f"defect: {sentence}", err=True)
    below = [sentence for sentence in gate(quality) if sentence not in quality.defects]
    for sentence in below:
        typer.echo(f"below the quality gate: {sentence}", err=True)
    return BELOW_GATE if quality.defects or below else FINE


def metric_table(quality: Quality) -> str:
    """Return one line per metric; figures without a meaning are left out."""
    return "\n".join(
        f"{name:<22} {_figure(name, value):>12}" for name, value in quality.metrics.items() if not math.isnan(value)
    )


def _figure(name: str, value: float) -> str:
    if name in COUNTS:
        return f"{value:.0f}    "
    return f"{value:.2f}  °" if name in DEGREES else f"{value:.5g}    "
