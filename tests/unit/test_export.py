import numpy as np
import pandas as pd
import pytest
import pyvista as pv

from drl_meshgen.errors import InputError
from drl_meshgen.export import (
    block_edges,
    block_table,
    read_mesh,
    read_table,
    replacing,
    write_layout,
    write_mesh,
    write_surface_ply,
    write_table,
)
from drl_meshgen.mesh import BlockMesh
from tests.standins import hemisphere, hemisphere_ogrid


def t_junction():
    """Return one block of 4 x 1 quads below two blocks of 2 x 1."""
    points = np.array([(i, j, 0) for j in range(3) for i in range(5)], float)
    ids = np.arange(15).reshape(3, 5).T
    return BlockMesh(points, (ids[:, :2], ids[:3, 1:], ids[2:, 1:]))


def test_mesh_reads_back_as_it_was_written(tmp_path):
    b = hemisphere_ogrid()
    write_mesh(tmp_path / "m.vtu", b)
    mesh, block = read_mesh(tmp_path / "m.vtu")
    np.testing.assert_array_equal(mesh.points, b.points)
    np.testing.assert_array_equal(mesh.quads, b.mesh.quads)
    np.testing.assert_array_equal(block, b.block)


def test_mesh_file_marks_irregular_nodes_by_signed_index(tmp_path):
    write_mesh(tmp_path / "m.vtu", hemisphere_ogrid())
    grid = pv.read(tmp_path / "m.vtu")
    assert np.bincount(-np.asarray(grid.point_data["irregular"])).tolist()[1] == 4
    assert set(grid.cell_data) == {"block", "i", "j"}


def test_layout_has_one_quad_per_block_over_its_corners(tmp_path):
    b = hemisphere_ogrid(8, 6)
    write_layout(tmp_path / "l.vtu", b)
    grid = pv.read(tmp_path / "l.vtu")
    assert grid.n_cells == 5
    assert grid.n_points == 8
    np.testing.assert_array_equal(grid.cell_data["ni"], [8, 6, 6, 6, 6])
    np.testing.assert_allclose(grid.points, b.points[grid.point_data["node"]])


@pytest.mark.parametrize("name", ["m.vtu", "l.vtu", "s.ply", "t.parquet"])
def test_writing_twice_gives_the_same_bytes(tmp_path, name):
    b = hemisphere_ogrid()
    for folder in "ab":
        path = tmp_path / folder / name
        match name:
            case "m.vtu":
                write_mesh(path, b)
            case "l.vtu":
                write_layout(path, b)
            case "s.ply":
                write_surface_ply(path, hemisphere(4))
            case _:
                write_table(path, block_table(b))
    assert (tmp_path / "a" / name).read_bytes() == (tmp_path / "b" / name).read_bytes()


def test_surface_ply_is_read_by_others(tmp_path):
    s = hemisphere(4)
    write_surface_ply(tmp_path / "s.ply", s)
    back = pv.read(tmp_path / "s.ply")
    np.testing.assert_allclose(back.points, s.vertices, atol=1e-7)
    np.testing.assert_array_equal(back.faces.reshape(-1, 4)[:, 1:], s.triangles)


def test_failed_write_leaves_the_old_file_and_nothing_else(tmp_path):
    target = tmp_path / "x.txt"
    target.write_text("old")

    def fail():
        with replacing(target) as part:
            part.write_text("half")
            raise RuntimeError

    with pytest.raises(RuntimeError):
        fail()
    assert target.read_text() == "old"
    assert list(tmp_path.iterdir()) == [target]


def test_table_reads_back(tmp_path):
    table = block_table(hemisphere_ogrid())
    write_table(tmp_path / "t.parquet", table)
    back = read_table(tmp_path / "t.parquet")
    back["neighbours"] = back["neighbours"].map(list)
    pd.testing.assert_frame_equal(back, table, check_dtype=False)


def test_block_edges_of_an_o_grid_are_eight_interfaces_and_four_boundary_edges():
    edges = block_edges(hemisphere_ogrid(8, 6))
    assert edges["kind"].value_counts().to_dict() == {"interface": 8, "boundary": 4}
    assert sorted(edges["nodes"].unique()) == [7, 9]


def test_side_facing_two_blocks_gives_two_edges():
    edges = block_edges(t_junction())
    inner = edges[edges["kind"] == "interface"]
    assert inner[["block", "across", "nodes"]].to_numpy().tolist() == [[0, 2, 3], [0, 1, 3], [1, 2, 2]]
    assert block_table(t_junction())["neighbours"].tolist() == [[1, 2], [0, 2], [0, 1]]


def test_every_edge_of_a_block_rim_is_counted_once():
    b = hemisphere_ogrid(5, 3)
    edges = block_edges(b)
    weight = np.where(edges["kind"] == "interface", 2, 1)
    rim = sum(2 * (g.shape[0] + g.shape[1] - 2) for g in b.grids)
    assert ((edges["nodes"] - 1) * weight).sum() == rim


def test_reading_what_is_not_a_quad_mesh_names_file_and_defect(tmp_path):
    write_surface_ply(tmp_path / "s.ply", hemisphere(4))
    with pytest.raises(InputError, match=r"s\.ply: 160 of 160 cells are not quadrilaterals"):
        read_mesh(tmp_path / "s.ply")
    with pytest.raises(InputError, match="no such file"):
        read_mesh(tmp_path / "none.vtu")
    (tmp_path / "x.nonsense").write_text("hello")
    with pytest.raises(InputError, match="cannot be read"):
        read_mesh(tmp_path / "x.nonsense")
