"""The reward of `templates.score` for many choices of template parameters of one domain, compiled (numba, float64).

Meshes are those of `templates.instantiate` and `instantiate_c`, judged block by block and never stored. Equal to
`templates.score` to rounding.
"""

from dataclasses import dataclass
from typing import Any, Final

import numba
import numpy as np
from jaxtyping import Bool, Float, Int

from drl_meshgen.errors import InputError
from drl_meshgen.templates.c_type import BLOCKS, EDGES, ENDS, RIM, CParameters
from drl_meshgen.templates.curves import SWELLS, WAVES
from drl_meshgen.templates.score import LEAST_JACOBIAN, PENALTY, Weights

HALF_PI: Final = np.pi / 2

#: Sides (bottom, top, left, right) of the blocks of an O-type mesh, the core first. Curves 0-3 are the sides of the
#: boundary, 4-7 the spokes, 8-11 the sides of the core; `~c` is curve c run backwards.
O_SIDES: Final[np.ndarray] = np.array([[8, ~10, ~11, 9], *([s, 8 + s, 4 + s, 4 + (s + 1) % 4] for s in range(4))])


def _c_sides() -> Int[np.ndarray, "9 4"]:
    """Return the same for C-type meshes: curves 0-11 are the parts of the boundary, 12-23 the internal edges."""
    ends = [(name, RIM[(i + 1) % len(RIM)]) for i, name in enumerate(RIM)] + [(a, b) for a, b, _ in EDGES]
    curve = {pair: i for i, pair in enumerate(ends)} | {(b, a): ~i for i, (a, b) in enumerate(ends)}
    return np.array([[curve[s] for s in ((a, b), (d, c), (a, d), (b, c))] for a, b, c, d in BLOCKS])


C_SIDES: Final[np.ndarray] = _c_sides()


@dataclass(frozen=True, eq=False)
class Judged:
    """What `b` meshes of a domain are worth."""

    reward: Float[np.ndarray, " b"]
    """Reward of meshes that keep their boundary nodes (eqs. 11-13, 15)."""
    penalty: Float[np.ndarray, " b"]
    """`templates.score.validity_penalty`."""
    least: Float[np.ndarray, " b"]
    """Least corner Jacobian over the squared mean side of its quad; positive where all quads are valid."""
    orthogonality: Float[np.ndarray, " b"]
    """Mean over quads of eq. 11, by the worst corner."""
    jacobian: Float[np.ndarray, " b"]
    """Mean over quads of eq. 12."""

    @property
    def valid(self) -> Bool[np.ndarray, " b"]:
        """Which meshes have none but valid quads."""
        return self.least > 0


def judge_o(  # noqa: PLR0917 - what fixes a mesh, in the order of `OParameters`
    nodes: Float[np.ndarray, "l 2"],
    corners: Int[np.ndarray, "b 2"],
    layers: Int[np.ndarray, " b"],
    singular: Float[np.ndarray, "b 4 2"],
    bulges: Float[np.ndarray, "b 8 2"],
    weights: Weights | None = None,
    *,
    waves: Float[np.ndarray, "b 8 2 2"] | None = None,
    swells: Float[np.ndarray, "b 4 3 2"] | None = None,
) -> Judged:
    """Judge O-type meshes of one domain; `corners` are `(i0, m)`, all else as in `OParameters` without grading.

    Raises `InputError` for an odd number of nodes, a number of layers below 1, or m not between 1 and L / 2 - 1.
    """
    corners, layers = np.asarray(corners, np.int64), np.asarray(layers, np.int64)
    half, odd = divmod(len(nodes), 2)
    if odd or (layers < 1).any() or ((corners[:, 1] < 1) | (corners[:, 1] >= half)).any():
        raise InputError("O-type template", f"corners or layers do not fit a boundary of {len(nodes)} nodes")
    waves = np.zeros((len(corners), 8, WAVES, 2)) if waves is None else _float(waves)
    swells = np.zeros((len(corners), 4, SWELLS, 2)) if swells is None else _float(swells)
    found = _all_o(_float(nodes), corners, layers, _float(singular), _float(bulges), waves, swells, O_SIDES)
    return _judged(found, weights or Weights())


def judge_c(nodes: Float[np.ndarray, "l 2"], parameters: list[CParameters], weights: Weights | None = None) -> Judged:
    """Judge C-type meshes of one domain; raises `InputError` where the counts do not add up to its nodes."""
    if any(p.counts.boundary != len(nodes) for p in parameters):
        raise InputError("C-type template", f"the counts do not fit a boundary of {len(nodes)} nodes")
    start = np.array([p.start for p in parameters], np.int64)
    rims = np.array([p.counts.rim for p in parameters], np.int64)
    cells = np.array([[getattr(p.counts, kind) for _, _, kind in EDGES] for p in parameters], np.int64)
    singular = _float(np.array([p.singular for p in parameters]))
    bulges = _float(np.array([p.bulges for p in parameters]))
    return _judged(_all_c(_float(nodes), start, rims, cells, singular, bulges, ENDS, C_SIDES), weights or Weights())


def _float(array: np.ndarray) -> np.ndarray:
    return np.ascontiguousarray(array, np.float64)


def _judged(found: Float[np.ndarray, "b 4"], w: Weights) -> Judged:
    orthogonality, jacobian, penalty, least = found.T
    reward = w.quality * (w.orthogonality * orthogonality + w.jacobian * jacobian)
    return Judged(reward, penalty, least, orthogonality, jacobian)


def _compiled(function: Any) -> Any:
    return numba.njit(cache=True)(function)


@_compiled
def _defect(det: float, dot: float) -> float:
    """Return `|pi/2 - theta|` of a corner of a quad that is not valid; reflex angles in full."""
    theta = np.arctan2(det, dot)
    return abs(HALF_PI - (theta + 2 * np.pi if theta < 0 else theta))


@_compiled
def _quad(x: tuple, y: tuple, sums: np.ndarray) -> None:
    """Add orthogonality, Jacobian ratio and lack of one quad to `sums[:3]`; lower `sums[3]` to its least Jacobian."""
    ax, bx, cx, dx = x[1] - x[0], x[2] - x[1], x[3] - x[2], x[0] - x[3]
    ay, by, cy, dy = y[1] - y[0], y[2] - y[1], y[3] - y[2], y[0] - y[3]
    aa, bb, cc, dd = ax * ax + ay * ay, bx * bx + by * by, cx * cx + cy * cy, dx * dx + dy * dy
    det = (ay * dx - ax * dy, by * ax - bx * ay, cy * bx - cx * by, dy * cx - dx * cy)
    dot = (ax * dx + ay * dy, bx * ax + by * ay, cx * bx + cy * by, dx * cx + dy * cy)
    low, high = min(det[0], det[1], det[2], det[3]), max(det[0], det[1], det[2], det[3])
    if low > 0:
        first = max(dot[0] * dot[0] / (aa * dd), dot[1] * dot[1] / (bb * aa))
        second = max(dot[2] * dot[2] / (cc * bb), dot[3] * dot[3] / (dd * cc))
        sums[0] += 1 - np.arcsin(min(1.0, np.sqrt(max(first, second)))) / HALF_PI
        sums[1] += low / high
    else:
        first = max(_defect(det[0], -dot[0]), _defect(det[1], -dot[1]))
        second = max(_defect(det[2], -dot[2]), _defect(det[3], -dot[3]))
        sums[0] += 1 - max(first, second) / HALF_PI
    side = (np.sqrt(aa) + np.sqrt(bb) + np.sqrt(cc) + np.sqrt(dd)) / 4
    least = low / (side * side)
    sums[2] += max(LEAST_JACOBIAN - least, 0.0)
    sums[3] = min(sums[3], least)


@_compiled
def _block(  # noqa: PLR0917
    sides: np.ndarray, points: np.ndarray, share: np.ndarray, cells: np.ndarray, swell: np.ndarray, sums: np.ndarray
) -> int:
    """Add the quads of one transfinite block (`templates.tfi.transfinite`) to `sums`; return their number."""
    ids, ends = np.empty(4, np.int64), np.zeros(4, np.int64)
    for s in range(4):
        ids[s] = sides[s] if sides[s] >= 0 else ~sides[s]
        ends[s] = -1 if sides[s] >= 0 else cells[ids[s]]
    ni, nj = cells[ids[0]], cells[ids[2]]
    at, f = np.empty((4, max(ni, nj) + 1, 2)), np.empty((4, max(ni, nj) + 1))
    for s in range(4):
        for i in range((ni if s < 2 else nj) + 1):
            if ends[s] < 0:
                at[s, i], f[s, i] = points[ids[s], i], share[ids[s], i]
            else:
                at[s, i], f[s, i] = points[ids[s], ends[s] - i], 1 - share[ids[s], ends[s] - i]
    inwards = np.sin(np.linspace(0, np.pi, nj + 1))
    x, y = np.empty((2, nj + 1)), np.empty((2, nj + 1))
    for i in range(ni + 1):
        new = i % 2
        sx, sy = 0.0, 0.0
        for w in range(len(swell)):
            sine = np.sin((w + 1) * np.pi * i / ni)
            sx, sy = sx + swell[w, 0] * sine, sy + swell[w, 1] * sine
        for j in range(nj + 1):
            if j == 0:
                x[new, j], y[new, j] = at[0, i]
            elif j == nj:
                x[new, j], y[new, j] = at[1, i]
            elif i == 0:
                x[new, j], y[new, j] = at[2, j]
            elif i == ni:
                x[new, j], y[new, j] = at[3, j]
            else:
                shift, tilt = f[1, i] - f[0, i], f[3, j] - f[2, j]
                u = (f[0, i] + f[2, j] * shift) / (1.0 - shift * tilt)
                v = f[2, j] + u * tilt
                for axis in range(2):
                    ruled = (1 - v) * at[0, i, axis] + v * at[1, i, axis] + (1 - u) * at[2, j, axis]
                    low = (1 - v) * at[0, 0, axis] + v * at[1, 0, axis]
                    high = (1 - v) * at[0, ni, axis] + v * at[1, ni, axis]
                    value = ruled + u * at[3, j, axis] - ((1 - u) * low + u * high)
                    if axis == 0:
                        x[new, j] = value + sx * inwards[j]
                    else:
                        y[new, j] = value + sy * inwards[j]
        if i > 0:
            for j in range(nj):
                quad = (x[1 - new, j], x[new, j], x[new, j + 1], x[1 - new, j + 1])
                _quad(quad, (y[1 - new, j], y[new, j], y[new, j + 1], y[1 - new, j + 1]), sums)
    return int(ni * nj)


@_compiled
def _rim(nodes: np.ndarray, first: int, cells: int, points: np.ndarray, share: np.ndarray) -> None:
    """Fill `points` and `share` with the boundary nodes from `first` on and their fractions of arc length."""
    points[0], share[0] = nodes[first % len(nodes)], 0.0
    for i in range(1, cells + 1):
        points[i] = nodes[(first + i) % len(nodes)]
        share[i] = share[i - 1] + np.hypot(points[i, 0] - points[i - 1, 0], points[i, 1] - points[i - 1, 1])
    for i in range(1, cells + 1):
        share[i] /= share[cells]


@_compiled
def _edge(  # noqa: PLR0917
    start: np.ndarray, end: np.ndarray, bulge: np.ndarray, wave: np.ndarray, share: np.ndarray, points: np.ndarray
) -> None:
    """Fill `points` with an internal edge at the fractions `share` (`templates.curves.sample`)."""
    dx, dy = end[0] - start[0], end[1] - start[1]
    for i in range(len(share)):
        t = share[i]
        bow = 4 * t * (1 - t)
        height = bulge[0] * bow + bulge[1] * 1.5 * np.sqrt(3.0) * bow * (1 - 2 * t)
        points[i, 0] = (1 - t) * start[0] + t * end[0] - height * dy
        points[i, 1] = (1 - t) * start[1] + t * end[1] + height * dx
        for w in range(len(wave)):
            sine = np.sin((w + 1) * np.pi * t)
            points[i, 0] += wave[w, 0] * sine
            points[i, 1] += wave[w, 1] * sine


@_compiled
def _mean(  # noqa: PLR0917
    sides: np.ndarray, points: np.ndarray, share: np.ndarray, cells: np.ndarray, swells: np.ndarray, result: np.ndarray
) -> None:
    sums = np.zeros(4)
    sums[3] = np.inf
    count = 0
    for block in range(len(sides)):
        # blocks after the first may swell
        swell = swells[block - 1] if 0 < block <= len(swells) else np.empty((0, 2))
        count += _block(sides[block], points, share, cells, swell, sums)
    result[:3] = sums[:3] / count
    result[2] *= PENALTY
    result[3] = sums[3]


@_compiled
def _all_o(  # noqa: PLR0917
    nodes: np.ndarray,
    corners: np.ndarray,
    layers: np.ndarray,
    singular: np.ndarray,
    bulges: np.ndarray,
    waves: np.ndarray,
    swells: np.ndarray,
    sides: np.ndarray,
) -> np.ndarray:
    result = np.empty((len(corners), 4))
    size = max(len(nodes) // 2, layers.max() + 1 if len(layers) else 0)
    points, share, cells = np.empty((12, size, 2)), np.empty((12, size)), np.empty(12, np.int64)
    for b in range(len(corners)):
        i0, m, k = corners[b, 0], corners[b, 1], layers[b]
        n = len(nodes) // 2 - m
        first = i0 + len(nodes)
        for s in range(4):
            cells[s] = cells[8 + s] = m if s % 2 == 0 else n
            cells[4 + s] = k
            _rim(nodes, first, cells[s], points[s], share[s])
            first += cells[s]
            for r in range(k + 1):
                share[4 + s, r] = r / k
        for s in range(2):
            for i in range(cells[s] + 1):
                across = (share[s, i] + 1 - share[s + 2, cells[s] - i]) / 2
                share[8 + s, i] = across
                share[10 + s, cells[s] - i] = 1 - across
        for s in range(4):
            _edge(points[s, 0], singular[b, s], bulges[b, s], waves[b, s], share[4 + s, : k + 1], points[4 + s])
            ahead = singular[b, (s + 1) % 4]
            part = share[8 + s, : cells[s] + 1]
            _edge(singular[b, s], ahead, bulges[b, 4 + s], waves[b, 4 + s], part, points[8 + s])
        _mean(sides, points, share, cells, swells[b], result[b])
    return result


@_compiled
def _all_c(  # noqa: PLR0917
    nodes: np.ndarray,
    start: np.ndarray,
    rims: np.ndarray,
    inner: np.ndarray,
    singular: np.ndarray,
    bulges: np.ndarray,
    ends: np.ndarray,
    sides: np.ndarray,
) -> np.ndarray:
    result = np.empty((len(start), 4))
    size = len(nodes) + 1
    points, share, cells = np.empty((24, size, 2)), np.empty((24, size)), np.empty(24, np.int64)
    calm = np.empty((0, 2))
    for b in range(len(start)):
        vertex = np.empty((16, 2))
        for i in range(12):
            cells[i] = (rims[b, i + 1] if i < 11 else len(nodes)) - rims[b, i]
            vertex[i] = nodes[(start[b] + rims[b, i]) % len(nodes)]
            _rim(nodes, start[b] + rims[b, i], cells[i], points[i], share[i])
        vertex[12:] = singular[b]
        for e in range(12):
            cells[12 + e] = inner[b, e]
            for i in range(inner[b, e] + 1):
                share[12 + e, i] = i / inner[b, e]
            part = share[12 + e, : inner[b, e] + 1]
            _edge(vertex[ends[e, 0]], vertex[ends[e, 1]], bulges[b, e], calm[:0], part, points[12 + e])
        _mean(sides, points, share, cells, calm.reshape(0, 0, 2), result[b])
    return result
