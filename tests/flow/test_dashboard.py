"""What is published in the dashboard and what is deployed."""

import ast
import base64
import io
from pathlib import Path

import pytest
import yaml
from PIL import Image

from flows.dashboard import slug, thumbnail

ROOT = Path(__file__).resolve().parents[2]


@pytest.mark.parametrize(
    ("text", "key"), [("giraffe", "giraffe"), ("My Model_2.stl", "my-model-2-stl"), ("é", "surface")]
)
def test_keys_are_made_of_lower_case_letters_digits_and_dashes(text, key):
    assert slug(text) == key


def test_a_thumbnail_is_small_and_keeps_its_proportions(tmp_path):
    Image.effect_noise((1600, 1200), 40).save(tmp_path / "big.png")
    address = thumbnail(tmp_path / "big.png")
    assert len(address) < 120_000
    head, _, content = address.partition(",")
    assert head == "data:image/jpeg;base64"
    assert Image.open(io.BytesIO(base64.b64decode(content))).size == (480, 360)


def test_two_pictures_share_a_thumbnail(tmp_path):
    for name, size in (("a.png", (100, 400)), ("b.png", (300, 300))):
        Image.new("RGB", size).save(tmp_path / name)
    content = base64.b64decode(thumbnail(tmp_path / "a.png", tmp_path / "b.png").partition(",")[2])
    assert Image.open(io.BytesIO(content)).size == (100 + 240, 400)


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
