"""Damped Gauss-Newton steps on the surface, solved by preconditioned conjugate gradients."""

from collections.abc import Callable

import numpy as np
from jaxtyping import Bool, Float

from drl_meshgen.smoothing.energy import QuadEnergy, Residuals, System
from drl_meshgen.smoothing.nodes import NodeSpace, NodeState, shortened

FIRST_DAMPING = 0.01
EASE, HARDEN = 1 / 3, 4.0
"""Factors of the damping after a step that lowered the cost and after one that did not."""
LEAST_DAMPING, MOST_DAMPING = 1e-3, 1e3
LOCAL_TRIES = 5
"""Trials of one step, each shortened where the one before made things worse."""
LOCAL_SHORTENING = 0.25
SPOT = 0.01
"""A quad that accounts for more than this share of the increase of the cost is a spot."""
ENOUGH = 5e-3
"""A stage ends when a step lowers the cost by less than this share."""

Observer = Callable[[NodeState, Residuals, float, float], None]
"""Called after every accepted step with state, residuals, cost and damping."""


def minimise(
    space: NodeSpace,
    energy: QuadEnergy,
    state: NodeState,
    reach: Float[np.ndarray, " n"],
    *,
    steps: int,
    observe: Observer = lambda *_: None,
) -> NodeState:
    """Levenberg-Marquardt with at most `steps` linearisations; no node moves further than `reach` in one step.

    Where a step makes things worse in a few spots only, it is shortened there, not everywhere.
    """
    residuals = energy.residuals(state)
    costs, damping = energy.quad_costs(residuals), FIRST_DAMPING
    for _ in range(steps):
        system = energy.system(state, residuals)
        before = costs.sum()
        accepted = False
        while damping <= MOST_DAMPING and not accepted:
            step = solve(system, damping, energy.options.cg_iterations)
            step = shortened(step, reach[energy.ids])
            for _ in range(LOCAL_TRIES):
                full = np.zeros((len(reach), 2))
                full[energy.ids] = step
                trial = space.moved(state, full)
                trial_residuals = energy.residuals(trial)
                trial_costs = energy.quad_costs(trial_residuals)
                accepted = trial_costs.sum() < before
                if accepted:
                    state, residuals, costs = trial, trial_residuals, trial_costs
                    break
                spots = local_trouble(energy, trial_costs - costs)
                if spots is None:
                    break
                step = np.where(spots[:, None], LOCAL_SHORTENING * step, step)
            damping = max(damping * EASE, LEAST_DAMPING) if accepted else damping * HARDEN
        cost = costs.sum()
        observe(state, residuals, cost, damping)
        if cost > (1 - ENOUGH) * before:
            break
    return state


def local_trouble(energy: QuadEnergy, increase: Float[np.ndarray, " m"]) -> Bool[np.ndarray, " n"] | None:
    """Nodes within two quads of the few that account for most of the increase; None if it has no such centre."""
    worse = np.maximum(increase, 0)
    culprits = worse > SPOT * worse.sum()
    if worse[culprits].sum() < 0.5 * worse.sum():
        return None
    nodes = np.zeros(energy.n_nodes, bool)
    for _ in range(2):
        nodes[energy.quads[:, culprits].ravel()] = True
        culprits = nodes[energy.quads].any(axis=0)
    return nodes


def solve(system: System, damping: float, iterations: int, tolerance: float = 0.05) -> Float[np.ndarray, "n 2"]:
    """Solve `(H + damping * blocks(H)) x = -g` to a relative residual by block-Jacobi conjugate gradients."""
    a, b, c = system.diagonal_blocks
    ridge = 1e-12 * (a + c) + np.where(a + c > 0, 0, 1)
    # a node with one unknown has an empty second row
    determinant = (a + ridge) * (c + ridge) - b * b
    lone = c <= 1e-9 * a
    inverse_a = np.where(lone, 1 / (a + ridge), (c + ridge) / determinant)
    inverse_b = np.where(lone, 0, -b / determinant)
    inverse_c = np.where(lone, 0, (a + ridge) / determinant)

    a, b, c = damping * system.diagonal_blocks

    def precondition(r: Float[np.ndarray, " u"]) -> Float[np.ndarray, " u"]:
        return apply(inverse_a, inverse_b, inverse_c, r)

    def damped(x: Float[np.ndarray, " u"]) -> Float[np.ndarray, " u"]:
        return system.multiply(x) + apply(a, b, c, x)

    x = np.zeros_like(system.gradient)
    r = -system.gradient
    z = precondition(r)
    p, rz = z, product(r, z)
    enough = tolerance**2 * rz
    for _ in range(iterations):
        if rz <= enough or rz == 0:
            break
        q = damped(p)
        alpha = rz / product(p, q)
        x += alpha * p
        r -= alpha * q
        z = precondition(r)
        rz, last = product(r, z), rz
        p = z + (rz / last) * p
    return x.reshape(-1, 2)


def apply(
    a: Float[np.ndarray, " n"], b: Float[np.ndarray, " n"], c: Float[np.ndarray, " n"], x: Float[np.ndarray, " u"]
) -> Float[np.ndarray, " u"]:
    """Multiply by the block-diagonal matrix of symmetric blocks [[a, b], [b, c]]."""
    out, first, second = np.empty_like(x), x[::2], x[1::2]
    out[::2] = a * first + b * second
    out[1::2] = b * first + c * second
    return out


def product(a: Float[np.ndarray, " u"], b: Float[np.ndarray, " u"]) -> float:
    """Scalar product summed in the same order on any number of threads."""
    return float(np.einsum("i,i->", a, b))
