"""Watching folders: which files are new or changed, and have stopped growing."""

from collections.abc import Iterable
from pathlib import Path

Stamp = tuple[int, int]
"""Size in bytes and time of the last change in nanoseconds."""


class Watch:
    """Remembers files from one look to the next."""

    def __init__(self) -> None:
        self._seen: dict[str, Stamp] = {}
        self._taken: dict[str, Stamp] = {}

    def settled(self, sources: Iterable[str]) -> tuple[str, ...]:
        """Return the sources that changed since they were last returned, and not since the last look.

        So a file is returned at the second look at the earliest, and one that is being written not before it is whole.
        Names of generated models are returned at the first look, as there is no file that could change.
        """
        now = {source: _stamp(source) for source in sources}
        ready = [
            source
            for source, stamp in now.items()
            if self._taken.get(source) != stamp and (stamp == _NO_FILE or self._seen.get(source) == stamp)
        ]
        self._seen = now
        self._taken |= {source: now[source] for source in ready}
        return tuple(ready)


_NO_FILE: Stamp = (-1, -1)


def _stamp(source: str) -> Stamp:
    try:
        status = Path(source).stat()
    except OSError:
        return _NO_FILE
    return status.st_size, status.st_mtime_ns
