"""Files read through Gmsh: STEP is tessellated finely and welded, MSH is taken as it is."""

import subprocess
import sys

import numpy as np
import pytest

from drl_meshgen.cleanup import CleanupOptions, clean
from drl_meshgen.models import load

MAKE = """
import sys, gmsh
gmsh.initialize()
gmsh.option.setNumber("General.Terminal", 0)
occ = gmsh.model.occ
if "cup" in sys.argv[1]:
    occ.addCylinder(0, 0, 0, 0, 0, 2, 1)
    occ.synchronize()
    top = [f for f in gmsh.model.getEntities(2) if gmsh.model.occ.getCenterOfMass(*f)[2] > 1.9]
    occ.remove(gmsh.model.getEntities(3))
    occ.remove(top)
else:
    occ.addRectangle(0, 0, 0, 10, 10)
    occ.addRectangle(10, 0, 0, 10, 10)
occ.synchronize()
if sys.argv[1].endswith(".msh"):
    gmsh.option.setNumber("Mesh.MshFileVersion", float(sys.argv[2]))
    gmsh.option.setNumber("Mesh.Binary", float(sys.argv[3]))
    gmsh.option.setNumber("Mesh.MeshSizeMax", 0.2)
    gmsh.option.setNumber("Mesh.SecondOrderLinear", 0)
    gmsh.model.mesh.generate(2)
    gmsh.model.mesh.setOrder(int(sys.argv[4]))
gmsh.write(sys.argv[1])
"""


def made(folder, name, *options):
    command = [sys.executable, "-c", MAKE, str(folder / name), *map(str, options)]
    subprocess.run(command, check=True, capture_output=True)
    return folder / name


def cleaned(raw):
    return clean(raw, CleanupOptions(min_triangles=0)).surface


def test_a_cup_in_step_is_one_surface_close_to_the_cylinder(tmp_path, capfd):
    surface = cleaned(load(made(tmp_path, "cup.step")))
    t = surface.topology
    assert (t.components[0], t.euler, len(t.loops)) == (1, 1, 1)
    wall = surface.vertices[surface.vertices[:, 2] > 1e-6]
    np.testing.assert_allclose(np.hypot(wall[:, 0], wall[:, 1]), 1, atol=1e-9)
    middle = surface.corners[(surface.vertices[surface.triangles, 2] > 1e-6).all(axis=1)].mean(axis=1)
    assert 1 - np.hypot(middle[:, 0], middle[:, 1]).min() < 4e-4 * surface.diagonal
    assert surface.area == pytest.approx(5 * np.pi, rel=2e-3)
    assert capfd.readouterr() == ("", "")


def test_faces_that_lie_against_each_other_are_welded(tmp_path):
    surface = cleaned(load(made(tmp_path, "sheets.stp")))
    assert (surface.topology.components[0], surface.topology.euler) == (1, 1)
    assert surface.area == pytest.approx(200)


@pytest.mark.parametrize(("version", "binary", "order"), [(2.2, 0, 1), (2.2, 1, 1), (4.1, 0, 1), (4.1, 1, 2)])
def test_triangles_of_msh_files_are_taken_as_they_are(tmp_path, version, binary, order):
    surface = cleaned(load(made(tmp_path, "cup.msh", version, binary, order)))
    t = surface.topology
    assert (t.components[0], t.euler, len(t.loops)) == (1, 1, 1)
    assert 0.1 < surface.edge_lengths.mean() < 0.2


def test_quads_of_msh_files_are_cut(tmp_path):
    nodes = [f"{3 * j + i + 1} {i} {j} 0" for j in range(2) for i in range(3)]
    elements = ["1 3 2 0 1 1 2 5 4", "2 2 2 0 1 2 3 6", "3 2 2 0 1 2 6 5"]
    text = ["$MeshFormat", "2.2 0 8", "$EndMeshFormat", "$Nodes", "6", *nodes, "$EndNodes", "$Elements", "3", *elements]
    (tmp_path / "strip.msh").write_text("\n".join([*text, "$EndElements", ""]))
    raw = load(tmp_path / "strip.msh")
    assert raw.triangles.shape == (4, 3)
    assert cleaned(raw).area == pytest.approx(2)
