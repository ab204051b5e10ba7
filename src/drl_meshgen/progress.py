"""How far long work has come, told to whoever listens; nothing of it enters results or the keys of the store."""

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from contextvars import ContextVar
from dataclasses import dataclass


@dataclass(frozen=True)
class Advance:
    """What a listener is told."""

    what: str
    """What is counted, in words: "pieces meshed"."""
    done: int
    """How many are done (count)."""
    total: int
    """How many there are, or at most will be (count)."""


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


def counter(what: str, total: int) -> Callable[[], None]:
    """Tell that `total` pieces of work begin; return what to call after each of them.

    The listener is the one of the moment in which the work begins, so what is returned may be called in any thread.
    """
    listener, done = _listener.get(), 0

    def tell() -> None:
        if listener is not None:
            listener(Advance(what, done, total))

    def step() -> None:
        nonlocal done
        done += 1
        tell()

    tell()
    return step
