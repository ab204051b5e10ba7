"""Places where irregular nodes are wanted or forbidden, and how junctions are opened with regard to them."""

from dataclasses import dataclass, replace
from typing import Literal

import numpy as np
from jaxtyping import Bool, Float

#: Within a forbidden zone the distance to the loops is taken this many times smaller, so that the spine leaves it.
REPULSION = 0.01


@dataclass(frozen=True)
class Zone:
    """A ball, or a box with edges along the axes, in space."""

    kind: Literal["wanted", "forbidden"] = "forbidden"
    """Whether irregular nodes shall come to its centre or stay out of it."""
    centre: tuple[float, float, float] = (0.0, 0.0, 0.0)
    """Position (model units)."""
    radius: float = 0.0
    """Radius of a ball (model units); a wanted node is looked for within it."""
    half: tuple[float, ...] = ()
    """Half of the three edge lengths of a box (model units), which takes the place of the ball."""

    def __post_init__(self) -> None:
        if len(self.half) not in (0, 3):
            raise ValueError(f"half is {list(self.half)}; a box has three edge lengths")
        if not all(size > 0 for size in self.half or (self.radius,)):
            raise ValueError("a zone needs a positive radius, or three positive half edge lengths")

    def contains(self, points: Float[np.ndarray, "n 3"]) -> Bool[np.ndarray, " n"]:
        """Tell which points lie in the zone."""
        away = points - np.array(self.centre)
        if self.half:
            return np.asarray((np.abs(away) <= np.array(self.half)).all(axis=1))
        return np.asarray(np.linalg.norm(away, axis=1) <= self.radius)

    def distances(self, points: Float[np.ndarray, "n 3"]) -> Float[np.ndarray, " n"]:
        """Return the distance of points to the centre (model units)."""
        return np.linalg.norm(points - np.array(self.centre), axis=1)


def repelled(
    distance: Float[np.ndarray, " v"], points: Float[np.ndarray, "v 3"], zones: tuple[Zone, ...]
) -> Float[np.ndarray, " v"]:
    """Shrink the distance to the loops within forbidden zones: what collapses first has no spine."""
    inside = np.zeros(len(points), bool)
    for zone in zones:
        if zone.kind == "forbidden":
            inside |= zone.contains(points)
    low = np.quantile(distance, 0.01)
    return np.where(inside & (distance > low), low + REPULSION * (distance - low), distance)


def attracted(
    distances: Float[np.ndarray, "v k"], points: Float[np.ndarray, "v 3"], zone: Zone
) -> Float[np.ndarray, "v k"] | None:
    """Scale the distances to the three loops nearest to a wanted point so that they are equal there.

    A node of the cut locus is where three loops are equally near. None where the point is not in this region, or lies
    on a loop.
    """
    away = zone.distances(points)
    at = int(np.argmin(away))
    if zone.kind != "wanted" or not zone.contains(points[[at]])[0] or distances.shape[1] < 3:
        return None
    nearest = np.argsort(distances[at], kind="stable")[:3]
    if distances[at, nearest[0]] <= 0:
        return None
    scale = np.ones(distances.shape[1])
    scale[nearest] = distances[at, nearest].mean() / distances[at, nearest]
    return distances * scale


def misfit(
    nodes: Float[np.ndarray, "n 3"], points: Float[np.ndarray, "v 3"], zones: tuple[Zone, ...]
) -> tuple[int, float]:
    """Return how many nodes lie in forbidden zones, and how far wanted points in a region are from the nearest, summed.

    `points` are those of the region; a wanted zone that holds none of them is left to others.
    """
    forbidden = sum(int(zone.contains(nodes).sum()) for zone in zones if zone.kind == "forbidden")
    here = [zone for zone in zones if zone.kind == "wanted" and zone.contains(points).any()]
    return forbidden, float(sum(zone.distances(nodes).min(initial=np.inf) for zone in here))


def held(irregular: Float[np.ndarray, "n 3"], zones: tuple[Zone, ...]) -> Bool[np.ndarray, " n"]:
    """Tell which irregular nodes the node optimiser must not move.

    The one nearest to each wanted point, and those outside a forbidden zone that are near enough to be drawn into it.
    """
    stay = np.zeros(len(irregular), bool)
    for zone in zones:
        inside = zone.contains(irregular)
        if zone.kind == "wanted" and inside.any():
            stay[np.argmin(zone.distances(irregular))] = True
        elif zone.kind == "forbidden":
            stay |= ~inside & replace(zone, radius=2 * zone.radius, half=tuple(2 * x for x in zone.half)).contains(
                irregular
            )
    return stay
