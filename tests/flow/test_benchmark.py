"""The benchmark flow: the same tables twice, and an earlier run to hold them to."""

import pandas as pd
import pytest
import typer
from typer.testing import CliRunner

from drl_meshgen.export import read_table, write_table
from flows import benchmark as module
from flows.benchmark import benchmark

SMALL = {"surfaces": ["hemisphere"], "target_quads": 300, "triangles": 5000}


@pytest.mark.usefixtures("server")
def test_two_runs_agree_in_everything_but_times_and_a_worse_one_is_told(tmp_path, monkeypatch):
    pages = []
    monkeypatch.setenv("DRL_MESHGEN_FILES", "http://127.0.0.1:4300")
    monkeypatch.setattr(module, "create_markdown_artifact", lambda page, **_k: pages.append(page))
    out = tmp_path / "runs"
    (tmp_path / "models").mkdir()
    (tmp_path / "models" / "empty.stl").touch()
    given = {**SMALL, "models": str(tmp_path / "models"), "out": str(out), "fresh": True}
    benchmark("one", **given)
    state = benchmark("two", **given, against="one", fail_on_worse=True, return_state=True)
    assert state.message == "2 surfaces, 1 did not pass; against one: nothing moved"
    assert state.is_completed()
    one, two = ({p.name: p.read_bytes() for p in (out / name).iterdir()} for name in ("one", "two"))
    assert {name for name in one if one[name] != two[name]} == {"seconds.csv", "seconds.parquet"}
    assert two.keys() - one.keys() == {"moved.csv", "moved.md", "moved.parquet"}
    table = read_table(out / "one/quality.parquet")
    assert table["verdict"].tolist() == ["passed", "failed"]
    assert (read_table(out / "one/seconds.parquet")["seconds"] > 0).all()
    write_table(out / "one/quality.parquet", table.assign(min_angle=90.0))
    assert not any("/artifacts/" in page for page in pages)  # the store of a fresh run is gone
    worse = benchmark("two", **given, against="one", fail_on_worse=True, return_state=True)
    assert worse.is_failed()
    assert worse.message.endswith("against one: 1 worse")
    assert read_table(out / "two/moved.parquet")["metric"].tolist() == ["min_angle"]


@pytest.mark.usefixtures("server")
def test_the_command_says_in_one_sentence_what_is_wrong_with_its_input(tmp_path):
    app = typer.Typer()
    app.command()(module.main)
    found = CliRunner().invoke(app, ["one", "--against", "none", "--surface", "hemisphere", "--out", str(tmp_path)])
    assert found.exit_code == 3
    assert "none: no such benchmark run; known are none" in found.output


def test_an_empty_row_of_seconds_is_a_table_too():
    assert isinstance(module._seconds([]), pd.DataFrame)
