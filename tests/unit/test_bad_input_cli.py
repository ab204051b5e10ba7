"""Bad input ends with exit code 3 and one sentence that names file and defect, and nothing is written."""

import numpy as np
import pytest
from typer.testing import CliRunner

from drl_meshgen.cli import app
from drl_meshgen.export import read_mesh, write_surface_ply
from drl_meshgen.mesh import TriMesh
from tests.strategies import flat_disk

DISK = flat_disk(500)


def ply(points, triangles):
    def write(path):
        write_surface_ply(path, TriMesh(np.asarray(points, float), np.asarray(triangles)))

    return write


def text(content):
    return lambda path: path.write_text(content)


def truncated(path):
    write_surface_ply(path, DISK)
    path.write_bytes(path.read_bytes()[:-1000])


def with_nan():
    points = DISK.vertices.copy()
    points[7, 1] = np.nan
    return ply(points, DISK.triangles)


def strip(twist, n=60, m=6):
    """Band around the z axis with `twist` half turns."""
    u, v = np.meshgrid(np.linspace(0, 2 * np.pi, n, endpoint=False), np.linspace(-0.3, 0.3, m), indexing="ij")
    r = 1 + v * np.cos(twist * u / 2)
    points = np.stack([r * np.cos(u), r * np.sin(u), v * np.sin(twist * u / 2)], -1).reshape(-1, 3)
    ids = np.arange(n * m).reshape(n, m)
    closing = ids[:1, ::-1] if twist % 2 else ids[:1]
    ids = np.vstack([ids, closing])
    a, b, c, d = ids[:-1, :-1].ravel(), ids[1:, :-1].ravel(), ids[1:, 1:].ravel(), ids[:-1, 1:].ravel()
    return points, np.r_[np.c_[a, b, c], np.c_[a, c, d]]


def three_sheets():
    """Three half disks that meet in a line of edges."""
    n = 12
    x, y = (a.ravel() for a in np.meshgrid(np.linspace(0, 1, n), np.linspace(0, 1, n), indexing="ij"))
    ids = np.arange(n * n).reshape(n, n)
    a, b, c, d = ids[:-1, :-1].ravel(), ids[1:, :-1].ravel(), ids[1:, 1:].ravel(), ids[:-1, 1:].ravel()
    sheet = np.r_[np.c_[a, b, c], np.c_[a, c, d]]
    turns = 2 * np.pi * np.arange(3) / 3
    points = np.vstack([np.c_[x * np.cos(t), x * np.sin(t), y] for t in turns])
    return points, np.vstack([sheet + k * n * n for k in range(3)])


def two_disks():
    points = np.vstack([DISK.vertices, 0.5 * DISK.vertices + [0, 0, 3]])
    return points, np.vstack([DISK.triangles, DISK.triangles + len(DISK.vertices)])


BAD = {
    "unknown type": ("a.xyz", text("1 2 3"), "neither a model's name nor a file type"),
    "empty file": ("a.stl", text(""), "empty"),
    "not what its suffix says": ("a.ply", text("hello"), "PLY"),
    "truncated": ("a.ply", truncated, "shorter than its header promises"),
    "points only": ("a.obj", text("v 0 0 0\nv 1 0 0\nv 0 1 0\n"), "no triangles"),
    "NaN coordinates": ("a.ply", with_nan(), "NaN"),
    "one-sided": ("a.ply", ply(*strip(1)), "one side"),
    "a single point": ("a.ply", ply(np.ones((3, 3)), [[0, 1, 2]]), "no area"),
    "no area": ("a.ply", ply(DISK.vertices * [1, 0, 0], DISK.triangles), "no area"),
}


def run(path, out, *more):
    arguments = ["mesh", str(path), "--out", str(out), "--target-quads", "60", "--no-pictures", *more]
    return CliRunner().invoke(app, arguments)


def assert_refused(result, out, name, words):
    assert result.exit_code == 3, result.output
    assert result.stdout == ""
    lines = result.stderr.splitlines()
    assert len(lines) == 1
    assert lines[0].startswith(f"{name}: ")
    assert words in lines[0]
    assert not out.exists()


@pytest.mark.parametrize("case", BAD)
def test_bad_file_is_refused_in_one_sentence(case, tmp_path):
    name, write, words = BAD[case]
    write(tmp_path / name)
    assert_refused(run(tmp_path / name, tmp_path / "out"), tmp_path / "out", name, words)


def test_missing_file_and_folder_are_refused(tmp_path):
    out = tmp_path / "out"
    assert_refused(run(tmp_path / "none.stl", out), out, "none.stl", "no such file")
    (tmp_path / "folder.stl").mkdir()
    assert_refused(run(tmp_path / "folder.stl", out), out, "folder.stl", "cannot be read")


def test_several_components_are_refused_when_strict(tmp_path):
    ply(*two_disks())(tmp_path / "a.ply")
    result = run(tmp_path / "a.ply", tmp_path / "out", "--strict")
    assert_refused(result, tmp_path / "out", "a.ply", "2 separate components")


def test_all_of_several_components_are_meshed_into_one_file(tmp_path):
    ply(*two_disks())(tmp_path / "a.ply")
    result = run(tmp_path / "a.ply", tmp_path / "out")
    assert (result.exit_code, result.stderr) == (0, "")
    mesh, _ = read_mesh(tmp_path / "out/a/mesh.vtu")
    assert mesh.topology.components[0] == 2


def test_sheets_that_meet_in_edges_are_meshed_each(tmp_path):
    ply(*three_sheets())(tmp_path / "a.ply")
    result = run(tmp_path / "a.ply", tmp_path / "out")
    assert (result.exit_code, result.stderr) == (0, "")
    mesh, _ = read_mesh(tmp_path / "out/a/mesh.vtu")
    assert mesh.topology.components[0] == 2


@pytest.mark.parametrize("scale", [1e-9, 1e9])
def test_any_unit_works(scale, tmp_path):
    ply(DISK.vertices * scale, DISK.triangles)(tmp_path / "a.ply")
    result = run(tmp_path / "a.ply", tmp_path / "out")
    assert (result.exit_code, result.stderr) == (0, "")


def test_duplicate_points_are_merged(tmp_path):
    ply(DISK.corners.reshape(-1, 3), np.arange(3 * len(DISK.triangles)).reshape(-1, 3))(tmp_path / "a.ply")
    result = run(tmp_path / "a.ply", tmp_path / "out")
    assert (result.exit_code, result.stderr) == (0, "")


def test_the_place_of_a_defect_is_drawn_and_the_picture_goes_when_the_input_is_mended(tmp_path):
    path = tmp_path / "a.ply"
    ply(*strip(1))(path)
    found = CliRunner().invoke(app, ["mesh", str(path), "--out", str(tmp_path / "out")])
    assert found.exit_code == 3
    assert [file.name for file in (tmp_path / "out/a").iterdir()] == ["defect.png"]
    assert f"the place is shown in {tmp_path / 'out/a/defect.png'}" in found.output
    write_surface_ply(path, DISK)
    found = CliRunner().invoke(app, ["mesh", str(path), "--out", str(tmp_path / "out"), "--target-quads", "100"])
    assert found.exit_code == 0
    assert not (tmp_path / "out/a/defect.png").exists()
