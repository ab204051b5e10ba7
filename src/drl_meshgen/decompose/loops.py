"""How the theta of a ring runs along the curves at its ends."""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float, Int

from drl_meshgen.decompose.cells import Ring
from drl_meshgen.partition import Curve


@dataclass(frozen=True, eq=False)
class LoopMap:
    """Monotone map between a ring's theta along one of its loops and the position on the shared curve.

    Both are unrolled over one period: `theta` rises by 1, `position` (share of the curve's length) rises or falls by 1.
    """

    theta: Float[np.ndarray, " n"]
    position: Float[np.ndarray, " n"]

    @property
    def direction(self) -> int:
        """1 when the curve runs with theta, -1 when against."""
        return 1 if self.position[-1] > self.position[0] else -1

    def to_position(self, theta: Float[np.ndarray, " k"]) -> Float[np.ndarray, " k"]:
        """Position on the curve (any real, period 1) at each theta."""
        turn = np.floor(theta - self.theta[0])
        return np.interp(theta - turn, self.theta, self.position) + self.direction * turn

    def to_theta(self, position: Float[np.ndarray, " k"]) -> Float[np.ndarray, " k"]:
        """Theta at each position."""
        forward = self.direction * (position - self.position[0])
        turn = np.floor(forward)
        return np.interp(forward - turn, self.direction * (self.position - self.position[0]), self.theta) + turn


def loop_map(ring: Ring, loop: Int[np.ndarray, " n"], curve: Curve) -> LoopMap:
    """Relate `loop` (of `ring`, in increasing theta) to positions on `curve`."""
    theta = ring.unwrapped(loop)
    p = ring.mesh.vertices[loop]
    step = np.linalg.norm(np.roll(p, -1, axis=0) - p, axis=1)
    along = np.r_[0.0, np.cumsum(step)] / step.sum()
    place = {int(v): k for k, v in enumerate(curve.vertices)}
    known = [(k, place[int(v)]) for k, v in enumerate(ring.origin[loop]) if int(v) in place]
    n = len(curve.vertices)
    forward = (known[1][1] - known[0][1]) % n < (known[0][1] - known[1][1]) % n
    zero = next(k for k, index in known if index == 0)
    position = along - along[zero]
    return LoopMap(np.r_[theta, theta[0] + 1], position if forward else -position)
