"""Readers in a process of their own, because a bad file can take a native library down."""

import subprocess
import sys
import tempfile
from pathlib import Path

import numpy as np


def read_apart(reader: Path, path: Path, limit: float) -> tuple[int, dict[str, np.ndarray]]:
    """Run `reader`, a script that takes a file and where to put arrays (`.npz`); return its exit code and the arrays.

    The exit code is negative where a signal ended it, and the arrays are empty where it is not 0. Raises TimeoutError
    where it takes more than `limit` seconds.
    """
    with tempfile.TemporaryDirectory() as folder:
        out = Path(folder, "out.npz")
        command = [sys.executable, "-P", str(reader), str(path.absolute()), str(out)]
        try:
            done = subprocess.run(command, capture_output=True, timeout=limit, check=False)  # noqa: S603
        except subprocess.TimeoutExpired:
            raise TimeoutError(f"{path.name} took more than {limit:g} s to read") from None
        if done.returncode or not out.is_file():
            return done.returncode or 1, {}
        with np.load(out) as read:
            return 0, dict(read)
