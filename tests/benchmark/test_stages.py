"""Time of the stages that cost most, on the giraffe of 25,000 triangles at 8,000 quads: `make bench`."""

import pytest

from drl_meshgen.pipeline import STAGES, MeshOptions, run

HOT = ("ricci", "partition", "decompose", "subdomain", "smoothing", "quality")
OPTIONS = MeshOptions().sized(target_quads=8000)


@pytest.fixture(scope="module")
def giraffe():
    return run("giraffe", OPTIONS)


@pytest.mark.parametrize("name", HOT)
def test_stage(benchmark, giraffe, name):
    stage = next(stage for stage in STAGES if stage.name == name)
    inputs = {known: giraffe[known] for known in stage.inputs}
    options = OPTIONS.by_stage("giraffe").get(name, stage.options())
    benchmark.pedantic(stage.run, (inputs, options), rounds=3)


def test_all_stages(benchmark):
    benchmark.pedantic(run, ("giraffe", OPTIONS), rounds=2)
