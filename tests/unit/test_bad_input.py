"""What a user gets for files and surfaces that cannot be meshed: one sentence with the name and the defect."""

import struct

import numpy as np
import pytest
import pyvista as pv

from drl_meshgen.cleanup import CleanupOptions, CleanupWarning, clean
from drl_meshgen.errors import InputError
from drl_meshgen.mesh import TriMesh
from drl_meshgen.models import RawSurface, load
from drl_meshgen.models.hemisphere import hemisphere
from tests.strategies import flat_disk

ASIS = CleanupOptions(min_triangles=0)


def raw(mesh, name="part"):
    return RawSurface(name, mesh.vertices, mesh.triangles)


def poly(mesh):
    return pv.PolyData.from_regular_faces(mesh.vertices, mesh.triangles)


def refuses(words, function, *args):
    with pytest.raises(InputError) as caught:
        function(*args)
    message = str(caught.value)
    assert words in message
    assert "\n" not in message
    assert caught.value.exit_code == 3
    return message


@pytest.fixture
def bowl():
    return hemisphere(500)


@pytest.mark.parametrize("suffix", ["stl", "ply", "obj", "off", "vtp", "vtu"])
@pytest.mark.parametrize(
    ("content", "words"), [(b"", "empty"), (b" \n\n", "empty"), (b"\x00\x01garbage" * 20, "part.")]
)
def test_files_without_a_surface_are_refused_by_name(tmp_path, capfd, suffix, content, words):
    path = tmp_path / f"part.{suffix}"
    path.write_bytes(content)
    assert refuses(words, load, path).startswith(f"part.{suffix}: ")
    assert capfd.readouterr() == ("", "")


@pytest.mark.parametrize("suffix", ["stl", "ply", "off", "vtp", "vtu"])
def test_truncated_files_are_refused(tmp_path, capfd, bowl, suffix):
    path = tmp_path / f"part.{suffix}"
    write(path, bowl)
    path.write_bytes(path.read_bytes()[: path.stat().st_size * 2 // 3])
    refuses("part.", load, path)
    assert capfd.readouterr() == ("", "")


def write(path, mesh, *, binary=True):
    if path.suffix == ".off":
        rows = [f"OFF\n{len(mesh.vertices)} {len(mesh.triangles)} 0"]
        rows += [f"{x!r} {y!r} {z!r}" for x, y, z in mesh.vertices.tolist()]
        path.write_text("\n".join([*rows, *(f"3 {a} {b} {c}" for a, b, c in mesh.triangles)]) + "\n")
    elif path.suffix == ".vtu":
        poly(mesh).cast_to_unstructured_grid().save(path)
    elif path.suffix == ".obj":
        path.write_text(obj_text(mesh))
    else:
        poly(mesh).save(path, binary=binary)


def obj_text(mesh):
    rows = [f"v {x!r} {y!r} {z!r}" for x, y, z in mesh.vertices.tolist()]
    return "\n".join([*rows, *(f"f {a + 1} {b + 1} {c + 1}" for a, b, c in mesh.triangles)]) + "\n"


def test_a_missing_file_is_named():
    assert refuses("no such file", load, "nowhere/fish.stl").startswith("fish.stl: ")


def test_a_folder_is_refused(tmp_path):
    (tmp_path / "folder.stl").mkdir()
    refuses("cannot be read", load, tmp_path / "folder.stl")


def test_a_missing_file_without_a_suffix_may_be_a_misspelt_model():
    assert refuses("no such file", load, "girafe").endswith(
        "no model of that name (hemisphere, giraffe, hand, random:SEED)"
    )


def test_unknown_types_say_what_can_be_read(tmp_path):
    (tmp_path / "fish.xyz").write_text("1 2 3")
    assert "STL" in refuses("neither a model's name nor a file type", load, tmp_path / "fish.xyz")


@pytest.mark.parametrize("name", ["part.msh", "part.step", "PART.STP"])
def test_msh_and_step_are_not_read_yet(tmp_path, name):
    (tmp_path / name).touch()
    assert "convert it to STL or PLY" in refuses("not read yet", load, tmp_path / name)


def test_points_alone_are_no_surface(tmp_path):
    pv.PolyData(np.random.default_rng(0).normal(size=(10, 3))).save(tmp_path / "cloud.vtp")
    refuses("no triangles", load, tmp_path / "cloud.vtp")


@pytest.mark.parametrize("value", [np.nan, np.inf])
def test_coordinates_that_are_no_numbers_are_counted(tmp_path, bowl, value):
    points = bowl.vertices.copy()
    points[7, 1] = value
    pv.PolyData.from_regular_faces(points, bowl.triangles).save(tmp_path / "part.ply")
    assert "point 7" in refuses("1 points have NaN", load, tmp_path / "part.ply")
    refuses("NaN", clean, RawSurface("part", points, bowl.triangles))


def test_indices_beyond_the_points_are_refused(tmp_path):
    (tmp_path / "part.off").write_text("OFF\n3 1 0\n0 0 0\n1 0 0\n0 1 0\n3 0 1 9\n")
    refuses("points that are not in the file", load, tmp_path / "part.off")


def test_a_binary_stl_that_promises_too_much_is_refused(tmp_path):
    (tmp_path / "part.stl").write_bytes(b"\0" * 80 + struct.pack("<I", 1000) + b"\0" * 500)
    refuses("truncated", load, tmp_path / "part.stl")


@pytest.mark.parametrize("triangles", [4999, 1_000_001])
def test_generated_sizes_have_limits(triangles):
    refuses("use 5000 to 1000000", load, "giraffe", triangles)


def test_an_edge_of_three_sheets_is_refused_with_a_place(bowl):
    """Two bowls and a disk welded along one rim: nothing hangs free at the edge."""
    sheet = flat_disk(500)
    n = len(bowl.vertices)
    rim_a, rim_b = bowl.topology.loops[0], sheet.topology.loops[0]
    ids = np.arange(len(sheet.vertices)) + 2 * n
    ids[rim_b] = rim_a
    mirror = np.arange(n) + n
    mirror[rim_a] = rim_a
    points = np.vstack([bowl.vertices, bowl.vertices * (1, 1, -1), sheet.vertices])
    triangles = np.vstack([bowl.triangles, mirror[bowl.triangles][:, ::-1], ids[sheet.triangles]])
    assert "near (" in refuses("belong to three or more triangles", clean, RawSurface("part", points, triangles))


def strip(half_turns, n=40):
    angle = 2 * np.pi * np.arange(n) / n
    width = np.array([-0.3, -0.1, 0.1, 0.3])
    twist = angle * half_turns / 2
    radius = 1 + width[None] * np.cos(twist)[:, None]
    points = np.stack(
        [radius * np.cos(angle)[:, None], radius * np.sin(angle)[:, None], width[None] * np.sin(twist)[:, None]],
        axis=-1,
    )
    faces = []
    for i in range(n):
        row = np.arange(4) + 4 * i
        following = np.arange(4) + 4 * ((i + 1) % n)
        following = following[::-1] if i == n - 1 and half_turns % 2 else following
        faces += [np.c_[row[:-1], following[:-1], following[1:]], np.c_[row[:-1], following[1:], row[1:]]]
    return RawSurface("strip", points.reshape(-1, 3), np.vstack(faces))


def test_a_moebius_strip_is_refused_and_an_untwisted_one_is_not():
    refuses("only one side", clean, strip(1))
    assert len(clean(strip(2)).surface.topology.loops) == 2


def test_the_largest_component_is_taken_with_a_warning_and_strictly_refused(bowl):
    small = bowl.vertices[np.newaxis] * 0.5 + 5
    points = np.vstack([small[0], bowl.vertices])
    both = RawSurface("pair", points, np.vstack([bowl.triangles, bowl.triangles + len(bowl.vertices)]))
    with pytest.warns(CleanupWarning, match="pair: 2 separate components"):
        result = clean(both, ASIS)
    assert np.array_equal(result.surface.vertices, bowl.vertices)
    assert np.array_equal(result.surface.triangles, bowl.triangles)
    refuses("2 separate components", clean, both, CleanupOptions(strict=True))


def test_closed_surfaces_are_not_meshed_yet():
    ball = pv.Icosphere(nsub=2)
    message = refuses("not meshed yet", clean, RawSurface("ball", ball.points, ball.regular_faces))
    assert "Euler characteristic 2, genus 0, 0 boundary loops" in message


def test_surfaces_with_handles_are_not_meshed_yet():
    torus = pv.ParametricTorus(u_res=30, v_res=20).clean().triangulate()
    faces = torus.regular_faces[2:]
    message = refuses("handles", clean, RawSurface("torus", torus.points, faces))
    assert "genus 1, 1 boundary loops" in message


@pytest.mark.parametrize("shape", ["point", "line"])
def test_surfaces_without_area_are_refused(bowl, shape):
    points = bowl.vertices * ((0, 0, 0) if shape == "point" else (1, 0, 0))
    refuses("no area", clean, RawSurface("flat", points, bowl.triangles))


def test_an_empty_surface_is_refused():
    refuses("no triangles", clean, raw(TriMesh(np.zeros((0, 3)), np.zeros((0, 3), int))))
