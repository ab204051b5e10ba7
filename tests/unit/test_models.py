"""Generated models and file reading."""

from pathlib import Path

import numpy as np
import pytest
import pyvista as pv

from drl_meshgen.cleanup import CleanupOptions, clean
from drl_meshgen.mesh import TriMesh
from drl_meshgen.models import RawSurface, load
from drl_meshgen.models.giraffe import giraffe
from drl_meshgen.models.hemisphere import hemisphere
from drl_meshgen.models.implicit import Part, build, catmull_rom, ellipsoid, smooth_min, tube
from drl_meshgen.models.sampling import Projector, Solid, Zone, sample
from drl_meshgen.ricci.pinches import separating_triangles
from tests.strategies import bumpy_disk

SHARED = Path(__file__).parents[2].parent / "shared" / "models"


def assert_disk(mesh):
    t = mesh.topology
    assert t.euler == 1
    assert len(t.loops) == 1
    assert t.components[0] == 1
    assert t.edge_count.max() == 2
    assert len(t.misoriented_edges) == 0
    assert t.used.all()


def shape_quality(mesh):
    """1 for equilateral triangles, 0 for degenerate ones."""
    sides = np.linalg.norm(mesh.corners - np.roll(mesh.corners, -1, axis=1), axis=2)
    return 4 * np.sqrt(3) * mesh.areas / (sides**2).sum(axis=1)


@pytest.mark.parametrize("triangles", [200, 5_000, 25_000, 200_000])
def test_hemisphere_lies_exactly_on_the_sphere_with_a_circular_rim(triangles):
    mesh = hemisphere(triangles)
    assert_disk(mesh)
    assert len(mesh.triangles) == pytest.approx(triangles, rel=0.1)
    np.testing.assert_allclose(np.linalg.norm(mesh.vertices, axis=1), 1, atol=1e-15)
    rim = mesh.topology.on_boundary
    assert (mesh.vertices[rim, 2] == 0).all()
    assert (mesh.vertices[~rim, 2] > 0).all()
    assert shape_quality(mesh).min() > 0.7
    assert (np.einsum("ij,ij->i", mesh.normals, mesh.corners.mean(axis=1)) > 0).all()


@pytest.mark.parametrize("name", ["giraffe", "hand"])
def test_generated_models_are_clean_disks_of_the_size_asked_for(name):
    surface = load(name, 5_000)
    mesh = TriMesh(surface.points, surface.triangles)
    assert_disk(mesh)
    assert len(mesh.triangles) == pytest.approx(5_000, rel=0.1)
    assert np.percentile(shape_quality(mesh), 1) > 0.6
    assert len(separating_triangles(mesh)) == 0
    result = clean(surface)
    assert np.array_equal(result.surface.vertices, mesh.vertices)
    assert np.array_equal(result.surface.triangles, mesh.triangles)


def test_rims_are_smooth_curves():
    """The belly rim is an ellipse seen from below; the wrist's lies in a plane."""
    belly, wrist = (TriMesh(s.points, s.triangles) for s in (load("giraffe", 5_000), load("hand", 5_000)))
    x, _, z = belly.vertices[belly.topology.on_boundary].T
    solid = giraffe()
    value = solid.opening(np.c_[x, np.full(len(x), 2.0), z])
    np.testing.assert_allclose(value, 0, atol=1e-6)
    assert np.ptp(wrist.vertices[wrist.topology.on_boundary, 1]) < 1e-6
    for mesh in (belly, wrist):
        loop = mesh.vertices[mesh.topology.loops[0]]
        side = np.roll(loop, -1, axis=0) - loop
        length = np.linalg.norm(side, axis=1)
        turn = np.einsum("ij,ij->i", side, np.roll(side, -1, axis=0)) / (length * np.roll(length, -1))
        assert np.degrees(np.arccos(turn)).max() < 60
        assert length.max() < 2 * length.min()


def bead():
    """Ball with a stalk, cut below: a small solid that is quick to sample."""
    parts = [
        Part(ellipsoid((0, 0, 0), (1, 1, 1)), 0.0),
        Part(tube([(0, 0, 0.5), (0, 0, 2)], [0.3, 0.3], pieces=1), 0.3),
    ]

    def smooth(points, band):
        return build([parts], points, band)[0]

    stalk = Zone(np.array([(0.0, 0.0, 1.2), (0.0, 0.0, 2.3)]), 0.5, 0.7, 0.1)
    low, high = (-1.3, -1.3, -1.3), (1.3, 1.3, 2.6)
    return Solid(low, high, 14.0, smooth, lambda _: smooth, lambda p: p[:, 2] + 0.6, (stalk,))


@pytest.mark.parametrize("triangles", [1_000, 4_000])
def test_sampling_puts_every_vertex_on_the_solid_and_the_rim_on_the_cut(triangles):
    solid = bead()
    mesh = sample(solid, triangles)
    assert_disk(mesh)
    assert len(mesh.triangles) == pytest.approx(triangles, rel=0.15)
    assert np.abs(solid.smooth(mesh.vertices, 0.2)).max() < 2e-3
    np.testing.assert_allclose(mesh.vertices[mesh.topology.on_boundary, 2], -0.6, atol=1e-9)
    outward = np.einsum("ij,ij->i", mesh.normals, mesh.corners.mean(axis=1))
    assert (outward > 0).mean() > 0.95
    stalk = mesh.corners.mean(axis=1)[:, 2] > 1.4
    assert mesh.areas[stalk].mean() < 0.7 * mesh.areas[~stalk].mean()


def test_sampling_is_repeatable():
    one, two = sample(bead(), 2_000), sample(bead(), 2_000)
    assert one.vertices.tobytes() == two.vertices.tobytes()
    assert one.triangles.tobytes() == two.triangles.tobytes()


def test_projection_leaves_points_on_the_surface_alone():
    projector = Projector(bead().smooth, bead().opening, 4.0)
    points = hemisphere(400).vertices * (1, 1, -1)
    points = points[points[:, 2] > -0.5]
    np.testing.assert_allclose(projector.onto_surface(points), points, atol=1e-9)
    np.testing.assert_allclose(projector.onto_surface(points * 1.05), points, atol=1e-3)


def test_fields_do_not_depend_on_how_points_are_bundled():
    parts = [
        Part(tube([(0, 0, 0), (1, 0, 0), (1, 1, 0)], [0.2, 0.1, 0.3]), 0.1),
        Part(ellipsoid((0, 1, 0), (0.3,) * 3), 0.2),
    ]
    points = np.random.default_rng(0).uniform(-1, 2, (6000, 3))
    together = build([parts], points, 0.3)[0]
    singly = np.array([build([parts], p[None], 0.3)[0, 0] for p in points[:200]])
    close = np.abs(together[:200]) < 0.3
    assert close.sum() > 5
    np.testing.assert_allclose(together[:200][close], singly[close])


def test_smooth_minimum_differs_from_the_minimum_only_within_the_blend():
    a, b = np.linspace(-1, 1, 101), np.zeros(101)
    smooth = smooth_min(a, b, 0.5)
    assert (smooth <= np.minimum(a, b)).all()
    far = np.abs(a) >= 0.5
    np.testing.assert_array_equal(smooth[far], np.minimum(a, b)[far])


def test_splines_pass_through_their_control_points():
    control = np.array([(0.0, 0, 0), (1, 2, 0), (3, 1, 1), (4, 0, 0)])
    np.testing.assert_allclose(catmull_rom(control, 5)[::5], control, atol=1e-12)


def test_the_cache_gives_the_same_bytes_and_heals_damage(tmp_path, monkeypatch):
    built = []

    def stub(name, triangles):
        built.append((name, triangles))
        return hemisphere(triangles)

    monkeypatch.setattr("drl_meshgen.models.loading.generate", stub)
    first = load("hand", 5_000, cache_dir=tmp_path)
    second = load("hand", 5_000, cache_dir=tmp_path)
    assert built == [("hand", 5_000)]
    assert first.points.tobytes() == second.points.tobytes()
    (stored,) = tmp_path.iterdir()
    damaged = bytearray(stored.read_bytes())
    damaged[len(damaged) // 2] ^= 1
    stored.write_bytes(damaged)
    third = load("hand", 5_000, cache_dir=tmp_path)
    assert len(built) == 2
    assert third.points.tobytes() == first.points.tobytes()
    assert [p.suffix for p in tmp_path.iterdir()] == [".npz"]


def test_the_cache_folder_can_be_chosen(tmp_path, monkeypatch):
    monkeypatch.setenv("DRL_MESHGEN_CACHE", str(tmp_path / "deep" / "er"))
    monkeypatch.setattr("drl_meshgen.models.loading.generate", lambda _, triangles: hemisphere(triangles))
    load("giraffe", 5_000)
    assert len(list((tmp_path / "deep" / "er").iterdir())) == 1


@pytest.mark.parametrize("suffix", ["stl", "ply", "vtp", "vtu", "off", "obj"])
@pytest.mark.parametrize("binary", [True, False])
def test_files_read_back_what_was_written(tmp_path, capfd, suffix, binary):
    mesh = bumpy_disk(300, seed=4)
    path = tmp_path / f"bowl.{suffix}"
    surface = pv.PolyData.from_regular_faces(mesh.vertices, mesh.triangles)
    if suffix == "off":
        rows = [" ".join(map(repr, p)) for p in mesh.vertices.tolist()]
        rows += [f"3 {a} {b} {c}" for a, b, c in mesh.triangles]
        path.write_text("\n".join([f"OFF\n# by hand\n{len(mesh.vertices)} {len(mesh.triangles)} 0", *rows]))
    elif suffix == "obj":
        rows = ["v " + " ".join(map(repr, p)) for p in mesh.vertices.tolist()]
        path.write_text("\n".join(rows + [f"f {a} {b} {c}" for a, b, c in (mesh.triangles + 1).tolist()]) + "\n")
    elif suffix == "vtu":
        surface.cast_to_unstructured_grid().save(path, binary=binary)
    else:
        surface.save(path, binary=binary)
    found = load(path)
    assert capfd.readouterr() == ("", "")
    assert found.name == "bowl"
    tolerance = 0 if suffix in {"vtp", "vtu", "off"} else 1e-6
    got = clean(found, CleanupOptions(min_triangles=0)).surface
    np.testing.assert_allclose(got.corners, mesh.corners, atol=tolerance)


def test_polygons_are_cut_in_triangles(tmp_path):
    plane = pv.Plane(i_resolution=4, j_resolution=3)
    plane.save(tmp_path / "plane.vtp")
    (tmp_path / "plane.off").write_text("OFF\n5 1 0\n0 0 0\n2 0 0\n3 1 0\n1 2 0\n-1 1 0\n5 0 1 2 3 4\n")
    assert len(load(tmp_path / "plane.vtp").triangles) == 24
    pentagon = load(tmp_path / "plane.off")
    assert TriMesh(pentagon.points, pentagon.triangles).area == pytest.approx(5.0)


@pytest.mark.models
@pytest.mark.parametrize("path", sorted(SHARED.glob("single/*.ply")), ids=lambda p: p.stem)
def test_real_surfaces_pass_cleanup_as_disks(path):
    surface = load(path)
    result = clean(surface)
    assert_disk(result.surface)
    assert isinstance(surface, RawSurface)
    assert len(separating_triangles(result.surface)) == 0


def with_sizes(mesh):
    surface = pv.PolyData.from_regular_faces(mesh.vertices, mesh.triangles)
    surface.point_data["size"] = mesh.vertices[:, 0] + 2
    surface.point_data["direction"] = mesh.vertices
    return surface


@pytest.mark.parametrize("suffix", ["vtp", "vtu"])
def test_numbers_per_point_are_read_and_vectors_are_not(tmp_path, suffix):
    mesh = bumpy_disk(300)
    surface = with_sizes(mesh)
    (surface if suffix == "vtp" else surface.cast_to_unstructured_grid()).save(tmp_path / f"part.{suffix}")
    raw = load(tmp_path / f"part.{suffix}")
    assert list(raw.point_data) == ["size"]
    np.testing.assert_array_equal(raw.point_data["size"], raw.points[:, 0] + 2)


@pytest.mark.parametrize("form", ["ascii", "binary_little_endian", "binary_big_endian"])
def test_numbers_per_vertex_of_ply_files_are_read(tmp_path, form):
    mesh = bumpy_disk(300)
    header = [
        f"ply\nformat {form} 1.0\ncomment sizes\nelement vertex {len(mesh.vertices)}",
        "property float x\nproperty float y\nproperty float z\nproperty uchar red\nproperty double size",
        f"element face {len(mesh.triangles)}\nproperty list uchar int vertex_indices\nend_header\n",
    ]
    order = ">" if "big" in form else "<"
    vertices = np.zeros(
        len(mesh.vertices), [(k, order + "f4") for k in "xyz"] + [("red", "u1"), ("size", order + "f8")]
    )
    faces = np.zeros(len(mesh.triangles), [("n", "u1"), ("v", order + "i4", 3)])
    for k, name in enumerate("xyz"):
        vertices[name] = mesh.vertices[:, k]
    vertices["size"], faces["n"], faces["v"] = mesh.vertices[:, 0] + 2, 3, mesh.triangles
    if form == "ascii":
        rows = [" ".join(map(str, row)) for row in vertices.tolist()]
        body = "\n".join([*rows, *(f"3 {a} {b} {c}" for a, b, c in mesh.triangles)]).encode() + b"\n"
    else:
        body = vertices.tobytes() + faces.tobytes()
    (tmp_path / "part.ply").write_bytes("\n".join(header).encode() + body)
    raw = load(tmp_path / "part.ply")
    assert list(raw.point_data) == ["size"]
    np.testing.assert_allclose(raw.point_data["size"], raw.points[:, 0] + 2, atol=1e-6)
    np.testing.assert_array_equal(raw.triangles, mesh.triangles)
