"""Pictures of surfaces and meshes, off-screen, on white, all of a model from one camera."""

import os
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Float, Int, UInt8
from PIL import Image as Pillow

from drl_meshgen.export import replacing
from drl_meshgen.export.layout import block_sides
from drl_meshgen.mesh import BlockMesh, QuadMesh, TriMesh
from drl_meshgen.quality import QuadShape
from drl_meshgen.report import palette
from drl_meshgen.report.view import View

Image = UInt8[np.ndarray, "h w 3"]
LONG_SIDE = 1000
"""Longer side of a picture, pixels, unless told otherwise."""
MARGIN = 1.06
"""Height of a picture over that of what it shows (ratio)."""
_OVERSAMPLING = 2


def _pyvista() -> Any:
    """Import pyvista for drawing without a display. Its stubs do not know its own methods, hence `Any`."""
    os.environ.setdefault("VTK_DEFAULT_OPENGL_WINDOW", "vtkEGLRenderWindow")
    import pyvista

    return pyvista


class Scene:
    """A white picture being drawn: add surfaces, lines and nodes, then `shoot`."""

    def __init__(self, view: View, long_side: int = LONG_SIDE) -> None:
        self.view = view
        unit = long_side / max(view.half_width, view.half_height)
        self.size = tuple(max(2, round(unit * half)) for half in (view.half_width, view.half_height))
        self._pv = _pyvista()
        self._plotter = self._pv.Plotter(
            off_screen=True, window_size=[_OVERSAMPLING * s for s in self.size], lighting="light kit"
        )
        self._plotter.set_background("white")
        self._plotter.disable_anti_aliasing()  # oversampling does it

    @property
    def radius(self) -> float:
        """Unit of line and node thickness: a two-hundredth of the picture's longer side, in model units."""
        return max(self.view.half_width, self.view.half_height) / 100

    def faces(
        self,
        points: Float[np.ndarray, "n 3"],
        faces: Int[np.ndarray, "m k"],
        colour: str | Float[np.ndarray, "m 3"] = palette.PLAIN,
        *,
        lines: float = 0.0,
        flat: bool = False,
    ) -> None:
        """Add polygons in one colour or one RGB (0..255) per face, with mesh lines of a width in pixels.

        `flat` polygons are drawn without light and shade.
        """
        mesh = self._pv.PolyData.from_regular_faces(points, faces)
        style = {"show_edges": lines > 0, "edge_color": palette.LINE, "line_width": lines * _OVERSAMPLING}
        style |= {"ambient": 0.48, "diffuse": 0.66, "specular": 0.0}
        if flat:
            style["lighting"] = False
        if isinstance(colour, str):
            self._plotter.add_mesh(mesh, color=colour, **style)
        else:
            mesh.cell_data["colour"] = np.asarray(colour, np.uint8)
            self._plotter.add_mesh(mesh, scalars="colour", rgb=True, **style)

    def field(
        self, surface: TriMesh, values: Float[np.ndarray, " v"], colours: Sequence[str], isolines: int = 0
    ) -> None:
        """Add a surface coloured by a value per vertex, with a number of evenly spaced thin isolines."""
        from matplotlib.colors import LinearSegmentedColormap

        mesh = self._pv.PolyData.from_regular_faces(surface.vertices, surface.triangles)
        mesh.point_data["value"] = values
        self._plotter.add_mesh(
            mesh,
            scalars="value",
            cmap=LinearSegmentedColormap.from_list("field", list(colours)),
            show_scalar_bar=False,
            smooth_shading=True,
            split_sharp_edges=False,
            ambient=0.48,
            diffuse=0.66,
            specular=0.0,
        )
        if isolines and np.ptp(values) > 0:
            levels = np.linspace(values.min(), values.max(), isolines + 2)[1:-1]
            thin = mesh.contour(levels, scalars="value").tube(radius=0.1 * self.radius, n_sides=6)
            self._plotter.add_mesh(self._pv.wrap(thin), color=palette.INK, opacity=0.55, ambient=0.6)

    def curves(self, curves: Sequence[Float[np.ndarray, "k 3"]], colour: str, thickness: float = 0.5) -> None:
        """Add polylines as tubes; thickness in units of `radius`."""
        curves = [c for c in curves if len(c) > 1]
        if not curves:
            return
        starts = np.cumsum([0] + [len(c) for c in curves[:-1]])
        cells = np.concatenate([np.r_[len(c), s + np.arange(len(c))] for c, s in zip(curves, starts, strict=True)])
        lines = self._pv.PolyData(np.concatenate(curves), lines=cells)
        tubes = self._pv.wrap(lines.tube(radius=thickness * self.radius, n_sides=10))
        self._plotter.add_mesh(tubes, color=colour, ambient=0.45, specular=0.0)

    def nodes(self, points: Float[np.ndarray, "n 3"], colour: str, thickness: float = 1.3) -> None:
        """Add balls; thickness in units of `radius`."""
        if len(points):
            fine = 20 if len(points) < 200 else 10
            ball = self._pv.Sphere(radius=thickness * self.radius, theta_resolution=fine, phi_resolution=fine)
            self._plotter.add_mesh(
                self._pv.PolyData(np.asarray(points)).glyph(geom=ball, scale=False, orient=False),
                color=colour,
                ambient=0.4,
                smooth_shading=True,
            )

    def shoot(self) -> Image:
        """Draw and return the picture; the scene is used up."""
        view, plotter = self.view, self._plotter
        reach = 10 * max(view.half_width, view.half_height)
        plotter.camera_position = [view.centre + reach * view.direction, view.centre, view.up]
        plotter.enable_parallel_projection()
        plotter.camera.parallel_scale = MARGIN * view.half_height
        plotter.reset_camera_clipping_range()
        picture = np.ascontiguousarray(plotter.screenshot(return_img=True)[..., :3], np.uint8)
        plotter.close()
        return np.asarray(Pillow.fromarray(picture).reduce(_OVERSAMPLING))


def write_png(path: Path, image: Image) -> None:
    """Write a picture, whole or not at all."""
    with replacing(path) as part:
        Pillow.fromarray(image).save(part, compress_level=6)


def block_lines(mesh: BlockMesh) -> list[Float[np.ndarray, "k 3"]]:
    """Return the sides of all blocks as polylines, each once."""
    seen: dict[bytes, np.ndarray] = {}
    for grid in mesh.grids:
        for side in block_sides(grid):
            forward, back = np.ascontiguousarray(side), np.ascontiguousarray(side[::-1])
            seen.setdefault(min(forward.tobytes(), back.tobytes()), side)
    return [mesh.points[side] for side in seen.values()]


def _rgb(colours: Sequence[str]) -> Float[np.ndarray, "n 3"]:
    return np.array([[int(c[k : k + 2], 16) for k in (1, 3, 5)] for c in colours], float)


def _graded(values: Float[np.ndarray, " m"], colours: Sequence[str]) -> Float[np.ndarray, "m 3"]:
    """Colours along a ramp for values in 0..1."""
    stops = np.linspace(0, 1, len(colours))
    return np.stack([np.interp(values, stops, channel) for channel in _rgb(colours).T], axis=1)


def _irregular(scene: Scene, mesh: QuadMesh, thickness: float) -> None:
    valence = mesh.topology.valence
    for value in np.unique(valence[mesh.irregular]).tolist():
        chosen = mesh.irregular & (valence == value)
        scene.nodes(mesh.points[chosen], palette.VALENCE.get(value, palette.VALENCE_OTHER), thickness)


def draw_depth(
    surface: TriMesh,
    depth: Float[np.ndarray, " v"],
    contours: Sequence[Float[np.ndarray, "k 3"]],
    view: View,
    *,
    long_side: int = LONG_SIDE,
) -> Image:
    """Draw the surface coloured by depth, with thin isolines and the contours that cut it."""
    scene = Scene(view, long_side)
    scene.field(surface, depth, palette.DEPTH, isolines=24)
    scene.curves(contours, palette.CONTOUR)
    return scene.shoot()


def draw_regions(
    surface: TriMesh,
    region: Int[np.ndarray, " f"],
    contours: Sequence[Float[np.ndarray, "k 3"]],
    view: View,
    *,
    long_side: int = LONG_SIDE,
) -> Image:
    """Draw the cut surface, one colour per region."""
    scene = Scene(view, long_side)
    t = surface.topology
    pairs = region[t.edge_faces[t.edge_count == 2]]
    colour = palette.neighbour_colours(int(region.max()) + 1, np.unique(pairs, axis=0))
    scene.faces(surface.vertices, surface.triangles, _rgb(palette.PASTELS)[colour[region]])
    scene.curves(contours, palette.INK, 0.35)
    return scene.shoot()


def draw_blocks(mesh: BlockMesh, view: View, *, long_side: int = LONG_SIDE) -> Image:
    """Draw the blocks in colours, mesh lines thin, block edges thick, irregular nodes as balls coloured by valence."""
    scene = Scene(view, long_side)
    t = mesh.mesh.topology
    pairs = mesh.block[t.edge_faces[t.edge_count == 2]]
    colour = palette.neighbour_colours(len(mesh.grids), np.unique(pairs, axis=0))
    scene.faces(mesh.points, mesh.mesh.quads, _rgb(palette.PASTELS)[colour[mesh.block]], lines=0.6)
    scene.curves(block_lines(mesh), palette.INK, 0.32)
    _irregular(scene, mesh.mesh, 1.6)
    return scene.shoot()


def draw_quality(mesh: QuadMesh, shape: QuadShape, view: View, *, long_side: int = LONG_SIDE) -> Image:
    """Draw each quad in the colour of its largest deviation from a right angle."""
    scene = Scene(view, long_side)
    share = np.clip(shape.deviation / palette.DEVIATION_RANGE, 0, 1)
    scene.faces(mesh.points, mesh.quads, _graded(share, palette.DEVIATION), lines=0.5)
    return scene.shoot()


def draw_mesh(
    mesh: QuadMesh, view: View, triangles: Int[np.ndarray, "t 3"] | None = None, *, long_side: int = LONG_SIDE
) -> Image:
    """Draw a mesh of any method alike: mesh lines, irregular nodes by valence, leftover triangles in red."""
    scene = Scene(view, long_side)
    scene.faces(mesh.points, mesh.quads, lines=0.7)
    if triangles is not None and len(triangles):
        scene.faces(mesh.points, triangles, palette.WORST, lines=0.7)
    _irregular(scene, mesh, 1.0)
    return scene.shoot()
