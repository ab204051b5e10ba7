"""A right hand, open at the wrist (centimetres; y towards the finger tips, z dorsal, thumb at +x)."""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from drl_meshgen.models.hand_relief import TIP_FACTOR, Digit, Skin
from drl_meshgen.models.implicit import Part, build, ellipsoid, frame, smooth_min, tube
from drl_meshgen.models.sampling import Field, Solid, Zone

WRIST = -4.4  # height of the cut


@dataclass(frozen=True)
class _Finger:
    """Proportions of one finger."""

    knuckle: tuple[float, float, float]
    spread: float
    """Degrees, positive away from the thumb."""
    flexion: tuple[float, float, float]
    """Degrees at the three joints."""
    phalanges: tuple[float, float, float]
    radii: tuple[float, float, float, float]
    metacarpal_radii: tuple[float, float, float, float] = (1.45, 1.22, 1.04, 0.86)


FINGERS = (
    _Finger((2.95, 9.2, 0.05), -7, (6, 10, 6), (4.1, 2.5, 1.65), (0.97, 0.92, 0.83, 0.70)),
    _Finger((0.95, 9.65, 0.22), -1, (4, 9, 6), (4.5, 2.85, 1.75), (1.0, 0.95, 0.85, 0.72)),
    _Finger((-1.08, 9.2, 0.12), 5, (7, 11, 6), (4.15, 2.65, 1.75), (0.94, 0.89, 0.80, 0.68)),
    _Finger((-2.95, 8.25, -0.15), 14, (9, 12, 6), (3.3, 2.0, 1.5), (0.83, 0.76, 0.69, 0.59), (1.4, 1.12, 0.93, 0.76)),
)
THUMB = np.array([(2.05, 1.5, -0.75), (4.55, 4.85, -1.75), (6.1, 7.6, -2.1), (7.0, 9.2, -2.15)])
DORSAL = np.array([0.0, 0.0, 1.0])


def rotate(vector: np.ndarray, axis: np.ndarray, degrees: float) -> Float[np.ndarray, " 3"]:
    """Rotate about a unit axis (Rodrigues' formula)."""
    a = np.radians(degrees)
    return vector * np.cos(a) + np.cross(axis, vector) * np.sin(a) + axis * (axis @ vector) * (1 - np.cos(a))


def _digits() -> list[Digit]:
    """Four fingers, then the thumb: joint positions by forward kinematics."""
    digits = []
    for finger in FINGERS:
        direction = rotate(np.array([0.0, 1.0, 0.0]), DORSAL, finger.spread)
        hinge = rotate(np.array([1.0, 0.0, 0.0]), DORSAL, finger.spread)
        joints = [np.array(finger.knuckle)]
        for bend, length in zip(finger.flexion, finger.phalanges, strict=True):
            direction = rotate(direction, hinge, -bend)
            joints.append(joints[-1] + direction * length)
        back = rotate(DORSAL, hinge, -0.5 * sum(finger.flexion))
        digits.append(Digit(np.array(joints), np.array(finger.radii), back, root_crease=True))
    back = np.array([0.50, -0.28, 0.82])
    digits.append(Digit(THUMB[1:], np.array([1.10, 0.98, 0.80]), back / np.linalg.norm(back), root_crease=False))
    return digits


def _palm() -> list[Part]:
    wrist = [(0.1, -6.5, 0), (0.1, -1.6, 0), (0.1, -0.4, -0.03), (0.1, 0.8, -0.05)]
    parts = [Part(tube(wrist, [2.85, 2.55, 2.5, 2.6], (1, 1, 1.36)), 0.5)]
    for finger in FINGERS:
        knuckle = np.array(finger.knuckle)
        heading = np.radians(-finger.spread)
        ray = [
            (knuckle[0] * 0.50, 0.5, -0.15),
            np.add(knuckle, (-knuckle[0] * 0.1, -3.0, -0.1)),
            np.add(knuckle, (0, -0.3, -0.16)),
            np.add(knuckle, (np.sin(heading) * 1.1, 1.05, -0.38)),
        ]
        parts.append(Part(tube(ray, list(finger.metacarpal_radii)), 0.9))
    parts += [
        Part(
            ellipsoid((-2.7, 3.7, -1.05), (1.2, 3.2, 1.35), frame(np.array([-0.05, 1, 0]), DORSAL)), 0.9
        ),  # hypothenar
        Part(ellipsoid((2.9, 3.2, -1.5), (1.6, 2.8, 1.55), frame(THUMB[1] - THUMB[0], DORSAL)), 1.0),  # thenar
        Part(ellipsoid((0.1, 5.3, -3.35), (1.9, 3.1, 2.0)), 1.2, carve=True),  # hollow
        Part(tube([THUMB[0], THUMB[1]], [1.45, 1.16], pieces=1), 0.9),
        Part(ellipsoid((3.6, 6.3, -0.55), (1.2, 1.6, 0.55), frame(np.array([1, 1.4, -0.4]), DORSAL)), 0.9),  # web
    ]
    parts += [Part(ellipsoid(np.add(f.knuckle, (0, -0.15, 0.52)), (0.46, 0.62, 0.42)), 0.45) for f in FINGERS]
    return [*parts, Part(ellipsoid((-1.65, -1.4, 0.80), (0.55, 0.8, 0.52)), 0.9)]  # ulnar head


def _digit_parts(digit: Digit) -> list[Part]:
    """Sleeve along the bones, pads on the palm side, joints and the tip."""
    joints, radii = digit.joints, digit.radii
    first = joints[1] - joints[0]
    root = joints[0] - first / np.linalg.norm(first) - 0.3 * digit.back
    sleeve = tube([root, *joints], [radii[0] * 0.86, radii[0] * 0.93, *radii[1:]], pieces=8)
    parts = [Part(sleeve, 0.04)]
    last = len(joints) - 2
    for i in range(last + 1):
        bone = joints[i + 1] - joints[i]
        axes = frame(bone, digit.back)
        back = axes[2] * np.sign(axes[2] @ digit.back)
        length, radius = np.linalg.norm(bone), radii[i : i + 2].mean()
        along, half = (0.66, 0.62) if i == last else (0.52, 0.44)
        pad = joints[i] + along * bone - 0.40 * radius * back
        parts.append(Part(ellipsoid(pad, (0.84 * radius, half * length, 0.76 * radius), axes), 0.22))
        if i > 0:
            parts.append(
                Part(ellipsoid(joints[i] + 0.03 * radii[i] * back, (1.02 * radii[i], radii[i], radii[i]), axes), 0.20)
            )
        if i == last:
            tip = radii[-1]
            parts.append(Part(ellipsoid(joints[-1], (1.10 * tip, 1.1 * tip, 0.84 * tip), axes), 0.12))
    return parts


DIGITS = tuple(_digits())
PALM_PARTS = tuple(_palm())
DIGIT_PARTS = tuple(tuple(_digit_parts(digit)) for digit in DIGITS)
WEBS = (0.45, 0.45, 0.45, 0.45, 0.7)  # blend width of each digit with the palm


def _fields(points: Float[np.ndarray, "n 3"], band: float) -> tuple[Float[np.ndarray, " n"], Float[np.ndarray, "d n"]]:
    """Field of the hand without relief and of each digit alone."""
    palm, *digits = build([PALM_PARTS, *DIGIT_PARTS], points, band + max(WEBS))
    return np.min([smooth_min(palm, d, web) for d, web in zip(digits, WEBS, strict=True)], axis=0), np.stack(digits)


def _smooth(points: Float[np.ndarray, "n 3"], band: float) -> Float[np.ndarray, " n"]:
    return _fields(points, band)[0]


def _detailed(blur: float) -> Field:
    skin = Skin(DIGITS, blur)

    def field(points: Float[np.ndarray, "n 3"], band: float) -> Float[np.ndarray, " n"]:
        solid, digits = _fields(points, band)
        return solid - skin.height(points, solid, digits)

    return field


def _opening(points: Float[np.ndarray, "n 3"]) -> Float[np.ndarray, " n"]:
    return points[:, 1] - WRIST


def hand() -> Solid:
    """Five digits and the wrist: five limbs and one opening, cut by a plane."""
    zones = tuple(Zone(np.array([d.joints[-2], d.joints[-1]]), 1.5, TIP_FACTOR, 0.45) for d in DIGITS)
    return Solid((-6.4, WRIST - 0.6, -4.3), (9.2, 20.6, 3.4), 470.0, _smooth, _detailed, _opening, zones)
