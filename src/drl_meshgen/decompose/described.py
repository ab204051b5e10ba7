"""A layout as people read it: every edge and ring with its name, its numbers and what it is linked to."""

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from drl_meshgen.decompose.names import EdgeKind
from drl_meshgen.decompose.stage import DecomposeOptions, Layout, Sizing
from drl_meshgen.partition import Partition
from drl_meshgen.sizing import Sizes


@dataclass(frozen=True)
class NamedEdge:
    """A graph edge or curve of the layout."""

    name: str
    kind: EdgeKind
    count: int
    """Quads along it."""
    wanted: float
    """Count that its length asks for at the spacing of the mesh."""
    length: float
    """Model units."""
    links: tuple[str, ...]
    """Equations that its count must satisfy."""


@dataclass(frozen=True)
class NamedRing:
    """A cell or tube of the layout."""

    name: str
    rows: int
    """Quads across it."""
    columns: tuple[str, ...]
    """Names of the curves it lies at."""


@dataclass(frozen=True)
class Description:
    """All edges and rings, in the order of the count program and of `Pieces.rings`."""

    edges: tuple[NamedEdge, ...]
    rings: tuple[NamedRing, ...]
    spacing: float
    """Edge length that the counts were solved for (model units)."""


def describe(
    partition: Partition, layout: Layout, options: DecomposeOptions, sizes: Sizes | None = None
) -> Description:
    """Name everything in a layout that has a count or rows; `sizes` are the wanted ones (uniform if None)."""
    sizes = sizes or Sizes.of(partition.surface.mesh, layout.spacing)
    sizing = Sizing(partition, layout.pieces, options, sizes, layout.spacing)
    names, n = sizing.names, sizing.n_edges
    counts = np.concatenate([*layout.edge_counts, layout.curve_counts])
    points = partition.surface.mesh.vertices
    own = [length for junction in layout.pieces.junctions for length in junction.lengths.tolist()]
    own += [curve.arc_length(points)[1] for curve in partition.curves]
    wanted = sizing.problem().target
    links = _links(sizing, names.edges)
    edges = tuple(
        NamedEdge(name, kind, int(counts[k]), float(wanted[k]), own[k], tuple(links[k]))
        for k, (name, kind) in enumerate(zip(names.edges, names.kinds, strict=True))
    )
    rows = np.concatenate([*layout.cell_rows, layout.tube_rows]).tolist()
    rings = tuple(
        NamedRing(name, int(r), tuple(dict.fromkeys(names.edges[n + c] for c in curves)))
        for name, r, curves in zip(names.rings, rows, sizing.ring_curves.tolist(), strict=True)
    )
    return Description(edges, rings, layout.spacing)


def _links(sizing: Sizing, names: Sequence[str]) -> list[list[str]]:
    """Equations of each count in words."""
    links: list[list[str]] = [[] for _ in names]
    for a, b in sizing.equal:
        links[a].append(f"= {names[b]}")
        links[b].append(f"= {names[a]}")
    for wide, narrow in sizing.steps:
        links[wide].append(f"= {names[narrow]} + an even number")
        links[narrow].append(f"= {names[wide]} - an even number")
    for total, parts in sizing.sums:
        times = Counter(parts)
        terms = [names[part] if k == 1 else f"{k} {names[part]}" for part, k in times.items()]
        links[total].append(f"= {' + '.join(terms)}")
        for part in times:
            links[part].append(f"in {names[total]}")
    for cap in sizing.parts.caps:
        links[sizing.n_edges + cap.curve].append("even")
    return links
