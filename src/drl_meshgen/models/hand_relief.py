"""Skin relief of the hand: creases, nails, tendons, veins and palm lines as a height over the smooth shape.

Every mark is a bell or step across a curve. `blur` widens it as a convolution with a Gaussian would and
lowers it by the same factor, so that a coarse surface carries the detail its triangles can show and no more.
"""

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from jaxtyping import Float
from scipy.interpolate import RectBivariateSpline

from drl_meshgen.models.implicit import catmull_rom, distance_to_polyline, gauss, step_down


@dataclass(frozen=True, eq=False)
class Digit:
    """A finger or the thumb."""

    joints: Float[np.ndarray, "j 3"]
    """From the knuckle to the centre of the tip."""
    radii: Float[np.ndarray, " j"]
    back: Float[np.ndarray, " 3"]
    """Unit vector towards the nail."""
    root_crease: bool


VEINS = (
    [(-1.9, 1.2), (-1.6, 3.0), (-2.2, 4.6), (-1.9, 6.3), (-2.0, 8.0)],
    [(-1.6, 3.0), (-0.5, 4.4), (0.1, 6.2), (0.0, 8.3)],
    [(0.9, 0.6), (1.2, 2.6), (1.9, 4.4), (1.85, 6.2), (1.95, 8.2)],
    [(1.2, 2.6), (0.4, 3.6), (-0.5, 4.4)],
)
PALM_LINES = (
    ([(3.75, 7.0), (2.6, 6.9), (1.8, 6.1), (1.15, 4.6), (1.0, 3.0), (1.15, 1.5)], 0.098),
    ([(3.75, 7.05), (2.3, 7.1), (0.6, 6.4), (-1.2, 5.6), (-2.6, 4.9)], 0.083),
    ([(1.75, 8.75), (1.2, 8.1), (-0.2, 7.6), (-1.8, 7.3), (-3.6, 7.0)], 0.090),
    ([(0.1, 2.0), (0.2, 4.0), (0.4, 6.5)], 0.038),
)
KNUCKLES = ((2.95, 9.2), (0.95, 9.65), (-1.08, 9.2), (-2.95, 8.25))
MAP_X, MAP_Y, MAP_STEP = (-7.0, 9.0), (-2.0, 11.0), 0.06
TIP_FACTOR = 0.7  # triangles are smaller at the finger tips by this factor
WRINKLES = ((-0.42, 0.03), (-0.24, 0.045), (-0.08, 0.055), (0.1, 0.05), (0.28, 0.04), (0.46, 0.028))


@dataclass(frozen=True)
class _Brush:
    """Marks of a given width, blurred."""

    blur: float

    def line(self, distance: np.ndarray, width: float) -> np.ndarray:
        """Bell across a curve."""
        wide = np.hypot(width, self.blur)
        return width / wide * gauss(distance, wide)

    def step(self, x: np.ndarray, width: float) -> np.ndarray:
        """Step from 1 (negative `x`) to 0."""
        return step_down(x, np.hypot(width, self.blur))


@dataclass(frozen=True, eq=False)
class Skin:
    """The relief of a hand for a given blur."""

    digits: tuple[Digit, ...]
    blur: float
    """Marks are widened as if convolved with a bell of this width (model units)."""

    @cached_property
    def _maps(self) -> tuple[RectBivariateSpline, RectBivariateSpline]:
        """Back and palm as height maps over (x, y)."""
        x, y = np.arange(*MAP_X, MAP_STEP), np.arange(*MAP_Y, MAP_STEP)
        nodes = np.stack(np.meshgrid(x, y, indexing="ij"), axis=-1).reshape(-1, 2)
        brush = _Brush(self.blur)
        back, palm = (paint(brush, nodes).reshape(len(x), len(y)) for paint in (_back_of_hand, _palm_lines))
        return RectBivariateSpline(x, y, back), RectBivariateSpline(x, y, palm)

    def height(
        self, points: Float[np.ndarray, "n 3"], solid: Float[np.ndarray, " n"], digits: Float[np.ndarray, "d n"]
    ) -> Float[np.ndarray, " n"]:
        """Height at points near the surface, where the hand has the field `solid` and each digit `digits`."""
        brush, fine = _Brush(self.blur), _Brush(TIP_FACTOR * self.blur)
        height = np.zeros(len(points))
        close = np.nonzero(np.abs(solid) < 0.5)[0]
        x, y, z = points[close].T
        owner, distance = digits[:, close].argmin(axis=0), digits[:, close].min(axis=0)
        back, palm = self._maps
        height[close] = step_down(-z - 0.25, 0.25) * back(x, y, grid=False)
        height[close] += step_down(z + 0.35, 0.25) * step_down(0.45 - distance, 0.15) * palm(x, y, grid=False)
        wrist = brush.line(y + 0.15 + 0.006 * x**2, 0.09) + 0.7 * brush.line(y + 0.75 - 0.006 * x**2, 0.09)
        height[close] -= 0.035 * step_down(z + 0.1, 0.4) * wrist
        for d, digit in enumerate(self.digits):
            mine = close[(owner == d) & (distance < 1.0)]
            fade = step_down(digits[d, mine] - 0.6, 0.1)
            height[mine] += fade * (_creases(brush, digit, points[mine]) + _nail(fine, digit, points[mine]))
        return height * step_down(np.abs(solid) - 0.35, 0.05)


def _local(digit: Digit, origin: np.ndarray, along: np.ndarray, points: np.ndarray) -> tuple[np.ndarray, ...]:
    """Coordinates along the digit, across it and towards its back, from `origin`."""
    axis = along / np.linalg.norm(along)
    back = digit.back - axis * (digit.back @ axis)
    back /= np.linalg.norm(back)
    q = points - origin
    return q @ axis, q @ np.cross(axis, back), q @ back


def _creases(brush: _Brush, digit: Digit, points: Float[np.ndarray, "n 3"]) -> Float[np.ndarray, " n"]:
    """Flexion creases on the palm side of the joints, wrinkles on the back of them."""
    height = np.zeros(len(points))
    for i in range(1, len(digit.joints) - 1):
        radius = digit.radii[i]
        s, u, z = _local(digit, digit.joints[i], digit.joints[i + 1] - digit.joints[i - 1], points)
        u, z = u / radius, z / radius
        reach = gauss(s, 1.6 * radius) * step_down(np.sqrt(s**2 + (u * radius) ** 2) - 2.0, 0.1)
        palmar, dorsal = step_down(z + 0.15, 0.25) * reach, step_down(0.35 - z, 0.2) * reach
        if i == 1:
            height -= palmar * 0.06 * brush.line(s - 0.05 + 0.05 * u * u, 0.085)
            height -= palmar * 0.04 * brush.line(s + 0.24 - 0.04 * u * u, 0.075)
        else:
            height -= palmar * 0.055 * brush.line(s + 0.03 * u * u, 0.08)
        for at, depth in WRINKLES:
            bow = 0.10 * u * u * np.sign(at)
            deep = depth * (1.0 if i == 1 else 0.7)
            height -= dorsal * deep * brush.line(s - 1.1 * at * radius - bow, 0.05) * gauss(u, 0.75)
    if digit.root_crease:
        bone = digit.joints[1] - digit.joints[0]
        s, _, z = _local(digit, digit.joints[0], bone, points)
        height -= step_down(z + 0.2, 0.2) * 0.055 * brush.line(s - 0.47 * np.linalg.norm(bone), 0.085)
    return height


def _nail(brush: _Brush, digit: Digit, points: Float[np.ndarray, "n 3"]) -> Float[np.ndarray, " n"]:
    """Raise a plate with a groove and a fold around it."""
    radius = digit.radii[-1]
    s, u, z = _local(digit, digit.joints[-1], digit.joints[-1] - digit.joints[-2], points)
    half, start, end = 0.78 * radius, -0.85 * radius, 0.78 * radius
    taper = 1 - 0.10 * ((s - start) / (end - start) - 0.5)
    outline = np.maximum(
        np.abs(u) - half * taper, np.maximum(start + 0.21 * radius * (u / half) ** 2 - s, s - end)
    )  # negative inside the plate
    top = step_down(0.18 * radius - z, 0.06)
    behind = step_down(s - end + 0.15, 0.05)
    plate = 0.075 * brush.step(outline, 0.035)
    groove = 0.06 * brush.line(outline - 0.05, 0.06) * behind
    under_edge = 0.04 * brush.line(s - end - 0.03, 0.07) * step_down(np.abs(u) - half, 0.05)
    fold = 0.04 * brush.line(outline - 0.18, 0.10) * behind
    return top * (plate - groove - under_edge + fold)


def _back_of_hand(brush: _Brush, xy: Float[np.ndarray, "n 2"]) -> Float[np.ndarray, " n"]:
    """Tendons and veins."""
    y = xy[:, 1]
    height = np.zeros(len(xy))
    for knuckle_x, knuckle_y in KNUCKLES:
        tendon = np.array([(knuckle_x * 0.42, 1.8), (knuckle_x * 0.97, knuckle_y - 0.3)])
        span = np.clip((y - 1.5) / 5, 0, 1) * np.clip((knuckle_y - 0.1 - y) / 1.2, 0, 1)
        height += 0.09 * brush.line(distance_to_polyline(xy, tendon), 0.30) * span
    for vein in VEINS:
        height += 0.055 * brush.line(distance_to_polyline(xy, catmull_rom(np.array(vein), 8)), 0.15)
    return height


def _palm_lines(brush: _Brush, xy: Float[np.ndarray, "n 2"]) -> Float[np.ndarray, " n"]:
    """Lines of the palm, as negative heights."""
    height = np.zeros(len(xy))
    for line, depth in PALM_LINES:
        height -= depth * brush.line(distance_to_polyline(xy, catmull_rom(np.array(line), 8)), 0.14)
    return height
