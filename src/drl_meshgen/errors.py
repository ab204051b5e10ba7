"""What can go wrong, as types: each carries one sentence for the user and decides the exit code.

Arrays have no types here, because commands that compute nothing shall not wait for the import of numpy.
"""

from collections.abc import Iterable
from enum import Enum
from functools import partial
from typing import Any, NamedTuple

FINE, INTERNAL, BELOW_GATE, SOME_FAILED = 0, 1, 4, 5
"""Exit codes of a run; errors carry their own."""


def overall(codes: Iterable[int]) -> int:
    """Return the exit code of several inputs from theirs: that of a single one, `SOME_FAILED` where one failed."""
    known = list(codes)
    if len(known) > 1 and any(code not in (FINE, BELOW_GATE) for code in known):
        return SOME_FAILED
    return max(known, default=FINE)


def disk_sentence(error: OSError) -> str:
    """Return what a disk, file or network said, in one line without the error's number."""
    return f"{error.strerror or error}: {error.filename or ''}".rstrip(": ")


class Place(NamedTuple):
    """Where on a surface something is wrong."""

    points: Any
    """Points at the place, `(n, 3)`, in the units of the input."""
    vertices: Any
    """Vertices of the surface, or nodes of the mesh, that it is on, `(v, 3)`."""
    faces: Any
    """Its triangles or quads, `(f, 3)` or `(f, 4)`."""


class MeshgenError(Exception):
    """Base of every error this package raises on purpose. `exit_code` is what the command line returns."""

    exit_code = 1
    where: Any = None
    """Points `(n, 3)` of the surface at which something is wrong, in the input's units; None where there is none."""
    place: Place | None = None
    """The same with the surface they are on: known to whoever called what raised the error."""


def _shown(name: str) -> str:
    """Escape what would break the line or steer a terminal: file names may hold anything."""
    return "".join(letter if letter.isprintable() else repr(letter)[1:-1] for letter in name)


class InputError(MeshgenError):
    """The user's input cannot be meshed: names the file or model, the defect and what to do."""

    exit_code = 3

    def __init__(self, name: str, defect: str, remedy: str = "", *, where: Any = None) -> None:
        self.name, self.defect, self.remedy, self.where = name, defect, remedy, where
        super().__init__(f"{_shown(name)}: {defect}" + (f"; {remedy}" if remedy else ""))

    def __reduce__(self) -> tuple[Any, ...]:
        """Let the error travel between processes as it is."""
        return partial(type(self), where=self.where), (self.name, self.defect, self.remedy), {"place": self.place}


class StageError(MeshgenError):
    """A stage ended without a usable result; `outcome` is its verdict, `detail` the values that show it."""

    def __init__(self, stage: str, outcome: Enum, detail: str = "", *, where: Any = None) -> None:
        self.stage, self.outcome, self.detail, self.where = stage, outcome, detail, where
        super().__init__(f"{stage}: {outcome.value}" + (f" ({detail})" if detail else ""))

    def __reduce__(self) -> tuple[Any, ...]:
        """Let the error travel between processes as it is."""
        return partial(type(self), where=self.where), (self.stage, self.outcome, self.detail), {"place": self.place}
