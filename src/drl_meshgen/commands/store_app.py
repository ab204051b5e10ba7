"""`drl-meshgen store`: arguments in, core calls, exit code out."""

from pathlib import Path
from typing import Annotated

import typer

from drl_meshgen.commands.arguments import (
    EXIT_CODES,
    Blocks,
    Config,
    Counts,
    Debug,
    Fast,
    FeatureAngle,
    LayoutFile,
    MaxIrregular,
    PolicyName,
    Remesh,
    Seed,
    Strict,
    TargetEdge,
    TargetQuads,
    Triangles,
    check_sizes,
    leave,
)

app = typer.Typer(help="Look into the artifact store, check it, tidy it up.", no_args_is_help=True)

Folder = Annotated[
    Path | None,
    typer.Option("--store", metavar="DIR", help="The store.  [default: DRL_MESHGEN_STORE, else artifacts]"),
]
Key = Annotated[str, typer.Argument(metavar="ID", help="Key of an artifact, or as many of its digits as are needed.")]
Only = Annotated[
    list[str] | None,
    typer.Option("--only", metavar="ID", help="Copy only this artifact and all it was made from; may be repeated."),
]
AsJson = Annotated[bool, typer.Option("--json", help="Print JSON.")]


@app.command(epilog=EXIT_CODES)
def ls(
    *,
    stage: Annotated[
        list[str] | None, typer.Option(metavar="STAGE", help="Only of this stage; may be repeated.")
    ] = None,
    surface: Annotated[
        list[str] | None,
        typer.Option("--input", metavar="NAME", help="Only made from this model or file; may be repeated."),
    ] = None,
    as_json: AsJson = False,
    store: Folder = None,
    debug: Debug = False,
) -> None:
    """List artifacts: stage, key, size, seconds of computation, surface."""

    def command() -> int:
        from drl_meshgen.commands.storing import list_records
        from drl_meshgen.store import Store

        return list_records(Store(store), stage or [], surface or [], as_json=as_json)

    leave(command, debug=debug)


@app.command(epilog=EXIT_CODES)
def show(key: Key, *, as_json: AsJson = False, store: Folder = None, debug: Debug = False) -> None:
    """Tell where an artifact comes from.

    Its stage, versions of code and libraries, seed, options, inputs back to the surface, outputs, and timings.
    """

    def command() -> int:
        from drl_meshgen.commands.storing import show as run
        from drl_meshgen.store import Store

        return run(Store(store), key, as_json=as_json)

    leave(command, debug=debug)


@app.command(epilog=EXIT_CODES)
def verify(
    *,
    repair: Annotated[
        bool, typer.Option("--repair", help="Remove what is damaged, so that the next run computes it again.")
    ] = False,
    store: Folder = None,
    debug: Debug = False,
) -> None:
    """Hash everything again and say what is damaged.

    The exit code is 1 where anything was.
    """

    def command() -> int:
        from drl_meshgen.commands.storing import check
        from drl_meshgen.store import Store

        return check(Store(store), repair=repair)

    leave(command, debug=debug)


@app.command(epilog=EXIT_CODES)
def gc(
    *,
    keep: Annotated[
        list[str] | None,
        typer.Option(metavar="ID", help="Keep this artifact and all it was made from; may be repeated."),
    ] = None,
    max_size: Annotated[
        str | None, typer.Option(metavar="SIZE", help="Remove artifacts, longest unused first, until 2GB are left.")
    ] = None,
    dry_run: Annotated[bool, typer.Option("--dry-run", help="Only say what would go.")] = False,
    store: Folder = None,
    debug: Debug = False,
) -> None:
    """Remove what is not wanted any more.

    Always what no record names and what dead processes left; with --max-size also artifacts. What running processes
    have asked for stays.
    """
    from drl_meshgen.commands.storing import bytes_of

    try:
        size = None if max_size is None else bytes_of(max_size)
    except ValueError as error:
        raise typer.BadParameter(str(error)) from None

    def command() -> int:
        from drl_meshgen.commands.storing import clean_up
        from drl_meshgen.store import Store

        return clean_up(Store(store), keep or [], size, dry_run=dry_run)

    leave(command, debug=debug)


@app.command(epilog=EXIT_CODES)
def plan(
    source: Annotated[str, typer.Argument(metavar="INPUT", help="Name of a model or file, as for `mesh`.")],
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
    compare: Annotated[bool, typer.Option("--compare", help="A run that also has Gmsh's methods.")] = False,
    strict: Strict = False,
    store: Folder = None,
    debug: Debug = False,
) -> None:
    """Say what `mesh` with the same options would compute, and why.

    For every stage that is not in the store: the fields in which its recipe differs from the most similar one there.
    """
    check_sizes([source], target_quads, target_edge, layout)

    def command() -> int:
        from drl_meshgen.store import Store
        from drl_meshgen.store.catalogue import existing

        place = existing(Store(store))
        typer.echo(f"{Path(source).name}: what a run would do")

        from drl_meshgen.commands.settings import chosen
        from drl_meshgen.commands.storing import explain

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
        return explain(place, source, options, triangles, layout, compare=compare)

    leave(command, debug=debug)


@app.command(epilog=EXIT_CODES)
def reproduce(
    key: Key,
    *,
    source: Annotated[
        Path | None, typer.Option("--input", metavar="FILE", help="Where the surface lies now, if it was moved.")
    ] = None,
    whole: Annotated[bool, typer.Option("--all", help="Compute again all it was made from, too.")] = False,
    store: Folder = None,
    debug: Debug = False,
) -> None:
    """Compute an artifact again from its recorded inputs and options, and compare bit by bit.

    The exit code is 1 where it differs.
    """

    def command() -> int:
        from drl_meshgen.commands.storing import recompute
        from drl_meshgen.store import Store

        return recompute(Store(store), key, source, whole=whole)

    leave(command, debug=debug)


@app.command(epilog=EXIT_CODES)
def push(
    target: Annotated[str, typer.Argument(metavar="TARGET", help="Folder, or URL such as s3://bucket/prefix.")],
    *,
    only: Only = None,
    store: Folder = None,
    debug: Debug = False,
) -> None:
    """Copy artifacts to another place that lacks them."""

    def command() -> int:
        from drl_meshgen.commands.storing import copy_out
        from drl_meshgen.store import Store

        return copy_out(Store(store), target, only or [])

    leave(command, debug=debug)


@app.command(epilog=EXIT_CODES)
def pull(
    source: Annotated[str, typer.Argument(metavar="SOURCE", help="Folder, or URL such as s3://bucket/prefix.")],
    *,
    only: Only = None,
    store: Folder = None,
    debug: Debug = False,
) -> None:
    """Copy artifacts from another place, each checked before it counts."""

    def command() -> int:
        from drl_meshgen.commands.storing import copy_in
        from drl_meshgen.store import Store

        return copy_in(Store(store), source, only or [])

    leave(command, debug=debug)


@app.command(epilog=EXIT_CODES)
def serve(
    *,
    host: Annotated[str, typer.Option(metavar="HOST", help="Address to listen at; this machine only.")] = "127.0.0.1",
    port: Annotated[int, typer.Option(metavar="PORT", min=0, max=65535, help="Port; 0: any free one.")] = 4300,
    store: Folder = None,
    debug: Debug = False,
) -> None:
    """Serve artifacts over HTTP, read-only, each file checked before it is sent.

    Pages link to it where DRL_MESHGEN_FILES names its address. Ends with SIGTERM or Ctrl-C.
    """

    def command() -> int:
        from drl_meshgen.commands.serving import serve as run
        from drl_meshgen.store import Store

        return run(Store(store), host, port)

    leave(command, debug=debug)
