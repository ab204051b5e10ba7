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

    @property
    def best(self) -> int:
        """The valid mesh of highest reward; where none is valid that of highest reward less penalty."""
        return self.preferred(0.0)

    def preferred(self, least: float) -> int:
        """Return the best mesh where its worst corner counts as well, by this weight; the reward knows means alone."""
        return int(np.lexsort((self.penalty - self.reward - least * self.least, ~self.valid))[0])


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
    # divisions by zero give what numpy gives: checking for them would keep loops from being vectorised
    return numba.njit(cache=True, error_model="numpy")(function)


@_compiled
def _arcsine(square: float) -> float:
    """Return the arc sine of the root of a number in [0, 1], without branches (the rational function of fdlibm)."""
    small = square < 0.25
    root = np.sqrt(square)
    t = square if small else 0.5 * (1 - root)
    over = 7.91534994289814532176e-04 + t * 3.47933107596021167570e-05
    over = 2.01212532134862925881e-01 + t * (-4.00555345006794114027e-02 + t * over)
    over = t * (1.66666666666666657415e-01 + t * (-3.25565818622400915405e-01 + t * over))
    under = 2.02094576023350569471e00 + t * (-6.88283971605453293030e-01 + t * 7.70381505559019352791e-02)
    under = 1 + t * (-2.40339491173441421878e00 + t * under)
    base = root if small else np.sqrt(t)
    value = base + base * (over / under)
    return value if small else HALF_PI - 2 * value


@_compiled
def _row(  # noqa: PLR0917
    x0: np.ndarray, y0: np.ndarray, x1: np.ndarray, y1: np.ndarray, figures: np.ndarray, low: np.ndarray
) -> None:
    """Write orthogonality, Jacobian ratio and least Jacobian of the quads between two lines, and the Jacobian itself.

    Free of branches, so that it is vectorised; orthogonality and ratio are right where the Jacobian is positive.
    """
    worst, ratio, least = figures[0], figures[1], figures[2]
    for j in range(len(low)):
        ax, bx, cx, dx = x1[j] - x0[j], x1[j + 1] - x1[j], x0[j + 1] - x1[j + 1], x0[j] - x0[j + 1]
        ay, by, cy, dy = y1[j] - y0[j], y1[j + 1] - y1[j], y0[j + 1] - y1[j + 1], y0[j] - y0[j + 1]
        aa, bb, cc, dd = ax * ax + ay * ay, bx * bx + by * by, cx * cx + cy * cy, dx * dx + dy * dy
        da, db, dc, de = ay * dx - ax * dy, by * ax - bx * ay, cy * bx - cx * by, dy * cx - dx * cy
        ea, eb, ec, ed = ax * dx + ay * dy, bx * ax + by * ay, cx * bx + cy * by, dx * cx + dy * cy
        # the larger squared cosine of two corners, compared without dividing
        p, q, r, s = ea * ea, eb * eb, ec * ec, ed * ed
        first = p * (bb * aa) > q * (aa * dd)
        p, q = (p if first else q), (aa * dd if first else bb * aa)
        second = r * (dd * cc) > s * (cc * bb)
        r, s = (r if second else s), (cc * bb if second else dd * cc)
        top = p * s > r * q
        square = (p if top else r) / (q if top else s)
        least_det, most_det = min(da, db, dc, de), max(da, db, dc, de)
        side = (np.sqrt(aa) + np.sqrt(bb) + np.sqrt(cc) + np.sqrt(dd)) / 4
        side = side if side > 0 else 1.0
        low[j] = least_det
        worst[j] = 1 - _arcsine(min(1.0, square)) / HALF_PI
        ratio[j] = least_det / most_det
        least[j] = least_det / (side * side)


@_compiled
def _folded(x: tuple, y: tuple) -> float:
    """Return the orthogonality of a quad that is not valid."""
    worst = 0.0
    for c in range(4):
        p, n = (c + 3) % 4, (c + 1) % 4
        ax, ay, bx, by = x[n] - x[c], y[n] - y[c], x[p] - x[c], y[p] - y[c]
        theta = np.arctan2(ax * by - ay * bx, ax * bx + ay * by)
        worst = max(worst, abs(HALF_PI - (theta + 2 * np.pi if theta < 0 else theta)))
    return 1 - worst / HALF_PI


@_compiled
def _line(  # noqa: PLR0917
    i: int, shape: tuple, f: np.ndarray, x: np.ndarray, y: np.ndarray, u: np.ndarray, v: np.ndarray, line: np.ndarray
) -> None:
    """Write line `i` of a transfinite block (`templates.tfi.transfinite`); `u` and `v` are room for as many numbers."""
    ni, nj = shape
    start, shift, low, high = f[0, i], f[1, i] - f[0, i], f[2], f[3]
    for j in range(nj + 1):
        tilt = high[j] - low[j]
        u[j] = (start + low[j] * shift) / (1.0 - shift * tilt)
        v[j] = low[j] + u[j] * tilt
    for side, values in ((x, line[0]), (y, line[1])):
        bottom, top, left, right = side[0, i], side[1, i], side[2], side[3]
        a, b, c, d = side[0, 0], side[1, 0], side[0, ni], side[1, ni]
        for j in range(nj + 1):
            s, t = u[j], v[j]
            ruled = (1 - t) * bottom + t * top + (1 - s) * left[j] + s * right[j]
            values[j] = ruled - ((1 - s) * ((1 - t) * a + t * b) + s * ((1 - t) * c + t * d))


@_compiled
def _block(  # noqa: PLR0917
    sides: np.ndarray, points: np.ndarray, share: np.ndarray, cells: np.ndarray, swell: np.ndarray, sums: np.ndarray
) -> int:
    """Add the quads of one transfinite block to `sums`: orthogonality, Jacobian ratio, lack; return their number.

    `sums[3]` falls to their least Jacobian. Lines run along the longer way, so that they are vectorised; across the
    block that mirrors its quads, which changes back where old and new line change places.
    """
    ids = np.where(sides >= 0, sides, ~sides)
    across = cells[ids[0]] > cells[ids[2]]
    ni, nj = min(cells[ids[0]], cells[ids[2]]), max(cells[ids[0]], cells[ids[2]])
    f, x, y = np.empty((4, nj + 1)), np.empty((4, nj + 1)), np.empty((4, nj + 1))
    for s in range(4):
        of = (s + 2) % 4 if across else s
        count = cells[ids[of]]
        for i in range(count + 1):
            at = i if sides[of] >= 0 else count - i
            x[s, i], y[s, i] = points[ids[of], at, 0], points[ids[of], at, 1]
            f[s, i] = share[ids[of], at] if sides[of] >= 0 else 1 - share[ids[of], at]
    shift, inwards = _swelling(swell, nj if across else ni, ni if across else nj)
    lines, u, v = np.empty((2, 2, nj + 1)), np.empty(nj + 1), np.empty(nj + 1)
    figures, low = np.empty((3, nj)), np.empty(nj)
    orthogonality, ratio, lack, least = 0.0, 0.0, 0.0, sums[3]
    for i in range(ni + 1):
        old, line = lines[1 - i % 2], lines[i % 2]
        _line(i, (ni, nj), f, x, y, u, v, line)
        for axis in range(2 if len(swell) else 0):
            for j in range(nj + 1):
                line[axis, j] += shift[axis, j] * inwards[i] if across else shift[axis, i] * inwards[j]
        # the ends exactly, as both blocks at a side have them
        line[0, 0], line[1, 0], line[0, nj], line[1, nj] = x[0, i], y[0, i], x[1, i], y[1, i]
        if i == 0 or i == ni:  # noqa: PLR1714 - compiled
            line[0], line[1] = x[2 if i == 0 else 3], y[2 if i == 0 else 3]
        if i == 0:
            continue
        first, second = (line, old) if across else (old, line)
        _row(first[0], first[1], second[0], second[1], figures, low)
        for j in range(nj):
            if low[j] > 0:
                orthogonality += figures[0, j]
                ratio += figures[1, j]
            else:
                quad = (first[0, j], second[0, j], second[0, j + 1], first[0, j + 1])
                orthogonality += _folded(quad, (first[1, j], second[1, j], second[1, j + 1], first[1, j + 1]))
            lack += max(LEAST_JACOBIAN - figures[2, j], 0.0)
            least = min(least, figures[2, j])
    sums[0] += orthogonality
    sums[1] += ratio
    sums[2] += lack
    sums[3] = least
    return int(ni * nj)


@_compiled
def _swelling(swell: np.ndarray, along: int, inwards: int) -> tuple[np.ndarray, np.ndarray]:
    """Return what a block swells by along itself, and the share of it that nodes inwards get."""
    shift, share = np.zeros((2, along + 1)), np.zeros(inwards + 1)
    if len(swell):
        for i in range(1, along):
            shift[0, i], shift[1, i] = _sines(swell, np.pi * i / along)
        for j in range(1, inwards):
            share[j] = np.sin(np.pi * j / inwards)
    return shift, share


@_compiled
def _sines(amplitudes: np.ndarray, angle: float) -> tuple[float, float]:
    """Return the sum of `amplitudes[w] sin((w + 1) angle)`, both coordinates."""
    x, y, before, sine, twice = 0.0, 0.0, 0.0, np.sin(angle), 2 * np.cos(angle)
    for w in range(len(amplitudes)):
        x, y = x + amplitudes[w, 0] * sine, y + amplitudes[w, 1] * sine
        before, sine = sine, twice * sine - before
    return x, y


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
        if len(wave):
            shift = _sines(wave, np.pi * t)
            points[i, 0] += shift[0]
            points[i, 1] += shift[1]


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
