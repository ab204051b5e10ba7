"""Pictures of the place where something is wrong: the whole in grey with the place in red, beside it a close-up."""

import numpy as np
from jaxtyping import Bool, Float, Int
from PIL import Image as Pillow
from PIL import ImageDraw
from scipy.spatial import KDTree

from drl_meshgen.errors import Place
from drl_meshgen.mesh import QuadMesh
from drl_meshgen.quality import GateOptions, QuadShape
from drl_meshgen.quality.shape import unit
from drl_meshgen.report import palette
from drl_meshgen.report.pictures import MARGIN, Image, Scene
from drl_meshgen.report.view import View, view_from

SIDE = 480
"""Longer side of either half, pixels."""
WORST = 200
"""At most so many of the worst quads are shown (count)."""
_SAME = 1e-9
"""Points this close are one (fraction of the diagonal)."""
_EDGES_AROUND = 5.0
"""Half the width of a close-up, in mean lengths of the edges at its middle, at least."""
_LARGEST = 0.2
"""Half the width of a close-up, at most (fraction of the diagonal)."""
_NEAR = 0.02
"""Points and faces this close belong to one place (fraction of the diagonal)."""
_BALLS = 60
"""Up to so many points are marked by balls (count); more show by their faces."""
_IN_FRONT = 0.7
"""What is so far in front of a close-up is left out (half its width)."""
_CIRCLE = 10
"""Least radius of the circle around the place, pixels."""


def worst_quads(mesh: QuadMesh, shape: QuadShape, options: GateOptions | None = None) -> Place:
    """Return the quads that the quality gate objects to, at most `WORST`, worst first; the worst where there are none.

    Structural defects have no quads of their own.
    """
    options = options or GateOptions()
    bad = ~shape.valid | (shape.min_angle <= options.min_angle) | (shape.max_angle >= options.max_angle)
    chosen = shape.worst(max(1, min(WORST, int(bad.sum()))))
    return Place(shape.corners[chosen].mean(axis=1), mesh.points, mesh.quads)


def draw_place(place: Place, *, side: int = SIDE) -> Image:
    """Draw the surface with the faces at the points in red, and beside it what is around the first of their clusters.

    A surface need be neither manifold nor oriented. Parts that would hide the place are left out of the close-up.
    Raises ValueError where there is no point.
    """
    if not len(place.points):
        raise ValueError("a place needs a point")
    ids, faces = np.unique(place.faces, return_inverse=True)
    vertices, faces = np.asarray(place.vertices, float)[ids], faces.reshape(place.faces.shape)
    diagonal = float(np.linalg.norm(np.ptp(vertices, axis=0)))
    centres = vertices[faces].mean(axis=1)
    red = _faces_at(place.points, vertices, faces, diagonal)
    focus = _focus(place.points, diagonal)
    around = _reach(vertices[faces[red]], focus, diagonal)
    whole = view_from(vertices, _outward(vertices, faces, focus, diagonal))
    in_front = (centres - focus) @ whole.direction > _IN_FRONT * around
    near = red | (np.linalg.norm(centres - focus, axis=1) < 2 * around) & ~in_front
    close = View(whole.direction, whole.up, focus, around, around)
    balls = place.points if len(place.points) <= _BALLS else place.points[:0]
    left = _circled(_shot(whole, vertices, faces, red, balls, side=side, lines=0.0), whole, focus, around)
    right = _shot(close, vertices, faces[near], red[near], balls, side=side, lines=0.8)
    return _beside(left, right)


def _faces_at(
    points: Float[np.ndarray, "n 3"], vertices: np.ndarray, faces: np.ndarray, diagonal: float
) -> Bool[np.ndarray, " f"]:
    """Faces with as many corners among the points as any face has; where none has one, the nearest faces."""
    at = np.zeros(len(vertices), bool)
    at[KDTree(points).query(vertices)[0] <= _SAME * diagonal] = True
    there = at[faces].sum(axis=1)
    if there.any():
        return there == there.max()
    red = np.zeros(len(faces), bool)
    red[KDTree(vertices[faces].mean(axis=1)).query(points)[1]] = True
    return red


def _focus(points: Float[np.ndarray, "n 3"], diagonal: float) -> Float[np.ndarray, " 3"]:
    """Return the point with the most others near it, the first of these."""
    counts = KDTree(points).query_ball_point(points, _NEAR * diagonal, return_length=True)
    return points[int(np.argmax(counts))]


def _reach(red: Float[np.ndarray, "r k 3"], focus: Float[np.ndarray, " 3"], diagonal: float) -> float:
    """Return half the width of the close-up, which shows several edges, and the red faces near its middle."""
    away = np.linalg.norm(red.mean(axis=1) - focus, axis=1)
    corners = red[away.argmin()]
    edge = float(np.linalg.norm(corners - np.roll(corners, 1, axis=0), axis=1).mean())
    cluster = float(away[away < 2 * _EDGES_AROUND * edge].max(initial=0.0))
    return float(np.clip(max(_EDGES_AROUND * edge, 1.5 * cluster), _SAME * diagonal, _LARGEST * diagonal))


def _outward(
    vertices: Float[np.ndarray, "v 3"], faces: Int[np.ndarray, "f k"], focus: Float[np.ndarray, " 3"], diagonal: float
) -> Float[np.ndarray, " 3"]:
    """Return a direction from which the place is seen: the mean normal there, away from the middle of the surface."""
    corners = vertices[faces]
    away = np.linalg.norm(corners.mean(axis=1) - focus, axis=1)
    near = corners[away <= max(_NEAR * diagonal, float(away.min()))]
    normal = np.cross(near[:, 1] - near[:, 0], near[:, 2] - near[:, 0]).sum(axis=0)
    outward = focus - vertices.mean(axis=0)
    direction = unit(normal if normal @ outward >= 0 else -normal)
    direction = direction if direction.any() else unit(outward)
    return direction if direction.any() else np.array([0.0, 0.0, 1.0])


def _shot(
    view: View,
    vertices: np.ndarray,
    faces: Int[np.ndarray, "f k"],
    red: Bool[np.ndarray, " f"],
    balls: Float[np.ndarray, "n 3"],
    *,
    side: int,
    lines: float,
) -> Image:
    scene = Scene(view, side)
    if not red.all():
        scene.faces(vertices, faces[~red], lines=lines)
    scene.faces(vertices, faces[red], palette.WORST, lines=lines)
    scene.nodes(balls, palette.WORST, 2.0)
    return scene.shoot()


def _circled(image: Image, view: View, focus: Float[np.ndarray, " 3"], around: float) -> Image:
    """Draw a circle around what the close-up shows: the place may be hidden behind something."""
    offset = focus - view.centre
    height, width, _ = image.shape
    scale = height / (2 * MARGIN * view.half_height)
    x = width / 2 + scale * float(offset @ np.cross(view.up, view.direction))
    y = height / 2 - scale * float(offset @ view.up)
    radius = max(_CIRCLE, scale * around)
    picture = Pillow.fromarray(image)
    ImageDraw.Draw(picture).ellipse((x - radius, y - radius, x + radius, y + radius), outline=palette.WORST, width=2)
    return np.asarray(picture)


def _beside(left: Image, right: Image) -> Image:
    """Join two pictures on white, each in the middle of the common height."""
    height = max(left.shape[0], right.shape[0])
    parts = []
    for image in (left, right):
        above = (height - image.shape[0]) // 2
        below = height - image.shape[0] - above
        parts.append(np.pad(image, ((above, below), (0, 0), (0, 0)), constant_values=255))
    line = np.full((height, 1, 3), 200, np.uint8)
    return np.concatenate([parts[0], line, parts[1]], axis=1)
