"""The sets of domains that learners are trained and judged on (paper section 6.1.1), each fixed by its seed."""

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from enum import Enum
from pathlib import Path

import numpy as np
import pandas as pd

from drl_meshgen.export import read_table, write_table
from drl_meshgen.rl.domains import Difficulty, drawn_domain
from drl_meshgen.templates.domain import Domain

COUNTS = (80, 120)
"""Fewest and most boundary nodes: 100, varied by 20 %."""


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
    """Evenly spaced nodes; area of the unit disk, centred."""


def samples_of(data: DataSet, indices: Iterable[int] | None = None) -> Iterator[Sample]:
    """Draw the domains of a set, or those of some `indices`: number i is the same whichever others are drawn."""
    for i in range(data.size) if indices is None else indices:
        rng = np.random.default_rng([data.seed, i])
        count = 2 * int(rng.integers(COUNTS[0] // 2, COUNTS[1] // 2 + 1))
        domain, family = drawn_domain(data.difficulties[i % len(data.difficulties)], rng, count)
        yield Sample(data.key, i, family, domain)


def write_samples(path: Path | str, samples: Sequence[Sample]) -> None:
    """Write domains as a Parquet table: set, index, family, count, and coordinates `x` and `y` as lists."""
    rows = [
        {
            "set": one.set,
            "index": one.index,
            "family": one.family,
            "count": len(one.domain),
            "x": one.domain.nodes[:, 0],
            "y": one.domain.nodes[:, 1],
        }
        for one in samples
    ]
    write_table(path, pd.DataFrame(rows, columns=["set", "index", "family", "count", "x", "y"]))


def read_samples(path: Path | str) -> list[Sample]:
    """Read what `write_samples` wrote; raises `InputError` for a domain that is none."""
    table = read_table(path)
    return [
        Sample(name, int(index), family, Domain(np.stack([x, y], axis=1)))
        for name, index, family, x, y in zip(*(table[key] for key in ("set", "index", "family", "x", "y")), strict=True)
    ]
