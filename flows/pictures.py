"""Pictures small enough to stand in the text of a page: `data:` addresses, the only ones that need no file server."""

import base64
import io
from collections.abc import Sequence
from pathlib import Path
from xml.sax.saxutils import escape

import numpy as np
from PIL import Image, ImageDraw

from drl_meshgen.commands.output import can_draw
from drl_meshgen.errors import Place
from drl_meshgen.report.places import draw_place

WIDTH = 880
"""Width of a row of thumbnails in pixels; the dashboard's page has about 900."""
LIMIT = 50_000
"""Most bytes of a JPEG."""
QUALITIES = (82, 70, 55, 40, 25)
"""JPEG qualities that are tried one after the other."""


def jpeg(image: Image.Image) -> str:
    """Return a picture as a `data:` address of a JPEG of at most `LIMIT` bytes, of a smaller picture if need be."""
    while True:
        for quality in QUALITIES:
            buffer = io.BytesIO()
            image.save(buffer, "JPEG", quality=quality, optimize=True)
            if buffer.tell() <= LIMIT:
                return "data:image/jpeg;base64," + base64.b64encode(buffer.getvalue()).decode()
        image = image.resize((max(1, image.width // 2), max(1, image.height // 2)))


def thumbnail(pictures: Sequence[tuple[str, Path]]) -> str:
    """Return pictures side by side with their captions below as one `data:` address; black on white in every theme."""
    parts = []
    for _, path in pictures:
        with Image.open(path) as image:
            part = image.convert("RGB")
        part.thumbnail((WIDTH // len(pictures) - _GAP, WIDTH // 2))
        parts.append(part)
    height = max(part.height for part in parts)
    step = WIDTH // len(parts)
    sheet = Image.new("RGB", (step * len(parts), height + _CAPTION), "white")
    pen = ImageDraw.Draw(sheet)
    for k, ((caption, _), part) in enumerate(zip(pictures, parts, strict=True)):
        sheet.paste(part, (k * step + (step - part.width) // 2, (height - part.height) // 2))
        pen.text((k * step + step // 2, height + _CAPTION // 2), caption, "black", anchor="mm", font_size=_FONT)
    return jpeg(sheet)


def place_picture(place: Place | None) -> str:
    """Return the place where something is wrong as a `data:` address; empty where none is known or nothing is drawn."""
    if place is None or not len(place.points) or not can_draw():
        return ""
    return jpeg(Image.fromarray(np.asarray(draw_place(place))))


def badge(text: str, colour: str) -> str:
    """Return a coloured cell with white text as a `data:` address: styles do not survive in the dashboard's pages."""
    svg = (
        f'<svg xmlns="http://www.w3.org/2000/svg" width="{_BADGE}" height="22">'
        f'<rect width="{_BADGE}" height="22" rx="4" fill="{colour}"/>'
        f'<text x="{_BADGE // 2}" y="15" fill="#fff" font-family="sans-serif" font-size="12" font-weight="bold" '
        f'text-anchor="middle">{escape(text)}</text></svg>'
    )
    return "data:image/svg+xml;base64," + base64.b64encode(svg.encode()).decode()


_GAP, _CAPTION, _FONT, _BADGE = 8, 24, 13, 90
