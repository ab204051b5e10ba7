"""A giraffe, open at the belly (x forward, y up, z to its right, metres)."""

import numpy as np
from jaxtyping import Float

from drl_meshgen.models.implicit import (
    Part,
    build,
    catmull_rom,
    distance_to_polyline,
    ellipsoid,
    frame,
    gauss,
    smooth_max,
    tube,
)
from drl_meshgen.models.sampling import Field, Solid, Zone

BELLY_CENTRE, BELLY_HALF_LENGTH, BELLY_HALF_WIDTH = -0.06, 0.30, 0.19
SIDES = (-1, 1)


def _torso() -> list[Part]:
    spine = [(-0.80, 2.56, 0), (-0.35, 2.53, 0), (0.12, 2.53, 0), (0.58, 2.66, 0)]
    return [
        Part(tube(spine, [0.37, 0.43, 0.475, 0.45], (1, 1, 1.18)), 0.22),
        Part(ellipsoid((0.45, 2.98, 0), (0.46, 0.30, 0.19)), 0.28),  # withers
        Part(ellipsoid((-0.84, 2.62, 0), (0.34, 0.27, 0.25)), 0.2),  # croup
        Part(ellipsoid((0.74, 2.50, 0), (0.30, 0.38, 0.24)), 0.2),  # chest
        Part(ellipsoid((0.05, 2.22, 0), (0.55, 0.22, 0.26)), 0.25),  # belly
    ]


MANE = [(0.42, 3.22, 0), (0.68, 3.52, 0), (0.93, 3.98, 0), (1.13, 4.42, 0), (1.30, 4.80, 0), (1.40, 5.05, 0)]


def _neck() -> list[Part]:
    nape = [(0.66, 2.86, 0), (0.90, 3.28, 0), (1.12, 3.75, 0), (1.30, 4.22, 0), (1.45, 4.66, 0), (1.53, 4.88, 0)]
    return [
        Part(tube(nape, [0.36, 0.262, 0.205, 0.170, 0.148, 0.138], (1, 1, 1.15)), 0.14),
        Part(tube([(0.95, 3.05, 0), (1.30, 3.85, 0), (1.50, 4.55, 0)], [0.15, 0.10, 0.09]), 0.12),  # throat
        Part(tube(MANE, [0.07, 0.085, 0.085, 0.08, 0.08, 0.06], (1, 1, 1.2)), 0.08),
    ]


def _ossicone(side: int) -> list[tuple[float, float, float]]:
    return [(1.60, 5.06, 0.075 * side), (1.555, 5.27, 0.098 * side), (1.53, 5.41, 0.105 * side)]


def _ear(side: int) -> tuple[np.ndarray, np.ndarray]:
    """Centre, and frame with the ear's length as second row and the opening of the ear as third."""
    return np.array([1.47, 5.05, 0.285 * side]), frame(np.array([-0.18, 0.14, 0.30 * side]), np.array([1, 0.1, 0]))


def _head() -> list[Part]:
    skull = [(1.52, 4.97, 0), (1.66, 4.97, 0), (1.90, 4.83, 0), (2.12, 4.69, 0)]
    parts = [
        Part(tube(skull, [0.165, 0.175, 0.125, 0.092], (1, 1, 1.1)), 0.10),
        Part(tube([(1.62, 4.83, 0), (1.86, 4.70, 0), (2.10, 4.60, 0)], [0.12, 0.085, 0.062]), 0.06),  # jaw
        Part(
            ellipsoid((2.16, 4.67, 0), (0.115, 0.085, 0.092), frame(np.array([1, -0.55, 0]), np.array([0, 0, 1]))), 0.05
        ),
        Part(ellipsoid((1.70, 5.08, 0), (0.14, 0.075, 0.09)), 0.06),  # forehead
    ]
    for side in SIDES:
        centre, axes = _ear(side)
        parts += [
            Part(ellipsoid((1.74, 4.99, 0.125 * side), (0.075, 0.06, 0.05)), 0.04),  # brow
            Part(ellipsoid((1.765, 4.985, 0.160 * side), (0.055, 0.048, 0.042)), 0.02),  # eye
            Part(tube(_ossicone(side), [0.058, 0.046, 0.058]), 0.05),
            Part(ellipsoid(centre, (0.085, 0.20, 0.050), axes), 0.05),
            Part(ellipsoid(centre + 0.055 * axes[2], (0.045, 0.13, 0.040), axes), 0.03, carve=True),
        ]
    return parts


def _fore_leg(side: int) -> list[tuple[float, float, float]]:
    stride = 0.16 * side
    return [
        (0.60, 2.55, 0.20 * side),
        (0.52 + 0.3 * stride, 2.02, 0.22 * side),
        (0.56 + stride, 1.16, 0.20 * side),
        (0.55 + 1.4 * stride, 0.34, 0.19 * side),
        (0.60 + 1.5 * stride, 0.16, 0.19 * side),
    ]


def _hind_leg(side: int) -> list[tuple[float, float, float]]:
    stride = -0.16 * side
    return [
        (-0.78, 2.42, 0.18 * side),
        (-0.60 + 0.3 * stride, 1.86, 0.22 * side),
        (-0.92 + stride, 1.20, 0.19 * side),
        (-0.84 + 1.2 * stride, 0.34, 0.18 * side),
        (-0.80 + 1.2 * stride, 0.16, 0.18 * side),
    ]


def _hoof(ankle: tuple[float, float, float], top: float, sole: float) -> Part:
    x, y, z = ankle
    return Part(tube([(x, y, z), (x + 0.035, -0.02, z)], [top, sole], pieces=1), 0.03)


def _legs() -> list[Part]:
    parts = []
    for side in SIDES:
        fore, hind = np.array(_fore_leg(side)), np.array(_hind_leg(side))
        parts += [
            Part(tube(_fore_leg(side), [0.30, 0.180, 0.104, 0.072, 0.078]), 0.08),
            Part(ellipsoid(fore[2] + (0.015, 0, 0), (0.112, 0.16, 0.108)), 0.06),  # knee
            Part(ellipsoid(fore[3] + (-0.02, -0.01, 0), (0.082, 0.11, 0.076)), 0.05),  # fetlock
            Part(ellipsoid((0.60, 2.45, 0.26 * side), (0.26, 0.42, 0.16)), 0.12),  # shoulder
            _hoof(_fore_leg(side)[4], 0.088, 0.135),
            Part(tube(_hind_leg(side), [0.36, 0.215, 0.092, 0.070, 0.076]), 0.08),
            Part(ellipsoid(hind[2] + (-0.02, 0.02, 0), (0.115, 0.15, 0.085)), 0.05),  # hock
            Part(ellipsoid(hind[3] + (-0.02, -0.01, 0), (0.078, 0.105, 0.072)), 0.05),
            Part(ellipsoid((-0.72, 2.25, 0.20 * side), (0.30, 0.44, 0.19)), 0.12),  # thigh
            _hoof(_hind_leg(side)[4], 0.084, 0.128),
        ]
    return parts


TAIL = [(-1.14, 2.66, 0), (-1.32, 2.48, 0), (-1.40, 2.1, 0), (-1.42, 1.72, 0), (-1.43, 1.48, 0), (-1.42, 1.22, 0)]


def _tail() -> list[Part]:
    return [Part(tube(TAIL, [0.095, 0.066, 0.052, 0.050, 0.082, 0.050]), 0.06)]


MOUTH = np.array([(1.93, 4.722), (2.08, 4.645), (2.19, 4.622), (2.27, 4.635)])


def _relief(points: Float[np.ndarray, "n 3"], blur: float) -> Float[np.ndarray, " n"]:
    """Height of surface detail: mouth line and nostrils, blurred to what the triangles can show."""

    def groove(distance: np.ndarray, width: float) -> np.ndarray:
        wide = np.hypot(width, blur)
        return width / wide * gauss(distance, wide)

    height = np.zeros(len(points))
    head = np.nonzero((points[:, 0] > 1.8) & (points[:, 1] > 4.4))[0]
    p = points[head]
    height[head] -= 0.016 * groove(distance_to_polyline(p[:, :2], MOUTH), 0.018)
    for side in SIDES:
        height[head] -= 0.022 * groove(np.linalg.norm(p - (2.24, 4.71, 0.058 * side), axis=1), 0.022)
    return height


PARTS = (*_torso(), *_neck(), *_head(), *_legs(), *_tail())


def _smooth(points: Float[np.ndarray, "n 3"], band: float) -> Float[np.ndarray, " n"]:
    return smooth_max(build([PARTS], points, band)[0], -points[:, 1], 0.04)  # soles on flat ground


def _detailed(blur: float) -> Field:
    return lambda points, band: _smooth(points, band) - _relief(points, blur)


def _opening(points: Float[np.ndarray, "n 3"]) -> Float[np.ndarray, " n"]:
    """Elliptic cylinder through the belly from below, as a distance-like field."""
    x = (points[:, 0] - BELLY_CENTRE) / BELLY_HALF_LENGTH
    z = points[:, 2] / BELLY_HALF_WIDTH
    radius = np.sqrt(x * x + z * z + 1e-12)
    return np.maximum((radius - 1) * BELLY_HALF_WIDTH, points[:, 1] - 2.4)


def _zones() -> tuple[Zone, ...]:
    zones = [Zone(np.array([(1.4, 4.95, 0), (2.2, 4.65, 0)]), 0.42, 0.75, 0.07)]  # head
    zones.append(Zone(np.array(MANE, float), 0.14, 0.8, 0.06))
    for leg in (_fore_leg, _hind_leg):
        zones += [Zone(np.array(leg(side)[2:], float), 0.26, 0.75, 0.06) for side in SIDES]
    zones.append(Zone(catmull_rom(np.array(TAIL, float)), 0.16, 0.5, 0.04))
    for side in SIDES:
        centre, axes = _ear(side)
        zones += [
            Zone(np.array([centre - 0.15 * axes[1], centre + 0.25 * axes[1]]), 0.13, 0.6, 0.04),
            Zone(np.array(_ossicone(side), float), 0.10, 0.5, 0.034),
        ]
    return tuple(zones)


def giraffe() -> Solid:
    """Four legs, tail, two ears, two ossicones and the muzzle: ten limbs; one opening under the belly."""
    return Solid((-1.75, -0.1, -0.65), (2.55, 5.6, 0.65), 18.0, _smooth, _detailed, _opening, _zones())
