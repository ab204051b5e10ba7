"""The plane domain a template fills: a closed simple polygon of ordered boundary nodes."""

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from jaxtyping import Float

from drl_meshgen.errors import InputError
from drl_meshgen.mesh.trimesh import frozen

MIN_NODES = 8
NAME = "template domain"


@dataclass(frozen=True, eq=False)
class Domain:
    """A simple polygon of `L >= 8` boundary nodes, anti-clockwise; node `i + 1` follows node `i` (mod L).

    Raises `InputError` for anything else. Clockwise input is refused here; `Domain.oriented` turns it.
    """

    nodes: Float[np.ndarray, "l 2"]

    def __post_init__(self) -> None:
        object.__setattr__(self, "nodes", frozen(self.nodes, np.float64))
        _validate(self.nodes)

    @classmethod
    def oriented(cls, nodes: Float[np.ndarray, "l 2"]) -> "Domain":
        """Return the domain of `nodes` run anti-clockwise: clockwise input is reversed, node 0 stays first."""
        nodes = np.asarray(nodes, np.float64)
        if nodes.ndim == 2 and nodes.shape[1] == 2 and signed_area(nodes) < 0:
            nodes = np.roll(nodes[::-1], 1, axis=0)
        return cls(nodes)

    def __len__(self) -> int:
        """Return the number of boundary nodes."""
        return len(self.nodes)

    def require_even(self) -> None:
        """Raise `InputError` for an odd number of nodes, which no O-type template can fill."""
        if len(self) % 2:
            raise InputError("O-type template", f"boundary has an odd number of nodes ({len(self)})", "make it even")

    @cached_property
    def edges(self) -> Float[np.ndarray, "l 2"]:
        """Edge `i` runs from node `i` to node `i + 1`."""
        return frozen(np.roll(self.nodes, -1, axis=0) - self.nodes, np.float64)

    @cached_property
    def lengths(self) -> Float[np.ndarray, " l"]:
        """Length of each edge."""
        return frozen(np.linalg.norm(self.edges, axis=1), np.float64)

    @cached_property
    def spacing(self) -> Float[np.ndarray, " l"]:
        """Mean length of the two edges at each node: the local size of boundary cells."""
        return frozen((self.lengths + np.roll(self.lengths, 1)) / 2, np.float64)

    @cached_property
    def area(self) -> float:
        """Enclosed area."""
        return signed_area(self.nodes)

    @cached_property
    def turning(self) -> Float[np.ndarray, " l"]:
        """Exterior angle at each node in radians, positive where convex; they sum to 2 pi."""
        before = np.roll(self.edges, 1, axis=0)
        return np.arctan2(cross(before, self.edges), (before * self.edges).sum(axis=1))

    @property
    def curvature(self) -> Float[np.ndarray, " l"]:
        """Turning angle over the node's share of the boundary length (1 / length)."""
        return self.turning / self.spacing

    @cached_property
    def frame(self) -> "Frame":
        """Similarity that centres the area and scales it to that of the unit disk."""
        local = self.nodes - self.nodes[0]
        ahead = np.concatenate([local[1:], local[:1]])
        centre = cross(local, ahead) @ (local + ahead)
        return Frame(self.nodes[0] + centre / (6 * self.area), float(np.sqrt(self.area / np.pi)))


@dataclass(frozen=True, eq=False)
class Frame:
    """A normalisation frame: `(x - origin) / scale`."""

    origin: Float[np.ndarray, "2"]
    scale: float

    def to_local(self, points: Float[np.ndarray, "*n 2"]) -> Float[np.ndarray, "*n 2"]:
        """Return `points` in the frame."""
        return (points - self.origin) / self.scale

    def to_world(self, points: Float[np.ndarray, "*n 2"]) -> Float[np.ndarray, "*n 2"]:
        """Return points of the frame in the plane."""
        return points * self.scale + self.origin


def cross(a: Float[np.ndarray, "*n 2"], b: Float[np.ndarray, "*n 2"]) -> Float[np.ndarray, "*n"]:
    """Return the scalar cross product of plane vectors."""
    return a[..., 0] * b[..., 1] - a[..., 1] * b[..., 0]


def signed_area(nodes: Float[np.ndarray, "l 2"]) -> float:
    """Return the area of a polygon, positive if anti-clockwise (shoelace formula about node 0)."""
    local = nodes - nodes[0]
    return float(cross(local, np.roll(local, -1, axis=0)).sum() / 2)


def crossing_edges(nodes: Float[np.ndarray, "l 2"]) -> np.ndarray:
    """Return pairs `(e, f)`, `e < f`, of non-adjacent edges of a closed polygon that touch or cross."""
    n = len(nodes)
    ahead = np.concatenate([nodes[1:], nodes[:1]])
    low, high = np.minimum(nodes, ahead), np.maximum(nodes, ahead)
    below = (low[:, None, 0] <= high[:, 0]) & (low[:, None, 1] <= high[:, 1])
    first, second = np.nonzero(np.triu(below & below.T, 2))
    apart = (first > 0) | (second < n - 1)
    first, second = first[apart], second[apart]
    a, b = nodes[first], nodes[(first + 1) % n]
    c, d = nodes[second], nodes[(second + 1) % n]
    across = cross(b - a, c - a) * cross(b - a, d - a) <= 0
    back = cross(d - c, a - c) * cross(d - c, b - c) <= 0
    return np.c_[first, second][across & back]


def _validate(nodes: np.ndarray) -> None:
    if nodes.ndim != 2 or nodes.shape[1] != 2:
        raise InputError(NAME, f"boundary has shape {nodes.shape}", "give (L, 2) coordinates")
    if len(nodes) < MIN_NODES:
        raise InputError(NAME, f"boundary has {len(nodes)} points", f"at least {MIN_NODES} are needed")
    bad = np.nonzero(~np.isfinite(nodes).all(axis=1))[0]
    if len(bad):
        raise InputError(NAME, f"boundary point {bad[0]} is not finite")
    order = np.lexsort((nodes[:, 1], nodes[:, 0]))
    same = np.nonzero((nodes[order[1:]] == nodes[order[:-1]]).all(axis=1))[0]
    if len(same):
        pair = sorted(order[same[0] : same[0] + 2].tolist())
        raise InputError(NAME, f"boundary points {pair[0]} and {pair[1]} coincide", "drop the repeated point")
    crossings = crossing_edges(nodes)
    if len(crossings):
        e, f = crossings[0]
        raise InputError(NAME, f"boundary edges {e} and {f} cross or touch", "give a simple polygon")
    area = signed_area(nodes)
    if area < 0:
        raise InputError(NAME, "boundary runs clockwise", "reverse it or use Domain.oriented")
    if area == 0:
        raise InputError(NAME, "boundary encloses no area")
