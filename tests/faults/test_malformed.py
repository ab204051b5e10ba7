"""Malformed files: refused in one sentence with exit code 3, or usable after all; never a crash, a hang, a flood.

`MALFORMED=500 python -m pytest tests/faults/test_malformed.py` takes all of them (`make faults`).
"""

import os
import resource
import sys
import time

import pytest

from drl_meshgen.cleanup import CleanupOptions, clean
from drl_meshgen.errors import InputError
from drl_meshgen.models import load
from tests.faults.malformed import CHANGES, FORMATS, malformed

COUNT = int(os.environ.get("MALFORMED", "36"))
STEP = 213
"""Numbers of the files that are taken: far enough apart to be of all kinds; coprime to the number of all."""
ALL = 500
SECONDS = 60.0
MEMORY = 3e9
"""Bytes that a process may hold at most, ours or that of a reader."""


def judged(path):
    """Return what became of a file."""
    sentence = ""
    try:
        clean(load(path), CleanupOptions())
    except InputError as error:
        sentence = str(error)
    assert sentence.isprintable(), "more than one line, or what steers a terminal"
    return "refused" if sentence else "usable"


def peak():
    """Return the most bytes that this process, or any child of it that ended, ever held."""
    return 1024 * max(resource.getrusage(who).ru_maxrss for who in (resource.RUSAGE_SELF, resource.RUSAGE_CHILDREN))


def test_malformed_files_are_refused_or_usable_and_nothing_else(tmp_path, capfd):
    numbers = [STEP * k % ALL for k in range(COUNT)]
    assert len(set(numbers)) == COUNT
    kinds, found = set(), {"refused": 0, "usable": 0}
    slowest, before = 0.0, peak()
    for k in numbers:
        folder = tmp_path / str(k)
        folder.mkdir()
        path, told = malformed(k, folder)
        kinds.add(told.partition(" ")[2])
        begun = time.monotonic()
        try:
            found[judged(path)] += 1
        except Exception as error:
            raise AssertionError(f"{told}: {type(error).__name__}: {error}") from error
        slowest = max(slowest, time.monotonic() - begun)
    assert slowest < SECONDS
    assert peak() < max(MEMORY, 1.5 * before)
    assert found["refused"] > COUNT / 2
    with capfd.disabled():
        sys.stdout.write(
            f"\n{COUNT} files of {len(kinds)} kinds: {found}, {slowest:.1f} s and {peak() / 1e9:.2f} GB at most\n"
        )


def test_there_are_files_of_every_kind():
    assert len(FORMATS) * len(CHANGES) < ALL


@pytest.mark.parametrize("k", range(0, 24, 5))
def test_a_number_stands_for_the_same_file(tmp_path, k):
    (tmp_path / "again").mkdir()
    assert malformed(k, tmp_path)[0].read_bytes() == malformed(k, tmp_path / "again")[0].read_bytes()
