"""Modules of training as commands: what the user did wrong is one sentence, not a traceback."""

from collections.abc import Callable
from typing import Any

import typer

from drl_meshgen.errors import MeshgenError


def run(command: Callable[..., Any]) -> None:
    """Run a function as a command whose options are its parameters; leave with the exit code of what it raised."""
    try:
        typer.run(command)
    except MeshgenError as error:
        typer.echo(str(error), err=True)
        raise SystemExit(error.exit_code) from None
