"""What VTK does not tell about PLY files: whether they are complete, and the numbers kept per vertex."""

import re
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

_TYPES = {
    **dict.fromkeys(("char", "int8"), "i1"),
    **dict.fromkeys(("uchar", "uint8"), "u1"),
    **dict.fromkeys(("short", "int16"), "i2"),
    **dict.fromkeys(("ushort", "uint16"), "u2"),
    **dict.fromkeys(("int", "int32"), "i4"),
    **dict.fromkeys(("uint", "uint32"), "u4"),
    **dict.fromkeys(("float", "float32"), "f4"),
    **dict.fromkeys(("double", "float64"), "f8"),
}
_ORDER = {"binary_little_endian": "<", "binary_big_endian": ">"}
_GEOMETRY = ("x", "y", "z", "nx", "ny", "nz")
_LOOKS = ("red", "green", "blue", "alpha", "s", "t", "u", "v", "texture_u", "texture_v")


@dataclass(frozen=True)
class _Element:
    name: str
    count: int
    properties: tuple[tuple[str, ...], ...]
    """`(type, name)` or `(list, type of the length, type, name)`."""

    @property
    def least(self) -> int:
        """Bytes it takes at least: lists of indices have three entries or more."""
        size = 0
        for kind, *more in self.properties:
            size += np.dtype(_TYPES[kind if kind != "list" else more[0]]).itemsize
            size += 3 * np.dtype(_TYPES[more[1]]).itemsize if kind == "list" and "ind" in more[2] else 0
        return self.count * size


@dataclass(frozen=True)
class PlyFile:
    """The header of a PLY file and the bytes after it."""

    order: str
    """`<` or `>` for binary data, empty for text."""
    elements: tuple[_Element, ...]
    body: bytes

    @property
    def complete(self) -> bool:
        """Whether the body can hold what the header promises."""
        if self.order:
            return len(self.body) >= sum(element.least for element in self.elements)
        return len(self.body.split(b"\n")) >= sum(element.count for element in self.elements)

    def vertex_arrays(self) -> dict[str, Float[np.ndarray, " n"]]:
        """One array per number kept at the vertices, without coordinates, normals, colours and texture coordinates.

        Empty where the vertices are not the first element or have lists.
        """
        vertex = self.elements[0] if self.elements else _Element("", 0, ())
        names = [words[-1] for words in vertex.properties]
        wanted = [name for name in names if name not in _GEOMETRY + _LOOKS]
        if vertex.name != "vertex" or not wanted or any(words[0] == "list" for words in vertex.properties):
            return {}
        if self.order:
            kinds = [(words[-1], self.order + _TYPES[words[0]]) for words in vertex.properties]
            rows = np.frombuffer(self.body, np.dtype(kinds), vertex.count)
            return {name: rows[name].astype(np.float64) for name in wanted}
        numbers = np.array(self.body.split(maxsplit=vertex.count * len(names))[: vertex.count * len(names)])
        table = numbers.astype(np.float64).reshape(vertex.count, len(names))
        return {name: table[:, names.index(name)].copy() for name in wanted}


def parse_ply(data: bytes) -> PlyFile | None:
    """Read the header; None where it is damaged."""
    end = re.search(rb"end_header\r?\n", data)
    if not data.startswith(b"ply") or end is None:
        return None
    order, elements = "", []
    for line in data[: end.start()].decode("ascii", "replace").splitlines():
        match line.split():
            case ["format", form, *_]:
                order = _ORDER.get(form, "")
            case ["element", name, count] if count.isdigit():
                elements.append(_Element(name, int(count), ()))
            case ["property", *words] if elements and len(words) == (4 if words[0] == "list" else 2):
                if any(kind not in _TYPES for kind in words[words[0] == "list" : -1]):
                    return None
                last = elements.pop()
                elements.append(_Element(last.name, last.count, (*last.properties, tuple(words))))
            case ["element" | "property", *_]:
                return None
    return PlyFile(order, tuple(elements), data[end.end() :])
