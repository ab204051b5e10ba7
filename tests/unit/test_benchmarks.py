import math
import os
import time

import numpy as np
import pandas as pd
import pytest

from drl_meshgen.benchmarks import examine as examining
from drl_meshgen.benchmarks import quality, robustness
from drl_meshgen.benchmarks.columns import FIGURES, RANKED
from drl_meshgen.benchmarks.examine import FILLED, SPECKS, Case, Status, examine, failure, kept, row
from drl_meshgen.benchmarks.pool import Ended, PoolOptions, run_jobs
from drl_meshgen.benchmarks.record import Record
from drl_meshgen.benchmarks.standings import PRINTED, ahead, write_standings
from drl_meshgen.benchmarks.summary import blanked, hardest, hardness
from drl_meshgen.cleanup import clean
from drl_meshgen.errors import StageError
from drl_meshgen.export import read_table
from drl_meshgen.models.random_surface import random_surface
from drl_meshgen.report.inputs import OURS

ONE = PoolOptions(workers=1)
PERFECT = dict.fromkeys(FIGURES, 0.0) | {"min_angle": 90.0, "max_angle": 90.0, "area_ratio": 1.0, "quads": 100.0}


def case(seed=3, target=300):
    return Case("random", f"random-{seed}", f"random:{seed}", seed, remesh=False, target=target)


def good(seed=3, **figures):
    return row(case(seed), {"genus": 0}, {"status": "meshed", "sentence": ""} | PERFECT | figures)


def bad(seed, sentence, status=Status.FAILED):
    return row(case(seed), {}, failure(status, sentence))


def test_jobs_all_end_with_their_results_whatever_the_order():
    ended = list(run_jobs(math.sqrt, [1.0, 4.0, 9.0, 16.0], PoolOptions(workers=2, jobs=2)))
    assert {e.index: e.result for e in ended} == {0: 1.0, 1: 2.0, 2: 3.0, 3: 4.0}
    assert all(e.cause == "" and 0 <= e.seconds < 10 for e in ended)


def test_a_job_out_of_time_is_ended_and_the_next_has_its_turn():
    slow, quick = run_jobs(time.sleep, [60.0, 0.0], PoolOptions(workers=1, timeout=3.0))
    assert (slow.index, slow.timed_out, slow.cause) == (0, True, "limit 3 s")
    assert (quick.index, quick.timed_out, quick.cause) == (1, False, "")


def test_a_process_that_dies_is_a_cause_and_the_next_job_has_its_turn():
    first, second = run_jobs(os._exit, [3, 4], ONE)
    assert (first.result, first.cause) == (None, "exit status 3")
    assert second.cause == "exit status 4"


def test_a_record_keeps_whole_lines_of_the_same_code_only(tmp_path):
    path = tmp_path / "work" / "rows.jsonl"
    Record(path, "old", resume=True).add("a", {"x": 1})
    record = Record(path, "new", resume=True)
    assert record.rows == {}
    record.add("b", {"x": math.nan})
    with path.open("a") as file:
        file.write('{"key": "c", "code": "new", "ro')
    again = Record(path, "new", resume=True)
    assert list(again.rows) == ["b"]
    assert math.isnan(again.rows["b"]["x"])
    again.add("c", {"x": 2})
    assert list(Record(path, "new", resume=True).rows) == ["b", "c"]
    assert Record(path, "new", resume=False).rows == {}


def test_a_surface_that_goes_through_has_every_figure_and_the_checker_has_the_last_word(tmp_path):
    checker = tmp_path / "checker.py"
    checker.write_text(
        "import json, sys\n"
        "from pathlib import Path\n"
        "mesh, option, surface, form = sys.argv[1:]\n"
        "assert option == '--surface' and form == '--json'\n"
        "assert Path(mesh).suffix == '.vtu' and Path(surface).suffix == '.ply'\n"
        "print(json.dumps({'defects': ['odd']}))\n"
        "sys.exit(4)\n"
    )
    made = random_surface(3)
    found = examine(case(), checker, tmp_path / "meshes")
    mesh, surface = kept(case(), tmp_path / "meshes")
    assert len(mesh.mesh.quads) == found["quads"]
    assert surface.topology.euler == mesh.mesh.topology.euler
    assert kept(case(4), tmp_path / "meshes") is None
    assert (found["status"], found["sentence"]) == (Status.DEFECTIVE.value, "referee: odd")
    assert (found["genus"], found["loops"], found["components"]) == (made.genus, made.loops, made.components)
    assert found["flaws"] == ", ".join(made.flaws)
    assert all(np.isfinite(found[name]) for name in FIGURES)
    assert set(found) == set(robustness.COLUMNS)


@pytest.mark.parametrize(
    ("error", "status", "sentence"),
    [
        (StageError("ricci", Status.FAILED, "n = 1"), Status.FAILED, "ricci: stage without result (n = 1)"),
        (MemoryError(), Status.OUT_OF_MEMORY, ""),
        (ValueError("first\nsecond"), Status.CRASHED, "ValueError: first"),
    ],
)
def test_whatever_goes_wrong_is_a_row_with_its_cause(monkeypatch, error, status, sentence):
    def fail(*_):
        raise error

    monkeypatch.setattr(examining, "run", fail)
    found = examine(case())
    assert (found["status"], found["sentence"]) == (status.value, sentence)
    assert found["loops"] == random_surface(3).loops
    assert math.isnan(found["quads"])
    assert set(found) == set(robustness.COLUMNS)


def test_a_file_that_cannot_be_read_is_refused_without_naming_its_folder(tmp_path):
    found = examine(Case("single", "none", str(tmp_path / "none.ply"), None, remesh=True, target=100))
    assert found["status"] == Status.REFUSED.value
    assert "no such file" in found["sentence"]
    assert str(tmp_path) not in found["sentence"]


def test_what_is_lost_between_surface_and_mesh_is_a_defect_unless_cleanup_says_so():
    known = {"genus": 1, "loops": 2, "components": 2}
    audit = pd.DataFrame({"step": [SPECKS, FILLED], "count": [0, 0]})
    assert examining._lost(known, audit, {"components": 2, "loops": 2, "euler": 0}) == []
    assert len(examining._lost(known, audit, {"components": 1, "loops": 2, "euler": 0})) == 1
    filled = audit.assign(count=[0, 1])
    assert examining._lost(known, filled, {"components": 2, "loops": 1, "euler": 1}) == []
    assert examining._lost(known, audit.assign(count=[1, 0]), {"components": 1, "loops": 1, "euler": 1}) == []


def test_cleanup_lists_the_steps_that_excuse_a_loss():
    steps = set(clean(random_surface(3).surface).audit["step"])
    assert {SPECKS, FILLED} & steps or random_surface(3).components == 1


def test_hardness_is_nothing_for_squares_grows_as_they_worsen_and_is_highest_without_a_mesh():
    worse = {"min_angle": 45.0, "max_angle": 135.0, "warp": 90.0, "area_ratio": 10**0.5}
    table = pd.DataFrame([good(), good(**worse), bad(0, "no")])
    assert hardness(table).tolist() == pytest.approx([0, 2, 14])


def test_the_hardest_are_each_surface_once_failures_of_different_causes_first():
    rows = [good(1, warp=90.0), good(1, warp=180.0), good(2), bad(3, "a 1"), bad(4, "a 2"), bad(5, "b")]
    found = hardest(pd.DataFrame(rows))
    assert found["seed"].tolist() == [3, 5, 4, 1, 2]
    assert found["warp"].tolist()[3] == 180
    assert len(hardest(pd.DataFrame(rows), 2)) == 2
    assert blanked("euler -2, 1.5e-3 of 7") == blanked("euler 0, 2 of 10")


@pytest.fixture
def _in_process(monkeypatch):
    """Run jobs in this process, in reverse order; the last one of them dies."""

    def run(work, jobs, _options):
        for k in reversed(range(len(jobs))):
            lost = k == len(jobs) - 1
            cause = "killed by SIGKILL" if lost else ""
            yield Ended(k, None if lost else work(jobs[k]), cause, timed_out=False, seconds=1.234)

    for module in (robustness, quality):
        monkeypatch.setattr(module, "run_jobs", run)


@pytest.mark.usefixtures("_in_process")
def test_a_robustness_run_writes_tables_in_the_order_of_the_cases_and_goes_on_where_it_was(
    monkeypatch, tmp_path, capsys
):
    seen = []

    def fake(case, referee, keep):
        assert referee is None
        assert keep == tmp_path / "work" / robustness.MESHES
        seen.append(case.seed)
        return good(case.seed)

    monkeypatch.setattr(robustness, "examine", fake)
    arguments = ["--only", "random", "--seeds", "4:7", "--out", str(tmp_path), "--work", str(tmp_path / "work")]
    assert robustness.main(arguments) == 1
    table = read_table(tmp_path / "robustness.parquet")
    assert tuple(table.columns) == robustness.COLUMNS
    assert table["seed"].tolist() == [4, 5, 6]
    assert table["status"].tolist() == ["meshed", "meshed", Status.DIED.value]
    assert read_table(tmp_path / "robustness-seconds.parquet")["seconds"].tolist() == [1.23] * 3
    page = (tmp_path / "robustness.md").read_text()
    assert "**2 of 3 runs went through, 66.7%**" in page
    assert "| 1 | process died | killed by SIGKILL | random-6 (random, 2,000) |" in page
    first = {p.name: p.read_bytes() for p in tmp_path.glob("robustness.*")}
    assert robustness.main([*arguments, "--resume"]) == 1
    assert seen == [5, 4]
    assert {p.name: p.read_bytes() for p in tmp_path.glob("robustness.*")} == first
    assert "3 of them measured before" in capsys.readouterr().out


def test_cases_of_files_are_every_kind_raw_and_remeshed_at_every_count(tmp_path):
    for kind, name in (("single", "b.ply"), ("single", "a.ply"), ("closed", "c.stl")):
        (tmp_path / kind).mkdir(exist_ok=True)
        (tmp_path / kind / name).touch()
    cases = robustness.file_cases(tmp_path, ("single", "multi", "closed"), (100, 200), None)
    assert len({case.key for case in cases}) == len(cases) == 3 * 2 * 2
    assert [case.surface for case in cases[:3]] == ["a", "b", "c"]
    assert [case.target for case in cases] == [100] * 6 + [200] * 6
    assert cases[3].options.cleanup.remesh
    assert [case.surface for case in robustness.file_cases(tmp_path, ("single",), (100,), 1)] == ["a", "a"]


def versus(method, **figures):
    head = {"surface": "hand", "target": 2000, "method": method, "ran": True, "ok": True, "cause": "", "defects": ""}
    return head | PERFECT | {"seconds": 1.0} | figures


def test_ahead_means_better_than_every_rival_at_the_digits_of_the_table():
    ours = versus(OURS, min_angle=50.04, warp=30.0)
    assert ahead(ours, [versus("a", min_angle=50.0), versus("b", min_angle=20.0)], "min_angle") == 0
    assert ahead(ours, [versus("a", min_angle=49.0)], "min_angle") == 1
    assert ahead(ours, [versus("a", warp=31.0), versus("b", warp=29.0)], "warp") == -1
    assert ahead(ours, [versus("a", warp=1.0, ok=False), versus("b", warp=math.nan)], "warp") == 1
    assert ahead(versus(OURS, warp=math.nan), [], "warp") is None
    assert ahead(versus(OURS, ok=False), [versus("a")], "warp") == -1


@pytest.mark.usefixtures("_in_process")
def test_a_quality_run_writes_every_match_with_its_printed_rows_and_who_is_ahead(monkeypatch, tmp_path):
    def fake(match, options):
        assert options.methods == ("quasi-structured", "quadriflow")
        rows = [versus(OURS, warp=30.0), versus("Gmsh quasi-structured", warp=60.0)]
        return [r | {"surface": match.surface, "target": match.target} for r in rows]

    monkeypatch.setattr(quality, "play", fake)
    folders = ["--out", str(tmp_path), "--work", str(tmp_path), "--models", str(tmp_path)]
    assert quality.main(["--only", "hand", *folders]) == 1
    table = read_table(tmp_path / "quality.parquet")
    assert table["method"].tolist() == [
        OURS, "Gmsh quasi-structured", "QuadWild (printed)", OURS, "QuadWild (printed)", "AutoRemesher (printed)",
    ]  # fmt: skip
    assert table["cause"].tolist()[3] == "killed by SIGKILL"
    assert table["ran"].tolist() == [True, True, False, True, False, False]
    page = (tmp_path / "quality.md").read_text()
    assert "| warp | 1 | 0 | 0 |  |" in page
    assert "| warp | 1 | 0 | 1 | hand 8,000 |" in page
    assert "| hand 2,000 | Gmsh quasi-structured |" in page
    assert len(read_table(tmp_path / "quality-seconds.parquet")) == 2
    write_standings(tmp_path)
    assert (tmp_path / "quality.md").read_text() == page


def test_printed_rows_hold_only_figures_that_are_ranked():
    for printed in PRINTED:
        known = {name for name in FIGURES if not math.isnan(printed[name])}
        assert known <= set(RANKED)
        assert "(printed)" in printed["method"]


def test_ours_failing_leaves_the_rivals_their_rows(monkeypatch):
    def fail(*_, **__):
        raise StageError("ricci", Status.FAILED)

    monkeypatch.setattr(quality, "run", fail)
    match = quality.Match("random-3", "random:3", 60)
    ours, theirs = quality.play(match, quality.RivalOptions(methods=("transfinite",)))
    assert (ours["method"], ours["ok"], ours["cause"]) == (OURS, False, "ricci: stage without result")
    assert theirs["method"] == "Gmsh transfinite"
