"""Inputs that are no plain files, or are called strangely: exit code 3, one sentence, no waiting."""

import os

import pytest
from typer.testing import CliRunner

from drl_meshgen.cli import app


def refused(path, words, out):
    done = CliRunner().invoke(app, ["mesh", "--out", str(out), "--no-pictures", "--", str(path)])
    assert done.exit_code == 3, done.output
    assert len(done.output.splitlines()) == 1, done.output
    assert words in done.output


MAKE = {
    "pipe.stl": os.mkfifo,
    "device.stl": lambda path: path.symlink_to("/dev/zero"),
    "loop.stl": lambda path: path.symlink_to(path),
    "folder.stl": lambda path: path.mkdir(),
    "hemisphere.stl": lambda path: path.mkdir(),
}


@pytest.mark.parametrize("name", MAKE)
def test_what_is_no_plain_file_is_refused_at_once(tmp_path, name):
    MAKE[name](tmp_path / name)
    refused(tmp_path / name, "no such file" if name == "loop.stl" else "not a plain file", tmp_path / "out")


@pytest.mark.parametrize(
    "name", ["a\nb.stl", "a\rb.ply", "a\x1b[31mb.obj", "-x.off", "--out.vtu", "ä \u202e.vtp", "\udcff.stl"]
)
def test_a_strange_name_stays_one_sentence(tmp_path, name):
    path = tmp_path / name
    path.write_bytes(b"\x00garbage")
    refused(path, ": ", tmp_path / "out")


@pytest.mark.parametrize("name", ["x" * 300 + ".stl", "a\0b.stl", "../" * 50 + "nowhere.stl"])
def test_a_name_that_no_file_can_have_is_refused(tmp_path, name):
    refused(f"{tmp_path}/{name}", ": ", tmp_path / "out")
