"""Modules of training as commands: what the user did wrong is one sentence, not a traceback."""

from collections.abc import Callable
from typing import Any

import typer

from drl_meshgen.errors import MeshgenError


def run(command: Callable[..., Any]) -> None:
    """Run a function as a command whose options are its parameters; leave with the exit code of what it raised."""
    raise SystemExit(code_of(lambda: typer.run(command)))


def code_of(main: Callable[[], int | None]) -> int:
    """Return the exit code of a command, or of what it raised, which is told."""
    try:
        return main() or 0
    except MeshgenError as error:
        typer.echo(str(error), err=True)
        return error.exit_code
