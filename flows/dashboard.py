"""What a flow run shows in Prefect's dashboard: a page per surface and one table."""

import base64
import io
import re
from collections.abc import Mapping, Sequence
from pathlib import Path

from PIL import Image
from prefect.artifacts import create_markdown_artifact, create_table_artifact

from flows.chain import Outcome

WIDTH = 480
"""Width of a thumbnail in pixels; as JPEG that stays below 50 KB."""


def slug(text: str) -> str:
    """Return a text as the dashboard wants keys: lower case letters, digits and dashes."""
    return re.sub(r"[^a-z0-9]+", "-", text.lower()).strip("-") or "surface"


def thumbnail(picture: Path) -> str:
    """Return a picture file as a small `data:` address; the dashboard loads no other address without a network."""
    with Image.open(picture) as image:
        small = image.convert("RGB")
    small.thumbnail((WIDTH, WIDTH))
    buffer = io.BytesIO()
    small.save(buffer, "JPEG", quality=80)
    return "data:image/jpeg;base64," + base64.b64encode(buffer.getvalue()).decode()


def show_surface(outcome: Outcome, metrics: Mapping[str, float], picture: Path | None = None) -> None:
    """Publish the page of one surface: picture, figures, artifacts. Needs a running flow."""
    lines = [f"# {outcome.surface}", ""]
    if picture is not None:
        lines += [f"![{outcome.surface}]({thumbnail(picture)})", ""]
    if outcome.failure:
        lines += [f"**{outcome.failure}**", ""]
    if metrics:
        lines += ["| metric | value |", "| --- | ---: |"]
        lines += [f"| {name} | {value:.4g} |" for name, value in metrics.items()] + [""]
    lines += ["| stage | file | SHA-256 |", "| --- | --- | --- |"]
    for stage, ref in outcome.refs.items():
        lines += [f"| {stage} | {name} | `{sha[:12]}` |" for name, sha in ref.outputs.items()]
    create_markdown_artifact(
        "\n".join(lines), key=f"surface-{slug(outcome.surface)}", description=f"Mesh of {outcome.surface}"
    )


def show_table(rows: Sequence[Mapping[str, object]]) -> None:
    """Publish one table with a row per surface. Needs a running flow."""
    create_table_artifact([dict(row) for row in rows], key="quality", description="Quality of all surfaces of the run")
