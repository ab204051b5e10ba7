"""The choice between ways to open junctions: whole layouts are filled, optimised and judged by their worst quads.

Neither the layout nor a few steps of the optimiser tell well which candidate ends best (decision 0015), so each is
taken to the end.
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
from drl_meshgen.quality import Quality, measure
from drl_meshgen.sizing import SizeField
from drl_meshgen.smoothing import SmoothingOptions, optimise
from drl_meshgen.smoothing.verdict import FOLDED, Figures

#: What a deviation from the surface by the diagonal of its bounding box counts in a trial (degrees of a worst angle).
DEVIATION = 300.0

#: What a patch of the base complex counts in a trial (degrees of a worst angle).
PATCH = 0.1


class _Trial(NamedTuple):
    """The candidate of each junction, what is wrong around each (squared degrees), and the shortfall of all quads."""

    chosen: tuple[int, ...]
    costs: Float[np.ndarray, " j"]
    shortfall: float


def choose(partition: Partition, field: SizeField, options: DecomposeOptions | None = None) -> Layout:
    """Open every junction in the way that ends in the best quads, and find node counts for the sizes of `field`.

    The most promising candidates (see `ranked`) are taken where a short optimisation leaves nothing to repair.
    Otherwise trial k takes the k-th candidate of every junction, for at most `options.candidates` of them, and a last
    one for each junction the candidate around which the fewest angles were missed. Each is optimised with default
    options, but for the search of places for folded quads; the one with the least shortfall (see `Figures`), deviation
    and blocks counted in, stays. Where there are zones, which come before quality, nothing is tried.

    Raises `StageError` where a region or the counts have no solution, `InputError` where fixed counts contradict.
    """
    options = options or DecomposeOptions()
    found = candidates(partition, options.exponents, strips=options.strips, zones=options.zones)
    most = 1 if options.zones else options.candidates
    ways = [min(len(junctions), most) for junctions in found.junctions]
    free = replace(options, fixed=(), former=())  # what people change in a layout must not lead to another one

    @cache
    def laid_out(chosen: tuple[int, ...]) -> Layout | None:
        try:
            return with_counts(partition, found.pieces(chosen), free, field)
        except StageError:  # the counts of one way to open a junction may have no solution; those of another may
            return None

    def tried(chosen: tuple[int, ...]) -> _Trial | None:
        layout = laid_out(chosen)
        return None if layout is None else _trial(partition, field, layout, chosen)

    chosen = tuple(0 for _ in ways)
    if max(ways, default=1) > 1 and not _is_fine(partition, field, laid_out(chosen)):
        uniform = [tuple(min(k, n - 1) for n in ways) for k in range(max(ways))]
        trials = [trial for trial in map(tried, uniform) if trial is not None]
        if trials:
            best = np.argmin([trial.costs for trial in trials], axis=0).tolist()
            mixed = tuple(trials[k].chosen[j] for j, k in enumerate(best))
            last = None if mixed in uniform else tried(mixed)
            if last is not None:
                trials.append(last)
            chosen = min(trials, key=lambda trial: trial.shortfall).chosen
    done = laid_out(chosen) if free == options else None
    return done or with_counts(partition, found.pieces(chosen), options, field)


def _is_fine(partition: Partition, field: SizeField, layout: Layout | None) -> bool:
    """Whether there is a layout of which a short optimisation leaves nothing to repair."""
    return layout is not None and _Outcome.of(partition, field, layout, SmoothingOptions().fast()).is_fine


class _Outcome(NamedTuple):
    """What becomes of the quads of a layout, and the pieces that the corners of each belong to."""

    quality: Quality
    pieces: Int[np.ndarray, "m 4"]
    options: SmoothingOptions

    @staticmethod
    def of(partition: Partition, field: SizeField, layout: Layout, options: SmoothingOptions) -> "_Outcome":
        """Fill, lift, optimise and measure."""
        surface, sizes = field.surface, field.at(layout.spacing)
        assembly = assemble(layout, fill(partition, layout, sizes=sizes))
        lifted = inverse_map(surface, layout, assembly)
        wanted = None if sizes.uniform else sizes.size
        result = optimise(surface, lifted.mesh.mesh, lifted.triangle, options, sizes=wanted)
        quality = measure(lifted.mesh.moved(result.points).mesh, surface)
        return _Outcome(quality, assembly.piece[lifted.mesh.mesh.quads], options)

    @property
    def is_fine(self) -> bool:
        """Whether no quad would have to be repaired."""
        figures, (low, high) = self.figures, self.options.repair_angles
        inside = figures.min_angle >= low and figures.max_angle <= high
        return not figures.invalid and inside and figures.area_ratio <= self.options.repair_area_ratio

    @property
    def figures(self) -> Figures:
        """Worst quads; sizes are not judged, since counts follow them in every layout."""
        m = self.quality.metrics
        invalid = int((~self.quality.shape.valid).sum())
        return Figures(invalid, m["min_angle"], m["max_angle"], m["area_ratio"], m["orthogonality"], size_error=0.0)

    @property
    def missed(self) -> Float[np.ndarray, " m"]:
        """Degrees by which the angles of each quad miss the wanted limits; much for folded ones."""
        shape, (low, high) = self.quality.shape, self.options.wanted_angles
        return np.maximum(low - shape.min_angle, 0) + np.maximum(shape.max_angle - high, 0) + FOLDED * ~shape.valid


def _trial(partition: Partition, field: SizeField, layout: Layout, chosen: tuple[int, ...]) -> _Trial:
    outcome = _Outcome.of(partition, field, layout, SmoothingOptions(searches=0))
    at = _junction_of_pieces(layout.pieces)[outcome.pieces]
    costs = [float((outcome.missed[(at == j).any(axis=1)] ** 2).sum()) for j in range(len(layout.pieces.junctions))]
    metrics = outcome.quality.metrics
    more = DEVIATION * metrics["surface_deviation"] + PATCH * np.nan_to_num(metrics["blocks"])
    return _Trial(chosen, np.array(costs), outcome.figures.shortfall(outcome.options) + more)


def _junction_of_pieces(pieces: Pieces) -> Int[np.ndarray, " p"]:
    """Junction that each piece belongs to, in the order of `Assembly.piece`; -1 for tubes and caps."""
    junctions = list(enumerate(pieces.junctions))
    cells = [j for j, junction in junctions for _ in junction.cells]
    strips = [j for j, junction in junctions for _ in junction.strips]
    return np.array([*cells, *[-1] * (len(pieces.tubes) + len(pieces.caps)), *strips], np.int64)
