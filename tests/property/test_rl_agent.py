"""The shipped policy: never an invalid mesh, and the same mesh however a domain is turned, mirrored or numbered."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from drl_meshgen.rl import Difficulty, drawn_domain
from drl_meshgen.rl.policies import policy_named
from drl_meshgen.templates import Domain, instantiate

FRESH = 2000


def fresh(seed, difficulty, low=60, high=140):
    rng = np.random.default_rng([20_000, seed])
    return drawn_domain(difficulty, rng, 2 * int(rng.integers(low // 2, high // 2 + 1)))[0]


def nodes_of(domain):
    return instantiate(domain, policy_named("agent").choose(domain)).points


def apart(a, b):
    """Return the largest distance from a node of either mesh to the nearest of the other."""
    gap = np.linalg.norm(a[:, None] - b[None], axis=-1)
    return max(gap.min(axis=0).max(), gap.min(axis=1).max())


@pytest.mark.parametrize("difficulty", list(Difficulty))
def test_every_fresh_domain_gets_a_valid_mesh(difficulty):
    policy = policy_named("agent")
    domains = (fresh(seed, difficulty) for seed in range(FRESH // 2))
    folded = [i for i, domain in enumerate(domains) if not instantiate(domain, policy.choose(domain)).valid]
    assert not folded


@pytest.mark.parametrize("count", [24, 400])
def test_small_and_large_boundaries_get_valid_meshes(count):
    policy = policy_named("agent")
    for seed in range(10):
        domain = fresh(seed, Difficulty.STANDARD, count, count)
        assert instantiate(domain, policy.choose(domain)).valid


@settings(max_examples=6, deadline=None, derandomize=True)
@given(
    st.integers(0, 500),
    st.sampled_from(Difficulty),
    st.floats(0, 6),
    st.floats(0.01, 100),
    st.integers(1, 59),
    st.booleans(),
)
def test_a_turned_mirrored_and_renumbered_domain_gets_the_same_mesh(  # noqa: PLR0917
    seed, difficulty, angle, scale, shift, mirror
):
    domain = fresh(seed, difficulty)
    move = scale * np.array([[np.cos(angle), np.sin(angle)], [-np.sin(angle), np.cos(angle)]])
    move = move * np.array([-1.0, 1.0]) if mirror else move
    moved = Domain.oriented(np.roll(domain.nodes @ move, shift, axis=0))
    assert apart(nodes_of(moved) / scale, nodes_of(domain) @ move / scale) < 1e-4
