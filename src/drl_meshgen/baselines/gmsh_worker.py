"""One Gmsh run on one surface, in a process of its own: `python gmsh_worker.py JOB OUT`.

JOB is an `.npz` with the fields of `Job`; OUT gets `points`, `quads`, `triangles`, `seconds`. Nothing else of the
package is imported.
"""

import math
import signal
import sys
import time
from dataclasses import dataclass

import gmsh
import numpy as np
from jaxtyping import Float, Int

_TRIANGLE, _QUAD, _LINE, _POINT = 2, 3, 1, 15
_QUASI_STRUCTURED, _FRONTAL_QUADS = 11, 8


@dataclass(frozen=True, eq=False)
class Job:
    """What to mesh and how."""

    vertices: Float[np.ndarray, "v 3"]
    triangles: Int[np.ndarray, "f 3"]
    loop: Int[np.ndarray, " n"]
    """Boundary vertices in order; transfinite only."""
    corners: Int[np.ndarray, " 4"]
    """Positions of the four corners in the loop, the first one 0; transfinite only."""
    method: str
    """`quasi-structured`, `blossom`, `blossom-subdivided` or `transfinite`."""
    size: float
    """Target edge length."""
    limit: float
    """Seconds after which the process ends itself, in case nobody is left to end it."""
    split: bool
    """Let Gmsh cut the surface into patches it can parametrise better."""


def _discrete_surface(job: Job) -> None:
    """Add the surface as one discrete entity and let Gmsh find curves and a parametrisation."""
    tag = gmsh.model.addDiscreteEntity(2)
    gmsh.model.mesh.addNodes(2, tag, np.arange(1, len(job.vertices) + 1), job.vertices.ravel())
    gmsh.model.mesh.addElementsByType(tag, _TRIANGLE, [], (job.triangles + 1).ravel())
    gmsh.model.mesh.classifySurfaces(np.pi, True, job.split, np.pi)  # noqa: FBT003 - Gmsh's signature
    gmsh.model.mesh.createGeometry()


def _four_sided_surface(job: Job) -> None:
    """Add the surface with its boundary loop in four curves, and ask for a transfinite mesh."""
    curves = (1, 2, 3, 4)
    for k in curves:
        gmsh.model.addDiscreteEntity(0, k)
    for k in curves:
        gmsh.model.addDiscreteEntity(1, k, [k, k % 4 + 1])
    gmsh.model.addDiscreteEntity(2, 1, list(curves))
    gmsh.model.mesh.addNodes(2, 1, np.arange(1, len(job.vertices) + 1), job.vertices.ravel())
    gmsh.model.mesh.addElementsByType(1, _TRIANGLE, [], (job.triangles + 1).ravel())
    closed = np.r_[job.loop, job.loop[:1]] + 1
    ends = np.r_[job.corners, len(job.loop)]
    length = []
    for k in curves:
        piece = closed[ends[k - 1] : ends[k] + 1]
        gmsh.model.mesh.addElementsByType(k, _POINT, [], piece[:1])
        gmsh.model.mesh.addElementsByType(k, _LINE, [], np.c_[piece[:-1], piece[1:]].ravel())
        length.append(np.linalg.norm(np.diff(job.vertices[piece - 1], axis=0), axis=1).sum())
    gmsh.model.mesh.reclassifyNodes()
    gmsh.model.mesh.createGeometry()
    area = np.linalg.norm(np.cross(*np.diff(job.vertices[job.triangles], axis=1).transpose(1, 0, 2)), axis=1).sum() / 2
    aspect = (length[0] + length[2]) / (length[1] + length[3])
    across = max(1, round(np.sqrt(area * aspect) / job.size))
    along = max(1, round(np.sqrt(area / aspect) / job.size))
    for k in curves:
        gmsh.model.mesh.setTransfiniteCurve(k, 1 + (across if k % 2 else along))
    gmsh.model.mesh.setTransfiniteSurface(1, "Left", list(curves))
    gmsh.model.mesh.setRecombine(2, 1)


def _mesh(job: Job) -> None:
    options = {
        "Mesh.MeshSizeMin": job.size,
        "Mesh.MeshSizeMax": job.size,
        "Mesh.MeshSizeExtendFromBoundary": 0,
        "Mesh.MeshSizeFromPoints": 0,
        "Mesh.Algorithm": _QUASI_STRUCTURED if job.method == "quasi-structured" else _FRONTAL_QUADS,
        "Mesh.RecombineAll": 1,
        "Mesh.RecombinationAlgorithm": 1,
        "Mesh.SubdivisionAlgorithm": 1 if job.method == "blossom-subdivided" else 0,
    }
    for name, value in options.items():
        gmsh.option.setNumber(name, value)
    if job.method == "transfinite":
        _four_sided_surface(job)
    else:
        _discrete_surface(job)
    gmsh.model.mesh.generate(2)


def work(job: Job) -> dict[str, np.ndarray]:
    """Run one job; raises whatever Gmsh raises."""
    gmsh.initialize()
    gmsh.option.setNumber("General.Terminal", 0)
    gmsh.model.add("rival")
    start = time.perf_counter()
    _mesh(job)
    seconds = time.perf_counter() - start
    tags, points = (np.asarray(a) for a in gmsh.model.mesh.getNodes()[:2])
    faces = [np.asarray(gmsh.model.mesh.getElementsByType(kind)[1], np.int64) for kind in (_QUAD, _TRIANGLE)]
    gmsh.finalize()
    used, local = np.unique(np.concatenate(faces), return_inverse=True)
    place = np.zeros(int(max(tags, default=0)) + 1, np.int64)
    place[tags] = np.arange(len(tags))
    return {
        "points": points.reshape(-1, 3)[place[used]],
        "quads": local[: len(faces[0])].reshape(-1, 4),
        "triangles": local[len(faces[0]) :].reshape(-1, 3),
        "seconds": np.array(seconds),
    }


def main() -> None:
    """Read the job, run it, write the mesh."""
    with np.load(sys.argv[1]) as stored:
        job = Job(
            stored["vertices"],
            stored["triangles"],
            stored["loop"],
            stored["corners"],
            str(stored["method"]),
            float(stored["size"]),
            float(stored["limit"]),
            bool(stored["split"]),
        )
    signal.alarm(math.ceil(job.limit) + 5)
    np.savez(sys.argv[2], **work(job))  # pyright: ignore[reportArgumentType]


if __name__ == "__main__":
    main()
