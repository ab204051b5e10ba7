"""Every stage result survives being written and read; what follows cannot tell the difference."""

import dataclasses
import shutil

import numpy as np
import pandas as pd
import pytest
import pyvista as pv

from drl_meshgen.codecs.files import read_grid, write_blocks, write_grid
from drl_meshgen.models.surface import RawSurface
from drl_meshgen.pipeline import STAGES, MeshOptions
from tests.chains import grid
from tests.standins import hemisphere_ogrid
from tests.strategies import flat_disk, limbed_disk

SHAPES = {
    "disk without a contour": lambda: flat_disk(5000),
    "two limbs": lambda: limbed_disk(5000, 2, 2.5, seed=1),
    "plate opened by strips": lambda: grid(60, 45, holes=3),
}


def differences(one, two, where):
    """Yield the places where two results differ: types, dtypes, shapes, bits."""
    if isinstance(one, np.ndarray):
        bits = [(x.dtype, x.shape, np.ascontiguousarray(x).tobytes()) for x in (one, two)]
        if bits[0] != bits[1]:
            yield f"{where}: {bits[0][:2]} {bits[1][:2]}"
    elif isinstance(one, pd.DataFrame):
        if not one.equals(two) or list(one.dtypes) != list(two.dtypes):
            yield where
    elif type(one) is not type(two):
        yield f"{where}: {type(one)} {type(two)}"
    elif dataclasses.is_dataclass(one):
        for field in dataclasses.fields(one):
            yield from differences(getattr(one, field.name), getattr(two, field.name), f"{where}.{field.name}")
    elif isinstance(one, dict):
        yield from differences(list(one), list(two), where)
        yield from differences(list(one.values()), list(two.values()), where)
    elif isinstance(one, (tuple, list)):
        if len(one) != len(two):
            yield f"{where}: {len(one)} {len(two)} items"
        for k, (a, b) in enumerate(zip(one, two, strict=False)):
            yield from differences(a, b, f"{where}[{k}]")
    elif one != two and not (one != one and two != two):  # noqa: PLR0124 - NaN
        yield f"{where}: {one!r} {two!r}"


def content(folder):
    return {path.name: path.read_bytes() for path in sorted(folder.iterdir())}


@dataclasses.dataclass
class Chain:
    """Results of all stages, each twice: as computed, and as computed from what was read back."""

    folder: object
    computed: dict
    reread: dict


@pytest.fixture(scope="module", params=SHAPES)
def chain(request, tmp_path_factory):
    folder = tmp_path_factory.mktemp("stages")
    surface = SHAPES[request.param]()
    raw = RawSurface("limbs", surface.vertices, surface.triangles, {"size": surface.vertices[:, 0]})
    options = MeshOptions().sized(target_quads=400).by_stage("limbs")
    computed, reread = {}, {}
    for stage in STAGES:
        own = options.get(stage.name, stage.options())
        for results, place in ((computed, "computed"), (reread, "reread")):
            result = raw if stage.name == "model" else stage.run({name: results[name] for name in stage.inputs}, own)
            where = folder / place / stage.name
            where.mkdir(parents=True)
            stage.write(result, where)
            results[stage.name] = stage.read(where) if place == "reread" else result
    yield Chain(folder, computed, reread)
    shutil.rmtree(folder)


@pytest.mark.parametrize("stage", STAGES, ids=lambda stage: stage.name)
def test_reading_back_gives_the_same_bits(chain, stage):
    back = stage.read(chain.folder / "computed" / stage.name)
    assert list(differences(chain.computed[stage.name], back, stage.name)) == []


@pytest.mark.parametrize("stage", STAGES, ids=lambda stage: stage.name)
def test_computing_on_from_files_gives_the_same_files(chain, stage):
    one, two = (content(chain.folder / place / stage.name) for place in ("computed", "reread"))
    assert one.keys() == two.keys()
    assert [name for name in one if one[name] != two[name]] == []


@pytest.mark.parametrize("stage", STAGES, ids=lambda stage: stage.name)
def test_meshes_open_in_vtk_and_tables_in_pandas(chain, stage):
    files = sorted((chain.folder / "computed" / stage.name).iterdir())
    assert {path.suffix for path in files} <= {".vtu", ".parquet"}
    assert any(path.suffix == ".vtu" for path in files)
    for path in files:
        if path.suffix == ".vtu":
            assert pv.read(path).n_cells > 0
        else:
            pd.read_parquet(path)


def test_blocks_read_back_as_the_same_node_grids(tmp_path):
    mesh = hemisphere_ogrid(5, 3)
    write_blocks(tmp_path / "m.vtu", mesh.points, mesh.grids)
    back = read_grid(tmp_path / "m.vtu")
    np.testing.assert_array_equal(back.points, mesh.points)
    assert len(back.grids()) == len(mesh.grids)
    for one, two in zip(back.grids(), mesh.grids, strict=True):
        np.testing.assert_array_equal(one, two)


def test_grids_keep_every_float_and_integer(tmp_path):
    points = np.array([[0.1 + 0.2, -0.0, 5e-324], [np.pi, 1e300, np.nan], [1, 2, 3]])
    arrays = {
        "a": np.array([-1, 2**62, 7]),
        "b": np.array([np.inf, np.nan, -0.0]),
        "flag": np.array([True, False, True]),
    }
    write_grid(tmp_path / "g.vtu", points, np.array([[0, 1, 2]]), arrays)
    back = read_grid(tmp_path / "g.vtu")
    assert back.points.tobytes() == points.tobytes()
    assert back.cells.tolist() == [[0, 1, 2]]
    assert back.point["a"].tobytes() == arrays["a"].tobytes()
    assert back.point["b"].tobytes() == arrays["b"].tobytes()
    assert back.point["flag"].astype(bool).tolist() == [True, False, True]
