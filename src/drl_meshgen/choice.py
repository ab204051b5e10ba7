"""The choice between ways to open junctions: whole layouts are filled, optimised and judged by their worst quads.

Neither the layout nor a few steps of the optimiser tell well which candidate ends best (decision 0015), so each is
taken nearly to the end.
"""

from dataclasses import replace
from functools import cache
from typing import NamedTuple

import numpy as np
from jaxtyping import Float, Int

from drl_meshgen.assembly import assemble, fill
from drl_meshgen.decompose import DecomposeOptions, Layout, Pieces
from drl_meshgen.decompose.pieces import candidates
from drl_meshgen.decompose.stage import with_counts
from drl_meshgen.errors import StageError
from drl_meshgen.lift.inverse import inverse_map
from drl_meshgen.partition import Partition
from drl_meshgen.progress import counter, listening
from drl_meshgen.quality import Quality, measure
from drl_meshgen.quality.closest import TriangleSearch
from drl_meshgen.quality.deviation import deviation
from drl_meshgen.sizing import SizeField
from drl_meshgen.smoothing import SmoothingOptions, optimise
from drl_meshgen.smoothing.verdict import FOLDED, Figures

#: What a deviation from the surface by the diagonal of its bounding box counts in a trial (degrees of a worst angle).
DEVIATION = 300.0

#: What a patch of the base complex counts in a trial (degrees of a worst angle).
PATCH = 0.1

#: Points at which the deviation of a trial is measured, to and from the surface.
SAMPLES = 2000

#: A layout is as good as needed where its worst quads miss the wanted limits by no more than this (degrees).
ENOUGH = 5.5

#: Trials have no more quads than this (count): which layout is best hardly depends on it, and their time does.
MOST_QUADS = 8000

#: So many fewer quads must stay folded with the turning that the charts give; less is chance (count).
FEWER = 2


class _Way(NamedTuple):
    """A candidate of each junction, and how bands and caps are turned."""

    chosen: tuple[int, ...]
    by_charts: bool = False
    """Whether the charts say how, instead of a search for few blocks."""


class _Trial(NamedTuple):
    """A way, taken to the end."""

    way: _Way
    costs: Float[np.ndarray, " j"]
    """What is wrong around each junction (squared degrees)."""
    shortfall: float
    """What is wrong with the whole (degrees), the deviation left out of one that is enough."""
    folded: int
    """Quads that stay folded (count)."""
    is_enough: bool
    """Whether a better layout would not be worth the time."""


def choose(partition: Partition, field: SizeField, options: DecomposeOptions | None = None) -> Layout:
    """Open every junction in the way that ends in the best quads, and find node counts for the sizes of `field`.

    Trial k takes the k-th candidate of every junction, the most promising first (see `ranked`), for at most
    `options.candidates` of them, and a last one for each junction the candidate around which the fewest angles were
    missed. Each is optimised with `trial_options`, with `MOST_QUADS` where more are wanted. The first that is as good
    as needed stays, else the one with the least shortfall (see `Figures`), deviation and blocks counted in. If `FEWER`
    or more quads stay folded even there, it is tried once more without the search for few blocks, whose counts and
    twist a tight place may have no room for, and that stays if so many fewer do. Where there are zones, which come
    before quality, nothing is tried.

    Raises `StageError` where a region or the counts have no solution, `InputError` where fixed counts contradict.
    """
    options = options or DecomposeOptions()
    found = candidates(partition, options.exponents, strips=options.strips, zones=options.zones)
    most = 1 if options.zones else options.candidates
    ways = [min(len(junctions), most) for junctions in found.junctions]
    # what people change in a layout must not lead to another one
    free = _coarse(replace(options, fixed=(), former=()), field)
    search = TriangleSearch(field.surface.corners)

    @cache
    def laid_out(way: _Way) -> Layout | None:
        try:
            return with_counts(partition, found.pieces(way.chosen), _turning(free, way), field)
        except StageError:  # the counts of one way to open a junction may have no solution; those of another may
            return None

    trials: list[_Trial] = []

    def tried(way: _Way) -> bool:
        """Add a trial, if there are counts for it; return whether it is the last that is needed."""
        layout = laid_out(way)
        if layout is not None:
            with listening(None):
                trials.append(_trial(partition, field, layout, way, search))
        advance()
        return layout is not None and trials[-1].is_enough

    advance = counter("layouts tried", max(ways, default=1) + 1)
    way = _Way(tuple(0 for _ in ways))
    if max(ways, default=1) > 1:
        uniform = [_Way(tuple(min(k, n - 1) for n in ways)) for k in range(max(ways))]
        if not any(map(tried, uniform)) and trials:
            best = np.argmin([trial.costs for trial in trials], axis=0).tolist()
            mixed = _Way(tuple(trials[k].way.chosen[j] for j, k in enumerate(best)))
            if mixed not in uniform:
                tried(mixed)
        if trials:
            least = trials[-1] if trials[-1].is_enough else min(trials, key=lambda one: one.shortfall)
            way = least.way
            if least.folded >= FEWER and options.block_weight:
                tried(way._replace(by_charts=True))
                way = trials[-1].way if trials[-1].folded <= least.folded - FEWER else way
    done = laid_out(way) if free == options else None
    return done or with_counts(partition, found.pieces(way.chosen), _turning(options, way), field)


def _coarse(options: DecomposeOptions, field: SizeField) -> DecomposeOptions:
    """Options of trials: with quads so large that `MOST_QUADS` cover the surface, if smaller ones are wanted."""
    if options.target_edge:
        least = float(np.sqrt(field.surface.area / MOST_QUADS))
        return replace(options, target_edge=max(options.target_edge, least))
    return replace(options, target_quads=min(options.target_quads, MOST_QUADS))


def _turning(options: DecomposeOptions, way: _Way) -> DecomposeOptions:
    return replace(options, block_weight=0.0) if way.by_charts else options


def trial_options() -> SmoothingOptions:
    """Return the options of trials: they end as the whole optimisation does, but mend little.

    What is still folded after one round of mending is left so: such a layout has no room.
    """
    return replace(SmoothingOptions(), searches=0, unfold_rounds=1, repair_rounds=1)


def _trial(partition: Partition, field: SizeField, layout: Layout, way: _Way, search: TriangleSearch) -> _Trial:
    """Fill, lift, optimise and measure; `search` is for the surface."""
    surface, sizes, options = field.surface, field.at(layout.spacing), trial_options()
    assembly = assemble(layout, fill(partition, layout, sizes=sizes))
    lifted = inverse_map(surface, layout, assembly)
    wanted = None if sizes.uniform else sizes.size
    result = optimise(surface, lifted.mesh.mesh, lifted.triangle, options, sizes=wanted)
    mesh = lifted.mesh.moved(result.points).mesh
    quality = measure(mesh, surface, search=search, with_deviation=False)
    at = _junction_of_pieces(layout.pieces)[assembly.piece[lifted.mesh.mesh.quads]]
    missed = _missed(quality, options)
    costs = [float((missed[(at == j).any(axis=1)] ** 2).sum()) for j in range(len(layout.pieces.junctions))]
    figures = _figures(quality)
    shortfall = figures.shortfall(options) + PATCH * float(np.nan_to_num(quality.metrics["blocks"]))
    is_enough = replace(figures, orthogonality=1.0).shortfall(options) <= ENOUGH
    if not is_enough:
        rim = mesh.topology.boundary_edges
        shortfall += DEVIATION * deviation(mesh, surface, rim, search, samples=SAMPLES).surface
    return _Trial(way, np.array(costs), shortfall, figures.invalid, is_enough)


def _figures(quality: Quality) -> Figures:
    """Worst quads; sizes are not judged, since counts follow them in every layout."""
    m = quality.metrics
    invalid = int((~quality.shape.valid).sum())
    return Figures(invalid, m["min_angle"], m["max_angle"], m["area_ratio"], m["orthogonality"], size_error=0.0)


def _missed(quality: Quality, options: SmoothingOptions) -> Float[np.ndarray, " m"]:
    """Degrees by which the angles of each quad miss the wanted limits; much for folded ones."""
    shape, (low, high) = quality.shape, options.wanted_angles
    return np.maximum(low - shape.min_angle, 0) + np.maximum(shape.max_angle - high, 0) + FOLDED * ~shape.valid


def _junction_of_pieces(pieces: Pieces) -> Int[np.ndarray, " p"]:
    """Junction that each piece belongs to, in the order of `Assembly.piece`; -1 for tubes and caps."""
    junctions = list(enumerate(pieces.junctions))
    cells = [j for j, junction in junctions for _ in junction.cells]
    strips = [j for j, junction in junctions for _ in junction.strips]
    return np.array([*cells, *[-1] * (len(pieces.tubes) + len(pieces.caps)), *strips], np.int64)
