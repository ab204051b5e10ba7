"""Malformed surface files by the number: file `k` is the same wherever and whenever it is made."""

import random
import re
import zlib
from base64 import b64encode
from collections.abc import Callable
from functools import cache
from pathlib import Path
from tempfile import TemporaryDirectory

import gmsh
import pyvista as pv

from drl_meshgen.mesh import TriMesh
from tests.strategies import flat_disk

FORMATS = ("ascii.stl", "binary.stl", "ascii.ply", "binary.ply", "plain.obj", "plain.off", "ascii.vtp", "binary.vtp")
FORMATS += ("ascii.vtu", "binary.vtu", "plain.msh", "plain.step")
NUMBERS = (b"4294967295", b"2147483648", b"2000000000", b"1000000000000", b"-1", b"99999999999999999999999", b"0")
VALUES = (b"nan", b"inf", b"-inf", b"1e400", b"1e308", b"-7", b"999999999", b"0x7f", b"")
NAMES = ("a b", "-rf", "--out", "ä\u202eb", "line\nbreak", "hemisphere", "a" * 200, "..a", "%s%n", "$(id)")


@cache
def sound(kind: str) -> bytes:
    """Return a small file that can be read."""
    mesh = flat_disk(300)
    form, _, suffix = kind.partition(".")
    if suffix == "off":
        return _off(mesh)
    if suffix in ("msh", "step"):
        return _by_gmsh(suffix)
    data = pv.PolyData.from_regular_faces(mesh.vertices, mesh.triangles)
    with TemporaryDirectory() as folder:
        path = Path(folder, f"sound.{suffix}")
        (data.cast_to_unstructured_grid() if suffix == "vtu" else data).save(path, binary=form != "ascii")
        return path.read_bytes()


def _off(mesh: TriMesh) -> bytes:
    points = "".join(f"{x} {y} {z}\n" for x, y, z in mesh.vertices.tolist())
    faces = "".join(f"3 {a} {b} {c}\n" for a, b, c in mesh.triangles.tolist())
    return f"OFF\n{len(mesh.vertices)} {len(mesh.triangles)} 0\n{points}{faces}".encode()


def _by_gmsh(suffix: str) -> bytes:
    gmsh.initialize()
    gmsh.option.setNumber("General.Terminal", 0)
    gmsh.model.occ.addDisk(0, 0, 0, 1, 1)
    gmsh.model.occ.synchronize()
    if suffix == "msh":
        gmsh.model.mesh.generate(2)
    with TemporaryDirectory() as folder:
        path = Path(folder, f"sound.{suffix}")
        gmsh.write(str(path))
        gmsh.finalize()
        return path.read_bytes()


def truncated(content: bytes, chance: random.Random) -> bytes:
    return content[: chance.randrange(len(content))]


def noise(_content: bytes, chance: random.Random) -> bytes:
    return chance.randbytes(chance.randrange(1, 5000))


def noise_after_head(content: bytes, chance: random.Random) -> bytes:
    return content[: chance.randrange(20, 400)] + chance.randbytes(3000)


def bytes_changed(content: bytes, chance: random.Random) -> bytes:
    changed = bytearray(content)
    for _ in range(chance.choice((1, 8, 100))):
        changed[chance.randrange(len(changed))] = chance.randrange(256)
    return bytes(changed)


def bytes_inserted(content: bytes, chance: random.Random) -> bytes:
    at = chance.randrange(len(content))
    return content[:at] + chance.randbytes(chance.choice((1, 4, 40))) + content[at:]


def piece_repeated(content: bytes, chance: random.Random) -> bytes:
    a, b = sorted(chance.randrange(len(content)) for _ in range(2))
    return content[:b] + content[a:b] * chance.choice((1, 3)) + content[b:]


def count_in_head(content: bytes, chance: random.Random) -> bytes:
    """Give a number of the first 1500 bytes another value; of a binary STL its count of triangles."""
    found = list(re.finditer(rb"(?<![\w.])-?\d+(?![\w.])", content[:1500]))
    if not found:
        return content[:80] + chance.choice((b"\xff" * 4, b"\0\0\0\x80", b"\0" * 4)) + content[84:]
    at = chance.choice(found)
    return content[: at.start()] + chance.choice(NUMBERS) + content[at.end() :]


def value_anywhere(content: bytes, chance: random.Random) -> bytes:
    """Give a number anywhere another value: NaN, infinity, an index that is no point."""
    found = list(re.finditer(rb"-?\d+(\.\d+)?(e[-+]?\d+)?", content))
    if not found:
        return truncated(content, chance)
    at = chance.choice(found)
    return content[: at.start()] + chance.choice(VALUES) + content[at.end() :]


def many_values(content: bytes, chance: random.Random) -> bytes:
    for _ in range(30):
        content = value_anywhere(content, chance)
    return content


def bomb(content: bytes, chance: random.Random) -> bytes:
    """Expand to gigabytes, or claim to: compressed blocks, entities of XML, elements within elements."""
    head = b'<?xml version="1.0"?>\n'
    if b"<VTKFile" not in content:
        return count_in_head(content, chance)
    kind = chance.randrange(3)
    if kind == 0:
        levels = b"".join(b'<!ENTITY e%d "%s">' % (k, b"&e%d;" % (k - 1) * 10) for k in range(1, 11))
        body = content.split(b"?>", 1)[1].replace(b"<Piece", b"&e10;<Piece", 1)
        return head + b'<!DOCTYPE x [<!ENTITY e0 "bomb">' + levels + b"]>" + body
    if kind == 1:
        depth = 100_000
        return head + b'<VTKFile type="PolyData">' + b"<Piece>" * depth + b"</Piece>" * depth + b"</VTKFile>"
    block = zlib.compress(bytes(1 << 24))
    sizes = [1000, 1 << 24, 0] + [len(block)] * 1000
    text = b64encode(b"".join(size.to_bytes(4, "little") for size in sizes)) + b64encode(block)
    return re.sub(rb"(<DataArray[^>]*>)[^<]*(</DataArray>)", lambda m: m[1] + text + m[2], content, count=1)


CHANGES: tuple[Callable[[bytes, random.Random], bytes], ...] = (
    truncated,
    noise,
    noise_after_head,
    bytes_changed,
    bytes_inserted,
    piece_repeated,
    count_in_head,
    count_in_head,
    value_anywhere,
    many_values,
    bomb,
)


def malformed(k: int, folder: Path) -> tuple[Path, str]:
    """Write file `k` into a folder and return its path and what was done to it."""
    chance = random.Random(k)
    kind, change = FORMATS[k % len(FORMATS)], CHANGES[k // len(FORMATS) % len(CHANGES)]
    name = chance.choice(NAMES) if k % 5 == 0 else f"file{k}"
    path = folder / f"{name}.{kind.partition('.')[2]}"
    path.write_bytes(change(sound(kind), chance))
    return path, f"{k}: {kind} {change.__name__}"
