"""Surfaces for property tests: random bumpy disks, described by a seed and a few numbers."""

import numpy as np
from hypothesis import strategies as st

from drl_meshgen.cleanup.meshlab import remesh_isotropic
from drl_meshgen.mesh import TriMesh
from drl_meshgen.models.hemisphere import hemisphere


def flat_disk(triangles: int) -> TriMesh:
    """Unit disk in the plane z = 0, normal +z, nearly equilateral triangles."""
    cap = hemisphere(triangles)
    polar = np.arccos(np.clip(cap.vertices[:, 2], -1, 1)) / (np.pi / 2)
    longitude = np.arctan2(cap.vertices[:, 1], cap.vertices[:, 0])
    return TriMesh(np.c_[polar * np.cos(longitude), polar * np.sin(longitude), np.zeros(len(polar))], cap.triangles)


def bumpy_disk(triangles: int = 1000, bumps: int = 3, height: float = 1.0, seed: int = 0) -> TriMesh:
    """Disk with smooth random bumps; `height` above 1 pulls them out to limbs. Flat within 10 % of the rim."""
    rng = np.random.default_rng(seed)
    disk = flat_disk(triangles)
    x, y = disk.vertices[:, 0], disk.vertices[:, 1]
    z = np.zeros(len(x))
    fade = np.clip((1 - np.hypot(x, y)) / 0.3, 0, 1)
    fade = fade * fade * (3 - 2 * fade)
    for _ in range(bumps):
        radius, angle = 0.55 * np.sqrt(rng.uniform()), rng.uniform(0, 2 * np.pi)
        width, tall = rng.uniform(0.15, 0.3), height * rng.uniform(0.4, 1.0)
        z += tall * np.exp(-((x - radius * np.cos(angle)) ** 2 + (y - radius * np.sin(angle)) ** 2) / width**2)
    return TriMesh(np.c_[x, y, fade * z], disk.triangles)


def limbed_disk(triangles: int = 4000, limbs: int = 3, length: float = 2.0, seed: int = 0) -> TriMesh:
    """Unit hemisphere with `limbs` round limbs of up to the given length, evenly triangulated."""
    rng = np.random.default_rng(seed)
    cap = hemisphere(16 * triangles)
    points = cap.vertices.copy()
    turn = rng.uniform(0, 2 * np.pi)
    for k in range(limbs):
        longitude = turn + 2 * np.pi * k / limbs
        axis = np.array([0.8 * np.cos(longitude), 0.8 * np.sin(longitude), 0.6])
        s = np.arccos(np.clip(cap.vertices @ axis, -1, 1)) / 0.5
        near = s < 1
        rise = length * rng.uniform(0.7, 1.0) * (1 - s[near] ** 2) ** 2
        points[near] += rise[:, None] * axis
    mesh = TriMesh(points, cap.triangles)
    edge = np.sqrt(4 / np.sqrt(3) * mesh.area / triangles)
    return TriMesh(*remesh_isotropic(points, cap.triangles, edge))


def rigidly_moved(mesh: TriMesh, seed: int = 0, scale: float = 1.0) -> TriMesh:
    """Random rotation and translation, and a scale."""
    rng = np.random.default_rng(seed)
    q, r = np.linalg.qr(rng.normal(size=(3, 3)))
    q *= np.sign(np.diag(r))
    q[:, 0] *= np.sign(np.linalg.det(q))
    return TriMesh(scale * (mesh.vertices @ q.T + rng.normal(size=3)), mesh.triangles)


def reordered(mesh: TriMesh, seed: int = 0) -> tuple[TriMesh, np.ndarray]:
    """Vertices, triangles and their first corners shuffled, and the old index of each new vertex."""
    rng = np.random.default_rng(seed)
    old = rng.permutation(len(mesh.vertices))
    new = np.argsort(old)
    triangles = new[mesh.triangles][rng.permutation(len(mesh.triangles))]
    turn = (np.arange(3) + rng.integers(0, 3, len(triangles))[:, None]) % 3
    return TriMesh(mesh.vertices[old], np.take_along_axis(triangles, turn, axis=1)), old


@st.composite
def bumpy_disks(draw: st.DrawFn, max_triangles: int = 2000, max_height: float = 1.5) -> TriMesh:
    """Bumpy disks of 200 to `max_triangles` triangles."""
    return bumpy_disk(
        triangles=draw(st.integers(200, max_triangles)),
        bumps=draw(st.integers(0, 4)),
        height=draw(st.floats(0.0, max_height)),
        seed=draw(st.integers(0, 2**16)),
    )


@st.composite
def limbed_disks(draw: st.DrawFn, max_limbs: int = 4) -> TriMesh:
    """Hemispheres with limbs: depth fields with as many tips as limbs."""
    return limbed_disk(limbs=draw(st.integers(1, max_limbs)), seed=draw(st.integers(0, 2**16)))
