"""The pipeline: every stage from a surface to its block-structured mesh, in order.

`STAGES` is the one list that the library call, the command line and the Prefect flow run; where rivals are wanted,
`COMPARED_STAGES`, which has one more.
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from functools import wraps
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Float, Int
from threadpoolctl import threadpool_limits

from drl_meshgen import codecs
from drl_meshgen.assembly import AssemblyOptions, LimitOptions, SubdomainOptions, assemble, fill, within
from drl_meshgen.baselines import Comparison, RivalOptions, compare
from drl_meshgen.choice import choose
from drl_meshgen.cleanup import CleanupOptions, CleanupResult, clean
from drl_meshgen.decompose import DecomposeOptions, Layout
from drl_meshgen.decompose.zones import held
from drl_meshgen.errors import MeshgenError, Place
from drl_meshgen.lift.inverse import LiftedMesh, inverse_map
from drl_meshgen.mesh import BlockMesh, TriMesh
from drl_meshgen.models import RawSurface, existing_file, is_generated, load
from drl_meshgen.partition import PartitionOptions, partition
from drl_meshgen.quality import Quality, measure
from drl_meshgen.ricci import RicciOptions, solve
from drl_meshgen.rl.policies import policy_identity, policy_named
from drl_meshgen.seams import OpenedSurface, SeamOptions, open_surface
from drl_meshgen.sizing import SizeOptions, size_field
from drl_meshgen.smoothing import SmoothingOptions, optimise_along
from drl_meshgen.smoothing.final import FinalMesh
from drl_meshgen.store import Execution, Progress, Stage, Store, execute, memoised
from drl_meshgen.store.canonical import digest, file_digest


@dataclass(frozen=True)
class ModelOptions:
    """Which surface is meshed."""

    source: str = ""
    """Name of a generated model or path of a file."""
    triangles: int = 25_000
    """Size of a generated model (count); files are taken as they are."""
    seed: int = 0
    """Seed of the run; it is recorded beside the model and changes nothing."""


@dataclass(frozen=True)
class NoOptions:
    """A stage without choices."""


@dataclass(frozen=True)
class MeshOptions:
    """All options of a run; each field belongs to the stage of its name."""

    cleanup: CleanupOptions = field(default_factory=CleanupOptions)
    seams: SeamOptions = field(default_factory=SeamOptions)
    ricci: RicciOptions = field(default_factory=RicciOptions)
    partition: PartitionOptions = field(default_factory=PartitionOptions)
    sizing: SizeOptions = field(default_factory=SizeOptions)
    decompose: DecomposeOptions = field(default_factory=DecomposeOptions)
    subdomain: SubdomainOptions = field(default_factory=SubdomainOptions)
    assembly: AssemblyOptions = field(default_factory=AssemblyOptions)
    smoothing: SmoothingOptions = field(default_factory=SmoothingOptions)
    comparison: RivalOptions = field(default_factory=RivalOptions)
    limits: LimitOptions = field(default_factory=LimitOptions)
    seed: int = 0
    """Seed of whatever is random; no stage is at present, so it changes nothing but what is recorded."""

    def sized(self, target_quads: int | None = None, target_edge: float | None = None) -> "MeshOptions":
        """Return these options with another size of the mesh; None leaves it as it is.

        A number of quads takes the place of an edge length that was set before.
        """
        size = {} if target_quads is None else {"target_quads": target_quads, "target_edge": 0.0}
        size |= {} if target_edge is None else {"target_edge": target_edge}
        return replace(self, decompose=replace(self.decompose, **size))

    def fast(self) -> "MeshOptions":
        """Return these options with less effort: about half the time for somewhat worse quads (decision 0012)."""
        decompose = replace(self.decompose, exponents=self.decompose.exponents[:1], candidates=1)
        return replace(self, decompose=decompose, smoothing=self.smoothing.fast())

    def by_stage(
        self, source: str, triangles: int = ModelOptions.triangles, *, compare: bool = False
    ) -> dict[str, object]:
        """Options of every stage that has any, for a run on `source`; of the comparison only where asked for."""
        rivals: dict[str, object] = {"comparison": self.comparison} if compare else {}
        return rivals | {
            "model": ModelOptions(source, triangles, self.seed),
            "cleanup": self.cleanup,
            "seams": self.seams,
            "ricci": self.ricci,
            "partition": replace(
                self.partition, target_quads=self.decompose.target_quads, target_edge=self.decompose.target_edge
            ),
            "sizing": self.sizing,
            "decompose": self.decompose,
            "subdomain": self.subdomain,
            "assembly": self.assembly,
            "smoothing": replace(self.smoothing, zones=self.decompose.zones),
        }


def _one_thread(run: Callable[[Mapping[str, Any], Any], Any]) -> Callable[[Mapping[str, Any], Any], Any]:
    """Run with single-threaded BLAS: sums in one order, so the same input gives the same bytes; small solves fly."""

    @wraps(run)
    def limited(inputs: Mapping[str, Any], options: Any) -> Any:
        with threadpool_limits(1):
            return run(inputs, options)

    return limited


def _placed(run: Callable[[Mapping[str, Any], Any], Any]) -> Callable[[Mapping[str, Any], Any], Any]:
    """Tell an error that knows points of a surface what surface that is: the last one the stage was given."""

    @wraps(run)
    def told(inputs: Mapping[str, Any], options: Any) -> Any:
        try:
            return run(inputs, options)
        except MeshgenError as error:
            if error.where is not None and error.place is None:
                error.place = Place(error.where, *_given_surface(inputs))
            raise

    return told


def _given_surface(inputs: Mapping[str, Any]) -> tuple[Float[np.ndarray, "v 3"], Int[np.ndarray, "t 3"]]:
    if "model" in inputs:
        return inputs["model"].points, inputs["model"].triangles
    if "cleanup" in inputs:
        surface = inputs["cleanup"].surface
    else:
        surface = inputs["partition"].surface.mesh if "partition" in inputs else inputs["seams"].mesh
    return surface.vertices, surface.triangles


def _model_identity(options: ModelOptions) -> dict[str, object]:
    if is_generated(options.source):
        return {"type": ModelOptions.__qualname__, "source": options.source, "triangles": options.triangles}
    path = existing_file(options.source)
    return {"name": path.name, "content": file_digest(path)}


def content_of(options: ModelOptions) -> str:
    """Return the digest of a surface as it comes in, whatever its file is called.

    Raises `InputError` where there is no such file and OSError where it cannot be read.
    """
    identity = _model_identity(options)
    return str(identity.get("content") or digest(identity))


def _read_model(_inputs: Mapping[str, Any], options: ModelOptions) -> RawSurface:
    """Build a model by name or read a surface from a file."""
    return load(options.source, options.triangles)


def _cleanup(inputs: Mapping[str, Any], options: CleanupOptions) -> Any:
    """Make one oriented manifold surface and list what was changed."""
    return clean(inputs["model"], options)


def _seams(inputs: Mapping[str, Any], options: SeamOptions) -> OpenedSurface:
    """Cut handles and closed surfaces open, so that every component has genus 0 and a boundary."""
    return open_surface(inputs["cleanup"].surface, options)


def _ricci(inputs: Mapping[str, Any], options: RicciOptions) -> Any:
    """Find the flat metric in the surface's conformal class by Newton's method on the discrete Ricci energy."""
    return solve(inputs["seams"].mesh, options)


def _partition(inputs: Mapping[str, Any], options: PartitionOptions) -> Any:
    """Cut the surface along isocontours of the depth into caps, tubes and junctions."""
    opened: OpenedSurface = inputs["seams"]
    size = None
    if options.target_edge or options.target_quads:
        spacing = options.target_edge or float(np.sqrt(opened.mesh.area / options.target_quads))
        size = inputs["sizing"].at(spacing).at(opened.mesh.vertices)
    return partition(opened.mesh, inputs["ricci"].u, options, opened.seams, size)


def _sizing(inputs: Mapping[str, Any], options: SizeOptions) -> Any:
    """Say how large quads should be where, relative to the global spacing or by the user's word."""
    cleaned: CleanupResult = inputs["cleanup"]
    return size_field(cleaned.surface, options, cleaned.point_data.get("size"), inputs["seams"].loops)


def _decompose(inputs: Mapping[str, Any], options: DecomposeOptions) -> Any:
    """Open junctions in the way that promises the best quads, chart every piece and solve the node counts."""
    return choose(inputs["partition"], inputs["sizing"], options)


def _subdomain(inputs: Mapping[str, Any], options: SubdomainOptions) -> Any:
    """Place the nodes of every piece in its chart; caps by the O-type template, with parameters from a policy."""
    layout: Layout = inputs["decompose"]
    policy = policy_named(options.policy)
    return fill(inputs["partition"], layout, policy, inputs["sizing"].at(layout.spacing))


def _policy_identity(options: SubdomainOptions) -> object:
    return {"policy": policy_identity(options.policy)}


def _assembly(inputs: Mapping[str, Any], options: AssemblyOptions) -> Any:
    """Weld the pieces by node ids and cut them into structured blocks."""
    return assemble(inputs["decompose"], inputs["subdomain"], options)


def _lift(inputs: Mapping[str, Any], _options: NoOptions) -> LiftedMesh:
    """Map all nodes from their charts to the surface."""
    return inverse_map(inputs["cleanup"].surface, inputs["decompose"], inputs["assembly"])


def _smoothing(inputs: Mapping[str, Any], options: SmoothingOptions) -> FinalMesh:
    """Optimise node positions on the surface, with mesh lines on sharp curves where there are any."""
    lifted: LiftedMesh = inputs["lift"]
    sizes = inputs["sizing"].at(inputs["decompose"].spacing)
    wanted = None if sizes.uniform else sizes.size
    mesh, fixed = lifted.mesh.mesh, None
    if options.zones:
        fixed = mesh.irregular.copy()
        fixed[fixed] = held(mesh.points[mesh.irregular], options.zones)
    along = optimise_along(
        inputs["cleanup"].surface, mesh, lifted.triangle, inputs["seams"].features, options, fixed=fixed, sizes=wanted
    )
    return FinalMesh(lifted.mesh.moved(along.smoothing.points), along.smoothing, along.share, along.deviation)


def _quality(inputs: Mapping[str, Any], _options: NoOptions) -> Quality:
    """Measure the finished mesh against the surface."""
    mesh: BlockMesh = inputs["smoothing"].mesh
    return measure(mesh.mesh, inputs["cleanup"].surface, mesh.block)


def _comparison(inputs: Mapping[str, Any], options: RivalOptions) -> Comparison:
    """Run other meshers on the same surface at the same number of quads."""
    return compare(inputs["cleanup"].surface, len(inputs["smoothing"].mesh.mesh.quads), options)


def _seconds(result: Comparison) -> Mapping[str, float]:
    return result.seconds


def _stage(
    run: Callable[[Mapping[str, Any], Any], Any],
    inputs: tuple[str, ...],
    modules: tuple[str, ...],
    codec: codecs.Codec,
    options: type = NoOptions,
    **more: Any,
) -> Stage[Any, Any]:
    own = (codec.module, *modules)
    name = run.__name__.lstrip("_").removeprefix("read_")
    return Stage(name, 1, own, inputs, options, _placed(_one_thread(run)), codec.write, codec.read, **more)


STAGES: tuple[Stage[Any, Any], ...] = (
    _stage(_read_model, (), ("drl_meshgen.models",), codecs.MODEL, ModelOptions, identity=_model_identity),
    _stage(_cleanup, ("model",), ("drl_meshgen.cleanup",), codecs.CLEANUP, CleanupOptions),
    _stage(_seams, ("cleanup",), ("drl_meshgen.seams",), codecs.SEAMS, SeamOptions),
    _stage(_ricci, ("seams",), ("drl_meshgen.ricci",), codecs.RICCI, RicciOptions),
    _stage(_sizing, ("cleanup", "seams"), ("drl_meshgen.sizing",), codecs.SIZING, SizeOptions),
    _stage(_partition, ("seams", "ricci", "sizing"), ("drl_meshgen.partition",), codecs.PARTITION, PartitionOptions),
    _stage(_decompose, ("partition", "sizing"), ("drl_meshgen.choice",), codecs.LAYOUT, DecomposeOptions),
    _stage(
        _subdomain,
        ("partition", "sizing", "decompose"),
        ("drl_meshgen.assembly", "drl_meshgen.rl.policies"),
        codecs.SUBDOMAINS,
        SubdomainOptions,
        identity=_policy_identity,
    ),
    _stage(_assembly, ("decompose", "subdomain"), ("drl_meshgen.assembly",), codecs.ASSEMBLY, AssemblyOptions),
    _stage(_lift, ("cleanup", "decompose", "assembly"), ("drl_meshgen.lift",), codecs.LIFTED),
    _stage(
        _smoothing,
        ("cleanup", "seams", "sizing", "decompose", "lift"),
        ("drl_meshgen.smoothing",),
        codecs.FINAL,
        SmoothingOptions,
    ),
    _stage(_quality, ("cleanup", "smoothing"), ("drl_meshgen.quality",), codecs.QUALITY),
)
COMPARED_STAGES: tuple[Stage[Any, Any], ...] = (
    *STAGES,
    _stage(
        _comparison,
        ("cleanup", "smoothing"),
        ("drl_meshgen.baselines",),
        codecs.COMPARISON,
        RivalOptions,
        parts=_seconds,
    ),
)


#: Stages with options that decide on the layout; what comes after only fills it.
LAYOUT_STAGES = ("cleanup", "seams", "ricci", "sizing", "partition", "decompose")


def coarsened(
    options: MeshOptions,
    source: str,
    triangles: int = ModelOptions.triangles,
    *,
    stages: tuple[Stage[Any, Any], ...] = STAGES,
) -> MeshOptions:
    """Return options without limits under which the layout of a surface is within those that `options` set.

    Nothing changes where there are none. The search (see `within`) runs in memory. Raises `InputError` where there is
    no such layout.
    """
    if not options.limits:
        return options
    known = tuple(memoised(stage) for stage in stages)
    if options.limits.blocks:  # patches with 1-to-1 interfaces where they are few enough, else bands
        most = min(options.assembly.most_blocks, options.limits.blocks)
        options = replace(options, assembly=replace(options.assembly, most_blocks=most))

    def lay(own: PartitionOptions, opening: DecomposeOptions, stage: str) -> Any:
        given = replace(options, partition=own, decompose=opening)
        return execute(known, given.by_stage(source, triangles), targets=[stage])[stage]

    name = source if is_generated(source) else Path(source).name
    own, opening = within(lay, (options.partition, options.decompose), options.limits, name)
    return replace(options, partition=own, decompose=opening, limits=LimitOptions())


def run(
    source: str,
    options: MeshOptions | None = None,
    *,
    triangles: int = ModelOptions.triangles,
    compare: bool = False,
    store: Store | None = None,
    progress: Callable[[Progress], None] | None = None,
) -> Execution:
    """Run all stages on a model name or file, in memory or through a store; results by stage name.

    With `compare` also the rivals, which can take minutes.
    """
    options = coarsened(options or MeshOptions(), source, triangles)
    stages = COMPARED_STAGES if compare else STAGES
    return execute(stages, options.by_stage(source, triangles, compare=compare), store=store, progress=progress)


def mesh_surface(surface: TriMesh | RawSurface | str | Path, options: MeshOptions | None = None) -> BlockMesh:
    """Mesh a surface by structured quadrilateral blocks.

    `surface` is a triangle mesh, a model name or a file. No server and no files are needed.

    Raises `InputError` for a surface that cannot be meshed and `StageError` for a stage without a result.
    """
    options = options or MeshOptions()
    if isinstance(surface, (str, Path)):
        return run(str(surface), options)["smoothing"].mesh
    raw = surface if isinstance(surface, RawSurface) else RawSurface("surface", surface.vertices, surface.triangles)
    stages = (replace(STAGES[0], run=lambda _inputs, _options: raw), *STAGES[1:])
    options = coarsened(options, raw.name, stages=stages)
    return execute(stages, options.by_stage(raw.name), targets=["smoothing"])["smoothing"].mesh
