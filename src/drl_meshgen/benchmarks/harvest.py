"""Test-Pipeline, domains that the pipeline hands to templates: `python -m drl_meshgen.benchmarks.harvest --help`.

Three families. *cap*: boundary of a cap in its disk chart, as the subdomain stage fills it, with its corners where the
layout fixes them. *outline*: the same nodes on the surface, seen from where the cap looks flattest; the pipeline fills
charts, these are for variety. *transition*: four-sided patch of a tube that loses columns, in the tube's chart; of
generated models only, with losing columns made free of cost, as the pipeline does not do it by default.
"""

import argparse
import tempfile
import warnings
from collections.abc import Iterator, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
import typer
from jaxtyping import Float, Int

from drl_meshgen.assembly.align import align
from drl_meshgen.assembly.subdomains import CapFill, Subdomains
from drl_meshgen.assembly.transition import TransitionFill
from drl_meshgen.assembly.turn import turned
from drl_meshgen.benchmarks.pool import PoolOptions, run_jobs
from drl_meshgen.benchmarks.templates import PIPELINE
from drl_meshgen.decompose import Layout
from drl_meshgen.errors import InputError, MeshgenError
from drl_meshgen.mesh.topology import Topology
from drl_meshgen.models import MODELS, is_generated
from drl_meshgen.partition import Partition
from drl_meshgen.pipeline import STAGES, MeshOptions
from drl_meshgen.rl.datasets import Sample, write_samples
from drl_meshgen.store import Execution, Store, execute
from drl_meshgen.templates import Domain
from drl_meshgen.templates.mesh import grid_quads

TARGET = 3_000
"""Wanted quads."""
LEAST = 12
"""Fewest boundary nodes of a domain that is kept."""
EACH = 3
"""Domains of a family that are kept of each surface, of different numbers of nodes, the largest first."""

Shape = tuple[str, str, Domain, tuple[int, ...]]
"""Family, provenance, domain and corners."""


def harvested(source: str) -> list[Shape]:
    """Return the domains that one surface gives, largest first; none where the pipeline refuses it."""
    options = MeshOptions().sized(TARGET)
    tapering = replace(options, decompose=replace(options.decompose, transitions=True, transition_cost=0.0))
    runs = [(options, _caps), (tapering, _transitions)][: 2 if is_generated(source) else 1]
    shapes: list[Shape] = []
    with warnings.catch_warnings(), tempfile.TemporaryDirectory() as folder:
        warnings.simplefilter("ignore")
        for own, find in runs:
            try:
                targets = ["partition", "decompose", "subdomain"]
                done = execute(STAGES, own.by_stage(source), targets=targets, store=Store(folder))
            except MeshgenError:
                continue
            shapes += find(Path(source).stem, done)
    shapes.sort(key=lambda shape: (shape[0], -len(shape[2])))
    return shapes


def _caps(name: str, done: Execution) -> Iterator[Shape]:
    """Yield the boundaries of caps in their charts, and as outlines."""
    parts: Partition = done["partition"]
    layout: Layout = done["decompose"]
    placed, corners = turned(layout, align(parts, layout))
    fills: Subdomains = done["subdomain"]
    for k, (cap, one, given) in enumerate(zip(layout.pieces.caps, fills.caps, corners, strict=True)):
        n = len(one.first)
        at = [int(np.nonzero(one.first == node)[0][0]) for node in given]
        yield from _shape("cap", f"{name} {TARGET}, cap {k}", np.array(one.chart[:n]), tuple(sorted(at)))
        places = _on_curve(parts, cap.curve, placed.positions[cap.curve], one)
        yield from _shape("outline", f"{name} {TARGET}, cap {k}", flattened(places), ())


def _on_curve(parts: Partition, curve: int, positions: np.ndarray, fill: CapFill) -> Float[np.ndarray, "n 3"]:
    """Return the boundary nodes of a cap on the surface."""
    vertices = parts.surface.mesh.vertices
    at, _ = parts.curves[curve].arc_length(vertices)
    loop = vertices[np.r_[parts.curves[curve].vertices, parts.curves[curve].vertices[:1]]]
    share = positions[fill.first] % 1.0
    return np.stack([np.interp(share, np.r_[at, 1.0], axis) for axis in loop.T], axis=1)


def flattened(places: Float[np.ndarray, "n 3"]) -> Float[np.ndarray, "n 2"]:
    """Return points in the plane that fits them best; signs are chosen so that the same points give the same."""
    _, _, axes = np.linalg.svd(places - places.mean(axis=0), full_matrices=False)
    flat = (places - places.mean(axis=0)) @ axes[:2].T
    return flat * np.sign((flat**3).sum(axis=0) + 1e-300)


def _transitions(name: str, done: Execution) -> Iterator[Shape]:
    """Yield the patches of C-type transitions in charts that are conformal."""
    layout: Layout = done["decompose"]
    fills: Subdomains = done["subdomain"]
    tubes = fills.rings[len(fills.rings) - len(layout.pieces.tubes) :]
    for k, (tube, one) in enumerate(zip(layout.pieces.tubes, tubes, strict=True)):
        if isinstance(one, TransitionFill):
            rim, corners = patch_rim(one.grids[1:])
            theta, h = one.chart[rim].T
            nodes = np.stack([np.unwrap(theta, period=1.0), h * tube.ring.chart.modulus], axis=1)
            yield from _shape("transition", f"{name} {TARGET}, tube {k}", nodes, corners)


def patch_rim(grids: Sequence[Int[np.ndarray, "ni1 nj1"]]) -> tuple[Int[np.ndarray, " l"], tuple[int, ...]]:
    """Return the boundary nodes of the nine blocks of a C-type patch, from bottom left on, and its corners in them."""
    quads = grid_quads(tuple(grids))
    ahead = dict(Topology(int(quads.max()) + 1, quads).boundary_edges.tolist())
    rim = [int(grids[1][0, 0])]
    while (node := ahead[rim[-1]]) != rim[0]:
        rim.append(node)
    corners = grids[1][0, 0], grids[5][-1, 0], grids[8][-1, -1], grids[6][0, -1]
    return np.array(rim), tuple(rim.index(int(node)) for node in corners)


def _shape(family: str, source: str, nodes: np.ndarray, corners: tuple[int, ...]) -> Iterator[Shape]:
    """Yield the domain of these nodes if it is one, at the scale of the unit disk."""
    try:
        domain = Domain.oriented(nodes)
    except InputError:  # an outline that crosses itself is no domain
        return
    if len(domain) >= LEAST:
        yield family, source, Domain(domain.frame.to_local(domain.nodes)), corners


def thinned(shapes: Sequence[Shape]) -> list[Shape]:
    """Return at most `EACH` shapes of each family, of different numbers of nodes."""
    kept: dict[tuple[str, int], Shape] = {}
    for shape in shapes:
        kept.setdefault((shape[0], len(shape[2])), shape)
    families = list(dict.fromkeys(shape[0] for shape in shapes))
    return [one for family in families for one in [s for (name, _), s in kept.items() if name == family][:EACH]]


def main(arguments: list[str] | None = None) -> int:
    """Harvest every surface and write the set; 1 where a surface gave nothing, else 0."""
    parser = argparse.ArgumentParser(prog="python -m drl_meshgen.benchmarks.harvest", description=__doc__)
    parser.add_argument("--models", type=Path, default=Path("../shared/models"), help="folder that has single")
    parser.add_argument("--only", nargs="+", default=(), metavar="NAME", help="surfaces by name")
    parser.add_argument("--out", type=Path, default=Path("docs/benchmarks/rl"), help="folder of the set")
    parser.add_argument("--workers", type=int, default=PoolOptions.workers, metavar="N", help="processes; 0: cores")
    given = parser.parse_args(arguments)
    sources = [*MODELS, *map(str, sorted((given.models / "single").glob("*.*")))]
    sources = [source for source in sources if not given.only or Path(source).stem in given.only]
    found: dict[int, list[Shape]] = {}
    for ended in run_jobs(harvested, sources, PoolOptions(given.workers)):
        found[ended.index] = thinned(ended.result or [])
        typer.echo(f"{sources[ended.index]}: {len(found[ended.index])} domains {ended.cause} ({ended.seconds:.0f} s)")
    shapes = [shape for k in range(len(sources)) for shape in found[k]]
    shapes.sort(key=lambda shape: shape[0])
    samples = [
        Sample(PIPELINE, k, family, domain, source, corners)
        for k, (family, source, domain, corners) in enumerate(shapes)
    ]
    write_samples(given.out / f"{PIPELINE}.parquet", samples)
    typer.echo(f"{len(samples)} domains")
    return int(any(not found[k] for k in range(len(sources))))


if __name__ == "__main__":
    raise SystemExit(main())
