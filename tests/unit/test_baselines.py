import importlib.util
import subprocess

import numpy as np
import pandas as pd
import pytest

from drl_meshgen.baselines import Method, RivalOptions, RivalOutcome, compare, run_rival
from drl_meshgen.baselines.runner import _checked, _four_sides
from drl_meshgen.codecs import COMPARISON
from drl_meshgen.mesh import TriMesh
from tests.standins import hemisphere


@pytest.fixture(scope="module")
def dome():
    return hemisphere(8)


def test_transfinite_mesh_of_a_disk_is_one_block_of_about_the_wanted_size(dome):
    made = compare(dome, 200, RivalOptions(methods=("transfinite",)))
    row = made.rows.iloc[0]
    assert row["ok"]
    assert row["cause"] == row["defects"] == ""
    assert (row["blocks"], row["irregular"], row["non_quads"]) == (1, 0, 0)
    assert row["quads"] == pytest.approx(200, rel=0.2)
    assert made.seconds["Gmsh transfinite"] > 0
    assert "seconds" not in made.rows


def test_blossom_leaves_triangles_and_its_row_says_so(dome):
    row = compare(dome, 150, RivalOptions(methods=("blossom",))).rows.iloc[0]
    assert row["ok"]
    assert row["euler"] == 1
    assert row["loops"] == 1
    assert ("faces are triangles" in row["defects"]) == (row["non_quads"] > 0)


def test_transfinite_does_not_apply_to_a_surface_with_two_loops(dome):
    holed = TriMesh(dome.vertices, np.delete(dome.triangles, 0, axis=0))
    rival = run_rival(holed, Method.TRANSFINITE, 100)
    assert rival.outcome is RivalOutcome.NOT_APPLICABLE


def test_rival_out_of_time_is_a_row_with_its_cause(dome):
    made = compare(dome, 100, RivalOptions(methods=("transfinite", "blossom"), timeout=1e-3))
    assert not made.rows["ok"].any()
    assert made.rows["cause"].tolist() == ["ran out of time (limit 0.001 s)"] * 2
    assert not made.meshes
    assert not made.seconds


def test_rival_that_crashes_is_a_row_with_its_last_words(dome, monkeypatch):
    def crash(*_, **__):
        return subprocess.CompletedProcess([], -11, "", "first\nSegmentation fault\n")

    monkeypatch.setattr(subprocess, "run", crash)
    row = compare(dome, 100, RivalOptions(methods=("blossom",))).rows.iloc[0]
    assert row["cause"] == "stopped with an error (Segmentation fault)"


def test_rival_that_leaves_out_part_of_the_surface_is_incomplete(dome):
    rival = run_rival(dome, Method.TRANSFINITE, 100)
    corners = rival.mesh.points[rival.mesh.quads].mean(axis=1)
    half = type(rival.mesh)(rival.mesh.points, rival.mesh.quads[corners[:, 0] > 0])
    checked = _checked(type(rival)(rival.method, rival.outcome, "", 1.0, half, rival.triangles), dome, 0.05)
    assert checked.outcome is RivalOutcome.INCOMPLETE
    assert checked.mesh is half


def test_loop_with_four_sharp_four_sides_is_cut_there_and_a_round_one_in_quarters(dome):
    points = np.array([(0, 0, 0), (1, 0, 0), (3, 0, 0), (3, 1, 0), (0, 1, 0)], float)
    surface = TriMesh(points, [[0, 1, 4], [1, 3, 4], [1, 2, 3]])
    loop, corners = _four_sides(surface, np.array([1, 2, 3, 4, 0]))
    assert loop[corners].tolist() == [2, 3, 4, 0]
    assert corners[0] == 0
    loop = dome.topology.loops[0]
    assert _four_sides(dome, loop)[1].tolist() == (len(loop) // 4 * np.arange(4)).tolist()


def test_rows_keep_the_order_of_the_options_and_runs_give_the_same_files(dome, tmp_path):
    options = RivalOptions(methods=("transfinite", "blossom"))
    for name in ("one", "two"):
        (tmp_path / name).mkdir()
        made = compare(dome, 100, options)
        COMPARISON.write(made, tmp_path / name)
        assert made.rows["method"].tolist() == ["Gmsh transfinite", "Gmsh blossom"]
    files = sorted(path.name for path in (tmp_path / "one").iterdir())
    assert files == ["blossom.vtu", "rivals.parquet", "transfinite.vtu"]
    assert all((tmp_path / "one" / name).read_bytes() == (tmp_path / "two" / name).read_bytes() for name in files)
    back = COMPARISON.read(tmp_path / "one")
    pd.testing.assert_frame_equal(back.rows, made.rows)
    assert list(back.meshes) == list(made.meshes)
    for name, mesh in made.meshes.items():
        np.testing.assert_array_equal(back.meshes[name].points, mesh.points)
        np.testing.assert_array_equal(back.meshes[name].quads, mesh.quads)
        np.testing.assert_array_equal(back.triangles[name], made.triangles[name])


def test_a_method_that_is_none_is_refused():
    with pytest.raises(ValueError, match="'triangle' is not a method; known are quasi-structured, blossom"):
        RivalOptions(methods=("triangle",))


def test_quadriflow_that_is_not_installed_is_a_row_that_says_how(dome, monkeypatch):
    monkeypatch.setattr(importlib.util, "find_spec", lambda _: None)
    row = compare(dome, 100, RivalOptions(methods=("quadriflow",))).rows.iloc[0]
    assert not row["ok"]
    assert "pip install 'drl-meshgen[bench]'" in row["cause"]


@pytest.mark.skipif(importlib.util.find_spec("pyQuadriFlow") is None, reason="the extra bench is not installed")
def test_quadriflow_makes_quads_only_of_about_the_wanted_count_and_keeps_the_rim(dome):
    row = compare(dome, 300, RivalOptions(methods=("quadriflow",), corrections=4)).rows.iloc[0]
    assert row["ok"]
    assert (row["non_quads"], row["loops"], row["euler"]) == (0, 1, 1)
    assert row["quads"] == pytest.approx(300, rel=0.25)
    assert row["boundary_deviation"] < 0.02
