"""Sharp edges: found, chained between corners, cut along where they close."""

from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest

from drl_meshgen import codecs
from drl_meshgen.mesh import TriMesh
from drl_meshgen.mesh.curves import closed_length
from drl_meshgen.mesh.topology import Topology
from drl_meshgen.models.surface import RawSurface
from drl_meshgen.pipeline import STAGES, MeshOptions
from drl_meshgen.seams import SeamKind, SeamOptions, open_surface
from drl_meshgen.seams.features import chains, sharp_edges
from drl_meshgen.store import execute
from tests.chains import grid
from tests.solids import side_by_side, sphere, spindle, tapered_torus, voxel_surface
from tests.strategies import flat_disk

SHARP = SeamOptions(feature_angle=40)


def lathe(*corners, around=32, step=0.25):
    """Surface of revolution of a polygon of `(radius, height)`, closed at both ends."""
    pieces = []
    for a, b in pairwise(corners):
        n = max(1, round(np.hypot(b[0] - a[0], b[1] - a[1]) / step))
        pieces.append(np.linspace(a, b, n, endpoint=False))
    r, z = np.vstack([*pieces, corners[-1]]).T
    return spindle(r, z, around)


def cylinder():
    return lathe((0.2, 0), (1, 0), (1, 3), (0.2, 3))


def box(*size):
    return voxel_surface(np.ones(size, bool))


def pieces(opened):
    mesh = opened.mesh
    n, label = mesh.topology.components
    parts = [Topology(len(mesh.vertices), mesh.triangles[label == c]) for c in range(n)]
    assert all(part.euler + len(part.loops) == 2 and part.loops for part in parts)
    return sorted(len(part.loops) for part in parts)


def test_a_cylinder_comes_apart_at_its_rims():
    opened = open_surface(cylinder(), SHARP)
    assert pieces(opened) == [1, 1, 2]
    assert [seam.kind for seam in opened.seams] == [SeamKind.FEATURE] * 2
    heights = [set(opened.mesh.vertices[seam.left][:, 2]) for seam in opened.seams]
    assert sorted(heights, key=min) == [{0.0}, {3.0}]


def test_a_stepped_shaft_comes_apart_at_every_step():
    opened = open_surface(lathe((0.2, 0), (1, 0), (1, 2), (0.6, 2), (0.6, 4), (0.2, 4)), SHARP)
    assert pieces(opened) == [1, 1, 2, 2, 2]
    assert all(curve.closed and not len(curve.corners) for curve in opened.features)


def test_nothing_is_sharp_unless_asked_for():
    opened = open_surface(cylinder())
    assert opened.features == ()
    assert [seam.kind for seam in opened.seams] == [SeamKind.WAIST]


def test_a_rim_of_few_edges_and_ends_without_inner_vertices_are_split_until_there_is_room():
    opened = open_surface(lathe((1, 0), (1, 3), around=7, step=3), SeamOptions(feature_angle=55, feature_corner=60))
    assert pieces(opened) == [1, 1, 2]
    assert min(len(seam.left) for seam in opened.seams) >= 12
    t = opened.mesh.topology
    assert not (t.on_boundary[t.edges].all(axis=1) & (t.edge_count == 2)).any()


def test_the_edges_of_a_box_end_in_its_corners_and_are_kept_but_not_cut():
    opened = open_surface(box(6, 5, 4), SHARP)
    assert len(opened.features) == 12
    ends = {tuple(p) for curve in opened.features for p in curve.points[curve.corners]}
    assert len(ends) == 8
    assert sorted(len(curve.points) - 1 for curve in opened.features) == [4] * 4 + [5] * 4 + [6] * 4
    assert [seam.kind for seam in opened.seams] == [SeamKind.WAIST]


def test_seams_of_all_kinds_live_side_by_side():
    opened = open_surface(side_by_side(cylinder(), tapered_torus(24, 12), sphere(12)), SeamOptions(feature_angle=60))
    assert pieces(opened) == [1, 1, 1, 1, 2, 2]
    assert sorted(opened.table.kind) == sorted(
        [SeamKind.FEATURE.value] * 2 + [SeamKind.HANDLE.value] + [SeamKind.WAIST.value]
    )
    for seam, length in zip(opened.seams, opened.table.length, strict=True):
        np.testing.assert_array_equal(opened.mesh.vertices[seam.left], opened.mesh.vertices[seam.right])
        assert closed_length(opened.mesh.vertices[seam.left]) == pytest.approx(length)


def test_given_edges_are_cut_whether_sharp_or_not():
    torus = tapered_torus(24, 12)
    ring = 12 * np.arange(24)
    opened = open_surface(torus, sharp=np.c_[ring, np.roll(ring, -1)])
    assert [seam.kind for seam in opened.seams] == [SeamKind.FEATURE]
    assert pieces(opened) == [2]
    np.testing.assert_array_equal(np.sort(opened.seams[0].left), ring)


def test_a_smooth_surface_has_no_sharp_edge():
    assert not sharp_edges(sphere(20), 30.0).any()


def test_weaker_edges_count_where_they_are_joined_to_sharp_ones():
    sheet = grid(10, 6)
    x, y = sheet.vertices[:, 0], sheet.vertices[:, 1]
    # a fold along x = 5 that fades from 45 to 27 degrees
    slope = np.tan(np.radians(45 - 3 * y))
    folded = TriMesh(np.c_[x, y, np.maximum(x - 5, 0) * slope], sheet.triangles)
    along = (x[sheet.topology.edges] == 5).all(axis=1)
    found = sharp_edges(folded, 40.0)
    assert found[along].all()
    assert not sharp_edges(folded, 60.0).any()


def test_spikes_are_noise():
    disk = flat_disk(1500)
    jolt = disk.vertices.copy()
    inner = np.nonzero(~disk.topology.on_boundary)[0][::97]
    jolt[inner, 2] += 0.05
    opened = open_surface(TriMesh(jolt, disk.triangles), SeamOptions(feature_angle=35, feature_length=0.15))
    assert opened.features == ()


def test_chains_part_at_branches_and_close_without():
    ring = [(0, 1), (1, 2), (2, 3), (3, 0)]
    ((vertices, closed),) = chains(np.array(ring))
    assert closed
    assert list(vertices) == [0, 1, 2, 3]
    found = chains(np.array([*ring, (1, 7), (7, 8)]))
    assert sorted((len(v), closed) for v, closed in found) == [(3, False), (5, False)]


def test_features_are_written_and_read_without_loss(tmp_path):
    opened = open_surface(side_by_side(cylinder(), box(3, 3, 3)), SHARP)
    codecs.SEAMS.write(opened, tmp_path)
    again = codecs.SEAMS.read(tmp_path)
    assert len(again.features) == len(opened.features)
    for one, two in zip(opened.features, again.features, strict=True):
        np.testing.assert_array_equal(one.points, two.points)
        np.testing.assert_array_equal(one.corners, two.corners)
        assert one.closed == two.closed


def test_finished_mesh_lines_lie_on_the_rims_of_a_cylinder():
    surface = cylinder()
    raw = RawSurface("cylinder", surface.vertices, surface.triangles)
    given = replace(STAGES[0], run=lambda _inputs, _options: raw)
    options = replace(MeshOptions().sized(700), seams=SHARP)
    done = execute((given, *STAGES[1:]), options.by_stage("cylinder"))
    points = done["smoothing"].mesh.points
    radius = np.linalg.norm(points[:, :2], axis=1)
    assert done["smoothing"].feature_share == 1
    assert done["quality"].defects == ()
    for height in (0, 3):
        on_rim = (np.abs(points[:, 2] - height) < 1e-9) & (radius > np.cos(np.pi / 32) - 1e-9)
        assert on_rim.sum() >= 12
