"""The command line: what it writes, prints and returns."""

import subprocess
import sys
from dataclasses import replace
from enum import Enum
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
import pyvista as pv
from typer.testing import CliRunner

import drl_meshgen
from drl_meshgen import pipeline
from drl_meshgen.cli import app
from drl_meshgen.commands.output import complete, folder_names
from drl_meshgen.commands.settings import SettingsError, read_settings, to_toml
from drl_meshgen.errors import StageError
from drl_meshgen.export import write_mesh, write_surface_ply
from drl_meshgen.mesh import BlockMesh
from drl_meshgen.pipeline import MeshOptions
from tests.standins import hemisphere, hemisphere_ogrid
from tests.strategies import flat_disk

FILES = {
    "mesh.vtu",
    "layout.vtu",
    "layout.toml",
    "blocks.parquet",
    "edges.parquet",
    "quality.parquet",
    "surface.ply",
    "options.toml",
}


def run(*arguments):
    return CliRunner().invoke(app, [str(a) for a in arguments])


def meshing(*arguments):
    return run("mesh", *arguments, "--no-pictures", "--target-quads", 100)


def content(folder):
    return {path.name: path.read_bytes() for path in folder.iterdir()}


@pytest.fixture(scope="module")
def disk(tmp_path_factory):
    path = tmp_path_factory.mktemp("input") / "disk.ply"
    write_surface_ply(path, flat_disk(1000))
    return path


@pytest.fixture(scope="module")
def meshed(disk, tmp_path_factory):
    out = tmp_path_factory.mktemp("meshed")
    return meshing(disk, "--out", out, "--timings"), out / "disk"


def test_mesh_writes_one_folder_of_files(meshed):
    result, folder = meshed
    assert (result.exit_code, result.stderr) == (0, "")
    assert {path.name for path in folder.iterdir()} == FILES
    assert [path.name for path in folder.parent.iterdir()] == ["disk"]


def test_verdict_line_agrees_with_the_files(meshed):
    result, folder = meshed
    line = result.stdout.splitlines()[0]
    row = pd.read_parquet(folder / "quality.parquet").iloc[0]
    assert line.startswith("disk ")
    assert f"{pv.read(folder / 'mesh.vtu').n_cells} quads" in line
    assert f"{pv.read(folder / 'layout.vtu').n_cells} blocks" in line
    assert f"angles {row.min_angle:5.1f} to {row.max_angle:5.1f}" in line


def test_timings_list_every_stage(meshed):
    names = [line.split()[0] for line in meshed[0].stdout.splitlines()[1:]]
    assert names == [*(stage.name for stage in pipeline.STAGES), "all"]


def test_rerun_library_and_store_give_the_same_bytes(meshed, disk, tmp_path):
    before = content(meshed[1])
    for _ in range(2):  # fills the store, then reads from it
        result = meshing(disk, "--out", tmp_path / "out", "--store", tmp_path / "store", "--timings")
        assert content(tmp_path / "out/disk") == before
    assert result.stdout.count("from the store") == len(pipeline.STAGES)
    write_mesh(tmp_path / "library.vtu", drl_meshgen.mesh_surface(disk, MeshOptions().sized(target_quads=100)))
    assert (tmp_path / "library.vtu").read_bytes() == before["mesh.vtu"]


def test_options_file_repeats_the_run(meshed, disk, tmp_path):
    result = run("mesh", disk, "--out", tmp_path, "--no-pictures", "--config", meshed[1] / "options.toml")
    assert result.exit_code == 0
    assert content(tmp_path / "disk") == content(meshed[1])


def test_own_files_in_the_folder_stay(disk, tmp_path):
    (tmp_path / "disk").mkdir()
    (tmp_path / "disk/notes.txt").write_text("mine")
    assert meshing(disk, "--out", tmp_path).exit_code == 0
    assert {path.name for path in (tmp_path / "disk").iterdir()} == FILES | {"notes.txt"}


def test_one_failure_of_several_is_5_and_the_others_are_written(disk, tmp_path):
    (tmp_path / "bad.ply").write_text("hello")
    result = meshing(tmp_path / "bad.ply", disk, "--out", tmp_path / "out")
    assert result.exit_code == 5
    assert result.stderr.startswith("bad.ply: ")
    assert [path.name for path in (tmp_path / "out").iterdir()] == ["disk"]


def test_mesh_below_the_gate_is_written_and_ends_with_4(disk, tmp_path, monkeypatch):
    def spoiled(*arguments, **named):
        done = pipeline.execute(pipeline.STAGES, *arguments, **named)
        quality = replace(done["quality"], metrics={**done["quality"].metrics, "min_angle": 1.0})
        return replace(done, _fetch=lambda stage: quality if stage == "quality" else done[stage])

    monkeypatch.setattr(pipeline, "run", lambda source, options, **_: spoiled(options.by_stage(source)))
    result = meshing(disk, "--out", tmp_path)
    assert result.exit_code == 4
    assert "below the quality gate: minimum angle 1.00" in result.stderr
    assert (tmp_path / "disk/mesh.vtu").is_file()


class Verdict(Enum):
    STUCK = "the solver is stuck"


@pytest.mark.parametrize(
    ("error", "words"),
    [
        (StageError("ricci", Verdict.STUCK, "error 0.1"), "disk.ply: ricci: the solver is stuck (error 0.1)"),
        (RuntimeError("boom\nmore"), "disk.ply: internal error: RuntimeError: boom; --debug shows where"),
        (PermissionError(13, "Permission denied", "out"), "disk.ply: Permission denied: out"),
    ],
)
def test_what_goes_wrong_inside_is_one_sentence_and_1(disk, tmp_path, monkeypatch, error, words):
    def fail(*_arguments, **_named):
        raise error

    monkeypatch.setattr(pipeline, "run", fail)
    result = meshing(disk, "--out", tmp_path / "out")
    assert (result.exit_code, result.stdout, result.stderr) == (1, "", words + "\n")
    assert not (tmp_path / "out").exists()
    assert ("Traceback" in meshing(disk, "--out", tmp_path, "--debug").stderr) == isinstance(error, RuntimeError)


def test_failure_while_writing_leaves_nothing(tmp_path):
    def fail():
        with complete(tmp_path / "out/name") as folder:
            (folder / "half").write_text("x")
            raise RuntimeError

    with pytest.raises(RuntimeError):
        fail()
    assert list((tmp_path / "out").iterdir()) == []


@pytest.mark.parametrize(
    "arguments",
    [
        ("mesh", "hand"),
        ("mesh", "--out", "x"),
        ("mesh", "hand", "--out", "x", "--target-quads", "9", "--target-edge", "1"),
        ("mesh", "hand", "--out", "x", "--target-edge", "-1"),
        ("mesh", "hand", "--out", "x", "--nonsense"),
        ("mesh", "hand", "--out", "x", "--config", "none.toml"),
        ("check",),
        ("nonsense",),
    ],
)
def test_wrong_usage_is_2(arguments, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    assert run(*arguments).exit_code == 2
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("[smoothing]\nrelax_sweep = 3", "unknown key smoothing.relax_sweep; did you mean smoothing.relax_sweeps?"),
        ("[rici]\n", "unknown key rici; did you mean ricci?"),
        ("[ricci]\nmax_steps = 1.5", "ricci.max_steps cannot be 1.5; it is a whole number"),
        ("[ricci]\nboundary = 'round'", "ricci.boundary cannot be 'round'; it is 'free' or 'disk'"),
        ("[ricci]\ntolerance = 1", "ricci: tolerance must lie between"),
        ("[smoothing]\nwanted_angles = [1.0]", "a list of a number, 2 of them"),
        ("ricci = 3", "ricci cannot be 3; it is a table"),
        ("= 3", "not a TOML file"),
    ],
)
def test_wrong_setting_is_named_and_ends_with_2(text, words, tmp_path):
    (tmp_path / "c.toml").write_text(text)
    result = run("mesh", "hemisphere", "--out", tmp_path / "out", "--config", tmp_path / "c.toml")
    assert result.exit_code == 2
    assert result.stderr.startswith("c.toml: ")
    assert words in result.stderr
    with pytest.raises(SettingsError):
        read_settings(tmp_path / "c.toml")


def test_settings_read_back_as_written(tmp_path):
    options = MeshOptions(seed=3).sized(target_edge=0.25)
    options = replace(options, cleanup=replace(options.cleanup, remesh=True, remesh_edge=0.01))
    options = replace(options, decompose=replace(options.decompose, exponents=(0.25, 1.0)))
    (tmp_path / "c.toml").write_text(to_toml(options))
    assert read_settings(tmp_path / "c.toml") == options


def test_number_of_quads_overrides_an_edge_length():
    assert MeshOptions().sized(target_edge=0.1).sized(target_quads=7).decompose.target_edge == 0


def test_equal_names_get_distinct_folders():
    sources = ["hand", "x/hand.stl", "y/Hand.ply", "hand-2.ply", "..ply", "hand"]
    assert folder_names(sources) == ("hand", "hand-2", "Hand-3", "hand-2-2", "surface", "hand-4")


def test_check_prints_metrics_and_accepts_what_was_meshed(meshed):
    result = run("check", meshed[1] / "mesh.vtu", "--surface", meshed[1] / "surface.ply")
    assert (result.exit_code, result.stderr) == (0, "")
    figures = dict(line.split()[:2] for line in result.stdout.splitlines())
    row = pd.read_parquet(meshed[1] / "quality.parquet").iloc[0]
    assert {name: float(value) for name, value in figures.items()}.keys() == set(row.dropna().index)
    assert float(figures["quads"]) == row.quads
    assert float(figures["min_angle"]) == pytest.approx(row.min_angle, abs=0.006)


def test_check_names_defects_and_ends_with_4(tmp_path):
    mesh = hemisphere_ogrid(4, 3)
    points = mesh.points.copy()
    inner = np.nonzero(~mesh.mesh.topology.on_boundary)[0][0]
    points[inner] += [1.5, 0.0, 0.0]
    write_mesh(tmp_path / "m.vtu", BlockMesh(points, mesh.grids))
    write_surface_ply(tmp_path / "s.ply", hemisphere(8))
    result = run("check", tmp_path / "m.vtu", "--surface", tmp_path / "s.ply")
    assert result.exit_code == 4
    assert "defect: " in result.stderr
    assert "quads with a Jacobian that is not positive" in result.stderr


def test_check_of_a_missing_or_wrong_file_is_3(tmp_path, disk):
    assert run("check", tmp_path / "none.vtu").exit_code == 3
    result = run("check", disk)
    assert result.exit_code == 3
    assert "not quadrilaterals" in result.stderr


def test_help_needs_no_numerical_library():
    script = (
        "import sys; from typer.testing import CliRunner; from drl_meshgen.cli import app\n"
        "assert CliRunner().invoke(app, ['mesh', '--help']).exit_code == 0\n"
        "print(*{'numpy', 'scipy', 'pandas', 'pyvista'} & set(sys.modules))"
    )
    done = subprocess.run([sys.executable, "-c", script], capture_output=True, text=True, check=True)
    assert done.stdout.split() == []


def test_public_names_resolve():
    assert all(getattr(drl_meshgen, name) is not None for name in drl_meshgen.__all__)
    with pytest.raises(AttributeError):
        _ = drl_meshgen.nonsense


def test_version_is_printed():
    assert run("--version").stdout.strip() == f"drl-meshgen {drl_meshgen.__version__}"


def test_unwritable_place_is_told_in_one_sentence(disk, tmp_path):
    (tmp_path / "out").mkdir()
    (tmp_path / "out/disk").write_text("a file where the folder should be")
    result = meshing(disk, "--out", tmp_path / "out")
    assert result.exit_code == 1
    assert result.stderr.startswith("disk.ply: ")
    assert len(result.stderr.splitlines()) == 1
    assert [path.name for path in Path(tmp_path / "out").iterdir()] == ["disk"]


def test_rivals_are_run_on_demand_and_get_a_line_and_files_each(disk, tmp_path):
    (tmp_path / "fast.toml").write_text('[comparison]\nmethods = ["transfinite", "blossom"]\n')
    result = meshing(disk, "--out", tmp_path, "--compare", "--config", tmp_path / "fast.toml")
    lines = result.stdout.splitlines()
    assert [line[:28].strip() for line in lines[1:]] == ["Gmsh transfinite", "Gmsh blossom"]
    assert all(" quads " in line for line in lines)
    files = {path.name for path in (tmp_path / "disk/rivals").iterdir()}
    assert files == {"rivals.parquet", "transfinite.vtu", "blossom.vtu"}
    assert {path.name for path in (tmp_path / "disk").iterdir()} == FILES | {"rivals"}


def test_an_unknown_rival_is_a_wrong_setting(disk, tmp_path):
    (tmp_path / "odd.toml").write_text('[comparison]\nmethods = ["triangle"]\n')
    result = meshing(disk, "--out", tmp_path, "--config", tmp_path / "odd.toml")
    assert result.exit_code == 2
    assert "odd.toml: comparison: 'triangle' is not a method" in result.stderr
