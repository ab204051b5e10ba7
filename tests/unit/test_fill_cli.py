"""The `fill` command: one plane domain in, a mesh out, and bad boundaries refused in one sentence."""

import os
import subprocess
import sys

import numpy as np
import pandas as pd
import pytest
import pyvista as pv
from typer.testing import CliRunner

from drl_meshgen.cli import app
from drl_meshgen.commands.outline import read_outline
from drl_meshgen.errors import InputError
from drl_meshgen.export import read_mesh

ANGLE = 2 * np.pi * np.arange(24) / 24
OVAL = np.stack([3 * np.cos(ANGLE), 2 * np.sin(ANGLE)], axis=1)


def write(path, points):
    table = pd.DataFrame(np.asarray(points, float), columns=["x", "y"])
    table.to_parquet(path) if path.suffix == ".parquet" else table.to_csv(path, index=False)
    return path


def run(path, out, *more):
    return CliRunner().invoke(app, ["fill", str(path), "--out", str(out), "--no-pictures", *more])


def with_nan():
    return np.where(np.arange(48).reshape(24, 2) == 7, np.nan, OVAL)


BAD = {
    "self-intersecting": (OVAL[[0, 2, 1, *range(3, 24)]], "intersects itself"),
    "open": (OVAL[:20], "is open"),
    "repeated points": (OVAL[[*range(10), 9, *range(10, 24)]], "points 9 and 10 coincide"),
    "touching itself": (np.concatenate([OVAL, 0.2 * OVAL]), "intersects itself"),
    "fewer than 12 points": (OVAL[::4], "6 boundary points; give 12"),
    "not finite": (with_nan(), "row 3 has a coordinate that is NaN"),
    "odd": (np.delete(OVAL, 5, axis=0), "odd number of boundary points (23); add one, for instance halfway between 4"),
    "no area": (np.stack([np.arange(14.0), np.zeros(14)], axis=1), "open"),
}


@pytest.mark.parametrize("case", BAD)
@pytest.mark.parametrize("suffix", [".csv", ".parquet"])
def test_a_bad_boundary_is_refused_in_one_sentence(case, suffix, tmp_path):
    points, words = BAD[case]
    result = run(write(tmp_path / f"a{suffix}", points), tmp_path / "out")
    assert result.exit_code == 3, result.output
    assert result.stdout == ""
    assert result.stderr.count("\n") == 1
    assert result.stderr.startswith(f"a{suffix}: ")
    assert words in result.stderr
    assert not (tmp_path / "out").exists()


@pytest.mark.parametrize(
    ("name", "content", "words"),
    [
        ("a.csv", "", "not a readable CSV"),
        ("a.csv", "u,v\n1,2\n", "no columns x and y"),
        ("a.csv", "x,y\n1,two\n", "not numbers"),
        ("a.parquet", "PAR1", "not a readable PARQUET"),
        ("a.vtp", "<VTKFile", "a.vtp: "),
        ("a.txt", "1 2", "give CSV, Parquet, VTP or VTU"),
    ],
)
def test_a_file_that_is_none_is_refused_in_one_sentence(name, content, words, tmp_path):
    (tmp_path / name).write_text(content)
    result = run(tmp_path / name, tmp_path / "out")
    assert (result.exit_code, result.stderr.count("\n")) == (3, 1), result.output
    assert words in result.stderr


def test_a_missing_file_and_an_unknown_policy_are_refused(tmp_path):
    assert "no such file" in run(tmp_path / "none.csv", tmp_path / "out").stderr
    result = run(write(tmp_path / "a.csv", OVAL), tmp_path / "out", "--policy", "guess")
    assert (result.exit_code, result.stderr.count("\n")) == (3, 1)
    assert "'guess' is not known" in result.stderr


def test_a_clockwise_boundary_is_turned_and_said_so(tmp_path):
    result = run(write(tmp_path / "a.csv", OVAL[::-1]), tmp_path / "out")
    assert result.exit_code == 0, result.output
    assert "clockwise" in result.stderr
    turned, clockwise = read_outline(tmp_path / "a.csv")
    assert clockwise
    assert (turned[0] == OVAL[-1]).all()
    assert (turned[1:] == OVAL[:-1]).all()


def test_a_first_point_repeated_at_the_end_closes_even_a_wide_gap(tmp_path):
    nodes, clockwise = read_outline(write(tmp_path / "a.csv", np.concatenate([OVAL[:20], OVAL[:1]])))
    assert (nodes == OVAL[:20]).all()
    assert not clockwise


@pytest.mark.parametrize("suffix", [".csv", ".parquet"])
def test_the_mesh_keeps_the_boundary_nodes_and_has_blocks(suffix, tmp_path):
    result = run(write(tmp_path / f"a{suffix}", OVAL), tmp_path / "out", "--layers", "2")
    assert (result.exit_code, result.stderr) == (0, ""), result.output
    mesh, block = read_mesh(tmp_path / "out/mesh.vtu")
    assert mesh.points[:24, :2] == pytest.approx(OVAL)
    assert np.unique(block).tolist() == [0, 1, 2, 3, 4]
    row = pd.read_parquet(tmp_path / "out/parameters.parquet").iloc[0]
    assert (row["layers"], row["m"] + row["n"], len(row["singular"])) == (2, 12, 8)
    quality = pd.read_parquet(tmp_path / "out/quality.parquet").iloc[0]
    assert quality["valid"] == quality["boundary_fit"] == 1
    assert f"reward{' ' * 17}" in result.stdout


def polyline(path, points, ids, *, grid=False):
    data = pv.PolyData(np.column_stack([points, np.zeros(len(points))]), lines=[len(ids), *ids])
    (data.cast_to_unstructured_grid() if grid else data).save(path)
    return path


@pytest.mark.parametrize("suffix", [".vtp", ".vtu"])
def test_closed_polylines_are_read_and_open_ones_refused(suffix, tmp_path):
    path = polyline(tmp_path / f"a{suffix}", OVAL, [*range(24), 0], grid=suffix == ".vtu")
    assert read_outline(path)[0] == pytest.approx(OVAL, abs=1e-6)
    path = polyline(tmp_path / f"a{suffix}", OVAL, range(24), grid=suffix == ".vtu")
    with pytest.raises(InputError, match="polyline is open"):
        read_outline(path)


def test_segments_are_joined_and_more_than_one_curve_is_refused(tmp_path):
    points = np.column_stack([OVAL, np.zeros(24)])
    segments = [entry for k in range(24) for entry in (2, k, (k + 1) % 24)]
    pv.PolyData(points, lines=segments).save(tmp_path / "a.vtp")
    outline, _ = read_outline(tmp_path / "a.vtp")
    assert {tuple(point) for point in outline.round(5)} == {tuple(point) for point in OVAL.round(5)}
    pv.PolyData(points, lines=[13, *range(12), 0, 13, *range(12, 24), 12]).save(tmp_path / "b.vtp")
    with pytest.raises(InputError, match="has 2 curves"):
        read_outline(tmp_path / "b.vtp")
    pv.PolyData(points).save(tmp_path / "c.vtp")
    with pytest.raises(InputError, match="holds no polyline"):
        read_outline(tmp_path / "c.vtp")


@pytest.mark.parametrize("nodes", ["99", "-1"])
def test_a_polyline_through_points_that_are_not_there_is_refused(tmp_path, nodes):
    path = polyline(tmp_path / "a.vtp", OVAL, [*range(24), 0])
    pv.read(path).save(path, binary=False)
    content = path.read_text()
    head, lines, rest = content.partition("<Lines>")
    assert " 23" in rest
    path.write_text(head + lines + rest.replace(" 23", f" {nodes}", 1))
    with pytest.raises(InputError, match="points that are not in the file"):
        read_outline(path)


def test_a_picture_is_drawn(tmp_path):
    arguments = ["fill", str(write(tmp_path / "a.csv", OVAL)), "--out", str(tmp_path / "out")]
    assert CliRunner().invoke(app, arguments).exit_code == 0
    assert (tmp_path / "out/mesh.png").stat().st_size > 5_000


def test_finishing_moves_interior_nodes_only_and_can_be_left_out(tmp_path):
    found = {}
    for how in ("--finish", "--no-finish"):
        assert run(write(tmp_path / "a.csv", OVAL), tmp_path / how, how, "--layers", "2").exit_code == 0
        row = pd.read_parquet(tmp_path / how / "parameters.parquet").iloc[0]
        assert row.finished == (how == "--finish")
        quality = pd.read_parquet(tmp_path / how / "quality.parquet").iloc[0]
        found[how] = read_mesh(tmp_path / how / "mesh.vtu")[0].points, quality
    (moved, finished), (plain, unfinished) = found.values()
    assert np.array_equal(moved[:24], plain[:24])
    assert not np.allclose(moved, plain, atol=1e-3)
    assert finished.smoothness > unfinished.smoothness


def test_finished_meshes_have_four_layers_unless_told(tmp_path):
    for more, layers in (((), 4), (("--layers", "2"), 2), (("--no-finish",), 3)):
        out = tmp_path / str(layers)
        assert run(write(tmp_path / "a.csv", OVAL), out, "--template", "o", *more).exit_code == 0
        assert pd.read_parquet(out / "parameters.parquet").layers[0] == layers


def test_a_terminal_is_told_at_once_what_is_filled_whatever_its_name(tmp_path):
    path = write(tmp_path / "[bold].csv", OVAL)
    ours, theirs = os.openpty()
    command = [
        sys.executable,
        "-m",
        "drl_meshgen.cli",
        "fill",
        str(path),
        "--out",
        str(tmp_path / "out"),
        "--no-pictures",
    ]
    done = subprocess.run(command, stdout=subprocess.PIPE, stderr=theirs, check=True)
    shown = os.read(ours, 100_000).decode()
    os.close(ours)
    os.close(theirs)
    assert "filling [bold].csv" in shown
    assert shown.rstrip().endswith("\x1b[2K")  # nothing of it stays
    assert done.stdout.startswith(b"quads ")
