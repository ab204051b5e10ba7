"""The `fill` command: one plane domain, one template."""

from pathlib import Path

import numpy as np
import pandas as pd
import typer

from drl_meshgen.assembly import SubdomainOptions
from drl_meshgen.commands.outline import read_outline
from drl_meshgen.commands.output import complete
from drl_meshgen.export import write_mesh, write_table
from drl_meshgen.quality import gate, measure
from drl_meshgen.rl.plane_metrics import plane_metrics
from drl_meshgen.rl.policies import policy_named
from drl_meshgen.templates import Domain, FilledCap, Outcome, fill_cap

FINE, BELOW_GATE = 0, 4


def fill(boundary: Path, out: Path, policy: str | None, layers: int | None, *, pictures: bool = True) -> int:
    """Fill the polygon of a file by an O-type mesh; write it to a folder and print what it is like.

    Returns the exit code: 4 below the quality gate, else 0. Raises `InputError` for a boundary that cannot be filled
    and for a policy that is not known.
    """
    policy = policy or SubdomainOptions.policy
    chooser = policy_named(policy)
    nodes, turned = read_outline(boundary)
    if turned:
        typer.echo(f"{boundary.name}: runs clockwise; taken the other way round, from the same first point", err=True)
    filled = fill_cap(nodes, chooser, layers)
    figures = plane_metrics(Domain(nodes), np.array(filled.points), np.array(filled.quads))
    with complete(out) as folder:
        write_mesh(folder / "mesh.vtu", filled.blocks)
        write_table(folder / "parameters.parquet", parameter_table(filled, policy))
        write_table(folder / "quality.parquet", pd.DataFrame([figures]))
        if pictures:
            from drl_meshgen.report.plane import draw_template  # Matplotlib takes a second to load

            draw_template(folder / "mesh.png", filled)
    for name, value in figures.items():
        typer.echo(f"{name:<22} {value:>12.6g}")
    below = gate(measure(filled.blocks.mesh, block=filled.blocks.block))
    if filled.outcome is Outcome.FOLDED:
        below = (f"{len(filled.folded)} folded: {Outcome.FOLDED.value}",)
    for sentence in below:
        typer.echo(f"below the quality gate: {sentence}", err=True)
    return BELOW_GATE if below else FINE


def parameter_table(filled: FilledCap, policy: str) -> pd.DataFrame:
    """Return the parameters of a template in one row; positions and displacements as lists of x, y, x, y ..."""
    p = filled.parameters
    whole = {"i0": p.i0, "m": p.m, "n": p.n, "layers": p.layers, "grading": p.grading}
    lists = {name: [getattr(p, name).ravel()] for name in ("singular", "bulges", "waves", "swells")}
    return pd.DataFrame({"policy": [policy], **whole, **lists, "outcome": filled.outcome.name})
