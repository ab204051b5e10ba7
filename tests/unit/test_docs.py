"""The documentation tells the truth: its links lead somewhere, its commands parse, its examples run."""

import importlib.util
import re
import shlex
import subprocess
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
import typer
from typer.testing import CliRunner

from drl_meshgen import codecs
from drl_meshgen.benchmarks.examine import Status, failure, row
from drl_meshgen.benchmarks.record import Record
from drl_meshgen.benchmarks.robustness import random_cases, write_tables
from drl_meshgen.cli import EXIT_CODES, app
from drl_meshgen.commands.settings import read_settings
from drl_meshgen.models import MODELS
from drl_meshgen.pipeline import COMPARED_STAGES
from drl_meshgen.quality import measure
from drl_meshgen.rl.plane_metrics import plane_metrics
from drl_meshgen.templates import Domain
from flows.batch import main as batch_main
from flows.mesh import main as mesh_main
from tests.standins import hemisphere, hemisphere_ogrid

ROOT = Path(__file__).resolve().parents[2]
README = (ROOT / "README.md").read_text("utf-8")
PAGES = [
    ROOT / "README.md",
    ROOT / "CHANGELOG.md",
    ROOT / "artifacts/README.md",
    *sorted((ROOT / "docs").rglob("*.md")),
]


def named(path):
    return str(path.relative_to(ROOT))


def blocks(text, language):
    return re.findall(rf"^```{language}\n(.*?)^```$", text, re.MULTILINE | re.DOTALL)


def commands(*starts):
    """Shell commands of all pages, as lists of arguments, that start with these words."""
    texts = [page.read_text("utf-8") for page in PAGES]
    lines = [line for text in texts for block in blocks(text, "sh") for line in block.splitlines()]
    lines += [line for text in texts for line in re.findall(r"`([^`\n]+)`", text) if line.startswith(starts[0] + " ")]
    return [words for line in lines if (words := shlex.split(line, comments=True))[: len(starts)] == list(starts)]


def script(path):
    """Load a script of the documentation as a module."""
    spec = importlib.util.spec_from_file_location(Path(path).stem, ROOT / path)
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def slug(heading):
    return re.sub(r"[^\w\- ]", "", heading.strip().lower()).replace(" ", "-")


@pytest.mark.parametrize("page", PAGES, ids=named)
def test_links_lead_to_files_and_headings_that_exist(page):
    text = re.sub(r"```.*?```", "", page.read_text("utf-8"), flags=re.DOTALL)
    for target in re.findall(r"\]\(([^)\s]+)\)", text):
        if target.startswith(("https://", "http://")):
            continue
        path, _, anchor = target.partition("#")
        file = (page.parent / path).resolve() if path else page
        assert file.exists(), target
        assert ROOT in file.parents, target
        if anchor:
            assert anchor in {slug(h) for h in re.findall(r"^#+ (.*)$", file.read_text("utf-8"), re.MULTILINE)}, target


@pytest.mark.parametrize("page", PAGES, ids=named)
def test_pages_name_no_place_of_one_machine(page):
    assert re.findall(r"(?<![\w.~/-])/(?:home|work|root|tmp|Users|mnt)/", page.read_text("utf-8")) == []


def test_pictures_are_small():
    assert [named(p) for p in (ROOT / "docs/images").iterdir() if p.stat().st_size > 200_000] == []


def test_python_of_the_readme_runs(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    (block,) = blocks(README, "python")
    exec(compile(block, "README.md", "exec"), {})
    assert "quads in" in capsys.readouterr().out
    assert {"mesh.vtu", "layout.vtu", "blocks.parquet", "edges.parquet"} <= {p.name for p in tmp_path.rglob("*")}


def test_the_figures_of_the_readme_are_those_of_their_script():
    figures = script("docs/figures.py")
    written = README.split(figures.MARKS[0])[1].split(figures.MARKS[1])[0]
    assert figures.line(figures.COLUMNS) in written
    wanted = [model for model in MODELS for _ in figures.COUNTS]
    assert re.findall(r"^\| (\w+) \| [\d,]+ \|", written, re.MULTILINE) == wanted


def test_settings_of_the_readme_are_read(tmp_path):
    first, *others = blocks(README, "toml")
    for block in (*others, first):
        (tmp_path / "settings.toml").write_text(block, "utf-8")
        options = read_settings(tmp_path / "settings.toml")
    assert options.decompose.target_quads == 8000


def parser(name):
    return typer.main.get_command(app).commands[name]


def store_parser(name):
    return parser("store").commands[name]


def flow(main):
    alone = typer.Typer()
    alone.command()(main)
    return typer.main.get_command(alone)


def options(parameter):
    return [*parameter.opts, *parameter.secondary_opts]


@pytest.mark.parametrize("words", commands("drl-meshgen"), ids=" ".join)
def test_every_command_of_the_pages_parses(words, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "settings.toml").touch()
    (tmp_path / "layout.toml").touch()
    if len(words) > 2 and words[1] in ("mesh", "layout", "check", "fill"):
        context = parser(words[1]).make_context(words[1], words[2:])
        assert context.params
    if len(words) > 2 and words[1] == "store":
        assert store_parser(words[2]).make_context(words[2], words[3:]).params


@pytest.mark.parametrize("words", [c for c in commands("python", "-m", "flows.mesh") if len(c) > 3], ids=" ".join)
def test_every_command_of_the_flow_parses(words):
    assert flow(mesh_main).make_context("flow", words[3:]).params["surfaces"]


@pytest.mark.parametrize("words", [c for c in commands("python", "-m", "flows.batch") if len(c) > 3], ids=" ".join)
def test_every_command_of_the_batch_parses(words):
    assert flow(batch_main).make_context("batch", words[3:]).params["models"]


def test_every_option_of_the_readme_exists():
    known = {
        o
        for command in (
            *map(parser, ("mesh", "layout", "check", "fill")),
            *parser("store").commands.values(),
            flow(mesh_main),
            flow(batch_main),
        )
        for p in command.params
        for o in options(p)
    }
    foreign = {"--type", "--all", "--pool", "--build"}  # of Prefect and Docker
    assert set(re.findall(r"(?<![\w-])--[a-z][a-z-]+", README)) - known - foreign == set()


def test_the_readme_explains_every_exit_code():
    stated = re.findall(r"\b(\d) [a-z]", EXIT_CODES)
    assert re.findall(r"^\| (\d) \|", README, re.MULTILINE) == stated


def test_the_readme_lists_every_file_that_is_written():
    said = CliRunner().invoke(app, ["mesh", "--help"]).output
    written = re.findall(r"\w+\.(?:vtu|parquet|ply|toml)", said.split("Arguments:")[0])
    assert set(written) - set(re.findall(r"`(?:\w+/)?(\w+\.\w+)`", README)) == set()


def test_the_page_of_metrics_defines_every_metric():
    mesh = hemisphere_ogrid()
    metrics = measure(mesh.mesh, hemisphere(), mesh.block).metrics
    page = (ROOT / "docs/metrics.md").read_text("utf-8")
    cells = {name for row in re.findall(r"^\|([^|]*)\|", page, re.MULTILINE) for name in re.findall(r"`(\w+)`", row)}
    square = Domain([[0, 0], [1, 0], [2, 0], [2, 1], [2, 2], [1, 2], [0, 2], [0, 1]])
    assert cells == set(metrics) | set(plane_metrics(square, square.nodes, np.array([[0, 2, 4, 6]])))


def test_the_page_of_files_has_every_stage_and_every_file():
    page = (ROOT / "docs/files.md").read_text("utf-8")
    found = re.findall(r"^## \d+ `(\w+)`$", page, re.MULTILINE)
    assert [s.name for s in COMPARED_STAGES] == found
    sources = Path(codecs.__file__).parent.glob("*.py")
    written = {name for source in sources for name in re.findall(r'"(\w+\.(?:vtu|parquet))"', source.read_text())}
    assert {name for name in written if f"`{name}`" not in page} == set()


def test_the_page_of_options_is_up_to_date():
    page = (ROOT / "docs/options.md").read_text("utf-8")
    assert page == script("docs/options.py").page(), "run `python docs/options.py`"


def test_the_architecture_page_names_every_stage_and_package():
    page = (ROOT / "docs/architecture.md").read_text("utf-8")
    assert {s.name for s in COMPARED_STAGES} <= set(re.findall(r"`(\w+)`", page))
    packages = {p.parent.name for p in (ROOT / "src/drl_meshgen").glob("*/__init__.py")} - {"rl"}
    assert packages <= set(re.findall(r"`(\w+)`", page))


def test_decisions_are_numbered_without_gaps_and_listed():
    folder = ROOT / "docs/decisions"
    pages = sorted(p.name for p in folder.glob("[0-9]*.md"))
    assert [int(name[:4]) for name in pages] == list(range(1, len(pages) + 1))
    assert re.findall(r"\]\((\d{4}-[\w-]+\.md)\)", (folder / "README.md").read_text("utf-8")) == pages
    for name in pages:
        headings = re.findall(r"^## (.*)$", (folder / name).read_text("utf-8"), re.MULTILINE)
        assert headings == ["Context", "What was measured", "Decision", "Consequences"], name


def test_the_version_of_the_package_has_a_changelog_entry():
    version = re.search(r'^version = "(.*)"$', (ROOT / "pyproject.toml").read_text(), re.MULTILINE)[1]
    assert f"## [{version}]" in (ROOT / "CHANGELOG.md").read_text("utf-8")


@pytest.mark.parametrize("target", sorted(set(re.findall(r"(?:`|^)make ([a-z]+)", README, re.MULTILINE))))
def test_targets_of_make_exist(target):
    done = subprocess.run(["make", "-n", target], cwd=ROOT, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr


def test_gallery_meshes_and_draws_a_model(tmp_path, capsys):
    small = ["hemisphere", "--quads", "120", "--triangles", "5000", "--no-picture", "--out", str(tmp_path)]
    assert (script("docs/gallery/mesh_and_draw.py").main(small) / "mesh.vtu").is_file()
    assert "min_angle" in capsys.readouterr().out


def test_gallery_compares_counts_on_one_flat_metric(capsys):
    table = script("docs/gallery/compare_counts.py").main(["hemisphere", "100", "200", "--triangles", "5000"])
    assert isinstance(table, pd.DataFrame)
    assert table["quads"].is_monotonic_increasing
    assert table["reused stages"].tolist() == [0, 5]
    assert "min_angle" in capsys.readouterr().out


def test_gallery_draws_the_hardest_on_one_sheet_and_shows_it_in_the_summary(tmp_path):
    hardest = script("docs/gallery/hardest.py")
    cases, record = random_cases(range(3, 4)), Record(tmp_path / "rows.jsonl", "code", resume=False)
    record.add(cases[0].key, row(cases[0], {}, failure(Status.FAILED, "as an example")) | {"seconds": 1.0})
    write_tables(tmp_path, cases, record)
    sheet = hardest.main([str(tmp_path), "--count", "1"])
    assert sheet.stat().st_size > 5_000
    assert f"]({sheet.name})" in (tmp_path / "robustness.md").read_text("utf-8")
