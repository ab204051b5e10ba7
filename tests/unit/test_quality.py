import numpy as np
import pytest

from drl_meshgen.mesh import QuadMesh, TriMesh
from drl_meshgen.quality import GateOptions, QuadShape, gate, measure
from drl_meshgen.quality.base_complex import base_complex, straight_pairs
from drl_meshgen.quality.closest import TriangleSearch
from drl_meshgen.quality.deviation import area_samples
from drl_meshgen.quality.shape import own_normals
from drl_meshgen.quality.structure import pinched_nodes, unstructured_blocks
from tests.standins import hemisphere, hemisphere_ogrid


def one_quad(*corners):
    p = np.array([[(*c, 0.0) if len(c) == 2 else c for c in corners]], float)
    return QuadShape(p, np.array([[0.0, 0.0, 1.0]]))


def plane_grid(n, m):
    points = np.stack(np.meshgrid(np.arange(n + 1.0), np.arange(m + 1.0), [0.0], indexing="ij"), -1).reshape(-1, 3)
    g = np.arange((n + 1) * (m + 1)).reshape(n + 1, m + 1)
    return QuadMesh(points, np.stack([g[:-1, :-1], g[1:, :-1], g[1:, 1:], g[:-1, 1:]], -1).reshape(-1, 4))


def rotation(seed=3):
    q, r = np.linalg.qr(np.random.default_rng(seed).normal(size=(3, 3)))
    q *= np.sign(np.diag(r))
    return q * np.sign(np.linalg.det(q))


def test_square_scores_full_marks_in_every_shape_metric():
    s = one_quad((0, 0), (2, 0), (2, 2), (0, 2))
    np.testing.assert_allclose(s.angle, 90)
    np.testing.assert_allclose([s.area[0], s.size[0], s.warp[0]], [4, 2, 0])
    np.testing.assert_allclose([s.orthogonality[0], s.jacobian_ratio[0], s.scaled_jacobian[0]], 1)
    assert s.valid.all()


def test_angles_of_a_planar_quad_sum_to_360_also_when_one_is_reflex():
    dart = one_quad((0, 0), (4, 0), (1, 1), (0, 4))
    assert dart.angle.sum() == pytest.approx(360)
    assert dart.max_angle[0] > 180
    assert not dart.valid[0]
    assert dart.jacobian_ratio[0] == 0


def test_rhombus_orthogonality_follows_its_worst_corner_and_the_printed_form_its_best():
    a = np.radians(60)
    s = one_quad((0, 0), (1, 0), (1 + np.cos(a), np.sin(a)), (np.cos(a), np.sin(a)))
    assert s.orthogonality[0] == pytest.approx(1 - 30 / 90)
    kite = one_quad((0, 0), (1, 0), (1.5, 1.5), (0, 1))
    assert kite.orthogonality_printed[0] == pytest.approx(1)
    assert kite.orthogonality[0] < 1


def test_turning_a_quad_round_makes_it_invalid():
    s = one_quad((0, 0), (0, 1), (1, 1), (1, 0))
    assert not s.valid[0]
    assert s.min_angle[0] == pytest.approx(270)


def test_warp_is_the_fold_angle_of_a_folded_sheet():
    fold = np.radians(40)
    s = one_quad((0, 0, 0), (1, -1, 0), (2, 0, 0), (1, np.cos(fold), np.sin(fold)))
    assert s.warp[0] >= 40 - 1e-9
    flat = one_quad((0, 0, 0), (1, -1, 0), (2, 0, 0), (1, 1, 0))
    assert flat.warp[0] == pytest.approx(0)


def test_worst_quads_come_invalid_first_then_by_angle():
    square, dart = [(0, 0, 0), (1, 0, 0), (1, 1, 0), (0, 1, 0)], [(0, 0, 0), (4, 0, 0), (1, 1, 0), (0, 4, 0)]
    slanted = [(0, 0, 0), (1, 0, 0), (1.2, 1, 0), (0.2, 1, 0)]
    shape = QuadShape(np.array([square, slanted, dart, square], float), np.tile([0.0, 0.0, 1.0], (4, 1)))
    assert shape.worst(3).tolist() == [2, 1, 0]


def test_grid_is_one_patch_with_straight_lines():
    grid = plane_grid(4, 3)
    assert base_complex(grid).max() == 0
    assert len(straight_pairs(grid)) == 2 * 3 * 2  # two lines through each of 3 x 2 interior nodes


def test_o_grid_has_five_patches_that_are_its_blocks():
    b = hemisphere_ogrid(6, 4)
    patch = base_complex(b.mesh)
    assert patch.max() + 1 == 5
    assert len(np.unique(np.c_[patch, b.block], axis=0)) == 5


def test_o_grid_measures_as_a_sound_hemisphere():
    b, surface = hemisphere_ogrid(), hemisphere()
    q = measure(b.mesh, surface, b.block)
    assert q.defects == ()
    m = q.metrics
    assert (m["irregular"], m["blocks"], m["named_blocks"], m["validity"]) == (4, 5, 5, 1)
    assert (m["euler"], m["loops"], m["components"]) == (1, 1, 1)
    assert 0 < m["surface_deviation_rms"] <= m["surface_deviation"] < 0.02
    assert m["boundary_deviation"] < 0.005
    assert gate(q) == ()


def test_metrics_do_not_change_under_rotation_translation_and_scale():
    b, surface = hemisphere_ogrid(6, 4), hemisphere(12)
    r, shift = rotation(), np.array([3.0, -2.0, 1.0])
    moved = QuadMesh(1e3 * (b.points @ r.T + shift), b.mesh.quads)
    there = TriMesh(1e3 * (surface.vertices @ r.T + shift), surface.triangles)
    one, two = measure(b.mesh, surface, b.block).metrics, measure(moved, there, b.block).metrics
    assert list(one) == list(two)
    for name, value in one.items():
        if "deviation" not in name and not name.startswith("boundary"):
            assert two[name] == pytest.approx(value, rel=1e-7, abs=1e-7), name


def test_metrics_do_not_change_with_node_and_quad_order():
    b, surface = hemisphere_ogrid(6, 4), hemisphere(12)
    rng = np.random.default_rng(1)
    new, order = rng.permutation(len(b.points)), rng.permutation(len(b.mesh.quads))
    points = np.empty_like(b.points)
    points[new] = b.points
    quads = np.roll(new[b.mesh.quads][order], 1, axis=1)
    one = measure(b.mesh, surface, b.block, with_deviation=False)
    two = measure(QuadMesh(points, quads), surface, b.block[order], with_deviation=False)
    assert two.defects == one.defects
    assert two.metrics == pytest.approx(one.metrics)


def test_mesh_turned_as_a_whole_is_named_but_measured():
    b, surface = hemisphere_ogrid(), hemisphere()
    q = measure(QuadMesh(b.points, b.mesh.quads[:, ::-1]), surface, with_deviation=False)
    assert q.defects == ("wound against the surface",)
    assert q.metrics["validity"] == 1


def test_single_turned_quad_is_invalid_and_misoriented():
    b, surface = hemisphere_ogrid(), hemisphere()
    quads = b.mesh.quads.copy()
    quads[10] = quads[10, ::-1]
    q = measure(QuadMesh(b.points, quads), surface, with_deviation=False)
    assert q.metrics["validity"] == pytest.approx(1 - 1 / len(quads))
    assert len(q.defects) == 2
    assert np.isnan(q.metrics["blocks"])


def test_missing_quad_shows_as_another_loop():
    b, surface = hemisphere_ogrid(), hemisphere()
    q = measure(QuadMesh(b.points, np.delete(b.mesh.quads, 30, axis=0)), surface, with_deviation=False)
    assert q.defects == ("loops: mesh 2, surface 1", "Euler characteristic: mesh 0, surface 1")


def test_non_manifold_edge_is_named():
    grid = plane_grid(2, 1)
    points = np.r_[grid.points, [[1, 0, 1], [1, 1, 1]]]
    q = measure(QuadMesh(points, np.r_[grid.quads, [[2, 3, 7, 6]]]))
    assert "1 non-manifold edges" in q.defects


def test_two_sheets_touching_in_a_node_are_pinched_there():
    grid = plane_grid(2, 2)
    assert pinched_nodes(QuadMesh(grid.points, grid.quads[[0, 3]]).topology).tolist() == [4]
    assert len(pinched_nodes(grid.topology)) == 0


def test_blocks_that_are_not_grids_are_found():
    grid = plane_grid(4, 4)
    rows = np.repeat([0, 1], 8)
    assert len(unstructured_blocks(grid, rows)) == 0
    l_shape = rows.copy()
    l_shape[8] = 0
    assert unstructured_blocks(grid, l_shape).tolist() == [0, 1]
    apart = np.where(np.arange(16) % 8 == 0, 7, rows)
    assert 7 in unstructured_blocks(grid, apart)
    ring = np.where(np.isin(np.arange(16), [5, 6, 9, 10]), 0, 3)
    assert unstructured_blocks(grid, ring).tolist() == [3]


def test_stretched_grid_has_area_ratio_of_its_steps_and_smoothness_of_its_growth():
    grid = plane_grid(5, 3)
    x = 1.5 ** np.arange(6)
    points = grid.points.copy()
    points[:, 0] = x[points[:, 0].astype(int)]
    m = measure(QuadMesh(points, grid.quads)).metrics
    assert m["area_ratio"] == pytest.approx(1.5)
    # interior edges: 3 pairs of length ratio 1.5 on each of 2 rows, 1 pair of ratio 1 on each of 4 columns
    assert 1 / 1.5 < m["smoothness"] < 1
    assert m["edge_ratio"] > 1


def test_closest_points_agree_with_brute_force_on_triangles_of_many_sizes():
    rng = np.random.default_rng(0)
    corners = rng.normal(size=(60, 1, 3)) + rng.normal(size=(60, 3, 3)) * 10.0 ** rng.uniform(-3, 0, (60, 1, 1))
    corners[7, 2] = corners[7, 1]
    queries = np.r_[rng.normal(size=(200, 3)), 30 * rng.normal(size=(10, 3)), corners[:20].mean(axis=1)]
    distance, triangle, point = TriangleSearch(corners)(queries)
    np.testing.assert_allclose(np.linalg.norm(point - queries, axis=1), distance)
    w = np.stack(np.meshgrid(*[np.linspace(0, 1, 41)] * 2), -1).reshape(-1, 2)
    w = w[w.sum(axis=1) <= 1 + 1e-12]
    dense = np.einsum("wk,fkd->fwd", np.c_[1 - w.sum(axis=1), w], corners)
    sampled = np.array([np.linalg.norm(dense - q, axis=2).min() for q in queries])
    spacing = np.linalg.norm(corners - np.roll(corners, 1, axis=1), axis=2).max() / 40
    assert (distance <= sampled + 1e-12).all()
    assert (sampled <= distance + spacing).all()
    assert (triangle >= 0).all()


def test_area_samples_are_spread_by_area():
    corners = np.array([[[0, 0, 0], [1, 0, 0], [0, 1, 0]], [[0, 0, 1], [3, 0, 1], [0, 1, 1]]], float)
    points = area_samples(corners, 400)
    assert (points[:, 2] == 1).mean() == pytest.approx(0.75)
    np.testing.assert_allclose(points[points[:, 2] == 1].mean(axis=0), corners[1].mean(axis=0), atol=0.05)


def test_deviation_of_a_lifted_sheet_is_its_height():
    grid = plane_grid(4, 4)
    surface = TriMesh(grid.points, np.concatenate([grid.quads[:, [0, 1, 2]], grid.quads[:, [0, 2, 3]]]))
    lifted = QuadMesh(grid.points + np.array([0, 0, 0.1]), grid.quads)
    m = measure(lifted, surface).metrics
    for name in ("surface_deviation", "surface_deviation_rms", "boundary_deviation", "node_deviation"):
        assert m[name] == pytest.approx(0.1 / surface.diagonal), name
    assert m["boundary_mse"] == pytest.approx((0.1 / surface.diagonal) ** 2)
    assert m["boundary_fit"] == pytest.approx(np.exp(-0.01))


def test_triangles_beside_the_quads_close_the_mixed_mesh():
    b, surface = hemisphere_ogrid(6, 4), hemisphere(12)
    split = b.mesh.quads[20]
    triangles = split[[[0, 1, 2], [0, 2, 3]]]
    mixed = QuadMesh(b.points, np.delete(b.mesh.quads, 20, axis=0))
    whole, m = measure(b.mesh, surface), measure(mixed, surface, triangles=triangles)
    assert m.defects == ("2 faces are triangles",)
    for name in ("euler", "loops", "components", "nodes", "boundary_deviation", "boundary_mse"):
        assert m.metrics[name] == pytest.approx(whole.metrics[name]), name
    assert m.metrics["irregular"] == whole.metrics["irregular"] + 2
    assert m.metrics["non_quads"] == pytest.approx(2 / (len(mixed.quads) + 2))
    assert np.isnan(m.metrics["blocks"])


def test_gate_names_each_failed_criterion():
    q = measure(hemisphere_ogrid().mesh)
    assert gate(q) == ()
    assert len(gate(q, GateOptions(min_angle=89, max_angle=91))) == 2


def test_own_normals_of_a_plane_are_its_normal():
    grid = plane_grid(2, 2)
    np.testing.assert_allclose(own_normals(grid.points[grid.quads]), np.tile([0, 0, 1], (4, 1)))
