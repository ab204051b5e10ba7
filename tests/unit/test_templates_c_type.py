import numpy as np
import pytest

from drl_meshgen.errors import InputError
from drl_meshgen.templates import CCounts, CParameters, CSides, Domain, Outcome, fill_transition, instantiate_c
from drl_meshgen.templates.c_type import EDGES, layout

COUNTS = [CCounts(1, 1, 1, 1, 1, 1), CCounts(4, 3, 4, 4, 3, 4), CCounts(2, 5, 3, 6, 2, 1), CCounts(1, 1, 1, 4, 1, 3)]


def patch(counts, height=0.6, bump=0.0):
    sides = [(0, 0, 1, 0), (1, 0, 1, height), (1, height, 0, height), (0, height, 0, 0)]
    nodes = []
    bottom, side, top = counts.sides
    for (x0, y0, x1, y1), count in zip(sides, (bottom, side, top, side), strict=True):
        t = np.arange(count)[:, None] / count
        nodes.append([x0, y0] + t * [x1 - x0, y1 - y0])
    nodes = np.concatenate(nodes)
    return nodes + bump * np.c_[0 * nodes[:, 0], np.sin(np.pi * nodes[:, 0])]


@pytest.fixture(params=COUNTS, ids=str)
def counts(request):
    return request.param


def test_a_transition_has_nine_blocks_and_two_nodes_each_of_valence_three_and_five(counts):
    mesh = fill_transition(patch(counts), 0, counts)
    topology = mesh.blocks.mesh.topology
    assert len(mesh.grids) == 9
    assert topology.euler == 1
    assert len(topology.misoriented_edges) == 0
    assert topology.edge_count.max() == 2
    assert sorted(topology.valence[mesh.blocks.mesh.irregular]) == [3, 3, 5, 5]
    assert mesh.outcome is Outcome.VALID


def test_sides_have_the_counts_asked_for_and_differ_by_twice_p(counts):
    mesh = fill_transition(patch(counts), 0, counts)
    valence = mesh.blocks.mesh.topology.valence[: counts.boundary]
    corners = np.nonzero(valence == 2)[0]
    assert np.diff(np.append(corners, counts.boundary)).tolist() == [
        counts.sides.bottom,
        counts.sides.side,
        counts.sides.top,
        counts.sides.side,
    ]
    assert counts.sides.bottom - counts.sides.top == 2 * counts.p


def test_twelve_internal_edges_join_the_blocks(counts):
    plan = layout(0, counts)
    rims = {tuple(sorted(side)) for g in plan.grids for side in (g[:, 0], g[:, -1], g[0], g[-1])}
    internal = {tuple(sorted(plan.path[a, b])) for a, b, _ in EDGES}
    assert len(internal) == 12
    assert internal <= rims
    assert len(rims) == 12 + 12


def test_every_node_belongs_to_a_block_and_boundary_nodes_are_untouched(counts):
    boundary = patch(counts)
    mesh = fill_transition(boundary, 0, counts)
    assert mesh.blocks.mesh.topology.used.all()
    assert np.array_equal(mesh.points[: len(boundary)], boundary)
    assert mesh.blocks.mesh.topology.loops[0].tolist() == list(range(len(boundary)))


def test_the_bottom_left_corner_may_be_any_boundary_node(counts):
    boundary = patch(counts)
    mesh = fill_transition(boundary, 0, counts)
    shifted = fill_transition(np.roll(boundary, 5, axis=0), 5, counts)
    inner = slice(counts.boundary, None)
    assert np.allclose(shifted.points[inner], mesh.points[inner], atol=1e-12)


def test_a_curved_patch_stays_valid():
    counts = CCounts(4, 3, 4, 4, 3, 4)
    assert fill_transition(patch(counts, bump=0.25), 0, counts).valid


def test_bulges_bend_internal_edges_but_not_the_boundary():
    counts = CCounts(4, 3, 4, 4, 3, 4)
    domain = Domain(patch(counts))
    straight = fill_transition(domain.nodes, 0, counts).parameters
    bent = CParameters(0, counts, straight.singular, np.tile([0.05, 0.0], (12, 1)))
    before, after = instantiate_c(domain, straight), instantiate_c(domain, bent)
    assert np.array_equal(before.points[: len(domain)], after.points[: len(domain)])
    assert abs(after.points - before.points).max() > 1e-3


@pytest.mark.parametrize(("bottom", "top", "side"), [(12, 8, 6), (5, 3, 2), (40, 20, 9)])
def test_balanced_counts_add_up_to_the_sides(bottom, top, side):
    counts = CCounts.between(CSides(bottom, side, top))
    assert counts.sides == (bottom, side, top)


@pytest.mark.parametrize(("bottom", "top", "side"), [(9, 8, 4), (8, 8, 4), (6, 8, 4), (4, 2, 4), (8, 6, 1)])
def test_counts_that_cannot_be_joined_are_refused(bottom, top, side):
    with pytest.raises(InputError):
        CCounts.between(CSides(bottom, side, top))


def test_counts_that_do_not_fit_the_boundary_are_refused():
    with pytest.raises(InputError, match="boundary nodes"):
        fill_transition(patch(COUNTS[0]), 0, COUNTS[1])
