"""The command line: arguments in, core calls, exit code out."""

import sys
import traceback
from collections.abc import Callable
from pathlib import Path
from typing import Annotated, Literal

import typer

from drl_meshgen import __version__
from drl_meshgen.errors import MeshgenError

EXIT_CODES = (
    "Exit codes: 0 fine, 1 internal error or a stage without a result, 2 usage, 3 bad input, "
    "4 meshed but below the quality gate, 5 some of several inputs failed."
)

app = typer.Typer(
    help="Block-structured quad meshes of triangulated surfaces, without anybody at the keyboard.",
    epilog=EXIT_CODES,
    no_args_is_help=True,
    add_completion=False,
    pretty_exceptions_enable=False,
    rich_markup_mode=None,
)

Inputs = Annotated[
    list[str],
    typer.Argument(
        metavar="INPUT",
        help="Names (hemisphere, giraffe, hand, random:SEED) or files (STL PLY OBJ OFF VTP VTU MSH STEP).",
    ),
]
Out = Annotated[Path, typer.Option(metavar="DIR", file_okay=False, help="Gets one folder per input.")]
TargetQuads = Annotated[int | None, typer.Option(metavar="N", min=4, help="Wanted number of quads.  [default: 4000]")]
TargetEdge = Annotated[float | None, typer.Option(metavar="H", help="Wanted edge length in the units of the input.")]
Triangles = Annotated[int, typer.Option(metavar="N", help="Size of generated models.")]
Config = Annotated[
    Path | None,
    typer.Option(metavar="FILE.toml", exists=True, dir_okay=False, help="Options of all stages, one table each."),
]
LayoutFile = Annotated[
    Path | None,
    typer.Option("--layout", metavar="FILE.toml", exists=True, dir_okay=False, help="Counts of an edited layout."),
]
Counts = Annotated[
    list[str] | None,
    typer.Option(
        "--count", metavar="NAME=N", help="Quads along an edge, or rows of a ring, of the layout; may be repeated."
    ),
]
Blocks = Annotated[
    int | None, typer.Option("--blocks", metavar="N", min=1, help="Coarsen the layout until it has at most N blocks.")
]
MaxIrregular = Annotated[
    int | None, typer.Option(metavar="N", min=1, help="Coarsen the layout until it has at most N irregular nodes.")
]
Fast = Annotated[bool, typer.Option("--fast", help="Half the time, somewhat worse quads.")]
PolicyName = Annotated[
    str | None,
    typer.Option(
        "--policy", metavar="NAME", help="Who places templates: agent, rule, optimizer or a file.  [default: agent]"
    ),
]
Remesh = Annotated[bool, typer.Option("--remesh", help="Remesh the input isotropically first.")]
FeatureAngle = Annotated[
    float | None,
    typer.Option(metavar="DEG", min=0, max=180, help="Keep edges sharper than this: mesh lines follow them."),
]
Strict = Annotated[bool, typer.Option("--strict", help="Refuse inputs of several components.")]
StoreFolder = Annotated[
    Path | None, typer.Option("--store", metavar="DIR", file_okay=False, help="Keep stage results here and reuse them.")
]
Debug = Annotated[bool, typer.Option("--debug", help="Show the traceback of an unexpected error.")]


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
    seed: Annotated[
        int | None, typer.Option(metavar="S", help="Seed of whatever is random, recorded with the options.")
    ] = None,
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
    _check_sizes(inputs, target_quads, target_edge, layout)

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

    _run(command, debug=debug)


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
    _check_sizes(inputs, target_quads, target_edge, layout)

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

    _run(command, debug=debug)


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

    _run(command, debug=debug)


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
        from drl_meshgen.commands.filling import fill as run

        return run(domain, out, policy, template, layers, finish=finish, pictures=not no_pictures)

    _run(command, debug=debug)


def _check_sizes(inputs: list[str], quads: int | None, edge: float | None, layout: Path | None) -> None:
    if quads is not None and edge is not None:
        raise typer.BadParameter("give --target-quads or --target-edge, not both")
    if edge is not None and not 0 < edge < float("inf"):
        raise typer.BadParameter("--target-edge must be a positive length")
    if layout is not None and len(inputs) > 1:
        raise typer.BadParameter("--layout is of one INPUT")


def _run(command: Callable[[], int], *, debug: bool) -> None:
    """Run a command and leave with its exit code; nobody sees a traceback who did not ask for it."""
    try:
        code = command()
    except MeshgenError as error:
        typer.echo(str(error), err=True)
        code = error.exit_code
    except Exception as error:  # noqa: BLE001 - the last line of defence
        typer.echo(f"internal error: {type(error).__name__}: {error}; --debug shows where", err=True)
        if debug:
            traceback.print_exception(error)
        code = 1
    raise typer.Exit(code)


def main() -> None:
    """Entry point of `drl-meshgen`."""
    app(prog_name="drl-meshgen")


if __name__ == "__main__":
    sys.exit(main())
