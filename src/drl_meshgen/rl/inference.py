"""The networks without PyTorch: weights by name, single precision, the same figures as `networks` to rounding."""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float, Int

from drl_meshgen.rl.scene import SHARES
from drl_meshgen.rl.symmetry import Symmetry

Weights = Mapping[str, Float[np.ndarray, "..."]]


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

    def __call__(self, x: Float[np.ndarray, "*b i"]) -> Float[np.ndarray, "*b o"]:
        """Return its answers."""
        for i, (weight, bias) in enumerate(self.layers):
            x = x @ weight
            x += bias
            if i < len(self.layers) - 1:
                x /= 1 + np.exp(-np.maximum(x, -80, dtype=np.float32))
        return x


class CornerValues:
    """`networks.CornerValue` of one domain."""

    def __init__(self, weights: Weights) -> None:
        """Take the weights called `corner.*`."""
        self.node, self.choice = Perceptron.of(weights, "corner.node"), Perceptron.of(weights, "corner.choice")

    def __call__(self, seen: Float[np.ndarray, "l s"], corners: Int[np.ndarray, "c 4"]) -> Float[np.ndarray, " c"]:
        """Return the values of choices of four nodes."""
        n, size = len(SHARES), len(seen)
        x = seen.astype(np.float32)
        other = np.concatenate(
            [-x[:, n : 2 * n], -x[:, :n], x[:, 3 * n : 4 * n], x[:, 2 * n : 3 * n], x[:, 4 * n :]], axis=1
        )
        across = ((corners[:, 1] - corners[:, 0]) % size / size).astype(np.float32)
        even = across * (0.5 - across)
        value = np.zeros(len(corners), np.float32)
        for turn, view in ((-1, x), (1, other)):
            alone, first, second = np.split(self.node(view), 3, axis=1)
            following = np.roll(corners, turn, axis=1)
            side = np.add.reduce([first[corners[:, c]] * second[following[:, c]] for c in range(4)]) / 4
            mean = np.add.reduce([alone[corners[:, c]] for c in range(4)]) / 4
            shape = np.stack([16 * even - 0.5, np.log(even.clip(1e-6)) + 3], axis=1)
            value += self.choice(np.concatenate([mean, side, shape], axis=1))[:, 0] / 2
        return value


class Placements:
    """`networks.Placer`."""

    def __init__(self, weights: Weights, name: str, symmetry: Symmetry) -> None:
        """Take the weights called `name.*`, and the symmetries that answers are averaged over."""
        self.body, self.symmetry = Perceptron.of(weights, f"{name}.body"), symmetry
        self._signs = symmetry.seen_signs.astype(np.float32), symmetry.answered_signs.astype(np.float32)

    def __call__(self, seen: Float[np.ndarray, "b s"]) -> Float[np.ndarray, "b c"]:
        """Return answers for a scene's `placed`, averaged over the symmetries."""
        s = self.symmetry
        turned = seen.astype(np.float32)[:, s.seen] * self._signs[0]
        answer = self.body(turned.reshape(-1, turned.shape[-1])).reshape(*turned.shape[:2], -1)
        back = np.take_along_axis(answer, np.broadcast_to(s.answered[None], answer.shape), axis=2)
        return (back * self._signs[1]).mean(axis=1).astype(np.float64)
