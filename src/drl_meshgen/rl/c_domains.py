"""Random four-sided plane domains whose opposite sides have unequal counts: what C-type templates are for.

The paper does not publish its subdomains; these follow its description of them (section 5.1.1): topologically
quadrilateral, with many more nodes on one arc than on the one across.
"""

from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from typing import Final

import numpy as np
from jaxtyping import Float

from drl_meshgen.errors import InputError
from drl_meshgen.rl.datasets import Sample
from drl_meshgen.rl.domains import MOST_DRAWS
from drl_meshgen.templates.c_type import CCounts, CSides
from drl_meshgen.templates.domain import Domain, crossing_edges

#: Points of each side of a shape before it is divided.
DENSE: Final = 48
#: Least and greatest angle of a corner, in degrees.
CORNERS: Final = (35.0, 150.0)
TEST: Final = (7, 60)
"""Seed and size of Test-C."""
TEST_NAME: Final = "test-c"

Shape = Float[np.ndarray, "4 k 2"]
"""Sides of a four-sided shape, anti-clockwise; each begins with its corner and ends before the next."""


@dataclass(frozen=True, eq=False)
class FourSided:
    """A domain with four given corners; area of the unit disk, centred."""

    index: int
    family: str
    domain: Domain
    sides: CSides
    """Its node 0 is the bottom left corner."""


def _square() -> Float[np.ndarray, "4 k 2"]:
    t = np.arange(DENSE) / DENSE
    zero = np.zeros(DENSE)
    return np.stack([np.c_[t, zero], np.c_[zero + 1, t], np.c_[1 - t, zero + 1], np.c_[zero, 1 - t]])


def _trapezoid(rng: np.random.Generator, square: Shape) -> Shape:
    """Return straight sides: a wide bottom, a narrower top moved and tilted."""
    top, height, lean = rng.uniform(0.3, 1.0), rng.uniform(0.3, 1.2), rng.uniform(-0.3, 0.3)
    x, y = square[..., 0] - 0.5, square[..., 1]
    return np.stack([x * (1 - y + y * top) + lean * y, height * y * (1 + rng.uniform(-0.3, 0.3) * x)], axis=-1)


def _sector(rng: np.random.Generator, square: Shape) -> Shape:
    """Return a sector of an annulus, the longer arc at the bottom."""
    inner, angle = rng.uniform(0.25, 0.8), np.radians(rng.uniform(30, 200))
    radius = 1 - (1 - inner) * square[..., 1]
    phi = angle * (square[..., 0] - 0.5)
    return np.stack([radius * np.sin(phi), -radius * np.cos(phi)], axis=-1)


def _waved(rng: np.random.Generator, square: Shape) -> Shape:
    """Return a trapezoid whose sides wave, each by up to 8 % of itself."""
    shape = _trapezoid(rng, square)
    t = np.arange(DENSE) / DENSE
    ends = np.concatenate([shape[:, :1], np.roll(shape[:, :1], -1, axis=0)], axis=1)
    chord = ends[:, 1] - ends[:, 0]
    wave = np.sin(np.pi * np.outer(np.arange(1, 4), t))
    height = rng.uniform(-0.08, 0.08, (4, 3)) @ wave
    return shape + height[..., None] * np.stack([-chord[:, 1], chord[:, 0]], axis=-1)[:, None]


def _bent(rng: np.random.Generator, square: Shape) -> Shape:
    """Return a waved trapezoid on a banana."""
    x, y = np.moveaxis(_waved(rng, square), -1, 0)
    return np.stack([x, y + rng.uniform(-0.9, 0.9) * x**2], axis=-1)


FAMILIES: Final = (("trapezoid", _trapezoid), ("sector", _sector), ("waved", _waved), ("bent", _bent))


def drawn_shape(rng: np.random.Generator) -> tuple[Shape, str]:
    """Draw a shape, turned by any angle, its bottom at least as long as its top two times out of three, and its family.

    Shapes that cross themselves or have too sharp or blunt corners are drawn again; raises `InputError` if none fits.
    """
    for _ in range(MOST_DRAWS):
        name, make = FAMILIES[int(rng.integers(len(FAMILIES)))]
        shape = make(rng, _square())
        if rng.uniform() < 1 / 3:
            shape = np.roll(shape, 2, axis=0)
        c, s = np.cos(turn := rng.uniform(0, 2 * np.pi)), np.sin(turn)
        loop = shape.reshape(-1, 2)
        ahead, back = loop[1::DENSE] - loop[::DENSE], loop[np.arange(4) * DENSE - 1] - loop[::DENSE]
        angle = np.degrees(np.angle((ahead[:, 0] - 1j * ahead[:, 1]) * (back[:, 0] + 1j * back[:, 1])))
        if angle.min() > CORNERS[0] and angle.max() < CORNERS[1] and not len(crossing_edges(loop[:: DENSE // 12])):
            return shape @ np.array([[c, s], [-s, c]]), name
    raise InputError("random four-sided domain", f"no shape fits in {MOST_DRAWS} draws")


def _wide(shape: Shape) -> Float[np.ndarray, " 4"]:
    loop = shape.reshape(-1, 2)
    return np.linalg.norm(np.roll(loop, -1, axis=0) - loop, axis=1).reshape(4, -1).sum(axis=1)


def drawn_sides(rng: np.random.Generator, shape: Shape, boundary: int) -> CSides:
    """Draw numbers of cells, `boundary` (even, at least 24) together, about as the lengths of the sides ask for."""
    length = _wide(shape)
    side = (length[1] + length[3]) / 2 * np.exp(rng.normal(0, 0.3))
    half, ratio = boundary // 2, float(np.exp(-abs(rng.normal(0, 0.45))))
    rows = int(np.clip(round(half * side / (side + (length[0] + length[2]) / 2)), 2, half - 6))
    across = half - rows  # half of bottom and top
    absorbed = int(np.clip(round(across * (1 - ratio) / (1 + ratio)), 1, (across - 3)))
    return CSides(across + absorbed, rows, across - absorbed)


def drawn_counts(rng: np.random.Generator, sides: CSides) -> CCounts:
    """Draw what the sides leave open."""
    n = min(max(round(sides.top * rng.uniform(0.05, 0.85)), 1), sides.top - 2)
    q0 = min(max(round((sides.top - n) * rng.uniform(0.15, 0.85)), 1), sides.top - n - 1)
    below = min(max(round(sides.side * rng.uniform(0.1, 0.9)), 1), sides.side - 1)
    p = (sides.bottom - sides.top) // 2
    return CCounts(q0, p, n, sides.top - n - q0, below, sides.side - below)


def divided(rng: np.random.Generator, shape: Shape, sides: CSides) -> Float[np.ndarray, "l 2"]:
    """Return the nodes, of unit scale; on half of the shapes evenly spaced, else denser here and there on each side."""
    nodes, uneven = [], rng.uniform() < 0.5
    for s, cells in enumerate((sides.bottom, sides.side, sides.top, sides.side)):
        curve = np.concatenate([shape[s], shape[(s + 1) % 4, :1]])
        run = np.concatenate([[0.0], np.linalg.norm(np.diff(curve, axis=0), axis=1).cumsum()])
        t = np.arange(cells) / cells
        if uneven:
            order, height = int(rng.integers(1, 4)), rng.uniform(-0.6, 0.6)
            t = t + height * np.sin(np.pi * order * t) / (np.pi * order)
        nodes.append(np.stack([np.interp(run[-1] * t, run, axis) for axis in curve.T], axis=1))
    domain = np.concatenate(nodes)
    x, y = domain.T
    cross = x * np.roll(y, -1) - np.roll(x, -1) * y
    middle = domain.mean(axis=0)
    return (domain - middle) / np.sqrt(cross.sum() / 2 / np.pi)


def four_sided(seed: int, indices: Iterable[int], boundary: int | None = None) -> Iterator[FourSided]:
    """Draw domains, number i of a seed is the same whichever others are drawn; 24 to 400 nodes if None."""
    for i in indices:
        rng = np.random.default_rng([seed, i])
        shape, family = drawn_shape(rng)
        size = boundary or 2 * round(float(np.exp(rng.uniform(np.log(24), np.log(400)))) / 2)
        sides = drawn_sides(rng, shape, size)
        domain = Domain(divided(rng, shape, sides))
        yield FourSided(i, family, Domain(domain.frame.to_local(domain.nodes)), sides)


def samples_of_test(indices: Iterable[int] | None = None) -> Iterator[Sample]:
    """Draw Test-C, or some of it."""
    for one in four_sided(TEST[0], range(TEST[1]) if indices is None else indices):
        bottom, side, top = one.sides
        corners = (0, bottom, bottom + side, bottom + side + top)
        yield Sample(TEST_NAME, one.index, one.family, one.domain, corners=corners)
