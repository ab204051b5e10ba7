"""Gmsh on one plane domain, in a process of its own: `python gmsh_plane_worker.py JOB OUT`.

JOB is an `.npz` with `nodes (l, 2)`, anti-clockwise, `corners (4,)` ascending nodes for transfinite meshes, `methods`
and `limit` in seconds. OUT is a folder that gets `METHOD.npz` with `points`, `quads`, `triangles`, `seconds` for each
method that ended. Nothing else of the package is imported.
"""

import math
import signal
import sys
import time
from itertools import pairwise
from pathlib import Path

import gmsh
import numpy as np
from jaxtyping import Float, Int

_TRIANGLE, _QUAD = 2, 3
_QUASI_STRUCTURED, _FRONTAL_QUADS = 11, 8


def _outline(nodes: Float[np.ndarray, "l 2"], cells: int) -> None:
    """Add the polygon in curves of two edges each, divided in `cells`: 1 where Gmsh halves the mesh in the end."""
    geo = gmsh.model.geo
    points = [geo.addPoint(float(x), float(y), 0.0) for x, y in nodes]
    points.append(points[0])
    lines = [geo.addPolyline(points[i : i + 3]) for i in range(0, len(nodes), 2)]
    for line in lines:
        geo.mesh.setTransfiniteCurve(line, cells + 1)
    geo.addPlaneSurface([geo.addCurveLoop(lines)], 1)
    geo.synchronize()


def _sides(nodes: Float[np.ndarray, "l 2"], corners: Int[np.ndarray, "4"]) -> None:
    """Add the domain as a four-sided surface; each side one curve with as many cells as edges."""
    geo = gmsh.model.geo
    points = [geo.addPoint(float(x), float(y), 0.0) for x, y in nodes]
    ends = [*corners.tolist(), int(corners[0]) + len(nodes)]
    lines = []
    for a, b in pairwise(ends):
        lines.append(geo.addPolyline([points[i % len(nodes)] for i in range(a, b + 1)]))
        geo.mesh.setTransfiniteCurve(lines[-1], b - a + 1)
    geo.addPlaneSurface([geo.addCurveLoop(lines)], 1)
    geo.mesh.setTransfiniteSurface(1, "Left", [points[i % len(nodes)] for i in ends[:-1]])
    geo.mesh.setRecombine(2, 1)
    geo.synchronize()


def _mesh(method: str, nodes: Float[np.ndarray, "l 2"], corners: Int[np.ndarray, "4"]) -> None:
    size = float(np.linalg.norm(np.roll(nodes, -1, axis=0) - nodes, axis=1).mean())
    settings = {
        "Mesh.Algorithm": _QUASI_STRUCTURED if method == "quasi-structured" else _FRONTAL_QUADS,
        "Mesh.RecombineAll": 1,
        "Mesh.RecombinationAlgorithm": 3 if method == "blossom" else 1,
        "Mesh.MeshSizeMin": 0.0,
        "Mesh.MeshSizeMax": 2 * size if method == "quasi-structured" else size,
    }
    for name, value in settings.items():
        gmsh.option.setNumber(name, value)
    if method == "transfinite":
        _sides(nodes, corners)
    else:
        _outline(nodes, 1 if method == "quasi-structured" else 2)
    gmsh.model.mesh.generate(2)


def work(method: str, nodes: Float[np.ndarray, "l 2"], corners: Int[np.ndarray, "4"]) -> dict[str, np.ndarray]:
    """Mesh the domain by one method; raises whatever Gmsh raises."""
    gmsh.clear()
    gmsh.model.add(method)
    start = time.perf_counter()
    _mesh(method, nodes, corners)
    seconds = time.perf_counter() - start
    tags, points = (np.asarray(a) for a in gmsh.model.mesh.getNodes()[:2])
    faces = [np.asarray(gmsh.model.mesh.getElementsByType(kind)[1], np.int64) for kind in (_QUAD, _TRIANGLE)]
    used, local = np.unique(np.concatenate(faces), return_inverse=True)
    place = np.zeros(int(max(tags, default=0)) + 1, np.int64)
    place[tags] = np.arange(len(tags))
    return {
        "points": points.reshape(-1, 3)[place[used], :2],
        "quads": local[: len(faces[0])].reshape(-1, 4),
        "triangles": local[len(faces[0]) :].reshape(-1, 3),
        "seconds": np.array(seconds),
    }


def main() -> None:
    """Read the job, run every method, write what they make."""
    with np.load(sys.argv[1]) as job:
        nodes, corners, methods = job["nodes"], job["corners"], [str(name) for name in job["methods"]]
        signal.alarm(math.ceil(float(job["limit"])) + 5)
    gmsh.initialize()
    gmsh.option.setNumber("General.Terminal", 0)
    for method in methods:
        np.savez(Path(sys.argv[2], f"{method}.npz"), **work(method, nodes, corners))  # pyright: ignore[reportArgumentType]
    gmsh.finalize()


if __name__ == "__main__":
    main()
