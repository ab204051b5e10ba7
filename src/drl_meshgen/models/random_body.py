"""Random implicit bodies: a blob or a ring with limbs, arches and openings. The body's radius is about 1."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from drl_meshgen.models.implicit import Part, Tube, build, ellipsoid, tube

FEWEST_LIMBS, MOST_LIMBS, MOST_ARCHES, MOST_OPENINGS = 2, 12, 3, 6
RING = 0.15
"""Share of bodies that are rings."""
SIDES = 48
"""Corners of a ring's centre line."""


@dataclass(frozen=True, eq=False)
class Cut:
    """One opening: what lies inside a ball, or of that only the part beyond a plane through its centre."""

    centre: Float[np.ndarray, " 3"]
    radius: float
    beyond: Float[np.ndarray, " 3"] | None = None
    """Unit vector across the plane, None for the whole ball."""

    def __call__(self, points: Float[np.ndarray, "n 3"]) -> Float[np.ndarray, " n"]:
        """Return a field that is negative inside the opening."""
        away = points - self.centre
        ball = np.linalg.norm(away, axis=1) - self.radius
        return ball if self.beyond is None else np.maximum(ball, -away @ self.beyond)


@dataclass(frozen=True, eq=False)
class Body:
    """An implicit solid with the openings to be cut in its surface."""

    parts: tuple[Part, ...]
    limbs: int
    cuts: tuple[Cut, ...]
    waves: Float[np.ndarray, "w 5"]
    """Wave vector, phase and height of each wave of the surface."""

    @property
    def bounds(self) -> tuple[np.ndarray, np.ndarray]:
        """Box around the solid."""
        low, high = zip(*(part.solid.bounds for part in self.parts), strict=True)
        return np.min(low, axis=0) - 0.4, np.max(high, axis=0) + 0.4

    def field(self, points: Float[np.ndarray, "n 3"], band: float) -> Float[np.ndarray, " n"]:
        """Return the solid's field, negative inside."""
        value = build([self.parts], points, band)[0]
        return value + np.sin(points @ self.waves[:, :3].T + self.waves[:, 3]) @ self.waves[:, 4]

    def opening(self, points: Float[np.ndarray, "n 3"]) -> Float[np.ndarray, " n"]:
        """Return the field of all openings, negative inside any."""
        value = np.full(len(points), np.inf)
        for cut in self.cuts:
            value = np.minimum(value, cut(points))
        return value


@dataclass(frozen=True, eq=False)
class _Slot:
    """A place on the body where something can grow, away from the other slots."""

    root: Float[np.ndarray, " 3"]
    outward: Float[np.ndarray, " 3"]


def _unit(vector: np.ndarray) -> Float[np.ndarray, " 3"]:
    return vector / np.linalg.norm(vector)


def _across(vector: np.ndarray, rng: np.random.Generator) -> Float[np.ndarray, " 3"]:
    """Return a random unit vector across a unit vector."""
    drawn = rng.normal(size=3)
    return _unit(drawn - (drawn @ vector) * vector)


def _blob(slots: int, rng: np.random.Generator) -> tuple[list[Part], list[_Slot]]:
    """Draw one to three overlapping ellipsoids; slots along a spiral over the sphere."""
    parts = []
    for k in range(int(rng.integers(1, 4))):
        centre = rng.uniform(-0.4, 0.4, 3) * (k > 0)
        parts.append(Part(ellipsoid(centre, tuple(rng.uniform(0.65, 1.4, 3))), 0.4))
    height = 1 - 2 * (np.arange(slots) + 0.5) / slots
    longitude = np.pi * (1 + np.sqrt(5)) * np.arange(slots) + rng.uniform(0, 2 * np.pi)
    radius = np.sqrt(1 - height**2)
    outward = np.c_[radius * np.cos(longitude), radius * np.sin(longitude), height]
    return parts, [_Slot(0.4 * direction, direction) for direction in outward]


def _ring(slots: int, rng: np.random.Generator) -> tuple[list[Part], list[_Slot]]:
    """Draw a torus, thick enough to carry limbs; slots around it, tilted up and down by turns."""
    angle = 2 * np.pi * np.arange(SIDES + 1) / SIDES
    circle = np.c_[np.cos(angle), np.sin(angle), np.zeros(SIDES + 1)]
    radius, thick = rng.uniform(1.3, 1.8), rng.uniform(0.35, 0.5)
    parts = [Part(Tube(radius * circle, np.full(SIDES + 1, thick), np.ones(3)), 0.2)]
    found = []
    for k in range(slots):
        turn = 2 * np.pi * (k + 0.5) / slots
        around, tilt = np.array([np.cos(turn), np.sin(turn), 0.0]), np.radians(50) * (-1) ** k
        found.append(_Slot(radius * around, np.cos(tilt) * around + np.sin(tilt) * np.array([0.0, 0.0, 1.0])))
    return parts, found


def _limb(slot: _Slot, rng: np.random.Generator) -> Tube:
    """Draw a bent tube that tapers, sometimes with a knob at its end."""
    length, bend = rng.uniform(1.2, 3.0), rng.uniform(0, 0.35)
    thick, thin = rng.uniform(0.2, 0.34), rng.uniform(0.14, 0.2)
    share = np.linspace(0, 1, 4)
    side = _across(slot.outward, rng)
    axis = slot.root + length * (share[:, None] * slot.outward + bend * share[:, None] ** 2 * side)
    radii = thick + (thin - thick) * share
    radii[-1] *= rng.choice([1.0, 1.0, 1.8])
    return tube(list(axis), list(radii), pieces=6)


def _arch(first: _Slot, second: _Slot, rng: np.random.Generator) -> Tube:
    """Draw a tube from one slot to another that stays clear of the body in between: one more handle."""
    reach, thick = rng.uniform(1.5, 1.9), rng.uniform(0.17, 0.24)
    a, b = first.root + reach * first.outward, second.root + reach * second.outward
    return tube([first.root, a, b, second.root], [thick] * 4, pieces=8)


def _tip_cut(limb: Tube, rng: np.random.Generator) -> Cut:
    """Cut the end off a limb, somewhere in its outer half."""
    n = len(limb.axis)
    k = int(rng.integers(n // 2, n - 1))
    left = np.linalg.norm(np.diff(limb.axis[k:], axis=0), axis=1).sum()
    return Cut(limb.axis[k], left + 3 * limb.radii[k:].max(), _unit(limb.axis[k + 1] - limb.axis[k]))


def _hole(parts: Sequence[Part], slot: _Slot, rng: np.random.Generator) -> Cut:
    """Cut a round hole where the ray of a slot leaves the body."""
    along = np.linspace(0, 3, 121)
    inside = build([parts], slot.root + along[:, None] * slot.outward, 3.0)[0] < 0
    return Cut(slot.root + along[np.nonzero(inside)[0].max()] * slot.outward, rng.uniform(0.15, 0.45))


def drawn_body(rng: np.random.Generator, *, closed: bool) -> Body:
    """Draw a body: 2 to 12 limbs, 0 to 3 arches, 1 to 6 openings (none where `closed`), waves on its surface."""
    limbs = int(rng.integers(FEWEST_LIMBS, MOST_LIMBS + 1))
    arches = int(rng.choice(MOST_ARCHES + 1, p=[0.55, 0.25, 0.12, 0.08]))
    openings = 0 if closed else int(rng.integers(1, MOST_OPENINGS + 1))
    holes = int(rng.integers(max(0, openings - limbs), openings + 1))
    shape = _ring if rng.random() < RING else _blob
    parts, slots = shape(limbs + 2 * arches + holes, rng)
    core = tuple(parts)
    order = [int(k) for k in rng.permutation(len(slots))]
    for _ in range(arches):
        first = order.pop(0)
        nearest = min(order, key=lambda k: -slots[first].outward @ slots[k].outward)
        order.remove(nearest)
        parts.append(Part(_arch(slots[first], slots[nearest], rng), 0.1))
    grown = [_limb(slots[k], rng) for k in order[:limbs]]
    parts += [Part(limb, rng.uniform(0.05, 0.3)) for limb in grown]
    cuts = [_tip_cut(limb, rng) for limb in grown[: openings - holes]]
    cuts += [_hole(core, slots[k], rng) for k in order[limbs:]]
    waves = np.c_[rng.normal(0, 3, (4, 3)), rng.uniform(0, 2 * np.pi, 4), rng.uniform(0, 0.015, 4)]
    return Body(tuple(parts), limbs, tuple(cuts), waves)
