"""Optimisers that search the paper's template parameters afresh for every domain (paper section 6.1.2), as policies.

All maximise the reward less the validity penalty of O-type meshes without waves and swells, as the learners do. They
share one parametrisation: `i0`, `m` and the number of layers, how far each singular point is from Tutte's embedding
(in radii of a disk of the domain's area), and two amplitudes of each of the eight internal edges.
"""

from abc import ABC, abstractmethod
from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass, field
from typing import Any, Final

import numpy as np
from jaxtyping import Float, Int
from scipy.optimize import minimize

from drl_meshgen.errors import InputError
from drl_meshgen.rl.controls import PLAIN, parameters_of
from drl_meshgen.rl.kernel import Judged, judge_o
from drl_meshgen.rl.optimum import tutte_points
from drl_meshgen.rl.scene import corner_choices
from drl_meshgen.templates.domain import Domain
from drl_meshgen.templates.o_type import EDGES, OParameters
from drl_meshgen.templates.options import Size
from drl_meshgen.templates.score import Weights

INTEGERS: Final = 3
"""Unknowns before the continuous ones: i0, m, layers."""
FAR: Final = 0.5
"""Bound of displacements, in radii."""
BENT: Final = 0.35
"""Bound of amplitudes, in chords; the largest line type has 0.3."""
MOST_CHOICES: Final = 3000
"""Choices of corners that are looked at, at most."""
SMALL: Final = 1e-6
"""Step of forward differences."""


@dataclass(frozen=True, eq=False)
class Search:
    """The mixed search space of one domain, and what its points are worth."""

    domain: Domain
    """The domain in its frame."""
    layers: tuple[int, int]
    """Fewest and most layers."""
    weights: Weights
    """Weights of the reward."""

    @property
    def bounds(self) -> Float[np.ndarray, "2 27"]:
        """Least and largest value of each unknown: integers first, then displacements and amplitudes."""
        half = len(self.domain) // 2
        reach = np.repeat([FAR, BENT], [8, PLAIN - 8])
        low = np.concatenate([[0, 1, self.layers[0]], -reach])
        return np.stack([low, np.concatenate([[half - 1, half - 1, self.layers[1]], reach])])

    def judged(self, integers: Int[np.ndarray, "b 3"], reals: Float[np.ndarray, "b 24"]) -> Judged:
        """Judge points of the space, all at once."""
        corners, layers = integers[:, :2], integers[:, 2]
        singular, bulges = self._placed(corners, reals)
        return judge_o(self.domain.nodes, corners, layers, singular, bulges, self.weights)

    def worth(self, integers: Int[np.ndarray, "b 3"], reals: Float[np.ndarray, "b 24"]) -> Float[np.ndarray, " b"]:
        """Return reward less penalty."""
        judged = self.judged(integers, reals)
        return judged.reward - judged.penalty

    def best_layers(self, corners: Int[np.ndarray, "2"], reals: Float[np.ndarray, "24"]) -> Int[np.ndarray, "3"]:
        """Return the corners with the number of layers that is worth most."""
        values = np.arange(self.layers[0], self.layers[1] + 1)
        integers = np.column_stack([np.tile(corners, (len(values), 1)), values])
        return integers[self.worth(integers, np.tile(reals, (len(values), 1))).argmax()]

    def _placed(self, corners: np.ndarray, reals: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        singular = tutte_points(self.domain.nodes, corners) + reals[:, :8].reshape(-1, 4, 2)
        return singular, reals[:, 8:].reshape(-1, EDGES, 2)

    def parameters(self, domain: Domain, integers: Int[np.ndarray, "3"], reals: np.ndarray) -> OParameters:
        """Return a point of the space as parameters of the domain as it was given."""
        i0, m, layers = integers.tolist()
        parts = self._placed(integers[None, :2], reals[None])
        return parameters_of(domain, (i0, m), layers, np.concatenate([part.ravel() for part in parts]))


@dataclass(frozen=True)
class _Rival(ABC):
    """What the optimisers have in common. A domain gets the same mesh each time: draws begin with the seed."""

    seed: int = 0
    """Seed of all draws."""
    layers: tuple[int, int] = (3, 10)
    """Fewest and most layers."""
    weights: Weights = field(default_factory=Weights)
    """Weights of the reward."""

    def choose(
        self,
        domain: Domain,
        *,
        layers: int | None = None,
        size: Size | None = None,  # noqa: ARG002 - the reward knows no sizes
        corners: tuple[int, int] | None = None,
    ) -> OParameters:
        """Return the best parameters found; raises `InputError` for odd numbers of nodes and for corners given."""
        domain.require_even()
        if corners is not None:
            raise InputError(type(self).__name__, "it chooses the corners itself", "take another policy")
        span = self.layers if layers is None else (layers, layers)
        search = Search(Domain(domain.frame.to_local(domain.nodes)), span, self.weights)
        return search.parameters(domain, *self._found(search, np.random.default_rng(self.seed)))

    @abstractmethod
    def _found(self, search: Search, rng: np.random.Generator) -> tuple[np.ndarray, np.ndarray]:
        """Return integers and reals of the best point found."""


@dataclass(frozen=True)
class SqpPolicy(_Rival):
    """Sequential quadratic programming from random starts: corners and layers of each start stay as drawn."""

    starts: int = 5
    """Starts (count)."""
    evaluations: int = 200
    """Evaluations of the objective from each start; those of its gradient by differences are not counted."""

    def _found(self, search: Search, rng: np.random.Generator) -> tuple[np.ndarray, np.ndarray]:
        low, high = search.bounds
        best: tuple[float, np.ndarray, np.ndarray] | None = None
        for _ in range(self.starts):
            integers = rng.integers(low[:INTEGERS].astype(int), high[:INTEGERS].astype(int), endpoint=True)
            start = rng.uniform(low[INTEGERS:], high[INTEGERS:]) / 5
            worth, reals = _climbed(lambda x, n=integers: search.worth(np.tile(n, (len(x), 1)), x),
                                    start, (low[INTEGERS:], high[INTEGERS:]), self.evaluations)  # fmt: skip
            if best is None or worth > best[0]:
                best = worth, integers, reals
        if best is None:
            raise InputError("SQP", "no start was asked for", "ask for at least one")
        return best[1], best[2]


class _SpentError(Exception):
    """The budget of evaluations is used up."""


def _climbed(
    worth: Callable[[np.ndarray], np.ndarray], start: np.ndarray, bounds: tuple[np.ndarray, np.ndarray], budget: int
) -> tuple[float, np.ndarray]:
    """Return the best value that SLSQP meets within a budget of evaluations, and where; gradients are not counted."""
    best, spent = (-np.inf, start), 0

    def descent(x: np.ndarray) -> tuple[float, np.ndarray]:
        nonlocal best, spent
        if spent == budget:
            raise _SpentError
        spent += 1
        values = worth(np.concatenate([x[None], x + SMALL * np.eye(len(x))]))
        if values[0] > best[0]:
            best = float(values[0]), x.copy()
        return -float(values[0]), -(values[1:] - values[0]) / SMALL

    settings: Any = {"maxiter": budget, "ftol": 1e-7}
    with suppress(_SpentError):  # the best so far is what the budget buys
        minimize(descent, start, jac=True, method="SLSQP", bounds=np.stack(bounds, axis=1), options=settings)
    return best


@dataclass(frozen=True)
class GeneticPolicy(_Rival):
    """A genetic algorithm over all unknowns: simulated binary crossover and polynomial mutation, integers rounded."""

    population: int = 100
    """Individuals (count)."""
    generations: int = 500
    """Generations; 50,000 evaluations with the population above."""

    def _found(self, search: Search, rng: np.random.Generator) -> tuple[np.ndarray, np.ndarray]:
        # imported here, as the core does not need it
        from pymoo.algorithms.soo.nonconvex.ga import GA
        from pymoo.core.problem import Problem
        from pymoo.optimize import minimize as run

        low, high = search.bounds
        margin = np.repeat([0.49, 0.0], [INTEGERS, PLAIN])  # so that every integer is drawn as often

        class Template(Problem):
            def _evaluate(self, x: np.ndarray, out: dict[str, Any], *_: Any, **__: Any) -> None:
                integers = x[:, :INTEGERS].round().astype(np.int64)
                out["F"] = -search.worth(integers, np.ascontiguousarray(x[:, INTEGERS:]))

        problem = Template(n_var=len(low), n_obj=1, xl=low - margin, xu=high + margin)
        seed = int(rng.integers(2**31))
        found = run(problem, GA(pop_size=self.population), ("n_gen", self.generations), seed=seed, verbose=False)
        x = np.asarray(found.X)
        return x[:INTEGERS].round().astype(np.int64), x[INTEGERS:]


@dataclass(frozen=True)
class EvolutionPolicy(_Rival):
    """CMA-ES over the continuous unknowns, from the choices of corners that are worth most on Tutte's embedding."""

    starts: int = 4
    """Choices of corners (count)."""
    evaluations: int = 2500
    """Evaluations from each."""
    step: float = 0.05
    """First standard deviation of displacements and amplitudes."""

    def _found(self, search: Search, rng: np.random.Generator) -> tuple[np.ndarray, np.ndarray]:
        # imported here, as the core does not need it
        import cma

        pairs, _ = corner_choices(len(search.domain), MOST_CHOICES)
        straight = np.zeros((len(pairs), PLAIN))
        layers = np.full(len(pairs), search.layers[0])
        order = np.argsort(-search.worth(np.column_stack([pairs, layers]), straight), kind="stable")
        low, high = search.bounds[:, INTEGERS:]
        best: tuple[float, np.ndarray, np.ndarray] | None = None
        for pair in pairs[order[: self.starts]]:
            integers = search.best_layers(pair, np.zeros(PLAIN))
            options = {"seed": int(rng.integers(1, 2**31)), "verbose": -9, "bounds": [low.tolist(), high.tolist()]}
            strategy = cma.CMAEvolutionStrategy(
                np.zeros(PLAIN), self.step, options | {"maxfevals": self.evaluations, "CMA_diagonal": 0}
            )
            while not strategy.stop():
                asked = strategy.ask()
                drawn = np.array(asked)
                worth = search.worth(np.tile(integers, (len(drawn), 1)), drawn)
                strategy.tell(asked, (-worth).tolist())
            reals = np.asarray(strategy.result.xbest)
            integers = search.best_layers(pair, reals)
            worth = float(search.worth(integers[None], reals[None])[0])
            if best is None or worth > best[0]:
                best = worth, integers, reals
        if best is None:
            raise InputError("CMA-ES", "no start was asked for", "ask for at least one")
        return best[1], best[2]
