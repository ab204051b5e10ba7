import subprocess

import numpy as np
import pytest

from drl_meshgen.baselines import Method, RivalOptions, RivalOutcome, compare, run_rival
from drl_meshgen.baselines.runner import _checked, _four_sides
from drl_meshgen.mesh import TriMesh
from tests.standins import hemisphere


@pytest.fixture(scope="module")
def dome():
    return hemisphere(8)


def test_transfinite_mesh_of_a_disk_is_one_block_of_about_the_wanted_size(dome):
    table, rivals = compare(dome, 200, [Method.TRANSFINITE])
    row = table.iloc[0]
    assert row["ok"]
    assert row["cause"] == row["defects"] == ""
    assert (row["blocks"], row["irregular"], row["non_quads"]) == (1, 0, 0)
    assert row["quads"] == pytest.approx(200, rel=0.2)
    assert rivals["Gmsh transfinite"].seconds > 0


def test_blossom_leaves_triangles_and_its_row_says_so(dome):
    row = compare(dome, 150, [Method.BLOSSOM])[0].iloc[0]
    assert row["ok"]
    assert row["euler"] == 1
    assert row["loops"] == 1
    assert ("faces are triangles" in row["defects"]) == (row["non_quads"] > 0)


def test_transfinite_does_not_apply_to_a_surface_with_two_loops(dome):
    holed = TriMesh(dome.vertices, np.delete(dome.triangles, 0, axis=0))
    rival = run_rival(holed, Method.TRANSFINITE, 100)
    assert rival.outcome is RivalOutcome.NOT_APPLICABLE


def test_rival_out_of_time_is_a_row_with_its_cause(dome):
    row = compare(dome, 100, [Method.TRANSFINITE], RivalOptions(timeout=1e-3))[0].iloc[0]
    assert not row["ok"]
    assert "ran out of time" in row["cause"]
    assert np.isnan(row["seconds"])


def test_rival_that_crashes_is_a_row_with_its_last_words(dome, monkeypatch):
    def crash(*_, **__):
        return subprocess.CompletedProcess([], -11, "", "first\nSegmentation fault\n")

    monkeypatch.setattr(subprocess, "run", crash)
    row = compare(dome, 100, [Method.BLOSSOM])[0].iloc[0]
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
