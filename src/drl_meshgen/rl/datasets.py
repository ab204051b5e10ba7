"""The sets of domains that learners are trained and judged on (paper section 6.1.1), each fixed by its seed."""

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from enum import Enum
from pathlib import Path

import numpy as np
import pandas as pd

from drl_meshgen.export import read_table, write_table
from drl_meshgen.rl.domains import Difficulty, drawn_domain
from drl_meshgen.templates.c_type import CSides
from drl_meshgen.templates.domain import Domain

COUNTS = (80, 120)
"""Fewest and most boundary nodes: 100, varied by 20 %."""
_COLUMNS = ("set", "index", "family", "source", "count", "corners", "x", "y")


class DataSet(Enum):
    """A set of domains: name, seed, size, and the difficulties that take turns in it."""

    TRAIN = ("train", 1, 10_000, (Difficulty.STANDARD,))
    TRAIN_HARD = ("train-hard", 2, 10_000, (Difficulty.HARD,))
    VALIDATION = ("validation", 3, 1_000, (Difficulty.STANDARD,))
    VALIDATION_HARD = ("validation-hard", 6, 1_000, (Difficulty.HARD,))
    TEST_STANDARD = ("test-standard", 4, 100, (Difficulty.STANDARD,))
    TEST_HARD = ("test-hard", 5, 50, (Difficulty.HARD,))

    def __init__(self, key: str, seed: int, size: int, difficulties: tuple[Difficulty, ...]) -> None:
        self.key, self.seed, self.size, self.difficulties = key, seed, size, difficulties


@dataclass(frozen=True, eq=False)
class Sample:
    """A domain of a set."""

    set: str
    """Name of the set."""
    index: int
    """Number in it."""
    family: str
    """Kind of curve."""
    domain: Domain
    """Evenly spaced nodes; area of the unit disk, centred. Of harvested domains: as the pipeline gave it."""
    source: str = ""
    """Where a harvested domain comes from."""
    corners: tuple[int, ...] = ()
    """Nodes of the four corners, anti-clockwise, where they are given; node counts of the sides follow."""

    @property
    def is_o_type(self) -> bool:
        """Whether the O-type template fills it: no corners are given, or opposite sides have the same counts."""
        if not self.corners:
            return len(self.domain) % 2 == 0
        a, b, c, d = self._cells
        return (a, b) == (c, d)

    @property
    def transition(self) -> tuple[int, CSides] | None:
        """Bottom left corner and cells of the sides of a domain for C-type templates; the bottom comes first."""
        if len(self.corners) != 4:
            return None
        bottom, right, top, left = self._cells
        return (self.corners[0], CSides(bottom, right, top)) if right == left and bottom > top else None

    @property
    def _cells(self) -> list[int]:
        return np.diff([*self.corners, self.corners[0] + len(self.domain)]).tolist()


def samples_of(data: DataSet, indices: Iterable[int] | None = None) -> Iterator[Sample]:
    """Draw the domains of a set, or those of some `indices`: number i is the same whichever others are drawn."""
    for i in range(data.size) if indices is None else indices:
        rng = np.random.default_rng([data.seed, i])
        count = 2 * int(rng.integers(COUNTS[0] // 2, COUNTS[1] // 2 + 1))
        domain, family = drawn_domain(data.difficulties[i % len(data.difficulties)], rng, count)
        yield Sample(data.key, i, family, domain)


def write_samples(path: Path | str, samples: Sequence[Sample]) -> None:
    """Write domains as a Parquet table, coordinates `x` and `y` and `corners` as lists."""
    rows = [
        {
            "set": one.set,
            "index": one.index,
            "family": one.family,
            "source": one.source,
            "count": len(one.domain),
            "corners": list(one.corners),
            "x": one.domain.nodes[:, 0],
            "y": one.domain.nodes[:, 1],
        }
        for one in samples
    ]
    write_table(path, pd.DataFrame(rows, columns=list(_COLUMNS)))


def read_samples(path: Path | str) -> list[Sample]:
    """Read what `write_samples` wrote; raises `InputError` for a domain that is none.

    Tables of drawn domains may lack `source` and `corners`.
    """
    table = read_table(path)
    if "source" not in table:
        table = table.assign(source="", corners=[np.zeros(0, np.int64)] * len(table))
    keys = ("set", "index", "family", "x", "y", "source", "corners")
    return [
        Sample(name, int(index), family, Domain(np.stack([x, y], axis=1)), source, tuple(corners.tolist()))
        for name, index, family, x, y, source, corners in zip(*(table[key] for key in keys), strict=True)
    ]
