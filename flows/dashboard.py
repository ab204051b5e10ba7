"""What a flow run shows in Prefect's dashboard: a page per surface and one table."""

import base64
import io
import math
import re
from collections.abc import Mapping, Sequence
from pathlib import Path

from PIL import Image
from prefect.artifacts import create_markdown_artifact, create_table_artifact

from flows.chain import Outcome

Methods = Mapping[str, Mapping[str, object]]
"""Figures by name for each method, ours first; beside them may stand the texts `cause` and `defects`."""
WIDTH = 480
"""Width of a thumbnail in pixels; as JPEG that stays below 50 KB."""


def slug(text: str) -> str:
    """Return a text as the dashboard wants keys: lower case letters, digits and dashes."""
    return re.sub(r"[^a-z0-9]+", "-", text.lower()).strip("-") or "surface"


def thumbnail(*pictures: Path) -> str:
    """Return pictures side by side as a small `data:` address; the dashboard loads no other without a network."""
    parts = []
    for picture in pictures:
        with Image.open(picture) as image:
            part = image.convert("RGB")
        part.thumbnail((WIDTH // len(pictures), WIDTH))
        parts.append(part)
    sheet = Image.new("RGB", (sum(part.width for part in parts), max(part.height for part in parts)), "white")
    left = 0
    for part in parts:
        sheet.paste(part, (left, 0))
        left += part.width
    buffer = io.BytesIO()
    sheet.save(buffer, "JPEG", quality=80)
    return "data:image/jpeg;base64," + base64.b64encode(buffer.getvalue()).decode()


def show_surface(outcome: Outcome, methods: Methods, pictures: Mapping[str, Path]) -> None:
    """Publish the page of one surface: pictures by caption, figures, artifacts. Needs a running flow."""
    lines = [f"# {outcome.surface}", ""]
    if pictures:
        lines += [f"![{outcome.surface}]({thumbnail(*pictures.values())})", "", " · ".join(pictures), ""]
    if outcome.failure:
        lines += [f"**{outcome.failure}**", ""]
    if methods:
        lines += _figures(methods)
    lines += ["| stage | file | SHA-256 |", "| --- | --- | --- |"]
    for stage, ref in outcome.refs.items():
        lines += [f"| {stage} | {name} | `{sha[:12]}` |" for name, sha in ref.outputs.items()]
    create_markdown_artifact(
        "\n".join(lines), key=f"surface-{slug(outcome.surface)}", description=f"Mesh of {outcome.surface}"
    )


def _figures(methods: Methods) -> list[str]:
    """Return the table with a metric per row and a method per column, and what is to be said of methods below it."""
    lines = [f"| metric | {' | '.join(methods)} |", "| --- " + "| ---: " * len(methods) + "|"]
    names = [name for name, value in next(iter(methods.values())).items() if isinstance(value, float)]
    for name in names:
        values = [row.get(name) for row in methods.values()]
        known = [isinstance(value, float) and math.isfinite(value) for value in values]
        cells = [f"{value:.4g}" if there else "–" for value, there in zip(values, known, strict=True)]
        lines.append(f"| {name} | {' | '.join(cells)} |")
    remarks = {method: [row[key] for key in ("cause", "defects") if row.get(key)] for method, row in methods.items()}
    told = [f"- {method}: {'; '.join(map(str, texts))}" for method, texts in remarks.items() if texts]
    return [*lines, "", *told, ""]


def show_table(rows: Sequence[Mapping[str, object]]) -> None:
    """Publish one table with a row per surface. Needs a running flow."""
    create_table_artifact([dict(row) for row in rows], key="quality", description="Quality of all surfaces of the run")
