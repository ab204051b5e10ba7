"""The networks without PyTorch: weights by name, single precision, the same figures as `networks` to rounding."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numba
import numpy as np
from jaxtyping import Float, Int

from drl_meshgen.rl.scene import SHARES
from drl_meshgen.rl.symmetry import Symmetry

Weights = Mapping[str, Float[np.ndarray, "..."]]


@numba.njit(cache=True, error_model="numpy", fastmath={"contract"})
def _activate(x: np.ndarray, bias: np.ndarray) -> None:
    """Add a bias and apply SiLU, in place; single precision to a few of its steps.

    x / (1 + exp(-x)) is h + h tanh h for h = x / 2, and tanh a quotient of polynomials up to where it is 1.
    """
    one = np.float32
    for i in range(len(x)):
        for j in range(len(bias)):
            h = one(0.5) * (x[i, j] + bias[j])
            c = min(max(h, one(-7.90531110763549805)), one(7.90531110763549805))
            s = c * c
            over = one(2.00018790482477e-13) + s * one(-2.76076847742355e-16)
            over = one(5.12229709037114e-08) + s * (one(-8.60467152213735e-11) + s * over)
            over = one(6.37261928875436e-04) + s * (one(1.48572235717979e-05) + s * over)
            over = c * (one(4.89352455891786e-03) + s * over)
            under = one(1.18534705686654e-04) + s * one(1.19825839466702e-06)
            under = one(4.89352518554385e-03) + s * (one(2.26843463243900e-03) + s * under)
            x[i, j] = h + h * (over / under)


@numba.njit(cache=True, error_model="numpy")
def _pooled(node: np.ndarray, corners: np.ndarray) -> np.ndarray:
    """Return what `CornerValue` pools of every choice of corners in both views, `node (2, l, 3 p)`."""
    size, width = node.shape[1], node.shape[2] // 3
    result = np.zeros((2, len(corners), 2 * width + 2), np.float32)
    quarter = np.float32(0.25)
    for c in range(len(corners)):
        across = np.float32((corners[c, 1] - corners[c, 0]) % size / size)
        even = across * (np.float32(0.5) - across)
        for view in range(2):
            row = result[view, c]
            for k in range(4):
                here = node[view, corners[c, k]]
                ahead = node[view, corners[c, (k + 1 + 2 * view) % 4]]
                for w in range(width):
                    row[w] += quarter * here[w]
                    row[width + w] += quarter * here[width + w] * ahead[2 * width + w]
            row[2 * width] = np.float32(16) * even - np.float32(0.5)
            row[2 * width + 1] = np.log(max(even, np.float32(1e-6))) + np.float32(3)
    return result


@dataclass(frozen=True, eq=False)
class Perceptron:
    """Linear layers with SiLU between them."""

    layers: tuple[tuple[Float[np.ndarray, "i o"], Float[np.ndarray, " o"]], ...]

    @classmethod
    def of(cls, weights: Weights, prefix: str) -> "Perceptron":
        """Return the one whose weights are called `prefix.0.weight`, `prefix.0.bias`, `prefix.2.weight` and so on."""
        names = sorted(
            (k for k in weights if k.startswith(prefix) and k.endswith("weight")), key=lambda k: int(k.split(".")[-2])
        )
        pairs = [(weights[name].T, weights[name.replace("weight", "bias")]) for name in names]
        return cls(tuple((np.ascontiguousarray(w, np.float32), b.astype(np.float32)) for w, b in pairs))

    def __call__(self, x: Float[np.ndarray, "b i"]) -> Float[np.ndarray, "b o"]:
        """Return its answers."""
        for weight, bias in self.layers[:-1]:
            x = x @ weight
            _activate(x, bias)
        weight, bias = self.layers[-1]
        return x @ weight + bias


class CornerValues:
    """`networks.CornerValue` of one domain."""

    def __init__(self, weights: Weights) -> None:
        """Take the weights called `corner.*`."""
        self.node, self.choice = Perceptron.of(weights, "corner.node"), Perceptron.of(weights, "corner.choice")

    def __call__(self, seen: Float[np.ndarray, "l s"], corners: Int[np.ndarray, "c 4"]) -> Float[np.ndarray, " c"]:
        """Return the values of choices of four nodes."""
        n, x = len(SHARES), seen.astype(np.float32)
        mirrored = np.concatenate(
            [-x[:, n : 2 * n], -x[:, :n], x[:, 3 * n : 4 * n], x[:, 2 * n : 3 * n], x[:, 4 * n :]], axis=1
        )
        node = self.node(np.concatenate([x, mirrored])).reshape(2, len(x), -1)
        pooled = _pooled(node, corners)
        return self.choice(pooled.reshape(2 * len(corners), -1)).reshape(2, -1).sum(axis=0) / 2


class Placements:
    """`networks.Placer`."""

    def __init__(self, weights: Weights, name: str, symmetry: Symmetry) -> None:
        """Take the weights called `name.*`, and the symmetries that answers are averaged over."""
        self.body, self.symmetry = Perceptron.of(weights, f"{name}.body"), symmetry
        self._signs = symmetry.seen_signs.astype(np.float32), symmetry.answered_signs.astype(np.float32)

    def __call__(self, seen: Float[np.ndarray, "b s"], parts: Sequence[int] | None = None) -> Float[np.ndarray, "b c"]:
        """Return answers for a scene's `placed`, averaged over the symmetries.

        Scenes are answered in `parts` of so many, if given: rounding depends on how many are multiplied at once, so
        that the answers for a domain are the same bits whatever others there are.
        """
        s = self.symmetry
        turned = seen.astype(np.float32)[:, s.seen] * self._signs[0]
        flat, ends = turned.reshape(-1, turned.shape[-1]), turned.shape[1] * np.cumsum(parts or [len(seen)])
        answer = np.concatenate([self.body(part) for part in np.split(flat, ends[:-1])])
        answer = answer.reshape(*turned.shape[:2], -1)
        back = np.take_along_axis(answer, np.broadcast_to(s.answered[None], answer.shape), axis=2)
        return (back * self._signs[1]).mean(axis=1).astype(np.float64)
