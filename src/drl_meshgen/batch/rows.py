"""What came of each model of a batch: a small file per model, so that a batch can go on, and one table of all."""

import json
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from enum import Enum
from pathlib import Path

import pandas as pd

from drl_meshgen.batch.jobs import Job
from drl_meshgen.errors import InputError
from drl_meshgen.export import write_table
from drl_meshgen.export.atomic import replacing
from drl_meshgen.pipeline import COMPARED_STAGES, STAGES, MeshOptions, ModelOptions, content_of
from drl_meshgen.store import Store
from drl_meshgen.store.canonical import digest

TABLE = "batch.parquet"
METRICS = (
    "quads",
    "nodes",
    "irregular",
    "blocks",
    "named_blocks",
    "t_junctions",
    "validity",
    "min_angle",
    "max_angle",
    "warp",
    "area_ratio",
    "side_ratio",
    "orthogonality",
    "orthogonality_printed",
    "compliance",
    "jacobian_ratio",
    "scaled_jacobian_min",
    "smoothness",
    "edge_ratio",
    "non_quads",
    "components",
    "loops",
    "euler",
    "boundary_mse",
    "boundary_fit",
    "surface_deviation",
    "surface_deviation_rms",
    "node_deviation",
    "boundary_deviation",
    "boundary_deviation_rms",
)
"""Columns of the table with the metrics of our mesh, see `quality.measure`; empty where there is no mesh."""
IDS = {"mesh_id": "smoothing", "quality_id": "quality"}
"""Columns with the keys of artifacts, and the stages that they are of."""


class Status(Enum):
    """What became of a model."""

    FINE = "fine"
    BELOW_GATE = "below gate"
    """Meshed, but not well enough (exit code 4)."""
    REFUSED = "refused"
    """The input is bad (exit code 3)."""
    FAILED = "failed"
    """A stage ended without a result."""
    INTERNAL = "internal error"
    TOO_LONG = "too long"
    """It took more seconds than it may."""
    DIED = "died"
    """The process that meshed it ended, as at the end of the memory."""

    @property
    def final(self) -> bool:
        """Tell whether another attempt would end the same: then a batch does not try again."""
        return self in {Status.FINE, Status.BELOW_GATE, Status.REFUSED, Status.FAILED}


@dataclass(frozen=True)
class Row:
    """What came of one model."""

    key: str
    """Digest of all that it depends on, see `keys_of`."""
    status: Status
    exit_code: int
    """What the command line returns for this model alone."""
    sentence: str = ""
    """What went wrong; empty where nothing did."""
    seconds: float = 0.0
    """What its stages took when they were computed, together: the same however often they are found in the store."""
    metrics: Mapping[str, float] = field(default_factory=dict)
    artifacts: Mapping[str, str] = field(default_factory=dict)
    """Key of the artifact of each stage that ended well."""
    picture: str = ""
    """Where it went wrong, as a `data:` address; empty where that has no place."""


def keys_of(jobs: Iterable[Job], *, compare: bool = False) -> dict[str, str]:
    """Return for each job's name the digest of its surface's content, its name, all options, and all stages' code.

    What is not there, a surface or a file that options name, has a key, too. Files of options are read once for all.
    """
    stages: dict[MeshOptions, str] = {}
    keys = {}
    for job in jobs:
        if job.options not in stages:
            stages[job.options] = _stages_key(job.options, compare=compare)
        try:
            content = content_of(ModelOptions(job.source, job.triangles))
        except (InputError, OSError) as error:
            content = str(error)
        own = {"name": job.name, "content": content, "refusal": job.refusal, "stages": stages[job.options]}
        keys[job.name] = digest(own)
    return keys


def _stages_key(options: MeshOptions, *, compare: bool) -> str:
    stages = COMPARED_STAGES if compare else STAGES
    given = options.by_stage("", compare=compare)
    own = [stage for stage in stages if stage.name != "model"]  # whose identity is the content
    try:
        identities = {stage.name: stage.identity(given.get(stage.name, stage.options())) for stage in own}
    except OSError as error:
        return str(error)
    code = {stage.name: [stage.version, stage.source] for stage in stages}
    return digest({"options": identities, "limits": options.limits, "code": code})


class Rows:
    """The rows of a batch in a folder: `rows/<name>.json`, and beside them who was begun with."""

    def __init__(self, out: Path, store: Store) -> None:
        self._folder, self._out, self._store = out / "rows", out, store

    def kept(self, job: Job, key: str) -> Row | None:
        """Return the row of a job where it need not be run: same key, final, and its artifacts are there.

        That looks for the records of all stages and for the files of those in `IDS`, without reading them.
        """
        row = self.read(job.name)
        if row is None or row.key != key or not row.status.final:
            return None
        shown = {stage: row.artifacts[stage] for stage in IDS.values() if stage in row.artifacts}
        there = all(self._store.record_path(stage, one).is_file() for stage, one in row.artifacts.items())
        return row if there and all(self._there(stage, one) for stage, one in shown.items()) else None

    def _there(self, stage: str, key: str) -> bool:
        """Tell whether the files of an artifact are there; what is in them is for `verify` to judge."""
        record = self._store.record(stage, key)
        return record is not None and all(
            self._store.objects.path(sha).is_file() for sha in record.ref.outputs.values()
        )

    def read(self, name: str) -> Row | None:
        """Return the row of a model; None where there is none that can be read."""
        try:
            data = json.loads(self._path(name).read_text("utf-8"))
            return Row(**{**data, "status": Status(data["status"])})
        except (OSError, ValueError, TypeError, KeyError):
            return None

    def write(self, name: str, row: Row) -> None:
        """Keep the row of a model, whole or not at all; it is begun no more."""
        data = {**vars(row), "status": row.status.value}
        with replacing(self._path(name)) as part:
            part.write_text(json.dumps(data, sort_keys=True, indent=1) + "\n", "utf-8")
        self._mark(name).unlink(missing_ok=True)

    def begin(self, name: str) -> None:
        """Note that a model is being meshed: if its process ends, it is a suspect."""
        self._mark(name).parent.mkdir(parents=True, exist_ok=True)
        self._mark(name).touch()

    def begun(self, name: str) -> bool:
        """Tell whether a model was begun and never ended."""
        return self._mark(name).exists()

    def write_table(self, jobs: Iterable[Job]) -> None:
        """Write the table with a row per job that has one, in the order of the jobs; nothing where none has.

        The same rows give the same bytes.
        """
        known = [(job, row) for job in jobs if (row := self.read(job.name)) is not None]
        if known:
            write_table(self._out / TABLE, table_of(known))

    def _path(self, name: str) -> Path:
        return self._folder / f"{name}.json"

    def _mark(self, name: str) -> Path:
        return self._folder / f"{name}.begun"


def table_of(rows: Sequence[tuple[Job, Row]]) -> pd.DataFrame:
    """Return the table of a batch: name, source, status, exit_code, sentence, seconds, metrics, keys of artifacts."""
    text = {
        "name": [job.name for job, _ in rows],
        "source": [job.label for job, _ in rows],
        "status": [row.status.value for _, row in rows],
    }
    told = {
        "exit_code": pd.array([row.exit_code for _, row in rows], dtype="int64"),
        "sentence": [row.sentence for _, row in rows],
        "seconds": pd.array([row.seconds for _, row in rows], dtype="float64"),
    }
    metrics = {name: pd.array([row.metrics.get(name) for _, row in rows], dtype="float64") for name in METRICS}
    ids = {column: [row.artifacts.get(stage, "") for _, row in rows] for column, stage in IDS.items()}
    return pd.DataFrame({**text, **told, **metrics, **ids})
