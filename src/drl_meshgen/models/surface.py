"""What models and user files give: points and triangles that nobody has checked yet."""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float, Int

from drl_meshgen.mesh.trimesh import frozen


@dataclass(frozen=True, eq=False)
class RawSurface:
    """A named triangle soup in its own units."""

    name: str
    points: Float[np.ndarray, "n 3"]
    triangles: Int[np.ndarray, "m 3"]

    def __post_init__(self) -> None:
        object.__setattr__(self, "points", frozen(self.points, np.float64))
        object.__setattr__(self, "triangles", frozen(self.triangles, np.int64))
