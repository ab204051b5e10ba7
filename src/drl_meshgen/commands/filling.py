"""The `fill` command: one plane domain, one template."""

from collections.abc import Mapping
from dataclasses import asdict, dataclass
from pathlib import Path

import numpy as np
import pandas as pd
import typer

from drl_meshgen.assembly import SubdomainOptions
from drl_meshgen.commands.outline import read_outline
from drl_meshgen.commands.output import complete
from drl_meshgen.errors import BELOW_GATE, FINE
from drl_meshgen.export import write_mesh, write_table
from drl_meshgen.quality import gate, measure
from drl_meshgen.rl.finish import LAYERS, finished
from drl_meshgen.rl.plane_metrics import plane_metrics
from drl_meshgen.rl.policies import policy_named
from drl_meshgen.rl.template_type import Template, template_for
from drl_meshgen.templates import CParameters, Domain, OParameters, Outcome, unfolded


@dataclass(frozen=True)
class Filled:
    """What there is to tell of a filled polygon."""

    name: str
    """The file's name."""
    turned: bool
    """Whether its points run clockwise."""
    figures: Mapping[str, float]
    """Metrics of the mesh by name."""
    below: tuple[str, ...]
    """What keeps it below the quality gate, in sentences."""


def fill(
    boundary: Path,
    out: Path,
    policy: str | None,
    template: str = "auto",
    layers: int | None = None,
    *,
    finish: bool = True,
    pictures: bool = True,
) -> Filled:
    """Fill the polygon of a file by a template and write the mesh to a folder.

    With `finish`, interior nodes then move by themselves, and O-type meshes have `LAYERS` layers if not told.
    Raises `InputError` for a boundary that cannot be filled and for a policy that is not known.
    """
    policy = policy or SubdomainOptions.policy
    chooser = policy_named(policy)
    nodes, turned = read_outline(boundary)
    domain = Domain(nodes)
    parameters = template_for(chooser, domain, Template(template), layers or (LAYERS if finish else None))
    mesh, outcome = unfolded(domain, parameters)
    if finish and outcome is not Outcome.FOLDED:
        mesh = finished(mesh, len(domain))
    figures = plane_metrics(domain, np.array(mesh.points), np.array(mesh.quads))
    with complete(out) as folder:
        write_mesh(folder / "mesh.vtu", mesh.blocks)
        write_table(folder / "parameters.parquet", parameter_table(parameters, policy, outcome, finish=finish))
        write_table(folder / "quality.parquet", pd.DataFrame([figures]))
        if pictures:
            from drl_meshgen.report.plane import draw_template  # Matplotlib takes a second to load

            draw_template(folder / "mesh.png", mesh)
    below = gate(measure(mesh.blocks.mesh, block=mesh.blocks.block))
    if outcome is Outcome.FOLDED:
        below = (f"{len(mesh.folded)} folded: {Outcome.FOLDED.value}",)
    return Filled(boundary.name, turned, figures, below)


def tell(filled: Filled) -> int:
    """Print what the mesh of a polygon is like and return the exit code: 4 below the quality gate, else 0."""
    if filled.turned:
        typer.echo(f"{filled.name}: runs clockwise; taken the other way round, from the same first point", err=True)
    for name, value in filled.figures.items():
        typer.echo(f"{name:<22} {value:>12.6g}")
    for sentence in filled.below:
        typer.echo(f"below the quality gate: {sentence}", err=True)
    return BELOW_GATE if filled.below else FINE


def parameter_table(p: OParameters | CParameters, policy: str, outcome: Outcome, *, finish: bool) -> pd.DataFrame:
    """Return the parameters of a template in one row; positions and displacements as lists of x, y, x, y ...

    A mesh that was finished is not that of the parameters any more.
    """
    if isinstance(p, OParameters):
        whole = {"template": "O", "i0": p.i0, "m": p.m, "n": p.n, "layers": p.layers, "grading": p.grading}
        names = ("singular", "bulges", "waves", "swells")
    else:
        whole = {"template": "C", "start": p.start, **asdict(p.counts)}
        names = ("singular", "bulges")
    lists = {name: [getattr(p, name).ravel()] for name in names}
    return pd.DataFrame({"policy": [policy], **whole, **lists, "outcome": outcome.name, "finished": finish})
