"""Spines: the homotopy type of the surface, one ring per loop, for any number of loops and for a handle."""

import numpy as np
import pytest

from drl_meshgen.decompose import DecomposeOptions, decompose
from drl_meshgen.decompose.cells import cells
from drl_meshgen.decompose.spine import loop_distances, nearest_distance, spine
from drl_meshgen.mesh.cutgraph import corner_classes
from drl_meshgen.mesh.topology import Topology
from drl_meshgen.partition.cutting import midpoint_refined
from tests.chains import chain, grid

PLATES = {f"plate with {k} loops": (lambda k=k: grid(4 * k, 8, k - 1), k, 0) for k in (3, 4, 6, 9)}
TORI = {f"torus with {k} loops": (lambda k=k: grid(16, 9, k, torus=True), k, 1) for k in (1, 2, 3)}
SHAPES = PLATES | TORI


@pytest.fixture(params=SHAPES)
def opened(request):
    build, k, genus = SHAPES[request.param]
    mesh = midpoint_refined(build())
    loops = mesh.topology.loops
    assert len(loops) == k
    assert mesh.topology.euler == 2 - 2 * genus - k
    return mesh, loops, spine(mesh, nearest_distance(mesh, loops, loop_distances(mesh, loops), 0.0)), k, genus


def test_excess_degrees_of_the_spine_are_twice_k_minus_two_plus_four_g(opened):
    _, _, graph, k, genus = opened
    assert (graph.degrees - 2).sum() == 2 * (k - 2) + 4 * genus
    assert graph.degrees.min() >= 3


def test_the_spine_has_the_euler_characteristic_of_the_surface(opened):
    mesh, _, graph, _, _ = opened
    edges = mesh.topology.edges[graph.edge_flags]
    assert len(np.unique(edges)) - len(edges) == mesh.topology.euler
    assert len(graph.nodes) - len(graph.paths) == mesh.topology.euler


def test_paths_run_between_nodes_along_edges_and_cover_the_spine_once(opened):
    mesh, _, graph, _, _ = opened
    index = {tuple(e): n for n, e in enumerate(mesh.topology.edges.tolist())}
    used = np.zeros(len(index), int)
    for path, (a, b) in zip(graph.paths, graph.ends, strict=True):
        assert (path[0], path[-1]) == (graph.nodes[a], graph.nodes[b])
        assert not np.isin(path[1:-1], graph.nodes).any()
        np.add.at(used, [index[tuple(sorted(pair))] for pair in zip(path.tolist(), path[1:].tolist(), strict=False)], 1)
    np.testing.assert_array_equal(used, graph.edge_flags)


def test_what_the_spine_leaves_is_one_ring_per_loop(opened):
    mesh, loops, graph, k, _ = opened
    classes = corner_classes(mesh.topology, graph.edge_flags)
    rest = Topology(classes.max() + 1, classes)
    n, label = rest.components
    assert n == k
    for piece in range(n):
        part = Topology(classes.max() + 1, classes[label == piece])
        assert (part.euler, len(part.loops)) == (0, 2)
        touched = [np.isin(loop, mesh.triangles[label == piece]).all() for loop in loops]
        assert sum(touched) == 1


def test_cells_have_the_loops_inside_and_see_every_spine_edge_from_both_sides(opened):
    mesh, loops, graph, k, _ = opened
    found = cells(mesh, graph, loops)
    assert found is not None
    assert len(found) == k
    seen = sorted(side for cell in found for side in cell.sides)
    assert seen == sorted((e, forward) for e in range(len(graph.paths)) for forward in (False, True))
    for cell, loop in zip(found, loops, strict=True):
        assert set(cell.ring.origin[cell.ring.inner].tolist()) == set(loop.tolist())
        assert cell.theta_shares.sum() == pytest.approx(1)
        assert cell.theta_shares.min() > 0
    assert sum(cell.ring.mesh.area for cell in found) == pytest.approx(mesh.area, rel=1e-12)


def test_sides_of_a_cell_follow_its_outer_loop(opened):
    mesh, loops, graph, _, _ = opened
    for cell in cells(mesh, graph, loops):
        rim = cell.ring.origin[cell.ring.outer]
        along = [graph.paths[e] if forward else graph.paths[e][::-1] for e, forward in cell.sides]
        np.testing.assert_array_equal(np.roll(rim, -cell.starts[0]), np.concatenate([path[:-1] for path in along]))


def test_the_spine_keeps_half_way_between_two_straight_loops():
    # a plate with one slot in its middle row: the spine around the slot has no node
    mesh = midpoint_refined(grid(12, 9, holes=1))
    loops = mesh.topology.loops
    graph = spine(mesh, nearest_distance(mesh, loops, loop_distances(mesh, loops), 0.0))
    assert not len(graph.nodes)
    assert not graph.paths
    assert cells(mesh, graph, loops) is None


def test_distance_is_least_on_the_loops_and_grows_away_from_them():
    mesh = grid(20, 12, holes=2)
    loops = mesh.topology.loops
    for exponent in (0.0, 1.0):
        distance = nearest_distance(mesh, loops, loop_distances(mesh, loops), exponent)
        on_loop = mesh.topology.on_boundary
        assert np.ptp(distance[on_loop]) == 0
        assert distance[on_loop].max() < distance[~on_loop].min()


def test_every_junction_of_a_real_partition_keeps_the_identity():
    for name in ("bumps", "two limbs", "four limbs", "plate with holes"):
        for junction in decompose(chain(name)["partition"], DecomposeOptions(strips=False)).pieces.junctions:
            assert (junction.spine.degrees - 2).sum() == 2 * (len(junction.cells) - 2)
            assert junction.distortion >= 0
            assert junction.lengths.min() > 0
