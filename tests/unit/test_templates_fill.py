import numpy as np
import pytest

from drl_meshgen.errors import InputError
from drl_meshgen.templates import Outcome, RulePolicy, fill_cap


def circle(count, seed=None, spread=0.3):
    step = np.ones(count) if seed is None else np.exp(np.random.default_rng(seed).normal(0, spread, count))
    angle = 2 * np.pi * np.cumsum(step) / step.sum()
    return np.c_[np.cos(angle), np.sin(angle)]


@pytest.mark.parametrize("count", [8, 10, 12, 24, 60])
def test_a_cap_has_five_blocks_and_four_nodes_of_valence_three(count):
    mesh = fill_cap(circle(count, seed=count))
    topology = mesh.blocks.mesh.topology
    p = mesh.parameters
    assert len(mesh.grids) == 5
    assert topology.euler == 1
    assert sorted(topology.valence[mesh.blocks.mesh.irregular]) == [3] * 4
    assert len(mesh.points) == count * p.layers + (p.m + 1) * (p.n + 1)
    assert len(mesh.quads) == count * p.layers + p.m * p.n
    assert mesh.valid
    assert mesh.outcome is Outcome.VALID


def test_boundary_nodes_come_first_untouched_and_in_order():
    boundary = circle(30, seed=1)
    mesh = fill_cap(boundary)
    assert np.array_equal(mesh.points[:30], boundary)
    assert [loop.tolist() for loop in mesh.blocks.mesh.topology.loops] == [list(range(30))]


def test_a_given_number_of_layers_is_kept():
    assert fill_cap(circle(24), RulePolicy(), k=5).parameters.layers == 5


def test_an_odd_boundary_is_refused():
    with pytest.raises(InputError, match="odd"):
        fill_cap(circle(9))
