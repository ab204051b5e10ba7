"""Coarsening within limits: predictions are what comes out, and as little as possible is given up."""

from dataclasses import replace

import numpy as np
import pytest
from typer.testing import CliRunner

from drl_meshgen.assembly import LimitOptions
from drl_meshgen.assembly.limits import predicted_irregular
from drl_meshgen.cleanup import CleanupOptions
from drl_meshgen.cli import app
from drl_meshgen.commands.settings import chosen, read_settings
from drl_meshgen.errors import InputError
from drl_meshgen.export import write_surface_ply
from drl_meshgen.pipeline import STAGES, MeshOptions, coarsened, mesh_surface
from drl_meshgen.store import Stage, execute, memoised
from tests.chains import SURFACES, chain, surface_of


@pytest.mark.parametrize("name", SURFACES)
def test_the_predicted_number_of_irregular_nodes_is_that_of_the_mesh(name):
    done = chain(name)
    assert predicted_irregular(done["partition"], done["decompose"]) == done["quality"].metrics["irregular"]


@pytest.fixture(scope="module")
def limbs(tmp_path_factory):
    path = tmp_path_factory.mktemp("input") / "limbs.ply"
    write_surface_ply(path, surface_of("four limbs"))
    return str(path)


def options(blocks=0, irregular=0):
    given = replace(MeshOptions().sized(700), cleanup=CleanupOptions(min_triangles=0))
    return replace(given, limits=LimitOptions(blocks, irregular))


def counts(limbs, given):
    done = execute(STAGES, given.by_stage(limbs), targets=["decompose", "assembly"])
    caps = len(done["decompose"].pieces.caps)
    return len(done["assembly"].grids), predicted_irregular(done["partition"], done["decompose"]), caps


def test_limits_that_hold_already_change_nothing(limbs):
    blocks, irregular, _ = counts(limbs, options())
    found = coarsened(options(blocks, irregular), limbs)
    assert replace(found, assembly=MeshOptions().assembly) == options()
    assert found.assembly.most_blocks == blocks


def test_limbs_are_left_out_until_the_layout_fits(limbs):
    blocks, irregular, caps = counts(limbs, options())
    fewer = coarsened(options(irregular=irregular - 1), limbs)
    assert fewer.partition.persistence > MeshOptions().partition.persistence
    found = counts(limbs, fewer)
    assert found[1] < irregular
    assert found[2] < caps
    assert counts(limbs, coarsened(options(blocks=blocks - 1), limbs))[0] < blocks


def test_the_search_gives_up_no_more_than_it_must(limbs):
    _, irregular, caps = counts(limbs, options())
    one = counts(limbs, coarsened(options(irregular=irregular - 1), limbs))
    two = counts(limbs, coarsened(options(irregular=one[1] - 1), limbs))
    assert two[1] < one[1] < irregular
    assert two[2] < one[2] < caps


def test_what_cannot_be_is_refused_with_the_fewest_there_can_be(limbs):
    with pytest.raises(InputError, match=r"no layout within 3 irregular nodes \(the fewest found are (\d+)\)") as error:
        coarsened(options(irregular=3), limbs)
    fewest = int(str(error.value).split()[-1].rstrip(")"))
    assert counts(limbs, coarsened(options(irregular=fewest), limbs))[1] == fewest
    result = CliRunner().invoke(app, ["mesh", limbs, "--out", limbs + "-out", "--blocks", "2", "--no-pictures"])
    assert result.exit_code == 3
    assert "no layout within 2 blocks (the fewest found are " in result.stderr
    assert len(result.stderr.splitlines()) == 1


def test_the_library_honours_limits():
    surface = surface_of("two limbs")
    mesh = mesh_surface(surface, replace(options(irregular=10), decompose=MeshOptions().sized(500).decompose))
    assert mesh.mesh.irregular.sum() <= 10


def test_limits_come_from_settings_and_from_the_command_line(tmp_path):
    (tmp_path / "a.toml").write_text("[limits]\nblocks = 40\nirregular = 30\n", "utf-8")
    assert read_settings(tmp_path / "a.toml").limits == LimitOptions(40, 30)
    assert chosen(tmp_path / "a.toml", blocks=20).limits == LimitOptions(20, 30)


def test_a_memoised_stage_runs_again_only_for_other_inputs_or_options():
    ran = []
    stage = Stage(
        "one",
        1,
        (),
        ("before",),
        float,
        lambda i, o: ran.append((i["before"], o)),
        lambda _r, _p: None,
        lambda _p: None,
    )
    known, a, b = memoised(stage), np.zeros(1), np.zeros(1)
    for before, option in ((a, 1.0), (a, 1.0), (b, 1.0), (b, 2.0), (b, 2.0)):
        known.run({"before": before}, option)
    assert [o for _, o in ran] == [1.0, 1.0, 2.0]
