"""Choosing a camera: upright, from the side that shows most, the same for every mesh of a surface."""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from drl_meshgen.mesh import TriMesh
from drl_meshgen.quality.shape import unit

_AZIMUTHS, _ELEVATION, _RASTER, _SNAP = 48, np.radians(20), 80, np.radians(35)
_ALONG = 0.95


@dataclass(frozen=True, eq=False)
class View:
    """A parallel projection."""

    direction: Float[np.ndarray, " 3"]
    """Unit vector from the model to the camera."""
    up: Float[np.ndarray, " 3"]
    """Unit vector that points up in the picture, orthogonal to the direction."""
    centre: Float[np.ndarray, " 3"]
    """What the picture is centred on."""
    half_width: float
    """Half the extent of the model across the picture, model units."""
    half_height: float
    """Half the extent of the model up the picture, model units."""


def _upright(surface: TriMesh) -> Float[np.ndarray, " 3"]:
    """Away from the longest boundary loop, or +z for a closed surface; snapped to an axis that is close."""
    up = np.array([0.0, 0.0, 1.0])
    if surface.topology.loops:
        centre = np.average(surface.corners.mean(axis=1), axis=0, weights=surface.areas)
        away = centre - surface.vertices[surface.topology.loops[0]].mean(axis=0)
        if np.linalg.norm(away) > 0.02 * surface.diagonal:
            up = unit(away)
    axis = np.abs(up).argmax()
    return np.sign(up[axis]) * np.eye(3)[axis] if abs(up[axis]) > np.cos(_SNAP) else up


def _extent(
    points: Float[np.ndarray, "n 3"], direction: np.ndarray, up: np.ndarray
) -> tuple[Float[np.ndarray, "n 2"], np.ndarray, np.ndarray]:
    right = np.cross(up, direction)
    flat = points @ np.c_[right, up]
    return flat, flat.min(axis=0), flat.max(axis=0)


def best_view(surface: TriMesh) -> View:
    """Return the view among a ring of slightly raised ones whose silhouette covers most."""
    up = _upright(surface)
    side = unit(np.cross(up, np.eye(3)[np.abs(up).argmin()]))
    front = np.cross(side, up)
    points = surface.corners.mean(axis=1)
    cell = surface.diagonal / _RASTER
    views = []
    for angle in 2 * np.pi * np.arange(_AZIMUTHS) / _AZIMUTHS:
        level = np.cos(angle) * front + np.sin(angle) * side
        direction = np.cos(_ELEVATION) * level + np.sin(_ELEVATION) * up
        upward = np.cos(_ELEVATION) * up - np.sin(_ELEVATION) * level
        flat, low, _ = _extent(points, direction, upward)
        column, row = ((flat - low) / cell).astype(int).T
        covered = np.count_nonzero(np.bincount(column * 2 * _RASTER + row))
        views.append((covered, direction, upward))
    _, direction, upward = max(views, key=lambda v: v[0])
    _, low, high = _extent(surface.vertices, direction, upward)
    depth = surface.vertices @ direction
    middle = (low + high) / 2
    centre = middle[0] * np.cross(upward, direction) + middle[1] * upward + depth.mean() * direction
    return View(direction, upward, centre, *(0.5 * (high - low)))


def view_from(points: Float[np.ndarray, "n 3"], direction: Float[np.ndarray, " 3"]) -> View:
    """Return the view of all points from a direction (a unit vector); +z is up, +y where one looks along z."""
    axis = np.eye(3)[1 if abs(direction[2]) > _ALONG else 2]
    up = unit(axis - (axis @ direction) * direction)
    _, low, high = _extent(points, direction, up)
    middle = (low + high) / 2
    right = np.cross(up, direction)
    centre = middle[0] * right + middle[1] * up + (points @ direction).mean() * direction
    return View(direction, up, centre, *(0.5 * (high - low)))
