"""Workers of compose.yaml write the same bytes on different processors, as far as one machine can play them."""

import os
import subprocess
import sys
from pathlib import Path

import pytest
import yaml

ROOT = Path(__file__).parents[2]
ENVIRONMENT = yaml.safe_load((ROOT / "compose.yaml").read_text())["services"]["worker"]["environment"]
SETTINGS = {name: ENVIRONMENT[name] for name in ("NPY_DISABLE_CPU_FEATURES", "OPENBLAS_CORETYPE")}
OTHERS = {
    "another BLAS": {"OPENBLAS_CORETYPE": "Zen"},
    "another compiled code": {"NUMBA_CPU_NAME": "haswell", "NUMBA_CPU_FEATURES": ""},
    "another libm": {"GLIBC_TUNABLES": "glibc.cpu.hwcaps=-AVX512F,-AVX512VL,-AVX512BW"},
}
PROCESSOR = Path("/proc/cpuinfo")


def hand(out, environment):
    command = ["mesh", "hand", "--triangles", "5000", "--target-quads", "300", "--no-pictures", "--out", str(out)]
    given = {**os.environ, **SETTINGS, **environment}
    subprocess.run([sys.executable, "-m", "drl_meshgen.cli", *command], env=given, stdout=subprocess.PIPE, check=True)
    return (out / "hand/mesh.vtu").read_bytes()


@pytest.mark.skipif(
    not PROCESSOR.exists() or not {"avx2", "fma"} <= set(PROCESSOR.read_text().split()),
    reason="the settings are for processors with AVX2 and FMA",
)
def test_processors_of_different_kinds_write_the_same_bytes(tmp_path):
    expected = hand(tmp_path / "this one", {})
    differing = [name for name, other in OTHERS.items() if hand(tmp_path / name, other) != expected]
    assert differing == []
