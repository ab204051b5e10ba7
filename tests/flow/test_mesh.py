"""The mesh flow on a real surface."""

import os
import subprocess
import sys
from pathlib import Path

import pytest

from drl_meshgen.baselines import RivalOptions
from drl_meshgen.commands import reports
from drl_meshgen.errors import overall
from drl_meshgen.export import read_table
from drl_meshgen.pipeline import COMPARED_STAGES, MeshOptions, run
from drl_meshgen.store import Store
from drl_meshgen.store.catalogue import Catalogue
from flows.mesh import mesh, outcomes_of
from flows.surface import TASKS

ROOT = Path(__file__).parents[2]

SMALL = {"target_quads": 300, "triangles": 5000}


def test_every_stage_has_its_task_in_order():
    assert list(TASKS) == [stage.name for stage in COMPARED_STAGES]


@pytest.mark.usefixtures("server")
def test_the_flow_and_the_library_leave_the_same_bytes_and_a_bad_file_spoils_nothing(tmp_path):
    (tmp_path / "empty.stl").touch()
    store, report = str(tmp_path / "flow"), tmp_path / "report"
    state = mesh(
        [str(tmp_path / "empty.stl"), "hemisphere"], **SMALL, store=store, report=str(report), return_state=True
    )
    bad, good = outcomes_of(state)
    assert state.is_failed()
    assert state.message == bad.failure
    assert "empty.stl" in bad.failure
    assert bad.exit_code == 3
    assert good.failure == ""
    assert overall([bad.exit_code, good.exit_code]) == 5
    alone = run("hemisphere", MeshOptions().sized(300), triangles=5000, store=Store(tmp_path / "library"))
    assert {stage: ref for stage, ref in good.refs.items() if stage != "comparison"} == alone.refs
    assert "hemisphere" in (report / "index.html").read_text()
    catalogue = Catalogue.of(Store(store))
    (written,) = [record for record in catalogue.records if record.ref.stage == reports.STAGE]
    again = reports.reproduce(catalogue, written, Store(store))
    assert (again.different, again.code_changed) == ((), False)
    assert set(again.same) == set(written.ref.outputs)
    table = read_table(report / "tables/quality.parquet").set_index("method")
    assert list(table.index) == ["drl-meshgen", *(method.value for method in RivalOptions().chosen)]
    assert (table["seconds"][table["ok"]] > 0).all()
    assert table["ok"]["Gmsh transfinite"]


def test_a_terminal_is_told_at_once_that_prefect_is_being_loaded():
    command = [sys.executable, "-m", "flows.mesh", "--help"]
    ours, theirs = os.openpty()
    done = subprocess.run(command, cwd=ROOT, stdout=subprocess.PIPE, stderr=theirs, text=True, check=True)
    told = os.read(ours, 1000).decode()
    os.close(ours)
    os.close(theirs)
    assert told == "loading Prefect ...\r\x1b[2K"  # nothing of it stays
    assert "Usage" in done.stdout
    assert subprocess.run(command, cwd=ROOT, capture_output=True, text=True, check=True).stderr == ""
