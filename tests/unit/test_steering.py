"""Layouts that people steer: names of edges, fixed counts, the layout file and its way back into a mesh."""

import re
import tomllib
from dataclasses import replace

import numpy as np
import pandas as pd
import pytest
import pyvista as pv
from typer.testing import CliRunner

from drl_meshgen.cli import app
from drl_meshgen.commands.layout_file import read_layout, steered
from drl_meshgen.commands.settings import SettingsError, chosen, read_settings, to_toml
from drl_meshgen.decompose import DecomposeOptions, decompose, describe
from drl_meshgen.decompose.conflicts import contradiction
from drl_meshgen.decompose.counts import CountProblem
from drl_meshgen.decompose.names import name_parts
from drl_meshgen.decompose.stage import with_counts
from drl_meshgen.errors import InputError
from drl_meshgen.export import write_surface_ply
from drl_meshgen.pipeline import MeshOptions
from tests.chains import SURFACES, chain, run_on, surface_of
from tests.strategies import limbed_disk, rigidly_moved


def run(*arguments):
    return CliRunner().invoke(app, [str(a) for a in arguments])


def described(name="four limbs", options=None):
    done, options = chain(name), options or DecomposeOptions()
    layout = with_counts(done["partition"], done["decompose"].pieces, options)
    return describe(done["partition"], layout, options)


def numbers(description):
    return {e.name: e.count for e in description.edges} | {r.name: r.rows for r in description.rings}


@pytest.mark.parametrize("name", SURFACES)
def test_every_edge_and_ring_has_a_name_of_its_own(name):
    names = name_parts(chain(name)["partition"], chain(name)["decompose"].pieces)
    both = (*names.edges, *names.rings)
    assert len(set(both)) == len(both)
    assert all(re.fullmatch(r"[a-z0-9-]+", one) for one in both)
    limbs = {one.split("-")[0] for one in names.edges if one.startswith("limb")}
    caps = [region for region in chain(name)["partition"].regions if region.kind.value == "cap"]
    assert len(limbs) == len([cap for cap in caps if not chain(name)["partition"].curves[cap.loops[0]].is_boundary])


def test_names_do_not_depend_on_place_scale_or_wanted_size():
    one = chain("four limbs")
    moved = run_on(rigidly_moved(surface_of("four limbs"), seed=3, scale=50.0), 1500, ["decompose"])
    assert name_parts(one["partition"], one["decompose"].pieces) == name_parts(
        moved["partition"], moved["decompose"].pieces
    )


def test_limbs_are_numbered_from_the_largest_on():
    edges = {edge.name: edge for edge in described().edges}
    rings = [edges[name].length for name in sorted(edges) if re.fullmatch(r"limb\d+-ring1?", name)]
    assert len(rings) == 4
    assert rings[0] > rings[-1]


def test_links_state_equations_that_the_counts_satisfy():
    description = described()
    count = {edge.name: edge.count for edge in description.edges}
    for edge in description.edges:
        for link in edge.links:
            if link == "even":
                assert edge.count % 2 == 0
            elif link.startswith("= "):
                terms = [term.split(" ") for term in link[2:].split(" + ")]
                assert edge.count == sum(int(t[0]) * count[t[1]] if len(t) > 1 else count[t[0]] for t in terms)


def test_a_fixed_count_and_fixed_rows_are_met_exactly():
    before = numbers(described())
    ring, rows = next((n, v) for n, v in before.items() if n.endswith("-rows"))
    edge = "limb2-ring1"
    after = numbers(described(options=DecomposeOptions(fixed=((edge, before[edge] + 4), (ring, rows + 3)))))
    assert (after[edge], after[ring]) == (before[edge] + 4, rows + 3)


def test_former_counts_are_kept_where_nothing_is_fixed():
    before = numbers(described())
    other = DecomposeOptions(target_quads=5000, former=tuple(before.items()))
    assert numbers(described(options=other)) == before


def test_a_changed_count_moves_the_others_only_as_far_as_the_sums_ask():
    before = numbers(described())
    options = DecomposeOptions(former=tuple(before.items()), fixed=(("limb2-ring1", before["limb2-ring1"] + 2),))
    after = numbers(described(options=options))
    changed = {name: after[name] - before[name] for name in before if after[name] != before[name]}
    assert changed["limb2-ring1"] == 2
    # two more nodes around a limb are two more on its junction and on what lies across: no count moves further
    assert max(map(abs, changed.values())) <= 2
    assert all("limb" not in name.split("-")[0] or name.split("-")[0] == "limb2" for name in changed)


def test_the_same_edit_gives_the_same_counts():
    options = DecomposeOptions(former=tuple(numbers(described()).items()), fixed=(("limb1-ring1", 16),))
    assert described(options=options) == described(options=options)


def refusal(*fixed):
    with pytest.raises(InputError) as error:
        described(options=DecomposeOptions(fixed=fixed))
    assert error.value.exit_code == 3
    return str(error.value)


def test_an_odd_count_around_a_cap_is_refused_with_what_would_do():
    assert "limb1-ring1 = 13 must be even; limb1-ring1 = 12 or 14 would do" in refusal(("limb1-ring1", 13))


def test_a_contradiction_names_only_those_that_contradict():
    said = refusal(("limb1-ring1", 12), ("limb2-ring1", 14), ("limb2-ring2", 16))
    assert "limb2-ring1 = 14 and limb2-ring2 = 16 must be equal" in said
    assert "limb1" not in said


def test_a_sum_that_cannot_be_is_written_out():
    # ring r = a + b is even, and equal to s
    names = ("a", "b", "r", "s")
    p = CountProblem(
        np.full(4, 8.0), np.ones(4), np.full(4, 2), ((2, (0, 1)),), ((2, 3),), (3,), fixed=((0, 3), (1, 4))
    )
    assert str(contradiction(p, names)) == (
        "layout: a = 3 and b = 4 cannot be: r, which must be even, is the sum of a and b; b = 3 or 5 would do"
    )
    assert contradiction(replace(p, fixed=((0, 3), (1, 5))), names) is None
    assert "r = 8 and s = 10 must be equal" in str(contradiction(replace(p, fixed=((2, 8), (3, 10))), names))


def test_an_unknown_name_is_answered_by_the_nearest():
    assert "did you mean limb1-ring1?" in refusal(("limb1-rings1", 12))


def test_counts_below_the_least_are_refused():
    assert "limb1-ring1 = 2 is less than 4" in refusal(("limb1-ring1", 2))
    assert "-rows = 0 is less than" in refusal(("limb1-rows", 0))


def test_named_counts_come_back_from_settings_and_from_the_command_line(tmp_path):
    (tmp_path / "a.toml").write_text('[decompose]\nfixed = {"limb1-ring1" = 12, "b" = 3}\n', "utf-8")
    options = read_settings(tmp_path / "a.toml")
    assert options.decompose.fixed == (("limb1-ring1", 12), ("b", 3))
    (tmp_path / "b.toml").write_text(to_toml(options), "utf-8")
    assert read_settings(tmp_path / "b.toml") == options
    assert chosen(tmp_path / "a.toml", ["b=7", "c=1"]).decompose.fixed == (("limb1-ring1", 12), ("b", 7), ("c", 1))
    for text in ("b", "b=x", "=3", "b=-2"):
        with pytest.raises(SettingsError, match="NAME=N"):
            chosen(None, [text])


@pytest.fixture(scope="module")
def limbs(tmp_path_factory):
    path = tmp_path_factory.mktemp("input") / "limbs.ply"
    write_surface_ply(path, limbed_disk(4000, 2, 2.5, seed=1))
    return path


def counts(folder):
    data = tomllib.loads((folder / "layout.toml").read_text("utf-8"))
    return {n: t["count"] for n, t in data["edges"].items()} | {n: t["rows"] for n, t in data["rings"].items()}


@pytest.fixture(scope="module")
def laid(limbs, tmp_path_factory):
    """A layout, the mesh of it, and the store both came from."""
    place = tmp_path_factory.mktemp("laid")
    stored = ("--store", place / "store", "--target-quads", 400)
    assert run("layout", limbs, "--out", place / "layout", *stored).exit_code == 0
    meshed = run("mesh", limbs, "--out", place / "mesh", "--no-pictures", *stored)
    assert meshed.exit_code in (0, 4), meshed.output
    return place


def again(laid, limbs, tmp_path, text):
    """Mesh with an edited layout file."""
    (tmp_path / "layout.toml").write_text(text, "utf-8")
    tail = ("--no-pictures", "--layout", tmp_path / "layout.toml", "--store", laid / "store")
    return run("mesh", limbs, "--out", tmp_path / "out", *tail)


def test_the_layout_is_written_as_text_curves_and_regions(laid):
    folder = laid / "layout/limbs"
    assert {path.name for path in folder.iterdir()} == {"layout.toml", "layout.vtp", "layout.vtu"}
    curves, surface = pv.read(folder / "layout.vtp"), pv.read(folder / "layout.vtu")
    named = counts(folder)
    assert [named[str(n)] for n in curves.cell_data["name"]] == curves.cell_data["count"].tolist()
    assert set(curves.cell_data["kind"]) <= {"contour", "boundary", "spine", "side of a strip", "mouth of a strip"} | {
        "arc between strips"
    }
    lengths = curves.compute_cell_sizes(length=True)["Length"]
    np.testing.assert_allclose(lengths, curves.cell_data["length"], rtol=1e-5)
    assert surface.cell_data["region"].max() >= 3
    assert (laid / "mesh/limbs/layout.toml").read_bytes() == (folder / "layout.toml").read_bytes()


def test_an_unedited_layout_gives_the_same_mesh_and_the_same_counts(laid, limbs, tmp_path):
    result = again(laid, limbs, tmp_path, (laid / "layout/limbs/layout.toml").read_text("utf-8"))
    assert result.exit_code in (0, 4), result.output
    assert (tmp_path / "out/limbs/mesh.vtu").read_bytes() == (laid / "mesh/limbs/mesh.vtu").read_bytes()
    assert counts(tmp_path / "out/limbs") == counts(laid / "layout/limbs")


def test_an_edited_count_is_met_and_irregular_nodes_stay(laid, limbs, tmp_path):
    text = (laid / "layout/limbs/layout.toml").read_text("utf-8")
    before = counts(laid / "layout/limbs")
    text = text.replace(
        f"[edges.limb1-ring1]\ncount = {before['limb1-ring1']}",
        f"[edges.limb1-ring1]\ncount = {before['limb1-ring1'] + 4}",
    )
    text = text.replace(
        f"[rings.limb1-rows]\nrows = {before['limb1-rows']}", f"[rings.limb1-rows]\nrows = {before['limb1-rows'] + 3}"
    )
    result = again(laid, limbs, tmp_path, text)
    assert result.exit_code in (0, 4), result.output
    after = counts(tmp_path / "out/limbs")
    assert after["limb1-ring1"] == after["limb1-ring2"] == before["limb1-ring1"] + 4
    assert after["limb1-rows"] == before["limb1-rows"] + 3
    assert {n: v for n, v in after.items() if n.startswith("limb2")} == {
        n: v for n, v in before.items() if n.startswith("limb2")
    }
    old, new = (pd.read_parquet(p / "limbs/quality.parquet").iloc[0] for p in (laid / "mesh", tmp_path / "out"))
    assert (new.irregular, new.named_blocks) == (old.irregular, old.named_blocks)
    assert new.quads > old.quads
    again_read = read_layout(tmp_path / "out/limbs/layout.toml")
    assert ("limb1-ring1", before["limb1-ring1"] + 4) in again_read.options.decompose.fixed


@pytest.mark.parametrize(
    "edit",
    [
        ("persistence = 1.2", "persistence = 1.3", "was made with other options than it holds"),
        ("[rings.", "[ringed.", "is not a layout file"),
        ("solved = ", "sowed = ", "solved of .* is None"),
        ("content = ", 'content = "0" #', "was made with other options than it holds"),
    ],
)
def test_a_file_that_was_edited_elsewhere_is_refused(laid, limbs, tmp_path, edit):
    old, new, said = edit
    text = (laid / "layout/limbs/layout.toml").read_text("utf-8")
    result = again(laid, limbs, tmp_path, text.replace(old, new))
    assert result.exit_code == 3
    assert re.search(said, result.stderr)
    assert len(result.stderr.splitlines()) == 1
    assert not (tmp_path / "out").exists() or not list((tmp_path / "out").iterdir())


def test_a_stale_file_is_refused_with_one_sentence(laid, limbs, tmp_path):
    other = tmp_path / "limbs.ply"
    write_surface_ply(other, limbed_disk(4000, 2, 2.5, seed=2))
    layout = laid / "layout/limbs/layout.toml"
    for arguments in ((other,), (limbs, "--target-quads", 500), (limbs, "--remesh")):
        result = run("mesh", *arguments, "--out", tmp_path / "out", "--layout", layout)
        assert result.exit_code == 3
        assert "was made" in result.stderr
        assert len(result.stderr.splitlines()) == 1


def test_settings_of_what_follows_the_layout_may_differ(laid, limbs, tmp_path):
    (tmp_path / "a.toml").write_text("[smoothing]\nrelax_sweeps = 1\n", "utf-8")
    layout = laid / "layout/limbs/layout.toml"
    options = steered(chosen(tmp_path / "a.toml"), layout, str(limbs), 0)
    assert options.smoothing.relax_sweeps == 1
    assert options.partition == MeshOptions().partition
    assert dict(options.decompose.former) == counts(laid / "layout/limbs")


def test_fixed_counts_pass_through_the_library():
    done = chain("four limbs")
    layout = decompose(done["partition"], DecomposeOptions(fixed=(("limb1-ring1", 20),)))
    names = name_parts(done["partition"], layout.pieces)
    curve = names.edges.index("limb1-ring1") - sum(map(len, layout.edge_counts))
    assert layout.curve_counts[curve] == 20
