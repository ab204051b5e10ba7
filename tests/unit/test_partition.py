"""Regions and curves keep the books: Euler characteristics, areas, loops and curvature add up."""

from collections import Counter

import numpy as np
import pytest

from drl_meshgen.decompose.cells import submesh
from drl_meshgen.errors import StageError
from drl_meshgen.mesh.cutgraph import trace
from drl_meshgen.mesh.topology import Topology
from drl_meshgen.partition import CutSurface, Outcome, PartitionOptions, RegionKind, partition
from drl_meshgen.partition.join_tree import join_tree
from drl_meshgen.partition.levels import Level
from drl_meshgen.partition.stage import filled_superlevel, smoothed_depth
from drl_meshgen.partition.thin import levelled
from drl_meshgen.ricci.flow import vertex_curvature
from drl_meshgen.ricci.triangulation import corners
from tests.chains import SURFACES, chain, grid
from tests.ricci_shapes import annulus, icosahedron
from tests.strategies import flat_disk, reordered


@pytest.fixture(params=SURFACES)
def run(request):
    return chain(request.param)


def test_euler_characteristics_of_the_regions_add_up_to_that_of_the_surface(run):
    # curves are circles: they count nothing
    assert sum(r.euler for r in run["partition"].regions) == run["cleanup"].surface.topology.euler


def test_every_curve_is_shared_by_two_regions_and_every_boundary_loop_belongs_to_one(run):
    parts = run["partition"]
    owners = Counter(c for region in parts.regions for c in region.loops)
    assert owners == {c: 1 if curve.is_boundary else 2 for c, curve in enumerate(parts.curves)}
    assert sum(curve.is_boundary for curve in parts.curves) == len(run["cleanup"].surface.topology.loops)


def test_regions_are_connected_and_cover_the_surface_once(run):
    parts = run["partition"]
    assert np.array_equal(np.unique(parts.region), np.arange(len(parts.regions)))
    for r, region in enumerate(parts.regions):
        piece = submesh(parts.surface.mesh, np.nonzero(parts.region == r)[0])[0].topology
        assert piece.components[0] == 1
        assert piece.euler == region.euler
        assert len(piece.loops) == len(region.loops)


def test_kind_of_a_region_follows_from_its_topology(run):
    for region in run["partition"].regions:
        genus = (2 - region.euler - len(region.loops)) // 2
        assert genus == 0
        assert region.kind is {1: RegionKind.CAP, 2: RegionKind.TUBE}.get(len(region.loops), RegionKind.JUNCTION)


def test_cutting_keeps_area_orientation_loops_and_old_vertices(run):
    surface, after = run["cleanup"].surface, run["partition"].surface
    np.testing.assert_array_equal(after.mesh.vertices[: len(surface.vertices)], surface.vertices)
    share = np.bincount(after.parent, after.mesh.areas, len(surface.triangles))
    np.testing.assert_allclose(share, surface.areas, rtol=1e-9)
    agreement = (after.mesh.normals * surface.normals[after.parent]).sum(axis=1)
    assert agreement.min() > 1 - 1e-6
    t = after.mesh.topology
    assert t.edge_count.max() == 2
    assert not len(t.misoriented_edges)
    assert (t.euler, len(t.loops)) == (surface.topology.euler, len(surface.topology.loops))


def test_curvature_of_each_region_adds_up_to_its_euler_characteristic(run):
    parts = run["partition"]
    for r, region in enumerate(parts.regions):
        piece = submesh(parts.surface.mesh, np.nonzero(parts.region == r)[0])[0]
        p = piece.corners
        lengths = np.stack([np.linalg.norm(p[:, (k + 2) % 3] - p[:, (k + 1) % 3], axis=1) for k in range(3)], axis=1)
        curvature = vertex_curvature(piece, piece.triangles, corners(np.log(lengths)).angles)
        assert curvature.sum() == pytest.approx(2 * np.pi * region.euler, abs=1e-6)


def test_contours_are_simple_closed_edge_paths_at_their_level(run):
    parts = run["partition"]
    edges = {tuple(edge) for edge in parts.surface.mesh.topology.edges.tolist()}
    for n, curve in enumerate(c for c in parts.curves if not c.is_boundary):
        v = curve.vertices
        assert len(set(v.tolist())) == len(v) > 2
        assert all(tuple(sorted(pair)) in edges for pair in zip(v.tolist(), np.roll(v, -1).tolist(), strict=True))
        assert (parts.surface.contour[v] == n).all()
        assert (parts.surface.depth[v] == curve.level).all()


def test_isovalues_lie_strictly_inside_their_arcs(run):
    table = run["partition"].isovalues
    assert (table.isovalue > table.arc_low).all()
    assert (table.isovalue < table.arc_high).all()


def test_isovalues_on_one_arc_keep_their_distance(run):
    for _, values in run["partition"].isovalues.groupby("arc").isovalue:
        assert np.diff(np.sort(values)).min(initial=np.inf) >= PartitionOptions.min_tube


@pytest.mark.parametrize(("name", "limbs"), [("two limbs", 2), ("four limbs", 4)])
def test_every_limb_gets_a_cap_and_all_meet_in_one_junction(name, limbs):
    kinds = Counter(region.kind for region in chain(name)["partition"].regions)
    assert kinds[RegionKind.CAP] == limbs
    assert kinds[RegionKind.JUNCTION] == 1


def caps(run, options, edge):
    surface = run["cleanup"].surface
    size = np.full(len(surface.vertices), edge)
    parts = partition(surface, run["ricci"].u, options, size=size)
    return Counter(region.kind for region in parts.regions)[RegionKind.CAP]


def test_limbs_thinner_than_the_wanted_quads_are_left_out_and_thick_ones_stay():
    run = chain("four limbs")
    lengths = run["partition"].isovalues.length
    always_small = PartitionOptions(small_limb=np.inf)
    assert caps(run, always_small, lengths.min() / 10) == 4
    assert caps(run, always_small, lengths.max()) < 4


@pytest.mark.parametrize(
    "options", [PartitionOptions(least_girth=0, small_limb=np.inf), PartitionOptions(small_limb=0)]
)
def test_limbs_that_are_long_or_that_nobody_asks_to_be_thick_stay_however_thin(options):
    run = chain("four limbs")
    assert caps(run, options, run["partition"].isovalues.length.max()) == 4


def test_levelling_limbs_lowers_them_to_their_saddle_and_changes_nothing_else():
    run = chain("four limbs")
    surface, options = run["cleanup"].surface, PartitionOptions(small_limb=np.inf, least_girth=np.inf)
    depth = smoothed_depth(surface, run["ricci"].u, options.smoothing)
    tree = join_tree(surface.topology.edges, depth, options.persistence, options.min_arc)
    flat = levelled(surface, depth, tree, options, np.ones(len(depth)))
    saddles = {arc.low for arc in tree.arcs if arc.upper < 0}
    assert set(flat[flat != depth]) <= saddles
    assert (flat <= depth).all()
    left = join_tree(surface.topology.edges, flat, options.persistence, options.min_arc)
    assert len(left.tips) == 1
    assert levelled(surface, flat, left, options, np.ones(len(depth))) is flat


def test_a_flat_sheet_stays_whole():
    sheet = grid(10, 6, holes=2)
    parts = partition(sheet, np.zeros(len(sheet.vertices)))
    assert [region.kind for region in parts.regions] == [RegionKind.JUNCTION]
    assert all(curve.is_boundary for curve in parts.curves)
    assert parts.outcome is Outcome.DONE


def test_regions_do_not_depend_on_the_order_of_vertices():
    run = chain("two limbs")
    surface, u = run["cleanup"].surface, run["ricci"].u
    mixed, old = reordered(surface, seed=5)
    one, two = partition(surface, u), partition(mixed, u[old])
    np.testing.assert_allclose(np.sort(one.isovalues.isovalue), np.sort(two.isovalues.isovalue), rtol=1e-12)
    areas = [np.sort(np.bincount(p.region, p.surface.mesh.areas)) for p in (one, two)]
    np.testing.assert_allclose(*areas, rtol=1e-9)


def test_a_closed_surface_is_refused():
    closed = icosahedron()
    with pytest.raises(StageError) as error:
        partition(closed, np.zeros(len(closed.vertices)))
    assert error.value.outcome is Outcome.NO_BOUNDARY


def test_the_border_of_a_superlevel_set_with_a_hole_is_one_closed_curve():
    #  depth of a crater:  _/\__/\_   the ring above the level is filled, so its inner rim is no border
    disk = flat_disk(800)
    r = np.linalg.norm(disk.vertices, axis=1)
    crater = 1 - np.abs(r - 0.5)
    level = Level(0, 0.8, int(np.argmax(crater)), 0.0, "")
    inside = filled_superlevel(CutSurface.whole(disk, crater), level, int(disk.topology.loops[0][0]))
    assert inside is not None
    assert inside[0]
    filled = Topology(len(disk.vertices), disk.triangles[inside[disk.triangles].all(axis=1)])
    assert (filled.euler, len(filled.loops)) == (1, 1)


def test_a_superlevel_set_of_next_to_nothing_is_not_cut():
    disk = flat_disk(300)
    depth = 1 - np.linalg.norm(disk.vertices, axis=1)
    whole, root = CutSurface.whole(disk, depth), int(disk.topology.loops[0][0])
    assert filled_superlevel(whole, Level(0, 0.999, 0, 0.0, ""), root) is None
    assert filled_superlevel(whole, Level(0, -1.0, 0, 0.0, ""), root) is None


def test_smoothing_the_depth_keeps_the_boundary_and_makes_no_new_extremes():
    ring = annulus(40)
    u = -np.random.default_rng(0).uniform(0, 3, len(ring.vertices))
    u[ring.topology.on_boundary] = 0
    for sweeps in (0, 1, 5):
        depth = smoothed_depth(ring, u, sweeps)
        assert (depth[ring.topology.on_boundary] == 0).all()
        assert depth.min() >= 0
        assert depth.max() <= -u.min()
    np.testing.assert_array_equal(smoothed_depth(ring, u, 0), -u)


def test_tracing_gives_each_closed_curve_once_from_its_smallest_vertex():
    edges = np.array([[4, 2], [2, 9], [9, 4], [1, 3], [3, 8], [8, 5], [5, 1]])
    assert [c.tolist() for c in trace(edges)] == [[1, 3, 8, 5], [2, 4, 9]]
