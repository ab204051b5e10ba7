import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st

from drl_meshgen.ricci import Outcome, RicciOptions, lay_out, solve
from tests.ricci_shapes import bumpy_disk

bumpy_disks = st.builds(
    bumpy_disk, n=st.integers(8, 30), seed=st.integers(0, 1000), height=st.floats(0.0, 1.0, allow_subnormal=False)
)


@settings(max_examples=25, deadline=None, derandomize=True)
@given(surface=bumpy_disks)
def test_any_bumpy_disk_gets_a_flat_metric_and_a_chart(surface):
    result = solve(surface)
    assert result.outcome is Outcome.CONVERGED
    np.testing.assert_allclose(result.history["total_curvature"], 2 * np.pi, atol=1e-10)
    assert (result.history["broken"].iloc[-1]) == 0
    chart = lay_out(result.triangulation)
    assert chart.closing_error < 1e-6
    assert not chart.inverted.any()


@settings(max_examples=15, deadline=None, derandomize=True)
@given(surface=bumpy_disks)
def test_any_bumpy_disk_maps_to_a_circle(surface):
    result = solve(surface, RicciOptions(boundary="disk"))
    assert result.outcome is Outcome.CONVERGED
    np.testing.assert_allclose(result.target.sum(), 2 * np.pi, rtol=1e-12)
