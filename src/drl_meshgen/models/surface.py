"""What models and user files give: points and triangles that nobody has checked yet."""

from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np
from jaxtyping import Float, Int

from drl_meshgen.mesh.trimesh import frozen


def frozen_arrays(arrays: Mapping[str, np.ndarray]) -> dict[str, Float[np.ndarray, " n"]]:
    """Return read-only arrays of floats, in the order of their names."""
    return {name: frozen(arrays[name], np.float64) for name in sorted(arrays)}


@dataclass(frozen=True, eq=False)
class RawSurface:
    """A named triangle soup in its own units."""

    name: str
    points: Float[np.ndarray, "n 3"]
    triangles: Int[np.ndarray, "m 3"]
    point_data: Mapping[str, Float[np.ndarray, " n"]] = field(default_factory=dict)
    """Numbers per point that came with the surface, by name, in units of their own."""

    def __post_init__(self) -> None:
        object.__setattr__(self, "points", frozen(self.points, np.float64))
        object.__setattr__(self, "triangles", frozen(self.triangles, np.int64))
        object.__setattr__(self, "point_data", frozen_arrays(self.point_data))
