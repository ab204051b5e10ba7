import numpy as np
import pandas as pd
import pytest
from typer.testing import CliRunner

from drl_meshgen.cli import app
from drl_meshgen.errors import InputError
from drl_meshgen.rl import DataSet, samples_of
from drl_meshgen.rl.policies import policy_named
from drl_meshgen.rl.template_type import Template, four_sides, template_for
from drl_meshgen.templates import CParameters, CSides, Domain, OParameters, RulePolicy


def four_sided(bottom, side, top, *, narrow=0.6, height=0.8):
    corners = np.array([[0, 0], [1, 0], [0.5 + narrow / 2, height], [0.5 - narrow / 2, height]])
    cells, ends = (bottom, side, top, side), np.roll(corners, -1, axis=0)
    parts = [a + (b - a) * np.arange(n)[:, None] / n for a, b, n in zip(corners, ends, cells, strict=True)]
    return np.concatenate(parts)


def test_a_trapezoid_has_one_way_to_be_four_sided():
    assert four_sides(Domain(four_sided(20, 12, 12))) == [(0, CSides(20, 12, 12))]
    assert four_sides(Domain(np.roll(four_sided(20, 12, 12), 5, axis=0))) == [(5, CSides(20, 12, 12))]


@pytest.mark.parametrize("cells", [(12, 12, 12), (12, 12, 20)])
def test_sides_across_must_differ_and_the_longer_is_the_bottom(cells):
    found = four_sides(Domain(four_sided(*cells)))
    assert [sides for _, sides in found] == [CSides(20, 12, 12)] * (cells[2] == 20)


@pytest.mark.parametrize("policy", ["agent", "rule"])
def test_a_trapezoid_gets_the_c_type_and_a_smooth_domain_the_o_type(policy):
    chooser = policy_named(policy)
    assert isinstance(template_for(chooser, Domain(four_sided(20, 12, 12))), CParameters)
    (sample,) = samples_of(DataSet.TEST_STANDARD, [1])
    assert isinstance(template_for(chooser, sample.domain), OParameters)


def test_the_type_can_be_asked_for():
    trapezoid = Domain(four_sided(20, 12, 12))
    assert isinstance(template_for(RulePolicy(), trapezoid, Template.O_TYPE), OParameters)
    assert isinstance(template_for(RulePolicy(), trapezoid, Template.C_TYPE), CParameters)
    with pytest.raises(InputError, match="has no four corners"):
        template_for(RulePolicy(), Domain(four_sided(12, 12, 12)), Template.C_TYPE)


def test_the_command_writes_the_c_type_mesh_and_its_parameters(tmp_path):
    pd.DataFrame(four_sided(20, 12, 12), columns=["x", "y"]).to_csv(tmp_path / "a.csv", index=False)
    result = CliRunner().invoke(app, ["fill", str(tmp_path / "a.csv"), "--out", str(tmp_path / "out")])
    assert result.exit_code == 0, result.output
    row = pd.read_parquet(tmp_path / "out/parameters.parquet").iloc[0]
    assert (row["template"], row["start"], row["p"], row["q0"] + row["n"] + row["q1"]) == ("C", 0, 4, 12)
    assert (tmp_path / "out/mesh.png").stat().st_size > 5_000
