"""Sheets, specks and holes: what cleanup parts, keeps, leaves out and fills."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from drl_meshgen.cleanup import CleanupOptions, CleanupWarning, clean
from drl_meshgen.cleanup.holes import fill_holes
from drl_meshgen.cleanup.refine import refined
from drl_meshgen.cleanup.sheets import manifold
from drl_meshgen.mesh import TriMesh
from drl_meshgen.mesh.topology import Topology
from drl_meshgen.models import RawSurface
from drl_meshgen.models.hemisphere import hemisphere
from tests.strategies import bumpy_disk, flat_disk

ASIS = CleanupOptions(min_triangles=0, fill_holes=0)


def raw(points, triangles):
    return RawSurface("part", points, triangles)


def changes(result):
    return {step: count for step, count in zip(result.audit["step"], result.audit["count"], strict=True) if count}


def joined(*meshes):
    start = np.cumsum([0, *(len(m.vertices) for m in meshes)])
    triangles = [m.triangles + s for m, s in zip(meshes, start[:-1], strict=True)]
    return np.vstack([m.vertices for m in meshes]), np.vstack(triangles)


def moved(mesh, by, scale=1.0):
    return TriMesh(scale * mesh.vertices + by, mesh.triangles)


def components(surface):
    n, label = surface.topology.components
    return [Topology(len(surface.vertices), surface.triangles[label == c]) for c in range(n)]


def plate(n, direction, origin=(0, 0, 0)):
    """Square of `n x n` cells between the z axis and `direction`."""
    x, z = (a.ravel() / n for a in np.indices((n + 1, n + 1)))
    ids = np.arange((n + 1) ** 2).reshape(n + 1, n + 1)
    a, b, c, d = ids[:-1, :-1].ravel(), ids[1:, :-1].ravel(), ids[1:, 1:].ravel(), ids[:-1, 1:].ravel()
    points = x[:, None] * np.asarray(direction, float) + z[:, None] * (0, 0, 1) + np.asarray(origin, float)
    return TriMesh(points, np.vstack([np.c_[a, b, c], np.c_[a, c, d]]))


def cube(n, at):
    """Surface of the unit cube with its lowest corner `at`, points of the faces not shared."""
    faces = []
    for axis in range(3):
        for level in (0, 1):
            flat = plate(n, (1, 0, 0))
            points = np.roll(np.c_[flat.vertices[:, [0, 2]], np.full(len(flat.vertices), level)], axis + 1, axis=1)
            triangles = flat.triangles if level else flat.triangles[:, ::-1]
            faces.append(TriMesh(points + np.asarray(at, float), triangles))
    return TriMesh(*joined(*faces))


def test_several_components_stay_as_they_are():
    points, triangles = joined(bumpy_disk(400), moved(flat_disk(300), (5, 0, 0), 0.3))
    result = clean(raw(points, triangles), ASIS)
    assert np.array_equal(result.surface.vertices, points)
    assert np.array_equal(result.surface.triangles, triangles)
    assert changes(result) == {}


def test_specks_are_left_out_with_a_warning():
    points, triangles = joined(moved(flat_disk(300), (3, 0, 0), 0.005), bumpy_disk(400))
    with pytest.warns(CleanupWarning, match="part: 1 of 2 components left out"):
        result = clean(raw(points, triangles), ASIS)
    assert result.surface.topology.components[0] == 1
    assert len(result.surface.triangles) == len(bumpy_disk(400).triangles)
    assert changes(result)["leave out specks"] == 1


def test_few_triangles_are_a_speck_at_ten_times_the_area_and_alone_they_are_the_surface():
    scrap = plate(1, (0.04, 0, 0))
    points, triangles = joined(flat_disk(300), moved(scrap, (2, 0, 0), 0.2))
    with pytest.warns(CleanupWarning):
        assert clean(raw(points, triangles), ASIS).surface.topology.components[0] == 1
    assert len(clean(raw(scrap.vertices, scrap.triangles), ASIS).surface.triangles) == 2


def test_every_component_is_refined_to_enough_triangles():
    fine, coarse = bumpy_disk(1500), flat_disk(200)
    mesh, rounds = refined(TriMesh(*joined(fine, moved(coarse, (5, 0, 0)))), 1000)
    n, label = mesh.topology.components
    assert n == 2
    assert rounds == 2
    assert sorted(np.bincount(label)) == sorted([len(fine.triangles), 16 * len(coarse.triangles)])


def test_a_wall_is_cut_off_the_floor_it_stands_on():
    """T of a floor of two plates and a wall between them."""
    points, triangles = joined(plate(6, (1, 0, 0)), plate(6, (-1, 0, 0)), plate(6, (0, 1, 0)))
    result = clean(raw(points, triangles), ASIS)
    assert changes(result)["take sheets apart at edges of three or more triangles"] == 6
    floor, wall = sorted(components(result.surface), key=lambda part: -len(part.faces))
    assert len(floor.faces) == 2 * len(wall.faces)
    assert (floor.euler, wall.euler) == (1, 1)
    assert np.ptp(result.surface.vertices[wall.faces, 0]) == 0
    assert result.surface.area == pytest.approx(3)


def test_crossing_plates_become_two_straight_ones():
    plates = [plate(5, d) for d in ((1, 0, 0), (0, 1, 0), (-1, 0, 0), (0, -1, 0))]
    result = clean(raw(*joined(*plates)), ASIS)
    parts = components(result.surface)
    assert [part.euler for part in parts] == [1, 1]
    for part in parts:
        assert np.ptp(result.surface.vertices[part.faces].reshape(-1, 3), axis=0).min() == 0


def test_cubes_that_touch_along_an_edge_stay_two_cubes():
    result = clean(raw(*joined(cube(4, (0, 0, 0)), cube(4, (1, 1, 0)))), ASIS)
    parts = components(result.surface)
    assert [(part.euler, len(part.loops)) for part in parts] == [(2, 0), (2, 0)]
    assert changes(result)["take sheets apart at edges of three or more triangles"] == 4


def test_bowls_and_a_lid_on_one_rim_become_a_ball_and_a_disk():
    bowl, lid = hemisphere(500), flat_disk(500)
    below = TriMesh(bowl.vertices * (1, 1, -1), bowl.triangles[:, ::-1])
    result = clean(raw(*joined(bowl, below, lid)), ASIS)
    assert sorted(part.euler for part in components(result.surface)) == [1, 2]


@given(st.integers(0, 2**16))
@settings(max_examples=40, deadline=None)
def test_any_soup_becomes_manifold(seed):
    rng = np.random.default_rng(seed)
    points = rng.normal(size=(9, 3))
    triangles = np.unique(np.sort(rng.integers(0, 9, (30, 3)), axis=1), axis=0)
    triangles = triangles[(np.diff(triangles, axis=1) > 0).all(axis=1)]
    parted, source, counts, _ = manifold(points, triangles)
    t = Topology(len(source), parted)
    assert t.edge_count.max(initial=0) <= 2
    assert len(parted) == len(triangles) - counts["triangles"]
    assert len(manifold(points[source], parted)[0]) == len(parted)
    assert manifold(points[source], parted)[2]["vertices"] == 0


def punched(mesh, seeds):
    """Mesh without the triangles around the given vertices."""
    return TriMesh(mesh.vertices, mesh.triangles[~np.isin(mesh.triangles, seeds).any(axis=1)])


def inner_vertices(mesh, n):
    """`n` vertices far from each other and from the rim."""
    far = np.nonzero(np.hypot(*mesh.vertices[:, :2].T) < 0.7)[0]
    chosen = [far[0]]
    for _ in range(n - 1):
        gap = np.linalg.norm(mesh.vertices[far][:, None] - mesh.vertices[chosen], axis=2).min(axis=1)
        chosen.append(far[gap.argmax()])
    return chosen


def test_small_holes_are_filled_and_the_rim_is_kept():
    mesh = flat_disk(8000)
    holed = punched(mesh, inner_vertices(mesh, 4))
    with pytest.warns(CleanupWarning, match="4 small holes filled"):
        result = clean(raw(holed.vertices, holed.triangles), CleanupOptions(min_triangles=0, fill_holes=0.04))
    assert len(result.surface.topology.loops) == 1
    assert result.surface.topology.euler == 1
    assert result.surface.area == pytest.approx(mesh.area)
    np.testing.assert_allclose(result.surface.normals[:, 2], 1)
    assert len(clean(raw(holed.vertices, holed.triangles), ASIS).surface.topology.loops) == 5


def test_larger_holes_are_filled_on_demand_only():
    mesh = flat_disk(2000)
    v = inner_vertices(mesh, 1)[0]
    ring = np.linalg.norm(mesh.vertices - mesh.vertices[v], axis=1) < 0.15
    holed = punched(mesh, np.nonzero(ring)[0])
    assert len(clean(raw(holed.vertices, holed.triangles)).surface.topology.loops) == 2
    with pytest.warns(CleanupWarning, match="1 small hole filled"):
        result = clean(raw(holed.vertices, holed.triangles), CleanupOptions(fill_holes=0.5))
    assert result.surface.area == pytest.approx(mesh.area)


def test_a_hole_over_a_bent_edge_is_filled_without_doubling_edges():
    """Ring of four corners a c b d around the hole; the surface has the edge ab already, so the patch uses cd."""
    points = np.array([(0, 0, 0), (1, 0, 0), (0.5, 0.5, 0.1), (0.5, -0.5, 0.1), (0.5, 0, -1)], float)
    triangles = np.array([(0, 1, 4), (2, 0, 4), (1, 2, 4), (1, 0, 3)])
    loops = Topology(5, triangles).loops
    filled, holes = fill_holes(points, triangles, 10.0)
    t = Topology(5, filled)
    assert holes == len(loops) == 1
    assert t.edge_count.max() == 2
    assert len(t.misoriented_edges) == 0
