"""How far long work has come, told to whoever listens; nothing of it enters results or the keys of the store."""

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from contextvars import ContextVar
from dataclasses import dataclass
from typing import Protocol


@dataclass(frozen=True)
class Advance:
    """What a listener is told."""

    what: str
    """What is counted, in words: "pieces meshed"."""
    done: int
    """How many are done (count)."""
    total: int
    """How many there are, or at most will be (count)."""
    note: str = ""
    """A figure that tells how well it goes, in words."""


Listener = Callable[[Advance], None]
_listener: ContextVar[Listener | None] = ContextVar("listener", default=None)


@contextmanager
def listening(listener: Listener | None) -> Iterator[None]:
    """Tell `listener` how far the work within has come; None: nobody, which also silences work within other work."""
    token = _listener.set(listener)
    try:
        yield
    finally:
        _listener.reset(token)


class Step(Protocol):
    """What is called after each piece of work; `note` may tell how well it goes."""

    def __call__(self, note: str = "") -> None:
        """Tell that one more is done."""


def counter(what: str, total: int, done: int = 0) -> Step:
    """Tell that `total` pieces of work begin, `done` of which are done; return what to call after each of the others.

    The listener is the one of the moment in which the work begins, so what is returned may be called in any thread.
    """
    listener = _listener.get()

    def tell(note: str = "") -> None:
        if listener is not None:
            listener(Advance(what, done, total, note))

    def step(note: str = "") -> None:
        nonlocal done
        done += 1
        tell(note)

    tell()
    return step
