"""Parameters of C-type meshes, learned and by gradient ascent: counts by trying some, placement as of O-type meshes."""

from collections.abc import Sequence
from itertools import product
from typing import Final

import numpy as np
from jaxtyping import Float

from drl_meshgen.rl.ascent import Mesh, ascended
from drl_meshgen.rl.c_scene import ANSWERED, PER_PART, CScene, counts_of, part_samples, parts_of
from drl_meshgen.rl.inference import Placements
from drl_meshgen.rl.kernel import Judged, judge_c
from drl_meshgen.templates.c_type import CCounts, CParameters, CSides
from drl_meshgen.templates.domain import Domain
from drl_meshgen.templates.score import Weights

GRID: Final = np.array(list(product((0.12, 0.3, 0.5, 0.75), (0.3, 0.5, 0.7), (0.3, 0.5, 0.7))))
"""Shares that are tried first: of the top for the middle, of the rest for its left, of the rows for those below."""
STEPS: Final = ((0.09, 0.1, 0.1), (0.04, 0.05, 0.05))
"""How far around the best shares are tried next, round by round."""
LEAST: Final = 0.03
"""Weight of the worst corner (least Jacobian over squared mean side) in the choice of counts."""


def counts_at(sides: CSides, shares: Float[np.ndarray, "s 3"]) -> list[CCounts]:
    """Return the distinct counts that come nearest to shares as in `GRID`; mirrored shares give mirrored counts."""
    bottom, side, top = sides
    found = {}
    for middle, left, below in shares.tolist():
        n, low = _near(middle * top, top - 2), _near(below * side, side - 1)
        rest, even = top - n, round(2 * left - 1, 9)
        fewer = _near(min(left, 1 - left) * rest, rest - 1)
        halves = {-1: (fewer,), 0: (rest // 2, rest - rest // 2), 1: (rest - fewer,)}[(even > 0) - (even < 0)]
        for q0 in halves:
            found[n, q0, low] = CCounts(q0, (bottom - top) // 2, n, rest - q0, low, side - low)
    return list(found.values())


def _near(wanted: float, most: int) -> int:
    return min(max(round(wanted), 1), most)


def shares_around(counts: CCounts, step: tuple[float, float, float]) -> Float[np.ndarray, "27 3"]:
    """Return the shares of these counts, and those a step away."""
    c = counts
    at = np.array([c.n / c.sides.top, c.q0 / (c.q0 + c.q1), c.below / c.sides.side])
    return at + np.array(list(product((0, -1, 1), repeat=3))) * step


def look(nodes: Float[np.ndarray, "l 2"], start: int, counts: Sequence[CCounts]) -> CScene:
    """Return what the placement policy sees of a domain of unit scale with each of these counts."""
    rims = np.array([one.rim for one in counts])
    at = np.full(len(counts), start)
    return CScene.of(part_samples(np.ascontiguousarray(nodes)[None], at, rims, PER_PART), counts_of(counts))


def proposed(
    placement: Placements, nodes: Float[np.ndarray, "l 2"], start: int, counts: Sequence[CCounts], weights: Weights
) -> tuple[list[CParameters], Judged]:
    """Place and judge meshes of a domain of unit scale with each of these counts."""
    scene = look(nodes, start, counts)
    parts = scene.placed(placement(scene.seen))
    both = zip(counts, parts["singular"], parts["bulges"], strict=True)
    found = [CParameters(start, one, singular, bulges) for one, singular, bulges in both]
    return found, judge_c(nodes, found, weights)


def best_transition(
    placement: Placements, domain: Domain, start: int, cells: CSides | CCounts, weights: Weights
) -> CParameters | None:
    """Return the best that is proposed for the counts, or for any that sides allow; None where no mesh is valid.

    Counts that leave a flat core have few bad quads, which a mean hardly sees: the worst corner counts by `LEAST`.
    Raises `InputError` for sides that no C-type mesh fits.
    """
    nodes = domain.frame.to_local(domain.nodes)
    if isinstance(cells, CCounts):
        found, judged = proposed(placement, nodes, start, [cells], weights)
    else:
        found, judged = proposed(placement, nodes, start, counts_at(cells.checked(), GRID), weights)
        for step in STEPS:
            near = counts_at(cells, shares_around(found[judged.preferred(LEAST)].counts, step))
            found, judged = proposed(placement, nodes, start, near, weights)
    best = judged.preferred(LEAST)
    return _in_plane(domain, found[best]) if judged.valid[best] else None


def ascended_transition(
    domain: Domain,
    start: int,
    cells: CSides | CCounts,
    *,
    kept: tuple[int, int],
    iterations: tuple[int, int],
    weights: Weights,
) -> CParameters:
    """Return the best parameters that gradient ascent finds, valid ones first.

    Tutte's embedding with every choice of counts, then a short ascent from the best `kept[0]`, a long one from the best
    `kept[1]` of these.
    """
    local = Domain(domain.frame.to_local(domain.nodes))
    counts = [cells] if isinstance(cells, CCounts) else counts_at(cells.checked(), GRID)
    scene = look(local.nodes, start, counts)
    tutte = scene.placed(np.zeros((len(counts), ANSWERED)))["singular"]
    straight = np.zeros((ANSWERED - 8) // 2)
    begin = [CParameters(start, one, at, straight.reshape(-1, 2)) for one, at in zip(counts, tutte, strict=True)]
    judged = judge_c(local.nodes, begin, weights)
    order = np.argsort(judged.penalty - judged.reward, kind="stable")[: kept[0]]
    found = [(0.0, counts[i], np.concatenate([tutte[i].ravel(), np.zeros(ANSWERED - 8)])) for i in order]
    for most, steps in zip(kept, iterations, strict=True):
        climbed = [
            (ascended(Mesh.of_transition(local, start, one), x, steps, weights), one) for _, one, x in found[:most]
        ]
        found = sorted([(worth, one, x) for (worth, x), one in climbed], key=lambda each: -each[0])
    ends = [CParameters(start, one, **parts_of(x)) for _, one, x in found]
    return _in_plane(domain, ends[judge_c(local.nodes, ends, weights).best])


def _in_plane(domain: Domain, p: CParameters) -> CParameters:
    """Return parameters of the domain from those in its frame."""
    return CParameters(p.start, p.counts, domain.frame.to_world(p.singular), p.bulges)
