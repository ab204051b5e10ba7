"""`layout.toml`: the layout of a surface as a file that people edit and `mesh --layout` takes.

It holds one table per edge and per ring, the options the layout was made with, and what tells whether it still fits:
the digest of the surface's content and one of both. Only counts and rows are meant to be edited.
"""

from collections.abc import Mapping
from dataclasses import dataclass, fields, replace
from pathlib import Path
from typing import Any

from drl_meshgen.commands.settings import from_tables, literal, read_toml, table_lines
from drl_meshgen.decompose import Description
from drl_meshgen.errors import InputError
from drl_meshgen.pipeline import LAYOUT_STAGES, MeshOptions, ModelOptions, content_of
from drl_meshgen.store.canonical import digest

HEAD = """\
# Layout of {name}: how many quads lie along each edge, and how many rows across each ring.
#
# Change `count` of any edge or `rows` of any ring, then run
#     drl-meshgen mesh {name} --layout layout.toml --out DIR
# What was changed is kept exactly; the other counts stay as close to theirs as the equations under `links` allow, and
# everything else stays as it is. `fixed = true` keeps a count that was not changed. All other keys are for reading.
#
# contour, boundary: closed curve around a limb or at an opening; its count is the number of quads around.
# spine: edge of the graph along which a junction is opened, between the two loops it is named after.
# strip: junctions may be opened by strips from loop to loop instead; a mouth lies on a loop, sides run between two.
# limb: ends in a cap. link: joins two junctions. Numbers run from the largest to the smallest of a kind.
"""


@dataclass(frozen=True)
class EditedLayout:
    """A layout file as read back."""

    content: str
    """Digest of the surface's content."""
    made_with: MeshOptions
    """Options of the layout."""
    options: MeshOptions
    """The same with former and fixed counts and the spacing found then."""


def layout_text(description: Description, source: str, triangles: int, options: MeshOptions) -> str:
    """Return the text of the file for a layout of `source`, made with `options`."""
    name, own = Path(source).name, _bare(options)
    content = content_of(ModelOptions(source, triangles))
    fixed = {key for key, _ in options.decompose.fixed}
    lines = [HEAD.format(name=name)]
    for edge in sorted(description.edges, key=lambda edge: _order(edge.name)):
        lines += [f"[edges.{edge.name}]", f"count = {edge.count}"]
        lines += ["fixed = true"] if edge.name in fixed else []
        lines += [f"solved = {edge.count}", f'kind = "{edge.kind.value}"']
        lines += [f"wanted = {edge.wanted:.3g}", f"length = {edge.length:.6g}"]
        lines += [f"links = [{', '.join(literal(link) for link in edge.links)}]", ""]
    for ring in sorted(description.rings, key=lambda ring: _order(ring.name)):
        lines += [f"[rings.{ring.name}]", f"rows = {ring.rows}"]
        lines += ["fixed = true"] if ring.name in fixed else []
        lines += [f"solved = {ring.rows}", f"between = [{', '.join(literal(one) for one in ring.columns)}]", ""]
    lines += [
        "# What follows tells whether the file still fits; a file that does not is refused.",
        "[made]",
        f"input = {literal(name)}",
        f"content = {literal(content)}",
        f"spacing = {description.spacing!r}",
        f"key = {literal(_key(content, own))}",
    ]
    for stage in LAYOUT_STAGES:
        lines += ["", *table_lines(getattr(own, stage), f"options.{stage}")]
    return "\n".join(lines) + "\n"


def read_layout(path: Path) -> EditedLayout:
    """Read a layout file back.

    Raises `SettingsError` for what is no TOML and `InputError` for what is no layout or was edited where it must not.
    """
    data = read_toml(path)
    edges, rings, made = (data.get(name) for name in ("edges", "rings", "made"))
    if not all(isinstance(part, dict) for part in (edges, rings, made, data.get("options"))):
        raise InputError(path.name, "is not a layout file", "write one with `drl-meshgen layout`")
    options = from_tables(data["options"], path, "options.")
    if data["made"].get("key") != _key(str(data["made"].get("content")), options):
        raise InputError(path.name, "was made with other options than it holds", "write it again with the new ones")
    former, fixed = [], []
    for tables, key in ((data["edges"], "count"), (data["rings"], "rows")):
        for name, table in tables.items():
            value, solved = (_whole(path, name, table, k) for k in (key, "solved"))
            former.append((name, solved))
            if value != solved or table.get("fixed") is True:
                fixed.append((name, value))
    own = replace(
        options.decompose, fixed=tuple(fixed), former=tuple(former), target_edge=float(data["made"]["spacing"])
    )
    return EditedLayout(data["made"]["content"], options, replace(options, decompose=own))


def steered(options: MeshOptions, path: Path, source: str, triangles: int) -> MeshOptions:
    """Return `options` with those of a layout file for all stages that make the layout.

    Raises `InputError` where the file was made from another surface or `options` say otherwise on such a stage.
    """
    edited = read_layout(path)
    if edited.content != content_of(ModelOptions(source, triangles)):
        raise InputError(path.name, "was made from another surface", "write it again for this one")
    own, default = edited.made_with, MeshOptions()
    for stage in LAYOUT_STAGES:
        given = getattr(_bare(options), stage)
        if given not in (getattr(own, stage), getattr(default, stage)):
            there = getattr(own, stage)
            key = next(f.name for f in fields(given) if getattr(given, f.name) != getattr(there, f.name))
            raise InputError(path.name, f"was made with another {stage}.{key}", "write it again with the new one")
    if options.limits:
        raise InputError(path.name, "is a layout already", "give limits to the layout command")
    fixed = dict(edited.options.decompose.fixed) | dict(options.decompose.fixed)
    own = {stage: getattr(edited.options, stage) for stage in LAYOUT_STAGES}
    return replace(options, **own | {"decompose": replace(edited.options.decompose, fixed=tuple(fixed.items()))})


def _bare(options: MeshOptions) -> MeshOptions:
    return replace(options, decompose=replace(options.decompose, fixed=(), former=()))


def _key(content: str, options: MeshOptions) -> str:
    return digest({"content": content, **{stage: getattr(options, stage) for stage in LAYOUT_STAGES}})


def _whole(path: Path, name: str, table: Mapping[str, Any] | Any, key: str) -> int:
    value = table.get(key) if isinstance(table, dict) else None
    if type(value) is not int or value < 1:
        raise InputError(path.name, f"{key} of {name} is {value!r}", "give a whole number above 0")
    return value


def _order(name: str) -> tuple[bool, list[tuple[str, int]]]:
    """Sort key: loops before what lies in junctions, `limb10` after `limb9`."""
    stems = [(word.rstrip("0123456789"), word) for word in name.split("-")]
    return name.startswith("junction"), [(stem, int(word[len(stem) :] or 0)) for stem, word in stems]
