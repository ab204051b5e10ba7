"""Progress of long work in the dashboard: one progress artifact per task or flow run that takes its time."""

import re
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import replace
from typing import cast
from uuid import UUID

import httpx
from prefect import get_run_logger
from prefect.artifacts import create_progress_artifact, update_progress_artifact
from prefect.context import FlowRunContext, TaskRunContext
from prefect.exceptions import PrefectException

from drl_meshgen.progress import Advance, counter, listening

AFTER = 2.0
"""Work that ends sooner shows no progress (seconds)."""
EVERY = 2.0
"""Least time between two updates (seconds); one takes about 10 ms."""


def artifact_key(text: str) -> str:
    """Return a text as the dashboard wants keys: lower case letters, digits and dashes."""
    return re.sub(r"[^a-z0-9]+", "-", text.lower()).strip("-") or "surface"


class Shown:
    """A listener that shows what it is told in the dashboard, seldom enough to cost little.

    A dashboard that cannot be reached never stops the work: one warning, and nothing more is shown.
    """

    def __init__(self, name: str, *, after: float = AFTER) -> None:
        """`name` is what runs, for the key; nothing is shown before `after` seconds."""
        self._key = f"progress-{artifact_key(name)}"
        self._next = time.monotonic() + after
        self._artifact: UUID | None = None
        self._last: Advance | None = None

    def __call__(self, advance: Advance) -> None:
        """Show how far the work has come, unless it was shown a moment ago."""
        self._last = advance
        if advance.total > 1 and time.monotonic() >= self._next:
            self._show(advance)

    def finish(self, *, whole: bool = True) -> None:
        """Show the end, if anything was shown: all as done, or, where that need not be so, how far the work came."""
        if self._artifact is not None and self._last is not None:
            self._show(replace(self._last, done=self._last.total) if whole else self._last)

    def _show(self, advance: Advance) -> None:
        share = 100.0 * advance.done / max(1, advance.total)
        text = f"{advance.what}: {advance.done} of {advance.total}" + (f", {advance.note}" if advance.note else "")
        try:
            if self._artifact is None:
                # in a thread of a flow or task it returns the id itself, not a coroutine
                self._artifact = cast("UUID", create_progress_artifact(share, key=self._key, description=text))
            else:
                update_progress_artifact(self._artifact, progress=share, description=text)
        except (httpx.HTTPError, PrefectException) as error:
            get_run_logger().warning("progress is not shown: %s", error)
            self._next = float("inf")
        else:
            self._next = time.monotonic() + EVERY


@contextmanager
def counted(name: str, what: str, total: int) -> Iterator[Callable[[], None]]:
    """Yield what to call after each of `total` pieces of work, whose progress the dashboard shows as that of `name`."""
    listener = Shown(name)
    with listening(listener):
        step = counter(what, total)
    yield step
    listener.finish()


@contextmanager
def shown(name: str, *, whole: bool = True) -> Iterator[None]:
    """Show the progress of the work within in the dashboard, where it is part of a run.

    `whole` work is done when it ends, though it may take fewer steps than it said; other work may end early.
    """
    if TaskRunContext.get() is None and FlowRunContext.get() is None:
        yield
        return
    listener = Shown(name)
    with listening(listener):
        yield
    listener.finish(whole=whole)
