"""Benchmark runs: what moved, and that the same figures give the same files."""

import pandas as pd
import pytest

from drl_meshgen.benchmarks.moved import moved
from drl_meshgen.benchmarks.runs import (
    earlier,
    moved_page,
    other_setting,
    run_folder,
    summary,
    surfaces_in,
    versions,
    write_run,
)
from drl_meshgen.errors import InputError
from drl_meshgen.pipeline import STAGES

SETTING = {"target_quads": 100, "versions": {"code": "1", "python": "3", "platform": "p", "libraries": {"numpy": "2"}}}


def table(**columns):
    first = {"surface": ["one"], "verdict": ["passed"], "remark": [""]}
    return pd.DataFrame(first | {name: [value] for name, value in columns.items()})


def moves(before, after, **options):
    return [tuple(row) for row in moved(before, after, **options).itertuples(index=False)]


def test_a_run_has_not_moved_against_itself():
    same = table(min_angle=40.0, irregular=8.0, area_ratio=float("nan"))
    assert moves(same, same) == []
    assert summary(moved(same, same)) == "nothing moved"


@pytest.mark.parametrize(
    ("metric", "before", "after", "movement"),
    [
        ("min_angle", 40.0, 44.0, "better"),
        ("min_angle", 40.0, 36.0, "worse"),
        ("max_angle", 120.0, 130.0, "worse"),
        ("irregular", 8.0, 9.0, "worse"),
        ("irregular", 8.0, 7.0, "better"),
    ],
)
def test_each_metric_knows_its_better_end(metric, before, after, movement):
    (row,) = moves(table(**{metric: before}), table(**{metric: after}))
    assert (row[1], row[-1]) == (metric, movement)
    (back,) = moves(table(**{metric: after}), table(**{metric: before}))
    assert {row[-1], back[-1]} == {"better", "worse"}


def test_figures_may_differ_by_the_tolerance_but_counts_may_not():
    assert moves(table(min_angle=40.0), table(min_angle=39.7), tolerance=0.01) == []
    assert len(moves(table(min_angle=40.0), table(min_angle=39.7), tolerance=0.001)) == 1
    assert len(moves(table(irregular=1000.0), table(irregular=1001.0), tolerance=0.01)) == 1


def test_a_verdict_that_fell_is_worse_and_says_so_once():
    assert moves(table(min_angle=40.0), table(min_angle=float("nan")).assign(verdict="failed")) == [
        ("one", "verdict", "passed", "failed", "worse")
    ]


def test_new_and_missing_surfaces_are_told_and_worse_comes_first():
    before = pd.concat([table(irregular=8.0), table(irregular=1.0).assign(surface="gone")])
    after = pd.concat([table(irregular=9.0).assign(surface="new"), table(irregular=9.0)])
    assert [(row[0], row[-1]) for row in moves(before, after)] == [
        ("one", "worse"),
        ("new", "new"),
        ("gone", "missing"),
    ]
    assert summary(moved(before, after)) == "1 worse, 1 new, 1 missing"


def test_two_runs_leave_the_same_bytes_but_for_times(tmp_path):
    for name, seconds in (("a", 1.0), ("b", 2.0)):
        times = pd.DataFrame([{"surface": "one", "stage": "ricci", "seconds": seconds}])
        write_run(tmp_path / name, table(min_angle=40.0), times, SETTING)
    for path in (tmp_path / "a").iterdir():
        same = path.read_bytes() == (tmp_path / "b" / path.name).read_bytes()
        assert same == (not path.name.startswith("seconds")), path.name


def test_an_earlier_run_is_found_by_name_or_as_the_last_and_a_wrong_name_lists_those_there_are(tmp_path):
    assert earlier(tmp_path, "last", "c") is None
    for name in ("a", "b", "c"):
        write_run(tmp_path / name, table(min_angle=40.0), pd.DataFrame({"surface": []}), SETTING)
    assert earlier(tmp_path, "a", "c")[0] == "a"
    assert earlier(tmp_path, "last", "c")[0] == "b"
    with pytest.raises(InputError, match="known are a, b, c"):
        earlier(tmp_path, "d", "c")


def test_what_moved_is_written_and_goes_when_the_run_is_made_again_without_a_comparison(tmp_path):
    movements = moved(table(irregular=8.0), table(irregular=9.0))
    write_run(tmp_path / "b", table(irregular=9.0), pd.DataFrame({"surface": []}), SETTING, ("a", movements))
    assert "| worse | one | irregular | 8 | 9 |" in (tmp_path / "b/moved.md").read_text()
    write_run(tmp_path / "b", table(irregular=9.0), pd.DataFrame({"surface": []}), SETTING)
    assert not list((tmp_path / "b").glob("moved*"))


def test_runs_of_another_setting_say_what_differs(tmp_path):
    write_run(tmp_path / "a", table(min_angle=40.0), pd.DataFrame({"surface": []}), SETTING)
    assert other_setting(tmp_path / "a", SETTING) == ""
    assert other_setting(tmp_path / "a", {**SETTING, "target_quads": 200}) == "other target_quads"
    assert other_setting(tmp_path / "b", SETTING) == "its setting cannot be read"


def test_a_long_list_of_movements_is_cut_on_the_page_only():
    many = pd.concat([moved(table(irregular=8.0), table(irregular=9.0))] * 300)
    assert moved_page("a", many).count("| worse |") == 200
    assert "and 100 more" in moved_page("a", many)


@pytest.mark.parametrize("name", ["", "..", "a/b", "last", "/tmp"])
def test_names_that_are_no_folder_of_their_own_are_refused(tmp_path, name):
    with pytest.raises(InputError, match="no name for a benchmark run"):
        run_folder(tmp_path, name)


def test_surfaces_of_a_folder_are_sorted_and_other_files_left_out(tmp_path):
    (tmp_path / "deep").mkdir()
    for name in ("b.ply", "a.STL", "deep/c.obj", "README.md"):
        (tmp_path / name).touch()
    assert surfaces_in(tmp_path) == [str(tmp_path / name) for name in ("a.STL", "b.ply", "deep/c.obj")]
    with pytest.raises(InputError, match="holds no files"):
        surfaces_in(tmp_path / "none")


def test_versions_name_every_library_that_a_stage_depends_on():
    found = versions(STAGES)
    assert {"numpy", "scipy"} <= found["libraries"].keys()
    assert list(found["libraries"]) == sorted(found["libraries"])
