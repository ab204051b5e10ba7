"""Arguments that commands share, and how every command begins and ends. Nothing heavy is imported here."""

import sys
import traceback
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Annotated

import typer

from drl_meshgen.errors import MeshgenError, disk_sentence

EXIT_CODES = (
    "Exit codes: 0 fine, 1 internal error or a stage without a result, 2 usage, 3 bad input, "
    "4 meshed but below the quality gate, 5 some of several inputs failed."
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
Seed = Annotated[
    int | None, typer.Option("--seed", metavar="S", help="Seed of whatever is random, recorded with the options.")
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


def check_sizes(inputs: list[str], quads: int | None, edge: float | None, layout: Path | None) -> None:
    """Raise a usage error for sizes that contradict or are none, and for one layout of several inputs."""
    if quads is not None and edge is not None:
        raise typer.BadParameter("give --target-quads or --target-edge, not both")
    if edge is not None and not 0 < edge < float("inf"):
        raise typer.BadParameter("--target-edge must be a positive length")
    if layout is not None and len(inputs) > 1:
        raise typer.BadParameter("--layout is of one INPUT")


@contextmanager
def working(what: str) -> Iterator[None]:
    """Tell a terminal what a command does that has nothing to print until its end, and take that back then."""
    if not sys.stderr.isatty():
        yield
        return
    from rich.console import Console
    from rich.text import Text

    with Console(file=sys.stderr).status(Text(what)):
        yield


def leave(command: Callable[[], int], *, debug: bool) -> None:
    """Run a command and leave with its exit code; nobody sees a traceback who did not ask for it."""
    try:
        code = command()
    except MeshgenError as error:
        typer.echo(str(error), err=True)
        code = error.exit_code
    except BrokenPipeError:  # `| head` has seen enough; typer ends quietly
        raise
    except OSError as error:
        typer.echo(disk_sentence(error), err=True)
        if debug:
            traceback.print_exception(error)
        code = 1
    except Exception as error:  # noqa: BLE001 - the last line of defence
        typer.echo(f"internal error: {type(error).__name__}: {error}; --debug shows where", err=True)
        if debug:
            traceback.print_exception(error)
        code = 1
    raise typer.Exit(code)
