"""The learned policy: corners by their values, singular points and line types by the placement policy, valid first."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from functools import cache

import numpy as np
from jaxtyping import Float, Int
from threadpoolctl import ThreadpoolController

from drl_meshgen.rl.boundary import PER_SIDE, side_samples
from drl_meshgen.rl.controls import parameters_of
from drl_meshgen.rl.inference import CornerValues, Placements
from drl_meshgen.rl.inference import Weights as NetworkWeights
from drl_meshgen.rl.kernel import Judged, judge_o
from drl_meshgen.rl.optimum import OptimizerPolicy
from drl_meshgen.rl.scene import Scene, corner_choices, views
from drl_meshgen.rl.symmetry import of_square, of_transition
from drl_meshgen.rl.transitions import best_transition
from drl_meshgen.templates.c_type import CCounts, CParameters, CSides
from drl_meshgen.templates.domain import Domain, Frame
from drl_meshgen.templates.o_type import OParameters
from drl_meshgen.templates.options import PlacementOptions, Size
from drl_meshgen.templates.placement import MAX_BOW, place, start_of
from drl_meshgen.templates.policy import parameters_of as parameters_of_placement
from drl_meshgen.templates.score import Weights
from drl_meshgen.templates.sketch import Sketch

TRANSITIONS = "c_placer"
"""Name of the weights for C-type meshes, which a policy may lack."""
LEARNT_LAYERS = 3, 10
"""Fewest and most layers that the policy was trained on."""
BATCH = 64
"""Domains whose proposals are made at once."""
SKETCHED = 6
"""Cells per side of the coarse mesh on which sizes are met."""


@cache
def _threads() -> ThreadpoolController:
    """Return what limits BLAS to one thread: same bytes everywhere, and matrices this small are faster so."""
    return ThreadpoolController()


@dataclass(frozen=True, eq=False)
class Proposals:
    """Choices of parameters for one domain of unit scale, and what their meshes are worth."""

    corners: Int[np.ndarray, "b 2"]
    layers: Int[np.ndarray, " b"]
    parts: Mapping[str, Float[np.ndarray, "b *d 2"]]
    """Continuous parameters by the fields of `OParameters`."""
    judged: Judged

    def parameters(self, domain: Domain, which: int) -> OParameters:
        """Return a proposal as parameters for the domain itself."""
        i0, m = self.corners[which].tolist()
        x = np.concatenate([part[which].ravel() for part in self.parts.values()])
        return parameters_of(domain, (i0, m), int(self.layers[which]), x)


@dataclass(frozen=True)
class AgentOptions:
    """How many proposals are judged."""

    tried_first: int = 3
    """Choices of corners that are placed and judged, the most valuable first."""
    tried: int = 8
    """As many where none of these makes a valid mesh."""
    tried_again: int = 64
    """As many where none of these makes a valid mesh."""
    choices: int = 400
    """Choices of corners whose value is computed, at most."""
    layers: tuple[int, ...] = (3,)
    """Numbers of layers that are placed and judged."""
    layers_then: tuple[int, ...] = (3, 5)
    """As many where none of these makes a valid mesh."""
    layers_again: tuple[int, ...] = (3, 5, 8)
    """As many where none of these makes a valid mesh."""
    sized_tried: int = 1
    """Choices of corners that are placed where sizes are wanted, each from the proposal and from Tutte's embedding."""
    sized_steps: int = 6
    """Steps by which a proposal then gives way to the sizes, in either of two rounds."""
    weights: Weights = field(default_factory=Weights)
    """Weights of the reward that proposals are judged by."""

    @property
    def rounds(self) -> tuple[tuple[int, tuple[int, ...]], ...]:
        """Choices of corners and numbers of layers of each round; one comes if those before it had no valid mesh."""
        first = min(self.tried_first, self.tried)
        return (first, self.layers), (self.tried, self.layers_then), (self.tried_again, self.layers_again)


class AgentPolicy:
    """The learned policy; equal domains get equal parameters."""

    def __init__(self, weights: NetworkWeights, options: AgentOptions | None = None) -> None:
        """Take the weights of the networks, by name."""
        self.value, self.options = CornerValues(weights), options or AgentOptions()
        self.placement = Placements(weights, "placer", of_square(len(weights["placer.body.6.bias"])))
        learned = any(name.startswith(TRANSITIONS) for name in weights)
        self.transitions = Placements(weights, TRANSITIONS, of_transition()) if learned else None

    def choose(
        self,
        domain: Domain,
        *,
        layers: int | None = None,
        size: Size | None = None,
        corners: tuple[int, int] | None = None,
    ) -> OParameters:
        """Return the best proposal; where none makes a valid mesh, the outcome of gradient ascent.

        With `size`, proposals are scaled to it and judged by how well they meet it instead of by the reward.
        Raises `InputError` for an odd number of nodes.
        """
        domain.require_even()
        with _threads().limit(limits=1):
            if size is None:
                return self._chosen([domain], layers, corners)[0]
            nodes = domain.frame.to_local(domain.nodes)
            pairs = np.array([corners]) if corners else self.corners([nodes], self.options.sized_tried)[0]
            return self._sized(Domain(nodes), pairs, domain.frame, layers, size)

    def choose_all(self, domains: Sequence[Domain], *, layers: int | None = None) -> list[OParameters]:
        """Return what `choose` returns for every domain, bit by bit, in less time; they may differ in size.

        Raises `InputError` for an odd number of nodes.
        """
        for domain in domains:
            domain.require_even()
        with _threads().limit(limits=1):
            batches = (domains[i : i + BATCH] for i in range(0, len(domains), BATCH))
            return [chosen for batch in batches for chosen in self._chosen(batch, layers, None)]

    def transition(self, domain: Domain, start: int, cells: CSides | CCounts) -> CParameters:
        """Return the best proposal of a C-type mesh; where none is valid, the outcome of gradient ascent."""
        if self.transitions is not None:
            with _threads().limit(limits=1):
                found = best_transition(self.transitions, domain, start, cells, self.options.weights)
            if found is not None:
                return found
        return OptimizerPolicy(weights=self.options.weights).transition(domain, start, cells)

    def _chosen(
        self, domains: Sequence[Domain], layers: int | None, corners: tuple[int, int] | None
    ) -> list[OParameters]:
        o = self.options
        nodes = [domain.frame.to_local(domain.nodes) for domain in domains]
        ranked = [np.array([corners])] * len(nodes) if corners else self.corners(nodes, max(o.tried, o.tried_again))
        chosen: dict[int, OParameters] = {}
        for count, values in o.rounds:
            left = [i for i in range(len(nodes)) if i not in chosen]
            pairs = [ranked[i][:count] for i in left]
            found = self.proposals_of_all([nodes[i] for i in left], pairs, values if layers is None else (layers,))
            for i, proposals in zip(left, found, strict=True):
                if proposals.judged.valid[best := proposals.judged.best]:
                    chosen[i] = proposals.parameters(domains[i], best)
        last = OptimizerPolicy(weights=o.weights)
        return [
            chosen[i] if i in chosen else last.choose(domain, layers=layers, corners=corners)
            for i, domain in enumerate(domains)
        ]

    def _sized(
        self, domain: Domain, pairs: Int[np.ndarray, "t 2"], frame: Frame, layers: int | None, size: Size
    ) -> OParameters:
        """Return the proposal that meets sizes best once its core is scaled and has given way to them a little.

        Tutte's embedding is proposed as well.
        """
        asked = min(max(layers or min(self.options.layers), LEARNT_LAYERS[0]), LEARNT_LAYERS[1])
        found = self.proposals(domain.nodes, pairs, (asked,))
        options = PlacementOptions(iterations=self.options.sized_steps)
        placed = []
        for (i0, m), singular, bulges in zip(
            pairs.tolist(), found.parts["singular"], found.parts["bulges"], strict=True
        ):
            sketch = Sketch.of(domain, i0, m, SKETCHED, 3)
            wanted = lambda points: size(frame.to_world(points)) / frame.scale  # noqa: E731
            for shape in ((singular, bulges[:, 0].clip(-MAX_BOW, MAX_BOW)), None):
                start = start_of(sketch, wanted, layers, options, shape)
                placed.append((place(sketch, wanted, layers, options, start, shape=shape), sketch))
        placement, sketch = min(placed, key=lambda pair: pair[0].energy)
        return parameters_of_placement(placement, sketch, frame.to_world(placement.singular))

    def corners(self, domains: Sequence[Float[np.ndarray, "l 2"]], count: int) -> list[Int[np.ndarray, "t 2"]]:
        """Return the `count` most valuable choices of corners of domains of unit scale, best first."""
        best = []
        for nodes in domains:
            pairs, four = corner_choices(len(nodes), self.options.choices)
            value = self.value(views(nodes[None])[0], four)
            best.append(pairs[np.argsort(-value, kind="stable")[:count]])
        return best

    def proposals(
        self, nodes: Float[np.ndarray, "l 2"], pairs: Int[np.ndarray, "t 2"], layers: Sequence[int]
    ) -> Proposals:
        """Place and judge every choice of corners with every number of layers."""
        return self.proposals_of_all([nodes], [pairs], layers)[0]

    def proposals_of_all(
        self,
        domains: Sequence[Float[np.ndarray, "l 2"]],
        pairs: Sequence[Int[np.ndarray, "t 2"]],
        layers: Sequence[int],
    ) -> list[Proposals]:
        """Return `proposals` of several domains, each with its choices of corners."""
        if not domains:
            return []
        corners = [np.tile(few, (len(layers), 1)) for few in pairs]
        k = [np.repeat(np.array(layers), len(few)) for few in pairs]
        rims = [
            side_samples(np.ascontiguousarray(nodes)[None], few, PER_SIDE)
            for nodes, few in zip(domains, corners, strict=True)
        ]
        counts = [len(few) for few in corners]
        size = np.repeat([len(nodes) for nodes in domains], counts)
        scene = Scene.of(np.concatenate(rims), np.concatenate(corners)[:, 1], size, np.concatenate(k))
        placed = scene.placed(self.placement(scene.seen, counts))
        found, start = [], 0
        for nodes, few, values in zip(domains, corners, k, strict=True):
            parts = {name: part[start : start + len(few)] for name, part in placed.items()}
            judged = judge_o(nodes, few, values, weights=self.options.weights, **parts)
            found.append(Proposals(few, values, parts, judged))
            start += len(few)
        return found
