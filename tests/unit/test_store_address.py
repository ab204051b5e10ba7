"""Addresses of artifacts: what links say and the file server understands."""

import pytest

from drl_meshgen.store import ArtifactRef
from drl_meshgen.store.address import artifact_path, artifact_url, parsed_path

REF = ArtifactRef("report", "a" * 64, {"index.html": "b" * 64, "pictures/hand/blocks.png": "c" * 64})


@pytest.mark.parametrize("output", ["", *REF.outputs])
def test_the_server_understands_every_address_that_is_made(output):
    assert parsed_path(artifact_path(REF, output)) == (REF.stage, REF.key, output)


def test_there_is_no_link_without_a_file_server_and_a_whole_one_with_it(monkeypatch):
    monkeypatch.delenv("DRL_MESHGEN_FILES", raising=False)
    assert artifact_url(REF, "index.html") is None
    monkeypatch.setenv("DRL_MESHGEN_FILES", "http://127.0.0.1:4300/")
    assert artifact_url(REF, "index.html") == f"http://127.0.0.1:4300/artifacts/report/{'a' * 64}/index.html"


def test_an_output_that_the_artifact_has_not_has_no_address():
    with pytest.raises(KeyError):
        artifact_path(REF, "other.html")


KEY = "a" * 64


@pytest.mark.parametrize(
    "path",
    [
        "",
        "/",
        "/artifacts",
        "/artifacts/report",
        f"/artifacts/report/{KEY}",
        f"artifacts/report/{KEY}/x",
        f"//artifacts/report/{KEY}/x",
        f"/artifacts/../report/{KEY}/x",
        f"/artifacts/report/{KEY}/../x",
        f"/artifacts/report/{KEY}/..%2fx",
        f"/artifacts/report/{KEY}/%2e%2e/x",
        f"/artifacts/report/{KEY}/x\0",
        f"/artifacts/report/{KEY}//etc/passwd",
        f"/artifacts/report/{KEY}/.hidden",
        f"/artifacts/report/{KEY}/x\n",
        f"/artifacts/report/{KEY}/a\\..\\x",
        f"/artifacts/Report/{KEY}/x",
        f"/artifacts/report/{KEY[:-1]}/x",
        f"/artifacts/report/{KEY.upper()}/x",
        f"/objects/aa/{KEY}",
    ],
)
def test_nothing_else_is_an_address(path):
    assert parsed_path(path) is None
