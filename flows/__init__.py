"""Prefect flows; importable from the repository root only. Quiet and offline unless the environment says otherwise."""

import logging
import os
import sys
from collections.abc import Callable
from typing import Any

_LOADING = sys.argv[:1] == ["-m"] and sys.stderr.isatty()  # `python -m flows...` has this before it loads the flow
if _LOADING:
    sys.stderr.write("loading Prefect ...")
    sys.stderr.flush()

os.environ.setdefault("DO_NOT_TRACK", "1")
os.environ.setdefault("PREFECT_SERVER_ANALYTICS_ENABLED", "false")


def _without_empty_traceback(record: logging.LogRecord) -> bool:
    """Drop the traceback that Prefect asks for where a task returned a failed state: it prints "NoneType: None"."""
    if record.exc_info is not None and record.exc_info[0] is None:
        record.exc_info = None
    return True


logging.getLogger("prefect.task_runs").addFilter(_without_empty_traceback)


def run_command(main: Callable[..., Any]) -> None:
    """Run the command line of a flow, once all that it needs is loaded."""
    import typer

    if _LOADING:
        sys.stderr.write("\r\x1b[2K")
    typer.run(main)
