import re
from html.parser import HTMLParser

import numpy as np
import pandas as pd
import pytest

from drl_meshgen.commands.output import can_draw
from drl_meshgen.export import read_table
from drl_meshgen.mesh import QuadMesh, TriMesh
from drl_meshgen.quality import measure, quality_row
from drl_meshgen.report import OURS, ModelRun, best_view, build_report
from drl_meshgen.report.build import ReportOptions
from drl_meshgen.report.charts import angle_chart
from drl_meshgen.report.palette import neighbour_colours
from drl_meshgen.report.pictures import block_lines
from drl_meshgen.report.tables import (
    BY_KEY,
    TABLE_5,
    angle_histogram,
    best_rows,
    by_model,
    latex,
    quality_table,
    shown,
    table_5,
)
from tests.standins import hemisphere, hemisphere_ogrid

SMALL = ReportOptions(worst=1, picture_size=120)
needs_egl = pytest.mark.skipif(not can_draw(), reason="no off-screen drawing here")


def dome_run(name="hand"):
    surface, mesh = hemisphere(8), hemisphere_ogrid(6, 4)
    depth = surface.vertices[:, 2]
    region = (depth[surface.triangles].mean(axis=1) > 0.7).astype(int)
    turn = np.linspace(0, 2 * np.pi, 33)
    contour = np.c_[0.7 * np.cos(turn), 0.7 * np.sin(turn), np.full(33, np.sqrt(1 - 0.49))]
    other = hemisphere_ogrid(8, 3).mesh
    rows = [
        quality_row(OURS, measure(mesh.mesh, surface, mesh.block), 1.25),
        quality_row("rival", measure(other, surface), 2.5),
        quality_row("lost", None, ok=False, cause="ran out of time (limit 1 s)"),
    ]
    timings = pd.DataFrame({"stage": ["ricci", "smoothing"], "seconds": [0.25, 1.0]})
    return ModelRun(
        name, surface, surface, depth, region, [contour], mesh, pd.DataFrame(rows), timings, {"rival": other}
    )


@pytest.fixture(scope="module")
def run():
    return dome_run()


@pytest.fixture(scope="module")
def page(run, tmp_path_factory):
    return build_report([run], tmp_path_factory.mktemp("report"), SMALL)


class Links(HTMLParser):
    def __init__(self):
        super().__init__()
        self.found, self.ids = set(), set()

    def handle_starttag(self, _tag, attrs):
        for key, value in attrs:
            if key in ("href", "src"):
                self.found.add(value)
            if key == "id":
                self.ids.add(value)


@needs_egl
def test_every_link_of_the_page_leads_to_a_file_beside_it_or_a_place_in_it(page):
    links = Links()
    links.feed(page.read_text(encoding="utf-8"))
    assert links.found
    for link in links.found:
        if link.startswith("#"):
            assert link[1:] in links.ids
        else:
            assert not re.match(r"[a-z]+:|/", link), link
            assert (page.parent / link).stat().st_size > 0


@needs_egl
def test_page_shows_the_figures_of_the_tables_and_the_causes_of_failures(page):
    text = page.read_text(encoding="utf-8")
    table = read_table(page.parent / "tables" / "quality.parquet")
    for key in ("min_angle", "orthogonality", "surface_deviation"):
        assert shown(BY_KEY[key], float(table[key][0])) in text
    assert "ran out of time (limit 1 s)" in text
    assert "8.84" in text
    assert "paper, own model" in text


@needs_egl
def test_building_twice_gives_the_same_bytes(run, page, tmp_path):
    again = build_report([run], tmp_path, SMALL)
    files = sorted(p.relative_to(page.parent) for p in page.parent.rglob("*") if p.is_file())
    assert files == sorted(p.relative_to(tmp_path) for p in tmp_path.rglob("*") if p.is_file())
    for name in files:
        assert (page.parent / name).read_bytes() == (again.parent / name).read_bytes(), name


def test_run_without_our_row_is_refused(run, tmp_path):
    bad = ModelRun(**{**vars(run), "quality": run.quality[run.quality["method"] != OURS]})
    with pytest.raises(ValueError, match="no row of drl-meshgen"):
        build_report([bad], tmp_path)


def test_table_5_puts_the_papers_rows_after_the_measured_ones(run):
    table = table_5(quality_table([run]))
    assert table["source"].tolist() == ["measured here"] * 3 + ["printed in the paper"] * 3
    np.testing.assert_allclose(table.loc[3, list(TABLE_5)].astype(float), [8.84, 173.11, 51.6, 6.05, 5.9])


def test_model_the_paper_has_not_has_no_rows_of_it():
    assert set(table_5(quality_table([dome_run("dome")]))["source"]) == {"measured here"}


def test_histogram_shares_sum_to_one(run):
    histogram = angle_histogram([run])
    np.testing.assert_allclose(histogram.groupby("method")["share"].sum(), 1)
    assert set(histogram["method"]) == {OURS, "rival"}
    chart = angle_chart(by_model(histogram)["hand"], [OURS, "rival", "lost"])
    assert chart.count("<polyline") == 2


def test_best_is_marked_only_among_whole_valid_quad_meshes():
    rows = [
        {"ok": True, "defects": "", "validity": 1.0, "min_angle": 40.0, "quads": 5.0},
        {"ok": True, "defects": "", "validity": 0.9, "min_angle": 60.0, "quads": 5.0},
        {"ok": False, "defects": "", "validity": 1.0, "min_angle": 70.0, "quads": 5.0},
        {"ok": True, "defects": "", "validity": 1.0, "min_angle": 30.0, "quads": 5.0},
        {"ok": True, "defects": "9 faces are triangles", "validity": 1.0, "min_angle": 80.0, "quads": 5.0},
    ]
    assert best_rows(rows, BY_KEY["min_angle"]) == [True, False, False, False, False]
    assert not any(best_rows(rows, BY_KEY["quads"]))
    assert not any(best_rows(rows[:1], BY_KEY["min_angle"]))


def test_figures_are_printed_with_their_digits_and_missing_ones_as_a_dash():
    assert shown(BY_KEY["quads"], 8201.0) == "8,201"
    assert shown(BY_KEY["validity"], 1.0) == "100.00"
    assert shown(BY_KEY["blocks"], np.nan) == "–"


def test_latex_escapes_and_aligns(run):
    text = latex(table_5(quality_table([run])), "50% & more")
    assert r"50\% \& more" in text
    assert text.count(r"\\") == 7
    assert "Minimum angle" in text


def test_view_is_upright_away_from_the_rim_and_the_same_after_a_turn():
    surface = hemisphere(8)
    view = best_view(surface)
    assert view.up[2] > 0.9
    assert view.direction @ view.up == pytest.approx(0)
    right = np.cross(view.up, view.direction)
    flat = (surface.vertices - view.centre) @ np.c_[right, view.up]
    np.testing.assert_allclose(np.abs(flat).max(axis=0), [view.half_width, view.half_height])
    flat_plate = TriMesh(np.array([(0, 0, 0), (4, 0, 0), (4, 1, 0), (0, 1, 0)], float), [[0, 1, 2], [0, 2, 3]])
    assert np.isfinite(best_view(flat_plate).direction).all()


def test_neighbours_get_different_colours():
    ring = np.array([(k, (k + 1) % 7) for k in range(7)])
    colour = neighbour_colours(7, ring)
    assert (colour[ring[:, 0]] != colour[ring[:, 1]]).all()


def test_each_block_side_is_drawn_once():
    mesh = hemisphere_ogrid(6, 4)
    assert len(block_lines(mesh)) == 12
    assert isinstance(mesh.mesh, QuadMesh)
