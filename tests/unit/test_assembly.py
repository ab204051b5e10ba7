"""One mesh from all pieces: welded by ids, structured blocks, the topology of the surface."""

import numpy as np
import pytest

from drl_meshgen.assembly.blocks import Annulus, along_feet, bands
from drl_meshgen.lift.inverse import _lift
from drl_meshgen.mesh import BlockMesh
from drl_meshgen.mesh.topology import Topology
from drl_meshgen.quality import measure
from drl_meshgen.quality.structure import structural_defects
from tests.chains import SURFACES, chain


@pytest.fixture(params=SURFACES)
def run(request):
    return chain(request.param)


def quads(grids):
    return BlockMesh(np.zeros((max(g.max() for g in grids) + 1, 3)), tuple(grids)).mesh.quads


def test_the_assembled_mesh_is_manifold_oriented_and_every_block_is_a_grid(run):
    mesh = run["lift"].mesh
    assert structural_defects(mesh.mesh, mesh.block) == ()
    assert mesh.mesh.topology.used.all()


def test_the_mesh_has_the_components_loops_and_euler_characteristic_of_the_surface(run):
    mine, theirs = run["lift"].mesh.mesh.topology, run["cleanup"].surface.topology
    assert mine.components[0] == theirs.components[0] == 1
    assert len(mine.loops) == len(theirs.loops)
    assert mine.euler == theirs.euler


def test_the_finished_mesh_has_no_defect(run):
    mesh = run["smoothing"].mesh
    assert measure(mesh.mesh, run["cleanup"].surface, mesh.block, with_deviation=False).defects == ()


def test_boundary_edges_are_as_many_as_the_counts_of_the_boundary_loops(run):
    wanted = [
        int(n)
        for curve, n in zip(run["partition"].curves, run["decompose"].curve_counts, strict=True)
        if curve.is_boundary
    ]
    assert sorted(len(loop) for loop in run["lift"].mesh.mesh.topology.loops) == sorted(wanted)


def test_every_quad_of_the_fills_is_there_once(run):
    fills = run["subdomain"]
    rings = sum((fill.chart.shape[0] - 1) * fill.chart.shape[1] for fill in fills.rings)
    caps = sum(len(f.first) * f.layers + (f.core.shape[0] - 1) * (f.core.shape[1] - 1) for f in fills.caps)
    strips = sum((fill.chart.shape[0] - 1) * (fill.chart.shape[1] - 1) for fill in fills.strips)
    q = run["lift"].mesh.mesh.quads
    assert len(q) == rings + caps + strips
    assert len(np.unique(np.sort(q, axis=1), axis=0)) == len(q)


def test_irregular_nodes_are_four_per_cap_the_nodes_of_spines_and_the_inner_corners_of_strips(run):
    mesh = run["lift"].mesh.mesh
    valence = mesh.topology.valence[mesh.irregular]
    pieces, curves = run["decompose"].pieces, run["partition"].curves
    expected = [3] * (4 * len(pieces.caps))
    for junction in pieces.junctions:
        if not junction.strips:
            expected += (2 * junction.spine.degrees).tolist()
        expected += [5 for rim in junction.rims for _ in rim.sides if not curves[rim.curve].is_boundary]
    assert sorted(valence.tolist()) == sorted(expected)


def test_indices_of_all_nodes_add_up_to_the_euler_characteristic(run):
    t = run["lift"].mesh.mesh.topology
    index = np.where(t.on_boundary, 3 - t.valence, 4 - t.valence)
    assert index.sum() == 4 * t.euler


def test_pieces_put_their_shared_nodes_in_the_same_place(run):
    """Positions of curve and spine nodes do not depend on which of the pieces that share them is asked."""
    layout, fills, assembly = run["decompose"], run["subdomain"], run["assembly"]
    points, spacing = run["lift"].mesh.points, layout.spacing
    start = np.r_[0, np.cumsum(layout.curve_counts)]  # nodes of curves come first

    def check(piece, nodes, chart, share=0.01):
        gap = np.linalg.norm(_lift(layout, piece, chart) - points[nodes], axis=1)
        assert gap.max() < share * spacing

    k = 0
    for junction in layout.pieces.junctions:
        for curve, _ in zip(junction.curves, junction.cells, strict=True):
            check(k, start[curve] + fills.rings[k].first, fills.rings[k].chart[0])
            k += 1
    for tube in layout.pieces.tubes:
        check(k, start[tube.curves[0]] + fills.rings[k].first, fills.rings[k].chart[0])
        check(k, start[tube.curves[1]] + fills.rings[k].last, fills.rings[k].chart[-1])
        k += 1
    for cap, fill in zip(layout.pieces.caps, fills.caps, strict=True):
        check(
            k, start[cap.curve] + fill.first, fill.chart[: len(fill.first)], 0.3
        )  # nodes on the circle, the chart's rim is a polygon
        k += 1
    for _ in layout.pieces.strips:
        assert (assembly.piece == k).any()
        k += 1
    assert assembly.piece.min() >= 0
    assert assembly.piece.max() == k - 1


def ring(first, rows, n, start, *, feet=(), inner=-1, is_cell=False):
    """Annulus of new ids from `start` on, whose row 0 is `first`."""
    new = start + np.arange(rows * n).reshape(rows, n)
    return Annulus(np.vstack([first, new]), 0, inner, feet, is_cell)


def test_a_flipped_ring_is_the_same_ring_with_the_same_orientation():
    one = Annulus(np.arange(15).reshape(3, 5), 2, 4, (1, 3))
    two = one.flipped()
    assert (two.first, two.last) == (4, 2)
    assert two.ids[-1, 0] == one.ids[0, 0]
    assert set(two.ids[0]) == set(one.ids[-1])
    np.testing.assert_array_equal(two.flipped().ids, one.ids)
    assert two.flipped().feet == one.feet
    assert [two.ids[0, f] for f in two.feet] == [one.ids[-1, f] for f in one.feet]
    both = np.vstack([quads([np.c_[a.ids, a.ids[:, :1]].T]) for a in (one, two)])
    canonical = [np.roll(q, -int(q.argmin())).tolist() for q in both]
    assert sorted(canonical[:10]) == sorted(canonical[10:])


@pytest.mark.parametrize("shift", [0, 3, 5])
def test_rings_that_share_a_curve_are_stacked_into_blocks_across_it(shift):
    n = 8
    curve = np.arange(n)
    cell = ring(curve, 3, n, 100, feet=(1, 4, 6), is_cell=True)
    # the tube meets the curve at its last row, turned by `shift`
    tube = Annulus(np.vstack([200 + np.arange(2 * n).reshape(2, n), np.roll(curve, -shift)]), 1, 0)
    grids = along_feet(bands([cell, tube], through=False))
    assert len(grids) == 3
    assert sorted(g.shape[0] - 1 for g in grids) == [2, 3, 3]
    assert {g.shape[1] - 1 for g in grids} == {5}
    assert len(quads(grids)) == 5 * n
    t = Topology(400, quads(grids))
    assert t.edge_count.max() == 2
    assert not len(t.misoriented_edges)
    assert (t.euler, len(t.loops)) == (0, 2)


@pytest.mark.parametrize("feet", [(), (3,)])
def test_a_ring_with_fewer_than_two_feet_is_cut_into_blocks_all_the_same(feet):
    grids = along_feet(bands([ring(np.arange(9), 2, 9, 20, feet=feet)], through=False))
    assert len(grids) == (2 if feet else 4)
    assert all(len(np.unique(g)) == g.size for g in grids)
    assert sum(g.shape[0] - 1 for g in grids) == 9
