import numpy as np
import pandas as pd
import pytest

from drl_meshgen.benchmarks import rl_paper
from drl_meshgen.benchmarks.harvest import flattened, patch_rim, thinned
from drl_meshgen.benchmarks.rl_figures import draw_front, draw_sets, draw_stages
from drl_meshgen.benchmarks.rl_judge import GMSH, judged
from drl_meshgen.benchmarks.rl_tables import main as make_tables
from drl_meshgen.benchmarks.rl_tables import tables_of, with_ceiling
from drl_meshgen.benchmarks.templates import domain_named, parameter_row, parameters_in
from drl_meshgen.benchmarks.templates import main as search
from drl_meshgen.errors import InputError
from drl_meshgen.export import read_table, write_table
from drl_meshgen.report.learning import ShownTable, build_learning_report
from drl_meshgen.rl import Sample, read_samples, write_samples
from drl_meshgen.rl.c_domains import samples_of_test
from drl_meshgen.templates import CCounts, CSides, Domain, RulePolicy, fill_transition

SAMPLE = domain_named("test-standard", 1)


def rows_of(columns, *rows):
    return [dict(zip(columns, row, strict=True)) for row in rows]


def test_parameters_survive_a_row_and_a_file(tmp_path):
    p = RulePolicy().choose(SAMPLE.domain)
    row = parameter_row(p) | {"waves": np.full(32, 0.01).tolist(), "grading": 1.25}
    write_table(tmp_path / "a.parquet", pd.DataFrame([row]))
    back = parameters_in(read_table(tmp_path / "a.parquet").to_dict("records")[0])
    assert (back.i0, back.m, back.n, back.layers, back.grading) == (p.i0, p.m, p.n, p.layers, 1.25)
    assert (back.singular == p.singular).all()
    assert (back.waves == 0.01).all()
    assert (back.swells == 0).all()


def test_an_unknown_set_is_refused():
    with pytest.raises(InputError, match="'nowhere' is not known; take one of train"):
        domain_named("nowhere", 0)


def test_the_ceiling_is_the_better_of_the_strongest_methods_on_each_domain():
    columns = ("set", "index", "method", "reward")
    rows = rows_of(columns, ("a", 0, "CMA-ES", 0.5), ("a", 0, "gradient optimiser", 0.8), ("a", 0, "ours", 0.4),
                   ("a", 1, "ours", 0.4))  # fmt: skip
    assert [row["share"] for row in with_ceiling(rows)] == pytest.approx([0.625, 1.0, 0.5, np.nan], nan_ok=True)


def test_every_method_gives_one_row_and_a_failure_is_a_row_without_figures(tmp_path):
    rows = judged(SAMPLE, tmp_path, ["rule", "PPO", GMSH[1]])
    assert [row["method"] for row in rows] == ["rule", GMSH[1]]  # no weights of PPO there
    assert all(row["validity"] == 1 and row["ms"] > 0 for row in rows)
    odd = Sample("test-standard", 0, "odd", Domain(SAMPLE.domain.nodes[1:]))
    (row,) = judged(odd, tmp_path, ["rule"])
    assert "odd number" in row["cause"]
    assert row["valid"] == 0
    assert "reward" not in row


def test_searches_resume_and_tables_figures_and_page_follow(tmp_path, monkeypatch, capsys):
    from drl_meshgen.benchmarks import templates
    from drl_meshgen.rl.rivals import SqpPolicy

    quick = {"SQP": SqpPolicy(starts=1, evaluations=5)}
    monkeypatch.setattr(templates, "SEARCHES", quick)
    monkeypatch.setattr(templates, "run_jobs", in_this_process)
    common = ["--sets", "test-standard", "--limit", "2", "--out", str(tmp_path)]
    for _ in range(2):
        assert search([*common, "--work", str(tmp_path), "--resume"]) == 0
    assert "2 searches, 2 of them done before" in capsys.readouterr().out
    assert len(read_table(tmp_path / "searches.parquet")) == 2

    monkeypatch.setattr("drl_meshgen.benchmarks.rl_tables.run_jobs", in_this_process)
    page = tmp_path / "page"
    assert make_tables([*common, "--methods", "rule", GMSH[1], "--report", str(page)]) == 0
    before = read_table(tmp_path / "judged.parquet")
    assert make_tables([*common, "--methods", "rule"]) == 0  # rows of others stay
    pd.testing.assert_frame_equal(read_table(tmp_path / "judged.parquet"), before)
    text = (tmp_path / "tables.md").read_text("utf-8")
    assert "| test-standard | SQP | 2 |" in text
    assert "0.87 ± 0.08" in text  # the paper's
    assert "Left out, as their data are not there: `ablation.parquet`, `stages.parquet`." in text
    html = (page / "report.html").read_text("utf-8")
    assert "Gmsh blossom" in html
    assert 'src="data:image/png;base64,' in html
    assert set(read_table(tmp_path / "summary.parquet")["method"]) == {"SQP", "rule", GMSH[1]}


def in_this_process(work, jobs, _options):
    from drl_meshgen.benchmarks.pool import Ended

    for k, job in enumerate(jobs):
        yield Ended(k, work(job), "", timed_out=False, seconds=1.0)


def test_tables_1_and_2_and_figures_10_and_11_are_made_where_their_data_are(tmp_path):
    row = {"set": "test-standard", "index": 1} | parameter_row(RulePolicy().choose(SAMPLE.domain))
    write_table(tmp_path / "stages.parquet", pd.DataFrame([{"stage": s} | row for s in ("early", "late")]))
    figures = {"boundary_error": 0.5, "orthogonality": 0.9, "validity": 1.0, "reward": 0.7}
    ablation = [{"configuration": name, "set": "test-standard", "index": 0} | figures for name in rl_paper.TABLE_1]
    write_table(tmp_path / "ablation.parquet", pd.DataFrame(ablation))
    front = [{"w_orth": w / 10, "orthogonality": 0.8 + w / 100, "jacobian_ratio": 0.9 - w / 100} for w in range(1, 10)]
    write_table(tmp_path / "pareto.parquet", pd.DataFrame(front))
    write_table(tmp_path / "judged.parquet", pd.DataFrame([], columns=["set", "index", "method"]))
    write_table(tmp_path / "judged-ms.parquet", pd.DataFrame([], columns=["set", "index", "method", "ms"]))
    first, second = tables_of(tmp_path)
    assert [row[0] for row in first.groups[0][1]] == ["quality", "fitting", "full"]
    assert first.groups[0][1][0][1:3] == ("0.500", "0.89 ± 0.12")
    assert [row[0] for row in second.groups[0][1]] == ["early", "late"]
    assert second.groups[0][1][1][-1] == "0.66"
    for drawn in (draw_front(tmp_path), draw_stages(tmp_path)):
        assert drawn.path.stat().st_size > 5_000


def test_the_page_needs_no_other_file_and_escapes_what_it_shows(tmp_path):
    table = ShownTable("a", "A <b>", "note", ("method", "x", "the paper"), (("", (("ours", "1 ± 2", "<3"),)),))
    text = build_learning_report(tmp_path, [table], [], "ours").read_text("utf-8")
    assert "A &lt;b&gt;" in text
    assert "&lt;3" in text
    assert 'class="ours"' in text
    assert 'href="http' not in text


def test_harvested_domains_keep_their_provenance_and_corners(tmp_path):
    one = Sample("test-pipeline", 3, "cap", SAMPLE.domain, "cat 3000, cap 2", (1, 5, 50, 54))
    write_samples(tmp_path / "a.parquet", [one])
    (back,) = read_samples(tmp_path / "a.parquet")
    assert (back.source, back.corners, back.is_o_type) == (one.source, one.corners, True)
    assert not Sample("test-pipeline", 3, "transition", SAMPLE.domain, "", (0, 20, 30, 44)).is_o_type
    assert draw_sets(tmp_path, tmp_path / "sets.png", rows=1, columns=4).path.stat().st_size > 5_000


def test_the_rim_of_a_transition_is_found_again_with_its_corners():
    counts = CCounts(2, 1, 3, 2, 2, 3)
    side = [counts.sides.bottom, counts.sides.side, counts.sides.top, counts.sides.side]
    ends = np.array([[0, 0], [4, 0], [4, 3], [0, 3], [0, 0]], float)
    rim = np.concatenate([ends[k] + np.linspace(0, 1, n, endpoint=False)[:, None] * (ends[k + 1] - ends[k])
                          for k, n in enumerate(side)])  # fmt: skip
    patch = fill_transition(rim, 0, counts)
    nodes, corners = patch_rim(patch.grids)
    assert nodes.tolist() == list(range(len(rim)))
    assert corners == tuple(np.cumsum([0, *side[:3]]))


def test_flattening_a_flat_curve_changes_no_distance():
    plane = np.column_stack([SAMPLE.domain.nodes, np.zeros(len(SAMPLE.domain))])
    turn, _ = np.linalg.qr(np.array([[1.0, 2, 3], [0, 1, 4], [5, 6, 0]]))
    flat = flattened(plane @ turn + 7)
    assert np.linalg.norm(flat - flat[0], axis=1) == pytest.approx(np.linalg.norm(plane - plane[0], axis=1))


def test_thinning_keeps_the_largest_of_different_sizes():
    sizes = (30, 30, 28, 26, 24)
    circle = [np.stack([np.cos(a), np.sin(a)], axis=1) for n in sizes for a in [2 * np.pi * np.arange(n) / n]]
    shapes = [("cap", "", Domain(nodes), ()) for nodes in circle]
    assert [len(shape[2]) for shape in thinned(shapes)] == [30, 28, 26]


def test_four_sided_domains_are_judged_by_what_knows_transitions(tmp_path):
    (sample,) = samples_of_test([1])
    assert sample.transition == (0, CSides(28, 19, 20))
    assert not sample.is_o_type
    rows = judged(sample, tmp_path, ["ours", "rule", "PPO", GMSH[2]])
    assert [row["method"] for row in rows] == ["ours", "rule"]
    assert all(row["valid"] for row in rows)
    assert rows[0]["reward"] > rows[1]["reward"]


def test_ours_is_timed_in_a_batch_as_well(tmp_path, monkeypatch):
    monkeypatch.setattr("drl_meshgen.benchmarks.rl_tables.run_jobs", in_this_process)
    assert make_tables(["--sets", "test-standard", "--limit", "2", "--methods", "ours", "--out", str(tmp_path)]) == 0
    times = read_table(tmp_path / "judged-ms.parquet")
    assert (times["ms_64"] > 0).all()
    assert "ms_64" not in read_table(tmp_path / "judged.parquet")
    assert "ms in a batch of 64" in (tmp_path / "tables.md").read_text("utf-8")
