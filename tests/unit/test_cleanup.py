"""Cleanup: what it changes, what it leaves alone, and that units and order do not matter."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from drl_meshgen.cleanup import CleanupOptions, clean
from drl_meshgen.cleanup.refine import split_edges, subdivided, widened_necks
from drl_meshgen.mesh import TriMesh
from drl_meshgen.models import RawSurface
from drl_meshgen.models.hemisphere import hemisphere
from drl_meshgen.ricci.pinches import separating_triangles
from tests.strategies import bumpy_disk, bumpy_disks, flat_disk, reordered

ASIS = CleanupOptions(min_triangles=0)


def raw(mesh):
    return RawSurface("part", mesh.vertices, mesh.triangles)


def changes(result):
    return {step: count for step, count in zip(result.audit["step"], result.audit["count"], strict=True) if count}


def same(a, b):
    return np.array_equal(a.vertices, b.vertices) and np.array_equal(a.triangles, b.triangles)


def soup(mesh):
    """Every triangle with its own three points, as in an STL file."""
    return RawSurface("soup", mesh.corners.reshape(-1, 3), np.arange(3 * len(mesh.triangles)).reshape(-1, 3))


def assert_clean_disk(mesh):
    t = mesh.topology
    assert t.euler == 1
    assert len(t.loops) == 1
    assert t.used.all()
    assert t.edge_count.max() == 2
    assert len(t.misoriented_edges) == 0
    assert t.components[0] == 1


@given(bumpy_disks())
@settings(max_examples=15, deadline=None)
def test_a_clean_surface_passes_unchanged(mesh):
    result = clean(raw(mesh), ASIS)
    assert same(result.surface, mesh)
    assert changes(result) == {}


@given(st.integers(0, 2**16))
@settings(max_examples=10, deadline=None)
def test_cleaning_twice_is_cleaning_once(seed):
    rng = np.random.default_rng(seed)
    mesh = bumpy_disk(400, seed=seed)
    flip = rng.random(len(mesh.triangles)) < 0.3
    dirty = soup(TriMesh(mesh.vertices, np.where(flip[:, None], mesh.triangles[:, ::-1], mesh.triangles)))
    once = clean(dirty, ASIS)
    assert_clean_disk(once.surface)
    assert same(clean(raw(once.surface), ASIS).surface, once.surface)


@pytest.mark.parametrize("scale", [1e-9, 1e-3, 1e9])
def test_units_do_not_matter(scale):
    mesh = bumpy_disk(500, seed=3)
    once, scaled = clean(soup(mesh)), clean(soup(TriMesh(mesh.vertices * scale, mesh.triangles)))
    assert np.array_equal(once.surface.triangles, scaled.surface.triangles)
    np.testing.assert_allclose(scaled.surface.vertices, once.surface.vertices * scale, rtol=1e-12, atol=1e-12 * scale)


def test_input_arrays_are_untouched():
    dirty = soup(hemisphere(200))
    points, triangles = dirty.points.copy(), dirty.triangles.copy()
    clean(dirty)
    assert np.array_equal(dirty.points, points)
    assert np.array_equal(dirty.triangles, triangles)


def test_duplicate_points_are_merged_into_the_first():
    mesh = hemisphere(300)
    result = clean(soup(mesh), ASIS)
    assert len(result.surface.vertices) == len(mesh.vertices)
    assert changes(result)["merge duplicate points"] == 3 * len(mesh.triangles) - len(mesh.vertices)
    np.testing.assert_array_equal(result.surface.corners, mesh.corners)


def test_degenerate_and_duplicate_triangles_are_dropped():
    mesh = hemisphere(300)
    extra = np.array([[0, 0, 5], [7, 7, 7], mesh.triangles[4], mesh.triangles[9][[1, 0, 2]]])
    result = clean(RawSurface("part", mesh.vertices, np.vstack([mesh.triangles, extra])), ASIS)
    assert same(result.surface, mesh)
    assert changes(result) == {"drop degenerate triangles": 2, "drop duplicate triangles": 2}


def test_a_cap_with_its_apex_on_an_edge_is_flipped_not_torn():
    r"""a---m---b above and below: m lies on the edge ab of the lower triangle only.

    >   top: a m c, m b c; cap: a b m (flat); bottom: b a d
    """
    points = np.array([(0, 0, 0), (1, 0, 0), (0.5, 1, 0), (0.5, -1, 0), (0.5, 0, 0)], float)
    triangles = np.array([(0, 4, 2), (4, 1, 2), (0, 1, 4), (1, 0, 3)])
    result = clean(RawSurface("cap", points, triangles), ASIS)
    assert_clean_disk(result.surface)
    assert changes(result) == {"mend flat triangles": 1}
    assert result.surface.area == pytest.approx(1.0)
    assert result.surface.areas.min() > 0.2


def test_vertices_that_make_needles_within_a_triangle_are_dropped():
    """Nested: a point near a side, then one near a corner of what that leaves."""
    mesh = bumpy_disk(300)
    points, triangles = mesh.vertices, mesh.triangles
    for weights in ((0.5, 0.4995, 0.0005), (0.9985, 0.001, 0.0005)):
        chosen = np.arange(0, len(triangles), 7)
        a, b, c = triangles[chosen].T
        new = len(points) + np.arange(len(chosen))
        points = np.vstack([points, np.einsum("k,nkd->nd", weights, points[triangles[chosen]])])
        parts = [np.c_[a, b, new], np.c_[b, c, new], np.c_[c, a, new]]
        triangles = np.vstack([np.delete(triangles, chosen, axis=0), *parts])
    result = clean(RawSurface("part", points, triangles), ASIS)
    assert changes(result)["drop vertices in slivers"] == len(points) - len(mesh.vertices)
    assert len(result.surface.triangles) == len(mesh.triangles)
    assert_clean_disk(result.surface)
    assert result.surface.area == pytest.approx(mesh.area)


def test_a_fin_is_trimmed():
    mesh = hemisphere(300)
    a, b = mesh.topology.edges[mesh.topology.edge_count == 2][10]
    points = np.vstack([mesh.vertices, mesh.vertices[a] * 1.05])
    fin = RawSurface("part", points, np.vstack([mesh.triangles, [(a, b, len(points) - 1)]]))
    result = clean(fin, ASIS)
    assert same(result.surface, mesh)
    assert changes(result) == {"trim fins at non-manifold edges": 1, "drop unused vertices": 1}


def test_sheets_that_touch_in_one_vertex_are_parted():
    r"""Two triangle fans of a disk left on either side of a removed pair: |><| becomes two corners."""
    mesh = flat_disk(600)
    inner = ~mesh.topology.on_boundary[mesh.triangles].any(axis=1)
    v = int(mesh.triangles[inner][0, 0])
    ring = np.nonzero((mesh.triangles == v).any(axis=1))[0]
    hole = np.delete(mesh.triangles, [ring[0], ring[np.argmax(_opposite(mesh, ring))]], axis=0)
    result = clean(RawSurface("part", mesh.vertices, hole), ASIS)
    assert changes(result)["split non-manifold vertices"] == 1
    assert len(result.surface.vertices) == len(mesh.vertices) + 1
    assert len(result.surface.topology.loops) == 2


def _opposite(mesh, ring):
    centres = mesh.corners[ring].mean(axis=1)
    return np.linalg.norm(centres - centres[0], axis=1)


def test_turned_triangles_are_turned_back_the_shorter_way():
    mesh = bumpy_disk(500, seed=5)
    few = mesh.triangles.copy()
    few[:20] = few[:20, ::-1]
    result = clean(RawSurface("part", mesh.vertices, few), ASIS)
    assert changes(result) == {"orient triangles": 20}
    np.testing.assert_allclose(result.surface.normals, mesh.normals)


def test_unused_vertices_are_dropped_in_order():
    mesh = hemisphere(300)
    points = np.vstack([[(9.0, 9.0, 9.0)], mesh.vertices])
    assert same(clean(RawSurface("part", points, mesh.triangles + 1), ASIS).surface, mesh)


def test_coarse_surfaces_are_refined_without_changing_their_shape():
    mesh = bumpy_disk(300, seed=2)
    result = clean(raw(mesh), CleanupOptions(min_triangles=1000))
    assert len(result.surface.triangles) == 4 * len(mesh.triangles)
    assert result.surface.area == pytest.approx(mesh.area, rel=1e-12)
    assert_clean_disk(result.surface)


@given(st.integers(0, 2**16), st.floats(0, 1))
@settings(max_examples=20, deadline=None)
def test_splitting_edges_keeps_area_orientation_and_topology(seed, share):
    mesh = bumpy_disk(200, seed=seed)
    marked = np.random.default_rng(seed).random(len(mesh.topology.edges)) < share
    split = split_edges(mesh, marked)
    assert_clean_disk(split)
    assert len(split.vertices) == len(mesh.vertices) + marked.sum()
    assert split.area == pytest.approx(mesh.area, rel=1e-12)


def test_subdivision_quarters_every_triangle():
    mesh = hemisphere(300)
    fine = subdivided(mesh)
    np.testing.assert_allclose(fine.areas.reshape(-1, 4), np.repeat(mesh.areas[:, None] / 4, 4, axis=1), rtol=1e-12)


def prism_tower():
    """Three-sided tower: a limb with three edges around, open at the foot."""
    angle = 2 * np.pi * np.arange(3) / 3
    rings = [np.c_[np.cos(angle), np.sin(angle), np.full(3, float(z))] for z in range(4)]
    faces = [(3 * z + i, 3 * z + (i + 1) % 3, 3 * z + 3 + i) for z in range(3) for i in range(3)]
    faces += [(3 * z + (i + 1) % 3, 3 * z + 3 + (i + 1) % 3, 3 * z + 3 + i) for z in range(3) for i in range(3)]
    return TriMesh(np.vstack(rings), np.array([*faces, (9, 10, 11)]))


def test_necks_of_three_edges_are_widened():
    tower = prism_tower()
    assert len(separating_triangles(tower)) == 2
    wide, found = widened_necks(tower)
    assert found == 2
    assert len(separating_triangles(wide)) == 0
    assert wide.area == pytest.approx(tower.area)
    assert changes(clean(raw(tower), ASIS))["widen necks of three edges"] == 2


def test_remeshing_makes_triangles_even_and_keeps_the_rim():
    mesh = bumpy_disk(800, height=2.0, seed=1)
    result = clean(raw(mesh), CleanupOptions(remesh=True, min_triangles=0))
    assert_clean_disk(result.surface)
    assert len(result.surface.triangles) == pytest.approx(len(mesh.triangles), rel=0.2)
    before, after = (m.edge_lengths.std() / m.edge_lengths.mean() for m in (mesh, result.surface))
    assert after < 0.5 * before
    rim = result.surface.vertices[result.surface.topology.on_boundary]
    np.testing.assert_allclose(np.hypot(rim[:, 0], rim[:, 1]), 1, atol=0.02)


def test_shuffled_input_gives_the_same_surface():
    mesh = bumpy_disk(600, seed=9)
    other, old = reordered(mesh, seed=1)
    np.testing.assert_array_equal(clean(raw(other), ASIS).surface.vertices, mesh.vertices[old])


def test_the_audit_lists_every_step_in_order():
    audit = clean(raw(hemisphere(300)), ASIS).audit
    assert list(audit.columns) == ["step", "count", "remark"]
    assert audit["step"].is_unique
    assert audit["step"].iloc[0] == "merge duplicate points"


def sized(mesh, scale=1.0):
    """A soup with a number per point that depends on where the point is."""
    given = soup(mesh)
    return RawSurface("soup", given.points, given.triangles, {"size": scale * (3 + given.points[:, 0])})


def test_numbers_per_point_follow_their_points_through_the_repairs():
    result = clean(sized(bumpy_disk(300)), ASIS)
    np.testing.assert_array_equal(result.point_data["size"], 3 + result.surface.vertices[:, 0])


@pytest.mark.parametrize("options", [CleanupOptions(min_triangles=2000), CleanupOptions(remesh=True)])
def test_numbers_per_point_are_interpolated_where_points_are_new(options):
    mesh = bumpy_disk(300)
    result = clean(sized(mesh), options)
    size = result.point_data["size"]
    assert size.shape == (len(result.surface.vertices),)
    np.testing.assert_allclose(size, 3 + result.surface.vertices[:, 0], atol=mesh.edge_lengths.max())
    assert (size >= 3 + mesh.vertices[:, 0].min()).all()
    assert (size <= 3 + mesh.vertices[:, 0].max()).all()
