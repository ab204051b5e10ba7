"""Write docs/options.md, the list of all settings, from the options classes: `python docs/options.py`."""

import ast
import inspect
import textwrap
from dataclasses import fields, is_dataclass
from pathlib import Path
from typing import Any, get_type_hints

from drl_meshgen.pipeline import MeshOptions

PAGE = Path(__file__).with_suffix(".md")
HEAD = """# Settings

Keys of the TOML file that `--config` takes, one table per stage; what is left out keeps its default. In the library the
same classes are given as `MeshOptions(smoothing=SmoothingOptions(relax_sweeps=5))`. This page is written by
`python docs/options.py` from their source.
"""


def descriptions(options: type) -> dict[str, str]:
    """Return the sentence under each field of a dataclass."""
    (body,) = ast.parse(textwrap.dedent(inspect.getsource(options))).body
    found = {}
    for field, after in zip(body.body, [*body.body[1:], None], strict=True):
        if isinstance(field, ast.AnnAssign) and isinstance(after, ast.Expr) and isinstance(after.value, ast.Constant):
            found[field.target.id] = inspect.cleandoc(after.value.value).replace("\n", " ")
    return found


def shown(value: Any) -> str:
    """Return a default as TOML has it."""
    if isinstance(value, bool):
        return f"`{str(value).lower()}`"
    if isinstance(value, tuple):
        return f"`[{', '.join(shown(item).strip('`') for item in value)}]`"
    return "not set" if value is None else f'`"{value}"`' if isinstance(value, str) else f"`{value!r}`"


def rows(options: Any) -> list[str]:
    """Return the table of one options object."""
    said = descriptions(type(options))
    lines = ["| key | default | meaning |", "| --- | --- | --- |"]
    for field in fields(options):
        value = getattr(options, field.name)
        if not is_dataclass(value):
            meaning = said[field.name].replace("|", "\\|")
            lines.append(f"| `{field.name}` | {shown(value)} | {meaning} |")
    return lines


def page() -> str:
    """Return the whole page."""
    default = MeshOptions()
    parts = [HEAD, *rows(default)]
    for name, kind in get_type_hints(MeshOptions).items():
        if is_dataclass(kind):
            parts += ["", f"## `[{name}]`", "", (inspect.getdoc(kind) or "").splitlines()[0], ""]
            parts += rows(getattr(default, name))
    return "\n".join(parts) + "\n"


if __name__ == "__main__":
    PAGE.write_text(page(), encoding="utf-8")
