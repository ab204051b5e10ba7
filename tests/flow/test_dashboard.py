"""What is published in the dashboard and what is deployed."""

import ast
import base64
import io
import json
from pathlib import Path

import numpy as np
import pytest
import yaml
from PIL import Image

from drl_meshgen.errors import Place
from drl_meshgen.store import ArtifactRef
from flows.chain import Outcome
from flows.dashboard import BADGES, MOST_ROWS, MOST_SHOWN, Shown, page, row, text
from flows.pictures import LIMIT, badge, jpeg, place_picture, thumbnail
from tasks.progress import artifact_key

ROOT = Path(__file__).resolve().parents[2]


@pytest.mark.parametrize(
    ("text", "key"), [("giraffe", "giraffe"), ("My Model_2.stl", "my-model-2-stl"), ("é", "surface")]
)
def test_keys_are_made_of_lower_case_letters_digits_and_dashes(text, key):
    assert artifact_key(text) == key


FIGURES = {"min_angle": 40.0, "max_angle": 130.0, "irregular": 8.0, "named_blocks": 5.0, "quads": 300.0}
REF = ArtifactRef("smoothing", "a" * 64, {"mesh.vtu": "b" * 64})
RIVAL = {**FIGURES, "min_angle": float("nan"), "cause": "", "defects": "2 faces are triangles"}


def pictures_of(address):
    return base64.b64decode(address.partition(",")[2])


def good(name, pictures=()):
    return Shown(Outcome(name, {"smoothing": REF}), {"drl-meshgen": FIGURES, "Gmsh": RIVAL}, pictures)


def bad(name, code=3):
    return Shown(Outcome(name, {}, f"{name}: is no good", code, "data:image/jpeg;base64,AAAA"))


@pytest.fixture
def drawn(tmp_path):
    path = tmp_path / "a.png"
    Image.new("RGB", (40, 30), "blue").save(path)
    return [("blocks", path), ("quality", path)]


def test_even_a_picture_of_noise_becomes_a_small_jpeg():
    address = jpeg(Image.effect_noise((1600, 1200), 80).convert("RGB"))
    assert address.startswith("data:image/jpeg;base64,")
    assert len(pictures_of(address)) <= LIMIT


def test_pictures_share_a_thumbnail_and_keep_their_proportions(tmp_path):
    for name, size in (("a.png", (100, 400)), ("b.png", (300, 300))):
        Image.new("RGB", size, "red").save(tmp_path / name)
    sheet = Image.open(io.BytesIO(pictures_of(thumbnail([("a", tmp_path / "a.png"), ("b", tmp_path / "b.png")]))))
    columns = np.asarray(sheet.convert("RGB"))[200, :, 1] < 128
    assert (columns[: sheet.width // 2].sum(), columns[sheet.width // 2 :].sum()) == (100, 300)


def test_no_place_no_picture():
    assert place_picture(None) == ""
    assert place_picture(Place(np.zeros((0, 3)), np.eye(3), np.array([[0, 1, 2]]))) == ""
    assert len(pictures_of(place_picture(Place(np.eye(3)[:1], np.eye(3), np.array([[0, 1, 2]]))))) > 1000


def test_the_page_has_a_verdict_for_every_surface_and_says_why_and_where_one_failed():
    written = page("run", [good("one"), bad("two"), bad("three", code=4)])
    assert "**1 passed** · **1 below gate** · **1 failed**" in written
    assert written.count("data:image/svg+xml") == 3
    assert "| one | 40.0° | 130.0° | 8 | 5 | 300 |" in written
    assert "## two: failed\n\ntwo: is no good\n\n![the place on two](data:image/jpeg;base64,AAAA)" in written
    assert written.index("## two: failed") < written.index("## three: below gate")


def test_rivals_stand_beside_ours_with_what_is_to_be_said_of_them(drawn):
    written = page("run", [good("one", drawn)])
    assert "| Gmsh | – | 130.0° | 8 | 5 | 300 |" in written
    assert "- Gmsh: 2 faces are triangles" in written
    assert "![one: blocks, quality](data:image/jpeg" in written


def test_links_need_a_file_server_else_the_folder_is_named(monkeypatch):
    report = ArtifactRef("report", "c" * 64, {"index.html": "d" * 64})
    monkeypatch.delenv("DRL_MESHGEN_FILES", raising=False)
    assert "report in the folder `reports/x`" in page("run", [good("one")], report, "reports/x")
    monkeypatch.setenv("DRL_MESHGEN_FILES", "http://127.0.0.1:4300")
    written = page("run", [good("one")], report, "reports/x")
    assert f"(http://127.0.0.1:4300/artifacts/report/{'c' * 64}/index.html)" in written
    assert f"[mesh](http://127.0.0.1:4300/artifacts/smoothing/{'a' * 64}/)" in written


def test_the_page_of_hundreds_stays_small(drawn):
    written = page("run", [*(good(f"s{k}", drawn) for k in range(200)), *(bad(f"b{k}") for k in range(50))])
    assert written.count("data:image/svg+xml") == 250
    assert 0 < written.count("(data:image/jpeg") <= MOST_SHOWN + 30
    assert f"Pictures of {MOST_SHOWN} of the 200" in written or "of the 200 surfaces that passed" in written
    assert len(written) < 2_000_000


def test_the_page_of_thousands_has_those_that_did_not_pass_and_says_where_the_others_are():
    written = page("run", [*(good(f"s{k}") for k in range(3000)), *(bad(f"b{k}", 4 - k % 2) for k in range(40))])
    assert "**3000 passed** · **20 below gate** · **20 failed**" in written
    assert f"{MOST_ROWS} of 3040 surfaces" in written
    assert written.count("data:image/svg+xml") == MOST_ROWS
    assert all(f"| b{k} |" in written for k in range(40))
    assert len(written) < 300_000


def test_names_and_sentences_cannot_break_the_page():
    name = "a|b<script>`*_[x](y)\n# c"
    assert "\n" not in text(name)
    written = page(name, [bad(name)])
    assert "<script>" not in written
    assert "\n# c" not in written


def test_a_row_of_the_table_is_json_without_nan():
    assert "NaN" not in json.dumps(row(Shown(Outcome("one"), {"drl-meshgen": {"warp": float("nan")}})))
    assert list(row(good("one")))[:2] == ["surface", "verdict"]


def test_white_text_reads_on_every_badge():
    for name, colour in BADGES.items():
        assert name in pictures_of(badge(name, colour)).decode()
        channels = [int(colour[k : k + 2], 16) / 255 for k in (1, 3, 5)]
        linear = [c / 12.92 if c <= 0.04045 else ((c + 0.055) / 1.055) ** 2.4 for c in channels]
        luminance = 0.2126 * linear[0] + 0.7152 * linear[1] + 0.0722 * linear[2]
        assert 1.05 / (luminance + 0.05) >= 3.9


def test_every_deployment_names_a_flow_that_exists_with_parameters_it_takes():
    deployments = yaml.safe_load((ROOT / "prefect.yaml").read_text())["deployments"]
    assert deployments
    for deployment in deployments:
        file, _, name = deployment["entrypoint"].partition(":")
        functions = {n.name: n for n in ast.parse((ROOT / file).read_text()).body if isinstance(n, ast.FunctionDef)}
        arguments = functions[name].args
        taken = {argument.arg for argument in [*arguments.args, *arguments.kwonlyargs]}
        assert set(deployment["parameters"]) <= taken


def test_compose_holds_no_secret_and_every_service_is_watched():
    text = (ROOT / "compose.yaml").read_text()
    assert "${POSTGRES_PASSWORD:?" in text
    services = yaml.safe_load(text)["services"]
    assert {name for name, service in services.items() if "healthcheck" not in service} == {"deploy"}
