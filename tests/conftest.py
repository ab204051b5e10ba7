"""What tests of several folders need."""

import os
import subprocess
from pathlib import Path

import pytest


class Disk:
    """A disk of its own, small enough to be filled."""

    def __init__(self, place: Path) -> None:
        self.place = place

    def mount(self, *options: str) -> bool:
        """Mount it, or mount it anew with other options; tell whether that was allowed."""
        command = ["mount", "-t", "tmpfs", "-o", ",".join(options), "tmpfs", str(self.place)]
        return subprocess.run(command, capture_output=True, check=False).returncode == 0

    def change(self, *options: str) -> None:
        assert self.mount("remount", *options)


@pytest.fixture
def small_disk(tmp_path):
    """Return a disk of 300 KB; skipped where nothing can be mounted."""
    own = Disk(tmp_path / "disk")
    own.place.mkdir()
    if os.name != "posix" or os.geteuid() != 0 or not own.mount("size=300k"):
        pytest.skip("needs the right to mount")
    yield own
    subprocess.run(["umount", "-l", str(own.place)], check=True)
