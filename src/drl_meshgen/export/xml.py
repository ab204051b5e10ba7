"""VTK's XML files, written by Python: where the disk is full VTK's own writing to a file ends the process."""

from pathlib import Path
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    import pyvista as pv


def write_xml(path: Path, data: "pv.UnstructuredGrid | pv.PolyData") -> None:
    """Write a grid as VTU or a surface as VTP, whatever the suffix, compressed; raises OSError where that fails."""
    from vtkmodules.vtkCommonDataModel import vtkPolyData
    from vtkmodules.vtkIOXML import vtkXMLPolyDataWriter, vtkXMLUnstructuredGridWriter

    writer = vtkXMLPolyDataWriter() if isinstance(data, vtkPolyData) else vtkXMLUnstructuredGridWriter()
    writer.SetInputData(data)
    writer.SetDataModeToBinary()
    writer.WriteToOutputStringOn()
    writer.Write()
    path.write_text(writer.GetOutputString(), "utf-8")
