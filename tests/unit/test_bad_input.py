"""What a user gets for files and surfaces that cannot be meshed: one sentence with the name and the defect."""

import struct
from itertools import combinations

import numpy as np
import pytest
import pyvista as pv

from drl_meshgen.cleanup import CleanupOptions, clean
from drl_meshgen.errors import InputError
from drl_meshgen.mesh import TriMesh
from drl_meshgen.models import RawSurface, load
from drl_meshgen.models.hemisphere import hemisphere


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


@pytest.mark.parametrize("name", ["part.iges", "PART.IGS", "part.brep"])
def test_other_cad_files_are_not_read_yet(tmp_path, name):
    (tmp_path / name).write_text("x")
    assert "convert it to STEP or STL" in refuses("not read yet", load, tmp_path / name)


MSH = "$MeshFormat\n2.2 0 8\n$EndMeshFormat\n$Nodes\n4\n1 0 0 0\n2 1 0 0\n3 0 1 0\n4 0 0 1\n$EndNodes\n$Elements\n"
STEP = "ISO-10303-21;\nHEADER;\nFILE_SCHEMA(('AUTOMOTIVE_DESIGN'));\nENDSEC;\nDATA;\n%s\nENDSEC;\nEND-ISO-10303-21;\n"


@pytest.mark.parametrize(
    ("name", "content", "words"),
    [
        ("part.msh", "", "empty"),
        ("part.msh", MSH, "ends too early or is not MSH"),
        ("part.msh", MSH + "1\n1 4 2 0 1 1 2 3 4\n$EndElements\n", "volume elements but no surface"),
        ("part.msh", MSH + "1\n1 1 2 0 1 1 2\n$EndElements\n", "holds no surface"),
        ("part.msh", "$MeshFormat\n9.9 7 8\n$EndMeshFormat\n$EndElements\n", "part.msh"),
        ("part.step", "nothing", "ends too early or is not STEP"),
        ("part.stp", STEP[:-30], "ends too early or is not STEP"),
        ("part.step", STEP % "", "part.step"),
        ("part.step", STEP % "#1=CARTESIAN_POINT('',(0.,0.,", "part.step"),
    ],
)
def test_cad_and_gmsh_files_without_a_surface_are_refused(tmp_path, capfd, name, content, words):
    (tmp_path / name).write_text(content)
    refuses(words, load, tmp_path / name)
    assert capfd.readouterr() == ("", "")


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
    assert "near (" in refuses("only one side", clean, strip(1))
    assert len(clean(strip(2)).surface.topology.loops) == 2


def test_several_components_are_refused_when_strict(bowl):
    points = np.vstack([bowl.vertices, bowl.vertices + 5])
    both = RawSurface("pair", points, np.vstack([bowl.triangles, bowl.triangles + len(bowl.vertices)]))
    refuses("2 separate components", clean, both, CleanupOptions(strict=True))


def test_triangles_tangled_beyond_repair_are_refused_with_a_place():
    """All triangles over six points: no sheet can be told from another."""
    triangles = np.array(list(combinations(range(6), 3)))
    points = np.random.default_rng(0).normal(100, 1, (6, 3))
    assert "near (" in refuses("tangled", clean, RawSurface("part", points, triangles))


@pytest.mark.parametrize("shape", ["point", "line"])
def test_surfaces_without_area_are_refused(bowl, shape):
    points = bowl.vertices * ((0, 0, 0) if shape == "point" else (1, 0, 0))
    refuses("no area", clean, RawSurface("flat", points, bowl.triangles))


def test_an_empty_surface_is_refused():
    refuses("no triangles", clean, raw(TriMesh(np.zeros((0, 3)), np.zeros((0, 3), int))))
