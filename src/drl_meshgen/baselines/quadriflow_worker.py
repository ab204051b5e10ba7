"""One QuadriFlow run on one surface, in a process of its own: `python quadriflow_worker.py JOB OUT`.

JOB and OUT are the files of `gmsh_worker.py`; of JOB this reads `vertices`, `triangles`, `size`, `limit` and `split`.
Needs pyquadriflow (the extra `bench`). Boundaries are kept, which QuadriFlow does not do unless told to: without, the
mesh ends up to several quads short of the rim. Creases are not marked, as the surfaces have none.
"""

import math
import signal
import sys
import time
from importlib import import_module
from typing import Any

import numpy as np
from jaxtyping import Float, Int

SEED = 0


def work(
    vertices: Float[np.ndarray, "v 3"], triangles: Int[np.ndarray, "f 3"], size: float, *, flow: bool
) -> dict[str, np.ndarray]:
    """Run QuadriFlow at the number of faces that quads of side `size` make; raises what it raises.

    `flow` solves for the integers by minimum-cost flow instead of maximum flow.
    """
    quadriflow: Any = import_module("pyQuadriFlow.pyQuadriFlow")  # an extra, without type stubs
    area = np.linalg.norm(np.cross(*np.diff(vertices[triangles], axis=1).transpose(1, 0, 2)), axis=1).sum() / 2
    sharp, boundary, adaptive, satisfiability = False, True, False, False
    start = time.perf_counter()
    made = quadriflow.pyquadriflow(
        max(4, round(area / size**2)),
        SEED,
        vertices.tolist(),
        triangles.tolist(),
        sharp,
        boundary,
        adaptive,
        satisfiability,
        flow,
    )
    seconds = time.perf_counter() - start
    used, quads = np.unique(np.array(made["faces"], np.int64).reshape(-1, 4), return_inverse=True)
    return {
        "points": np.array(made["vertices"], float).reshape(-1, 3)[used],
        "quads": quads.reshape(-1, 4),
        "triangles": np.zeros((0, 3), np.int64),
        "seconds": np.array(seconds),
    }


def main() -> None:
    """Read the job, run it, write the mesh."""
    with np.load(sys.argv[1]) as stored:
        signal.alarm(math.ceil(float(stored["limit"])) + 5)
        made = work(stored["vertices"], stored["triangles"], float(stored["size"]), flow=bool(stored["split"]))
    np.savez(sys.argv[2], **made)  # pyright: ignore[reportArgumentType]


if __name__ == "__main__":
    main()
