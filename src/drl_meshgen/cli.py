"""The command line: arguments in, core calls, exit code out."""

import sys
from pathlib import Path
from typing import Annotated, Literal

import typer

from drl_meshgen import __version__
from drl_meshgen.commands.arguments import (
    EXIT_CODES,
    Blocks,
    Config,
    Counts,
    Debug,
    Fast,
    FeatureAngle,
    Inputs,
    LayoutFile,
    MaxIrregular,
    Out,
    PolicyName,
    Remesh,
    Seed,
    StoreFolder,
    Strict,
    TargetEdge,
    TargetQuads,
    Triangles,
    check_sizes,
    leave,
    working,
)
from drl_meshgen.commands.store_app import app as store_app

app = typer.Typer(
    help="Block-structured quad meshes of triangulated surfaces, without anybody at the keyboard.",
    epilog=EXIT_CODES,
    no_args_is_help=True,
    add_completion=False,
    pretty_exceptions_enable=False,
    rich_markup_mode=None,
)
app.add_typer(store_app, name="store")


def _version(*, wanted: bool) -> None:
    if wanted:
        typer.echo(f"drl-meshgen {__version__}")
        raise typer.Exit


@app.callback()
def _common(
    *, version: Annotated[bool, typer.Option("--version", callback=_version, is_eager=True, help="Print it.")] = False
) -> None:
    pass


@app.command(epilog=EXIT_CODES)
def mesh(
    inputs: Inputs,
    out: Out,
    *,
    target_quads: TargetQuads = None,
    target_edge: TargetEdge = None,
    triangles: Triangles = 25_000,
    seed: Seed = None,
    config: Config = None,
    layout: LayoutFile = None,
    count: Counts = None,
    blocks: Blocks = None,
    max_irregular: MaxIrregular = None,
    feature_angle: FeatureAngle = None,
    fast: Fast = False,
    policy: PolicyName = None,
    remesh: Remesh = False,
    compare: Annotated[
        bool, typer.Option("--compare", help="Run Gmsh's methods on the same surfaces too; takes minutes.")
    ] = False,
    strict: Strict = False,
    timings: Annotated[bool, typer.Option("--timings", help="Print the time of every stage.")] = False,
    no_pictures: Annotated[bool, typer.Option("--no-pictures", help="Write no PNG files.")] = False,
    store: StoreFolder = None,
    debug: Debug = False,
) -> None:
    """Mesh surfaces by structured quadrilateral blocks.

    Writes mesh.vtu, layout.vtu, layout.toml, blocks.parquet, edges.parquet, quality.parquet, surface.ply, options.toml
    and pictures to DIR/NAME; with --compare also the folder rivals. NAME is the model or the file without its suffix;
    where names coincide, -2, -3 ... is appended.
    """
    check_sizes(inputs, target_quads, target_edge, layout)

    def command() -> int:
        from drl_meshgen.commands.meshing import Request, mesh_all
        from drl_meshgen.commands.settings import chosen
        from drl_meshgen.store import Store

        options = chosen(
            config,
            count or [],
            target_quads,
            target_edge,
            seed,
            blocks=blocks,
            irregular=max_irregular,
            feature_angle=feature_angle,
            fast=fast,
            policy=policy,
            remesh=remesh,
            strict=strict,
        )
        kept = None if store is None else Store(store)
        return mesh_all(
            Request(
                inputs,
                out,
                options,
                triangles,
                kept,
                pictures=not no_pictures,
                compare=compare,
                timings=timings,
                debug=debug,
                layout=layout,
            )
        )

    leave(command, debug=debug)


@app.command(epilog=EXIT_CODES)
def layout(
    inputs: Inputs,
    out: Out,
    *,
    target_quads: TargetQuads = None,
    target_edge: TargetEdge = None,
    triangles: Triangles = 25_000,
    config: Config = None,
    layout: LayoutFile = None,
    count: Counts = None,
    blocks: Blocks = None,
    max_irregular: MaxIrregular = None,
    feature_angle: FeatureAngle = None,
    fast: Fast = False,
    remesh: Remesh = False,
    strict: Strict = False,
    store: StoreFolder = None,
    debug: Debug = False,
) -> None:
    """Lay out blocks and node counts, without a mesh.

    Writes layout.toml, layout.vtp and layout.vtu to DIR/NAME: counts to edit and to give to `mesh --layout`, the edges
    of the layout as polylines, and the surface with its regions.
    """
    check_sizes(inputs, target_quads, target_edge, layout)

    def command() -> int:
        from drl_meshgen.commands.layout import layout_all
        from drl_meshgen.commands.meshing import Request
        from drl_meshgen.commands.settings import chosen
        from drl_meshgen.store import Store

        options = chosen(
            config,
            count or [],
            target_quads,
            target_edge,
            blocks=blocks,
            irregular=max_irregular,
            feature_angle=feature_angle,
            fast=fast,
            remesh=remesh,
            strict=strict,
        )
        kept = None if store is None else Store(store)
        return layout_all(Request(inputs, out, options, triangles, kept, debug=debug, layout=layout))

    leave(command, debug=debug)


@app.command(epilog=EXIT_CODES)
def check(
    mesh: Annotated[Path, typer.Argument(metavar="MESH", help="Quad mesh in any format that VTK reads.")],
    *,
    surface: Annotated[
        Path | None, typer.Option(metavar="S", help="Surface it should lie on; adds deviation and topology.")
    ] = None,
    debug: Debug = False,
) -> None:
    """Print the metrics of a quad mesh.

    The exit code is 4 where it has defects or is below the quality gate.
    """

    def command() -> int:
        from drl_meshgen.commands.checking import check as run

        return run(mesh, surface)

    leave(command, debug=debug)


@app.command(epilog=EXIT_CODES)
def fill(
    domain: Annotated[
        Path,
        typer.Argument(metavar="DOMAIN", help="Boundary points in order: CSV or Parquet with x and y, VTP or VTU."),
    ],
    out: Annotated[Path, typer.Option(metavar="DIR", file_okay=False, help="Folder of the results.")],
    *,
    policy: PolicyName = None,
    template: Annotated[
        Literal["auto", "o", "c"],
        typer.Option(help="O-type, or C-type for four sides with more points on one than across; auto: the better."),
    ] = "auto",
    layers: Annotated[
        int | None, typer.Option(metavar="K", min=1, help="Layers of quads around the core.  [default: chosen]")
    ] = None,
    finish: Annotated[
        bool,
        typer.Option("--finish/--no-finish", help="Move every interior node by itself, to better and more even quads."),
    ] = True,
    no_pictures: Annotated[bool, typer.Option("--no-pictures", help="Write no PNG file.")] = False,
    debug: Debug = False,
) -> None:
    """Mesh one plane domain by a template.

    The points are a closed simple polygon, an even number of them, at least 12; they become the boundary nodes. Writes
    mesh.vtu, parameters.parquet, quality.parquet and mesh.png to DIR and prints the metrics of the mesh.
    """

    def command() -> int:
        with working(f"filling {domain.name}"):
            from drl_meshgen.commands.filling import fill as run
            from drl_meshgen.commands.filling import tell

            filled = run(domain, out, policy, template, layers, finish=finish, pictures=not no_pictures)
        return tell(filled)

    leave(command, debug=debug)


def main() -> None:
    """Entry point of `drl-meshgen`."""
    app(prog_name="drl-meshgen")


if __name__ == "__main__":
    sys.exit(main())
