"""What a flow run shows in Prefect's dashboard: one page and one table.

The page is plain Markdown with `data:` pictures. Both of Prefect's pages show these; of HTML one drops styles and the
other the rest, see docs/dashboard.md.
"""

import math
import os
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path

from prefect.artifacts import create_markdown_artifact, create_table_artifact

from drl_meshgen.errors import BELOW_GATE, FINE
from drl_meshgen.report import OURS
from drl_meshgen.store import ArtifactRef
from drl_meshgen.store.address import artifact_url
from flows.chain import Outcome
from flows.pictures import badge, thumbnail

Methods = Mapping[str, Mapping[str, object]]
"""Figures by name for each method, ours first; beside them may stand the texts `cause` and `defects`."""
BADGES = {"passed": "#2e7d32", "below gate": "#b26a00", "failed": "#c62828"}
"""Verdicts and their colours: white text reads on each, and each on white and on black."""
MOST_SHOWN = 12
"""Most surfaces that passed and have pictures on the page (count); all others have a row."""
MOST_FAILED = 30
"""Most surfaces that failed, or are below the gate, and have a picture on the page (count)."""
MOST_ROWS = 500
"""Most surfaces that have a row on the page (count); the table artifact has all."""
_STRIP = (
    ("min_angle", "min angle", "{:.1f}°"),
    ("max_angle", "max angle", "{:.1f}°"),
    ("irregular", "irregular", "{:.0f}"),
    ("named_blocks", "blocks", "{:.0f}"),
    ("quads", "quads", "{:.0f}"),
)


@dataclass(frozen=True)
class Shown:
    """What the page knows of one surface."""

    outcome: Outcome
    """What became of it, with the picture of the place where it failed, if there is one."""
    methods: Methods = field(default_factory=dict)
    """Figures of our mesh and of the rivals; empty where there is no mesh."""
    pictures: Sequence[tuple[str, Path]] = ()
    """Captions and files of pictures."""

    @property
    def verdict(self) -> str:
        """One of `BADGES`."""
        known = {FINE: "passed", BELOW_GATE: "below gate"}
        return known.get(self.outcome.exit_code, "failed")


def page(title: str, shown: Sequence[Shown], report: ArtifactRef | None = None, folder: str = "") -> str:
    """Return the page of a run as Markdown: verdicts, what failed and where, pictures, links.

    `report` is the artifact of the report, `folder` where a copy of it lies, or the results of a run without one. Links
    need the environment variable `DRL_MESHGEN_FILES`; without, the folder is named.
    """
    counts = {verdict: sum(one.verdict == verdict for one in shown) for verdict in BADGES}
    told = [f"**{count} {verdict}**" for verdict, count in counts.items() if count]
    address = None if report is None else artifact_url(report, "index.html")
    if address is not None:
        told.append(f"[report with all pictures and tables]({address})")
    elif folder:
        told.append(f"{'results' if report is None else 'report'} in the folder {code(folder)}")
    lines = [f"# {text(title)}", "", " · ".join(told), ""]
    if len(shown) > MOST_ROWS:
        lines += [f"{MOST_ROWS} of {len(shown)} surfaces, those that did not pass first; the table has all:", ""]
        shown = sorted(shown, key=_worst_first)[:MOST_ROWS]
    lines += _strip(shown)
    bad = sorted((one for one in shown if one.verdict != "passed"), key=_worst_first)
    for k, one in enumerate(bad):
        lines += [f"## {text(one.outcome.surface)}: {one.verdict}", "", text(one.outcome.failure), ""]
        lines += _picture(f"the place on {one.outcome.surface}", one.outcome.picture if k < MOST_FAILED else "")
        lines += _thumbnails(one) if k < MOST_FAILED else []
    good = [one for one in shown if one.verdict == "passed" and one.pictures]
    sample = good[:: math.ceil(len(good) / MOST_SHOWN) or 1]
    if len(sample) < len(good):
        lines += [f"Pictures of {len(sample)} of the {len(good)} surfaces that passed:", ""]
    for one in sample:
        lines += [f"## {text(one.outcome.surface)}", "", *_thumbnails(one)]
    return "\n".join(lines)


def show_run(
    title: str, shown: Sequence[Shown], report: ArtifactRef | None = None, folder: str = "", key: str = "mesh"
) -> None:
    """Publish the page of a run (see `page`) and the table of all figures. Needs a running flow."""
    counts = ", ".join(f"{n} {v}" for v in BADGES if (n := sum(one.verdict == v for one in shown)))
    create_markdown_artifact(
        page(title, shown, report, folder), key=key, description=f"Verdicts and pictures: {counts}"
    )
    rows = [row(one) for one in shown]
    create_table_artifact(rows, key=f"{key}-quality", description="Quality of all surfaces of the run")


def row(shown: Shown) -> dict[str, object]:
    """Return a row of the table of all figures; JSON has no NaN."""
    ours = {name: value for name, value in shown.methods.get(OURS, {}).items() if isinstance(value, float)}
    figures = {name: round(value, 4) if math.isfinite(value) else None for name, value in ours.items()}
    first = {name: figures.pop(name, None) for name, _, _ in _STRIP}
    return {
        "surface": shown.outcome.surface,
        "verdict": shown.verdict,
        **first,
        "remark": shown.outcome.failure,
        **figures,
    }


def text(raw: str) -> str:
    """Return a text so that Markdown shows it as it is, in one line."""
    plain = " ".join(raw.split()).replace("&", "&amp;").replace("<", "&lt;")
    return "".join(f"\\{c}" if c in "\\`*_[]|#~" else c for c in plain)


def code(raw: str) -> str:
    """Return a text as Markdown's code, in one line."""
    return f"`{' '.join(raw.split()).replace('`', chr(39))}`"


def _worst_first(one: Shown) -> int:
    return -list(BADGES).index(one.verdict)


def _strip(shown: Sequence[Shown]) -> list[str]:
    """Return the table of verdicts: a coloured cell and the main figures of each surface."""
    linked = bool(os.environ.get("DRL_MESHGEN_FILES"))
    heads = ["verdict", "surface", *(label for _, label, _ in _STRIP), *(["files"] if linked else [])]
    lines = [f"| {' | '.join(heads)} |", "| --- | --- |" + " ---: |" * len(_STRIP) + (" --- |" if linked else "")]
    for one in shown:
        cells = _figures(one.methods.get(OURS, {}))
        mark = f"![{one.verdict}]({badge(one.verdict, BADGES[one.verdict])})"
        links = [_links(one.outcome)] if linked else []
        lines.append(f"| {' | '.join([mark, text(one.outcome.surface), *cells, *links])} |")
    return [*lines, ""]


def _links(outcome: Outcome) -> str:
    """Return links to what a surface left behind: the mesh, else the latest artifact."""
    wanted = {"mesh": "smoothing", "quality": "quality"}
    known = {label: artifact_url(outcome.refs[stage]) for label, stage in wanted.items() if stage in outcome.refs}
    return " ".join(f"[{label}]({address})" for label, address in known.items() if address)


def _thumbnails(one: Shown) -> list[str]:
    if not one.pictures:
        return []
    lines = _picture(
        f"{one.outcome.surface}: {', '.join(caption for caption, _ in one.pictures)}", thumbnail(one.pictures)
    )
    return [*lines, *_beside(one.methods)]


def _figures(figures: Mapping[str, object]) -> list[str]:
    """Return the main figures as text, a dash where there is none."""
    values = [(form, figures.get(name)) for name, _, form in _STRIP]
    return [form.format(v) if isinstance(v, float) and math.isfinite(v) else "–" for form, v in values]


def _picture(caption: str, address: str) -> list[str]:
    return [f"![{text(caption)}]({address})", ""] if address else []


def _beside(methods: Methods) -> list[str]:
    """Return the table of our figures beside those of the rivals, a method per row; empty without rivals."""
    if len(methods) < 2:
        return []
    lines = [f"| method | {' | '.join(label for _, label, _ in _STRIP)} |", "| --- |" + " ---: |" * len(_STRIP)]
    remarks = []
    for method, figures in methods.items():
        remark = "; ".join(str(figures[key]) for key in ("cause", "defects") if figures.get(key))
        lines.append(f"| {text(method)} | {' | '.join(_figures(figures))} |")
        remarks += [f"- {text(method)}: {text(remark)}"] if remark else []
    return [*lines, "", *remarks, ""]
