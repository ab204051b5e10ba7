import itertools

import numpy as np
import pytest

from drl_meshgen.errors import InputError
from drl_meshgen.templates import Domain, OParameters, Outcome, RulePolicy, fill_cap, instantiate
from drl_meshgen.templates.untangle import untangle


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


def test_a_deep_cap_gets_as_many_cells_as_its_size_field_asks_for():
    # cylinder of height 1 closed by a hemisphere, both of radius 1, in its conformal disk map
    count, rim = 48, np.exp(-1.0)
    spacing = 2 * np.pi / count

    def size(points):
        r = np.linalg.norm(points, axis=1)
        return spacing * np.where(r > rim, r, rim / 2 * (1 + np.minimum(r / rim, 1) ** 2))

    mesh = fill_cap(circle(count), size=size)
    assert mesh.valid
    assert len(mesh.quads) == pytest.approx(2 * np.pi * (1 + 1) / spacing**2, rel=0.2)
    assert len(mesh.quads) > 1.5 * len(fill_cap(circle(count)).quads)


def l_shape(per_unit):
    corners = np.array([[0, 0], [2, 0], [2, 1], [1, 1], [1, 2], [0, 2], [0, 0]], float)
    sides = [
        a + np.arange(per_unit * int(np.abs(b - a).sum()))[:, None] * (b - a) / (per_unit * np.abs(b - a).sum())
        for a, b in itertools.pairwise(corners)
    ]
    return np.concatenate(sides)


def test_folded_cells_of_a_non_convex_domain_are_unfolded_without_moving_the_boundary():
    boundary = l_shape(12)
    domain = Domain(boundary)
    size = np.full(10_000, 1 / 12)
    corners = boundary[[0, 24, 48, 72]]
    folded = instantiate(domain, OParameters(0, 24, 24, 3, 1.2 + 0.2 * (corners - 1), np.zeros((8, 2))))
    assert len(folded.folded) > 0
    mesh, outcome = untangle(folded, len(boundary), size[: len(folded.points)])
    assert outcome is Outcome.UNTANGLED
    assert mesh.valid
    assert np.array_equal(mesh.points[: len(boundary)], boundary)


def test_any_policy_may_choose_the_parameters():
    class Straight:
        def choose(self, domain, *, layers=None, size=None, **_given):
            at = domain.nodes[::6]
            return OParameters(0, 6, 6, layers or (2 if size is None else 3), 0.6 * at, np.zeros((8, 2)))

    mesh = fill_cap(circle(24), Straight())
    assert mesh.parameters.singular == pytest.approx(0.6 * circle(24)[::6])


def test_a_hopeless_domain_ends_with_a_verdict_and_no_error():
    # boundary cells would need more than half a turn at a slit's tip: no O-type mesh of these nodes is valid
    slit = np.array([[0, 0], [4, 0], [4, 4], [2.02, 4], [2, 0.1], [1.98, 4], [0, 4], [0, 2]], float)
    mesh = fill_cap(slit)
    assert mesh.outcome in set(Outcome)
    assert mesh.valid == (mesh.outcome is not Outcome.FOLDED)
