"""Random plane domains: closed simple curves, smooth (standard) or with corners and notches (hard), evenly sampled.

The paper takes its domains from subdomains of engineering models (section 6.1.1, Fig. 9) that it does not publish;
these follow its description: various aspect ratios and curvatures with mild concavity, and, for the hard ones,
irregular boundaries and sharp inner angles.
"""

from collections.abc import Callable
from enum import Enum
from typing import Final, NamedTuple

import numpy as np
from jaxtyping import Float

from drl_meshgen.errors import InputError
from drl_meshgen.templates.domain import MIN_NODES, Domain, crossing_edges, signed_area

#: Points of a curve before it is sampled.
DENSE = 1440
#: Nodes further apart than this along the boundary (in spacings) must be `LEAST_GAP` apart in the plane.
AROUND = 6
#: Least distance between parts of the boundary that face one another, in spacings.
LEAST_GAP = 3.0
#: Draws before a generator is given up; a tenth of them is refused.
MOST_DRAWS = 1000

Curve = Float[np.ndarray, "n 2"]
Maker = Callable[[np.random.Generator], Curve]


class Difficulty(Enum):
    """Which generator a domain comes from."""

    STANDARD = "standard"
    HARD = "hard"


class Family(NamedTuple):
    """A kind of curve and how often it is drawn."""

    name: str
    share: float
    """Share of the domains of its difficulty; they sum to 1."""
    make: Maker
    """Draws a closed curve, about the size of the unit disk."""


def drawn_domain(difficulty: Difficulty, rng: np.random.Generator, count: int) -> tuple[Domain, str]:
    """Draw a domain of `count` evenly spaced nodes and the area of the unit disk, centred; and its family's name.

    Curves that cross themselves, or come nearer to themselves than `LEAST_GAP` spacings, are drawn again.

    Raises `InputError` for an odd count or fewer than `MIN_NODES`, and where no curve fits (a count far too small).
    """
    if count % 2 or count < MIN_NODES:
        raise InputError("random domain", f"{count} boundary nodes", f"take an even number, at least {MIN_NODES}")
    families = FAMILIES[difficulty]
    for _ in range(MOST_DRAWS):
        family = families[int(rng.choice(len(families), p=[one.share for one in families]))]
        curve = family.make(rng)
        curve = deformed(curve, rng) if difficulty is Difficulty.STANDARD else _turned(curve, rng)
        nodes = resampled(curve, count)
        if _is_fit(nodes):
            domain = Domain.oriented(nodes)
            return Domain(domain.frame.to_local(domain.nodes)), family.name
    raise InputError("random domain", f"no {difficulty.value} domain of {count} nodes in {MOST_DRAWS} draws")


def resampled(curve: Curve, count: int) -> Float[np.ndarray, "count 2"]:
    """Return `count` points at equal arc length on the closed polygon `curve`, its first point among them."""
    loop = np.concatenate([curve, curve[:1]])
    run = np.concatenate([[0.0], np.linalg.norm(np.diff(loop, axis=0), axis=1).cumsum()])
    at = run[-1] * np.arange(count) / count
    return np.stack([np.interp(at, run, axis) for axis in loop.T], axis=1)


def deformed(curve: Curve, rng: np.random.Generator) -> Curve:
    """Stretch by up to 2.6, bend, wave and swell a curve a little, then turn it; orientation stays."""
    curve = curve * np.sqrt(np.array([1.0, 1 / 2.6]) ** rng.uniform(0, 1))
    x, y = _turned(curve, rng).T
    y = y + rng.uniform(-0.35, 0.35) * x**2  # a banana
    x = x + rng.uniform(0, 0.08) * np.sin(rng.uniform(1.5, 4) * y + rng.uniform(0, 2 * np.pi))
    centre, reach = rng.uniform(-1, 1, 2), rng.uniform(0.4, 0.9)
    away = np.stack([x, y], axis=1) - centre
    swell = 1 + rng.uniform(-0.25, 0.25) * np.exp(-((away / reach) ** 2).sum(axis=1))
    return _turned(centre + away * swell[:, None], rng)


def _turned(curve: Curve, rng: np.random.Generator) -> Curve:
    """Turn a curve by any angle and start it anywhere."""
    c, s = np.cos(turn := rng.uniform(0, 2 * np.pi)), np.sin(turn)
    return np.roll(curve, int(rng.integers(len(curve))), axis=0) @ np.array([[c, s], [-s, c]])


def _is_fit(nodes: Float[np.ndarray, "l 2"]) -> bool:
    """Whether the polygon is simple, with room between parts of the boundary that face one another."""
    spacing = np.linalg.norm(np.roll(nodes, -1, axis=0) - nodes, axis=1)
    h = float(spacing.mean())
    apart = np.abs(np.subtract.outer(np.arange(len(nodes)), np.arange(len(nodes))))
    apart = np.minimum(apart, len(nodes) - apart)
    distance = np.linalg.norm(nodes[:, None] - nodes, axis=2)
    # a corner may bring nodes together, as far as its two sides do: no more than a quarter of the way around
    near = (distance < np.minimum(LEAST_GAP * h, apart * h / 4)) & (apart > AROUND)
    steady = spacing.min() > h / 2
    return bool(steady and not near.any() and abs(signed_area(nodes)) > 0 and not len(crossing_edges(nodes)))


def _angles() -> Float[np.ndarray, " n"]:
    return 2 * np.pi * np.arange(DENSE) / DENSE


def _polar(radius: Float[np.ndarray, " n"]) -> Curve:
    t = _angles()
    return radius[:, None] * np.stack([np.cos(t), np.sin(t)], axis=1)


def _superellipse(rng: np.random.Generator) -> Curve:
    """Return |x|^p + |y|^p = 1, between a diamond with round sides and a square with round corners."""
    t, p = _angles(), rng.uniform(1.5, 6.0)
    c, s = np.cos(t), np.sin(t)
    return np.stack([np.sign(c) * np.abs(c) ** (2 / p), np.sign(s) * np.abs(s) ** (2 / p)], axis=1)


def _fourier(low: int, high: int, height: float) -> Maker:
    """Return a maker of star-shaped curves: a circle with waves `low` to `high` around, together `height` at most."""

    def make(rng: np.random.Generator) -> Curve:
        orders = np.arange(low, high + 1)
        share = rng.dirichlet(np.ones(len(orders))) * height * rng.uniform(0.3, 1.0)
        phase = rng.uniform(0, 2 * np.pi, len(orders))
        return _polar(1 + np.cos(np.outer(_angles(), orders) + phase) @ share)

    return make


def _polygon(corners: tuple[int, int], radii: tuple[float, float], smooth: tuple[float, float]) -> Maker:
    """Return a maker of star-shaped polygons whose corners are rounded over a share `smooth` of the outline."""

    def make(rng: np.random.Generator) -> Curve:
        n = int(rng.integers(corners[0], corners[1] + 1))
        t = 2 * np.pi * (np.arange(n) + rng.uniform(-0.25, 0.25, n)) / n
        r = rng.uniform(*radii, n)
        return rounded(np.stack([r * np.cos(t), r * np.sin(t)], axis=1), rng.uniform(*smooth))

    return make


def rounded(corners: Float[np.ndarray, "k 2"], share: float) -> Curve:
    """Return the closed polygon, its corners rounded by averaging over this share of the outline (twice)."""
    curve = resampled(corners, DENSE)
    width = round(share * DENSE)
    if width < 2:
        return curve
    wave = np.fft.rfft(np.ones(width) / width, DENSE)[:, None] ** 2
    return np.fft.irfft(np.fft.rfft(curve, axis=0) * wave, DENSE, axis=0)


def _ell(rng: np.random.Generator) -> np.ndarray:
    a, b, c, d = rng.uniform(1.0, 1.8), rng.uniform(1.0, 1.8), rng.uniform(0.4, 0.7), rng.uniform(0.4, 0.7)
    return np.array([[0, 0], [a, 0], [a, d], [c, d], [c, b], [0, b]])


def _tee(rng: np.random.Generator) -> np.ndarray:
    a, b, c, d = rng.uniform(0.3, 0.6), rng.uniform(0.25, 0.45), rng.uniform(0.6, 1.2), rng.uniform(0.35, 0.6)
    e = rng.uniform(0.3, 0.6)
    return np.array([[-b, 0], [b, 0], [b, c], [b + e, c], [b + e, c + d], [-b - a, c + d], [-b - a, c], [-b, c]])


def _notch(rng: np.random.Generator) -> np.ndarray:
    a, b = rng.uniform(1.0, 1.6), rng.uniform(0.7, 1.2)
    width, depth, at = rng.uniform(0.12, 0.3), rng.uniform(0.2, 0.55) * b, rng.uniform(-0.3, 0.3)
    slant = rng.uniform(0.0, 0.15)
    notch = [[at + width + slant, b], [at + width, b - depth], [at - width, b - depth], [at - width - slant, b]]
    return np.array([[-a / 2 - 0.2, 0], [a / 2 + 0.2, 0], [a / 2 + 0.2, b], *notch, [-a / 2 - 0.2, b]])


def _angular(rng: np.random.Generator) -> Curve:
    """Return an L, a T or a notched block, its corners hardly rounded, sheared a little."""
    corners = (_ell, _tee, _notch)[int(rng.integers(3))](rng)
    shear = np.array([[1.0, 0.0], [rng.uniform(-0.25, 0.25), 1.0]])
    return rounded((corners - corners.mean(axis=0)) @ shear, rng.uniform(0.0, 0.02))


FAMILIES: Final[dict[Difficulty, tuple[Family, ...]]] = {
    Difficulty.STANDARD: (
        Family("superellipse", 0.30, _superellipse),
        Family("waves", 0.35, _fourier(2, 5, 0.35)),
        Family("round polygon", 0.35, _polygon((4, 7), (0.75, 1.2), (0.06, 0.14))),
    ),
    Difficulty.HARD: (
        Family("polygon", 0.45, _polygon((5, 9), (0.5, 1.2), (0.0, 0.03))),
        Family("steep waves", 0.25, _fourier(2, 7, 0.6)),
        Family("angular", 0.30, _angular),
    ),
}
