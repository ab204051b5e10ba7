import numpy as np
import pytest

from drl_meshgen.ricci import RicciOptions, solve
from tests.ricci_shapes import bumpy_disk, capsule


@pytest.mark.parametrize("boundary", ["free", "disk"])
def test_newton_converges_quadratically(boundary):
    history = solve(bumpy_disk(80, seed=1, height=0.8), RicciOptions(boundary=boundary, tolerance=1e-12)).history
    error = history["error"].to_numpy()
    error = error[error > 1e-12]
    assert len(error) >= 3
    last = np.log(error[-3:])
    assert (last[2] - last[1]) / (last[1] - last[0]) > 1.7


def test_one_factorisation_serves_all_steps():
    history = solve(bumpy_disk(80, seed=1, height=0.8)).history
    assert history["refactored"].sum() == 1
    assert history["cg_iterations"].max() <= 20


def test_u_on_a_capsule_converges_with_second_order():
    errors = []
    for around in (12, 24, 48):
        surface, exact = capsule(around, length=4.0)
        errors.append(np.abs(solve(surface).u - exact).max())
    assert np.log2(errors[0] / errors[2]) / 2 > 1.8, errors
