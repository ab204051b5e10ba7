"""`drl-meshgen store`: arguments in, core calls, exit code out."""

from pathlib import Path
from typing import Annotated

import typer

from drl_meshgen.commands.arguments import EXIT_CODES, Debug, leave

app = typer.Typer(help="Look into the artifact store, check it, tidy it up.", no_args_is_help=True)

Folder = Annotated[
    Path | None,
    typer.Option("--store", metavar="DIR", help="The store.  [default: DRL_MESHGEN_STORE, else artifacts]"),
]
Key = Annotated[str, typer.Argument(metavar="ID", help="Key of an artifact, or as many of its digits as are needed.")]
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
