"""Layouts within a number of blocks or irregular nodes: coarser partitions, spines instead of strips, until one fits.

The search goes from the layout that the options ask for to coarser ones: at every partition first with strips, where
these are wanted, then without; then the limbs of least persistence are left out. The first layout that fits is taken,
so nothing is given up that the limits allow. Only of the first are several ways to open junctions tried.
"""

from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from drl_meshgen.decompose import DecomposeOptions, Layout
from drl_meshgen.errors import InputError, StageError
from drl_meshgen.partition import Partition, PartitionOptions, RegionKind


@dataclass(frozen=True)
class LimitOptions:
    """How coarse the layout has to be."""

    blocks: int = 0
    """Most blocks (count); 0 is no limit."""
    irregular: int = 0
    """Most irregular nodes (count); 0 is no limit."""

    def __bool__(self) -> bool:
        return self.blocks > 0 or self.irregular > 0

    def admit(self, blocks: int, irregular: int) -> bool:
        """Tell whether numbers are within the limits."""
        return (not self.blocks or blocks <= self.blocks) and (not self.irregular or irregular <= self.irregular)


def predicted_irregular(partition: Partition, layout: Layout) -> int:
    """Return the number of irregular nodes of the mesh of a layout.

    A cap has 4 of valence 3, a spine node of degree d has valence 2 d, a corner of a strip valence 5 (unless it lies on
    the boundary), a transition has 4.
    """
    parts, counts = layout.pieces, layout.curve_counts
    total = 4 * len(parts.caps) + 4 * sum(counts[t.curves[0]] != counts[t.curves[1]] for t in parts.tubes)
    for junction in parts.junctions:
        inner = (len(rim.sides) for rim in junction.rims if not partition.curves[rim.curve].is_boundary)
        total += sum(inner) if junction.strips else len(junction.spine.nodes)
    return int(total)


def within(
    lay: Callable[[PartitionOptions, DecomposeOptions, str], Any],
    options: tuple[PartitionOptions, DecomposeOptions],
    limits: LimitOptions,
    name: str,
) -> tuple[PartitionOptions, DecomposeOptions]:
    """Return the options of the finest layout within `limits` that the search meets.

    `lay` returns the result of a stage (`partition`, `decompose`, `assembly`) under given options. Blocks are counted
    in what is assembled, which takes no node positions on the surface.

    Raises `InputError`, which says how few there can be, where no layout is coarse enough.
    """
    fewest: tuple[int, ...] = ()
    plain: Partition | None = None  # the last whose layout had nothing that may be left out
    hopeless: tuple[PartitionOptions, DecomposeOptions] | None = None

    def numbers(own: PartitionOptions, opening: DecomposeOptions) -> tuple[int, int] | None:
        try:
            irregular = predicted_irregular(lay(own, opening, "partition"), lay(own, opening, "decompose"))
            return len(lay(own, opening, "assembly").grids) if limits.blocks else 0, irregular
        except StageError:  # a coarser partition may have no layout; the next one may
            return None

    for partition, own, opening in _candidates(lay, *options):
        if partition is plain:
            continue
        hopeless = None if limits.admit(*_least(partition)) else (own, opening)
        found = None if hopeless else numbers(own, opening)
        if found is None:
            continue
        if limits.admit(*found):
            return own, replace(opening, fixed=options[1].fixed, former=options[1].former)
        fewest = tuple(map(min, zip(fewest or found, found, strict=True)))
        layout: Layout = lay(own, opening, "decompose")
        plain = partition if not layout.pieces.strips and not opening.transitions else None
    found = None if hopeless is None else numbers(*hopeless)  # the coarsest tells how few there can be
    fewest = tuple(map(min, zip(fewest or found, found, strict=True))) if found else fewest
    if not fewest:
        raise InputError(name, "has no layout under the options given")
    wanted = ((limits.blocks, "blocks", fewest[0]), (limits.irregular, "irregular nodes", fewest[1]))
    told = [f"{limit} {what} (the fewest found are {few})" for limit, what, few in wanted if limit]
    raise InputError(name, f"there is no layout within {' and '.join(told)}")


def _candidates(
    lay: Callable[[PartitionOptions, DecomposeOptions, str], Any], options: PartitionOptions, opening: DecomposeOptions
) -> Iterator[tuple[Partition, PartitionOptions, DecomposeOptions]]:
    """Partitions with the options they and the opening of their junctions take, from fine to coarse."""
    opening = replace(opening, fixed=(), former=())
    single = replace(opening, candidates=1)
    plain = replace(single, transitions=False)
    coarser = (single, plain, replace(plain, strips=False))
    openings = tuple(dict.fromkeys((opening, *coarser)))
    first: Partition = lay(options, opening, "partition")
    heights = first.merges["persistence"].to_numpy()
    steps = np.unique(np.r_[heights, heights / options.large_share])
    before = -1
    for persistence in (options.persistence, *np.nextafter(steps[steps >= options.persistence], np.inf).tolist()):
        own = replace(options, persistence=float(persistence))
        partition = lay(own, opening, "partition")
        if len(partition.regions) != before:
            before = len(partition.regions)
            yield from ((partition, own, one) for one in openings)
            openings = tuple(dict.fromkeys(coarser))


def _least(partition: Partition) -> tuple[int, int]:
    """Return numbers of blocks and of irregular nodes that no way to open the junctions gets below."""
    caps = sum(region.kind is RegionKind.CAP for region in partition.regions)
    loops = [len(region.loops) for region in partition.regions if region.kind is RegionKind.JUNCTION]
    return caps + sum(k - 1 for k in loops), 4 * caps + len(loops)
