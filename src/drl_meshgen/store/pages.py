"""The pages that the file server writes itself: the latest runs, and the files of an artifact."""

import html
from datetime import UTC, datetime

from drl_meshgen.store.address import artifact_path
from drl_meshgen.store.catalogue import SHORT, options_of, record_names, surface_name
from drl_meshgen.store.record import Record
from drl_meshgen.store.store import Store

LATEST = 50
"""Entries in each list of the first page."""
_STYLE = (
    "body{font:15px/1.5 system-ui,sans-serif;margin:2rem auto;max-width:62rem;padding:0 1rem;color:#222}"
    "table{border-collapse:collapse}td,th{padding:.15rem 1.2rem .15rem 0;text-align:left;vertical-align:top}"
    "code{font-size:13px}a{color:#0b57a4}"
)


def page(title: str, body: str) -> str:
    """Return a whole HTML page; `body` is HTML, `title` text."""
    head = f'<!doctype html><html lang="en"><meta charset="utf-8"><title>{html.escape(title)}</title>'
    return f"{head}<style>{_STYLE}</style><h1>{html.escape(title)}</h1>{body}</html>\n"


def files(record: Record) -> str:
    """Return the list of an artifact's files as HTML."""
    rows = [
        (_link(artifact_path(record.ref, name), name), f"<code>{sha}</code>")
        for name, sha in record.ref.outputs.items()
    ]
    return '<p><a href="/">latest</a></p>' + _table(("file", "SHA-256"), rows)


def latest(store: Store) -> str:
    """Return the latest runs as HTML: pages that runs left, then whatever was made or asked for last."""
    times = {name: time for name in record_names(store) if (time := _asked(store, *name)) is not None}
    names = sorted(times, key=lambda name: (-times[name], name))
    pages, others = [], []
    for stage, key in names:
        wanted = len(others) < LATEST
        if not wanted and (stage != "report" or len(pages) == LATEST):
            continue
        record = store.record(stage, key)
        if record is None:
            continue
        when = datetime.fromtimestamp(times[stage, key], UTC).strftime("%Y-%m-%d %H:%M:%S")
        if "index.html" in record.ref.outputs and len(pages) < LATEST:
            pages.append((when, _link(artifact_path(record.ref, "index.html"), _title(record))))
        if wanted:
            name = f"{stage} {key[:SHORT]}"
            others.append((when, _link(artifact_path(record.ref), name), html.escape(_title(record, ""))))
    return (
        f"<h2>Latest runs</h2>{_table(('last used (UTC)', 'page'), pages)}"
        f"<h2>Latest artifacts</h2>{_table(('last used (UTC)', 'artifact', 'surface'), others)}"
    )


def _asked(store: Store, stage: str, key: str) -> float | None:
    try:
        return store.record_path(stage, key).stat().st_mtime
    except OSError:  # removed meanwhile
        return None


def _title(record: Record, default: str | None = None) -> str:
    surfaces = options_of(record).get("surfaces")
    if isinstance(surfaces, list):
        return f"{record.ref.stage} " + ", ".join(map(str, surfaces))
    return surface_name(record) or (f"{record.ref.stage} {record.ref.key[:SHORT]}" if default is None else default)


def _link(path: str, text: str) -> str:
    return f'<a href="{html.escape(path)}">{html.escape(text)}</a>'


def _table(heads: tuple[str, ...], rows: list[tuple[str, ...]]) -> str:
    if not rows:
        return "<p>none yet</p>"
    lines = ["".join(f"<th>{head}</th>" for head in heads)]
    lines += ["".join(f"<td>{cell}</td>" for cell in row) for row in rows]
    return "<table>" + "".join(f"<tr>{line}</tr>" for line in lines) + "</table>"
