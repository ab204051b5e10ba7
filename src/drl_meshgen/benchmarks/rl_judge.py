"""What every quick method makes of a domain: policies, value learners, Gmsh. One row per method, nothing is raised."""

import math
import time
from collections.abc import Sequence
from functools import cache
from pathlib import Path
from typing import Protocol

import numpy as np

from drl_meshgen.baselines.plane import PlaneMethod, plane_rivals
from drl_meshgen.benchmarks.record import Row
from drl_meshgen.errors import InputError
from drl_meshgen.rl.agent import BATCH, AgentOptions
from drl_meshgen.rl.datasets import Sample
from drl_meshgen.rl.finish import LAYERS, finished
from drl_meshgen.rl.plane_metrics import plane_metrics
from drl_meshgen.rl.policies import SHIPPED, policy_named
from drl_meshgen.rl.policy_file import read_policy
from drl_meshgen.templates import (
    CParameters,
    CSides,
    Domain,
    OParameters,
    RulePolicy,
    TemplatePolicy,
    instantiated,
)

OURS = "ours"
FINISHED = "ours, finished"
REPEATS = 5
"""How often a batch is timed."""
POLICIES = {OURS: "agent", FINISHED: "agent", "rule": "rule", "gradient optimiser": "optimizer"}
"""Policies by their names in the tables."""
LEARNERS = {"Double DQN (the paper's)": "dqn", "Rainbow-type DQN": "rainbow", "PPO": "ppo"}
"""Value learners by their names in the tables; judged where there is a file of weights of that name."""
GMSH = tuple(method.value for method in PlaneMethod)
SQUARE = Domain(np.array([[i, 0] for i in range(6)] + [[6, i] for i in range(6)]
                         + [[6 - i, 6] for i in range(6)] + [[0, 6 - i] for i in range(6)], float))  # fmt: skip
"""What a policy meets first, so that loading and compiling are not timed."""

ON_SQUARE = CSides(8, 6, 4)
"""Sides that its boundary can be taken for."""


class Chooser(Protocol):
    """What chooses the parameters of O-type meshes at least."""

    def choose(self, domain: Domain) -> OParameters:
        """Return parameters for a domain."""
        ...


@cache
def policy_of(method: str, folder: Path) -> Chooser | None:
    """Return the policy under a name of the tables; None where its weights are not there."""
    if method in LEARNERS:
        path = folder / f"{LEARNERS[method]}.safetensors"
        if not path.is_file():
            return None
        # imported here, as no other method needs the extra `rl`
        from drl_meshgen.rl.value.policy import load_value_policy

        policy = load_value_policy(path)
    elif method in {OURS, FINISHED} and not SHIPPED.is_file():
        return None
    else:
        finer = AgentOptions(layers=(LAYERS,), layers_then=(LAYERS, LAYERS + 1))
        policy = read_policy(SHIPPED, finer) if method == FINISHED else policy_named(POLICIES[method])
        policy.transition(SQUARE, 0, ON_SQUARE)
    finished(instantiated(SQUARE, policy.choose(SQUARE)), len(SQUARE))
    return policy


def made_by(policy: Chooser, sample: Sample) -> OParameters | CParameters | None:
    """Return what a policy chooses for a domain, of the type that fits it; None where it knows no such template."""
    if sample.transition is None:
        return policy.choose(sample.domain)
    return policy.transition(sample.domain, *sample.transition) if isinstance(policy, TemplatePolicy) else None


def judged(sample: Sample, folder: Path, methods: Sequence[str]) -> list[Row]:
    """Return a row per method: set, index, method, cause, metrics, milliseconds of CPU (of Gmsh: inside the mesher)."""
    rows = [row for method in methods if method not in GMSH for row in _chosen(sample, method, folder)]
    asked = [method for method in PlaneMethod if method.value in methods]
    if sample.transition:  # a grid has as many cells on opposite sides
        asked = [method for method in asked if method is not PlaneMethod.TRANSFINITE]
    corners = RulePolicy().choose(sample.domain).corners if PlaneMethod.TRANSFINITE in asked else np.arange(4)
    for method, made in (plane_rivals(sample.domain.nodes, corners, asked) if asked else {}).items():
        if len(made.quads):
            figures = plane_metrics(sample.domain, made.points, made.quads)
            rows.append(_row(sample, method.value, figures, 1000 * made.seconds))
        else:
            rows.append(_row(sample, method.value, {}, math.nan, made.outcome.value))
    return rows


def milliseconds_in_batch(samples: Sequence[Sample]) -> float:
    """Return milliseconds of CPU per domain of our choice of parameters in batches of `BATCH`; the best of several.

    NaN where there are no weights, or no domains with an even number of nodes.
    """
    domains = [sample.domain for sample in samples if len(sample.domain) % 2 == 0]
    if not domains or not SHIPPED.is_file():
        return math.nan
    policy, taken = read_policy(SHIPPED), []
    policy.choose_all(domains[:1])
    for _ in range(REPEATS):
        # domains anew, as they remember what was computed
        batch = [Domain(domains[i % len(domains)].nodes) for i in range(BATCH)]
        begin = time.process_time()
        policy.choose_all(batch)
        taken.append(1000 * (time.process_time() - begin) / BATCH)
    return min(taken)


def _chosen(sample: Sample, method: str, folder: Path) -> list[Row]:
    policy = policy_of(method, folder)
    if policy is None:
        return []
    begin = time.process_time()
    try:
        parameters = made_by(policy, sample)
    except InputError as error:
        return [_row(sample, method, {}, math.nan, str(error))]
    milliseconds = 1000 * (time.process_time() - begin)
    if parameters is None:
        return []
    mesh = instantiated(sample.domain, parameters)
    if method == FINISHED:
        mesh = finished(mesh, len(sample.domain))
        milliseconds = 1000 * (time.process_time() - begin)
    return [
        _row(sample, method, plane_metrics(sample.domain, np.array(mesh.points), np.array(mesh.quads)), milliseconds)
    ]


def _row(sample: Sample, method: str, figures: dict[str, float], milliseconds: float, cause: str = "") -> Row:
    """Return a row; a method without a mesh has no figures, but its domain is not valid."""
    head = {"set": sample.set, "index": sample.index, "family": sample.family, "method": method, "cause": cause}
    return head | (figures or {"valid": 0.0}) | {"ms": milliseconds}
