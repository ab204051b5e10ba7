"""What a cache key depends on: canonical options and source code."""

from dataclasses import dataclass, field
from enum import Enum
from pathlib import Path

import numpy as np
import pytest

from drl_meshgen.store.canonical import canonical
from drl_meshgen.store.source import source_digest


class Mode(Enum):
    FREE = "free boundary"


@dataclass(frozen=True)
class Inner:
    tolerance: float = 1e-7


@dataclass(frozen=True)
class Outer:
    steps: int = 3
    mode: Mode = Mode.FREE
    inner: Inner = field(default_factory=Inner)
    sizes: tuple[int, ...] = (1, 2)


@dataclass(frozen=True)
class Twin:
    tolerance: float = 1e-7


def test_order_of_keys_does_not_matter():
    assert canonical({"b": 1, "a": 2}) == canonical({"a": 2, "b": 1})


def test_every_float_bit_matters_and_reads_back():
    assert canonical(0.1 + 0.2) == "0.30000000000000004"
    assert canonical(np.float64(0.1)) == canonical(0.1)


def test_integer_and_float_differ():
    assert canonical(1) != canonical(1.0)


def test_a_changed_option_deep_inside_changes_the_text():
    assert canonical(Outer()) == canonical(Outer())
    assert canonical(Outer()) != canonical(Outer(inner=Inner(1e-8)))
    assert canonical(Outer()) != canonical(Outer(sizes=(2, 1)))


def test_equal_fields_of_another_type_differ():
    assert canonical(Inner()) != canonical(Twin())


@pytest.mark.parametrize("value", [Path("a"), np.zeros(3), {1: 2}, object(), {"a"}, b"a"])
def test_values_without_canonical_form_are_refused(value):
    with pytest.raises(TypeError):
        canonical(value)


@pytest.mark.parametrize("value", [float("nan"), float("inf")])
def test_values_that_are_not_numbers_are_refused(value):
    with pytest.raises(ValueError, match="not JSON compliant"):
        canonical({"a": value})


BASE = {
    "__init__.py": "from pack.alone import z\n",
    "alone.py": "z = 1\n",
    "solve/__init__.py": "from pack.solve.newton import step\n",
    "solve/newton.py": "import math\n\ndef step():\n    from ..base import tolerance\n    return tolerance\n",
    "solve/weights.txt": "1 2 3",
    "base.py": "from pack import cycle\ntolerance = 1e-7\n",
    "cycle.py": "import pack.base\n",
}


def digest_with(tmp_path, name, changes=(), modules=("pack.solve",)):
    root = tmp_path / name / "pack"
    for path, text in {**BASE, **dict(changes)}.items():
        (root / path).parent.mkdir(parents=True, exist_ok=True)
        (root / path).write_text(text)
    return source_digest(modules, root)


def test_the_digest_does_not_depend_on_the_place(tmp_path):
    assert digest_with(tmp_path, "one") == digest_with(tmp_path, "two")


@pytest.mark.parametrize(
    ("file", "text"),
    [
        ("solve/newton.py", "step = 2\n"),
        ("base.py", "tolerance = 1e-8\nimport pack.cycle\n"),
        ("cycle.py", "import pack.base\nx = 1\n"),
        ("solve/weights.txt", "1 2 4"),
        ("solve/extra.py", "y = 1\n"),
    ],
)
def test_a_change_in_what_a_stage_imports_changes_its_digest(tmp_path, file, text):
    assert digest_with(tmp_path, "one") != digest_with(tmp_path, "two", {file: text})


def test_a_change_elsewhere_leaves_the_digest_alone(tmp_path):
    assert digest_with(tmp_path, "one") == digest_with(tmp_path, "two", {"alone.py": "z = 2\n"})


def test_an_imported_library_joins_with_its_version(tmp_path, monkeypatch):
    before = digest_with(tmp_path, "one", {"base.py": "import numpy\n"})
    monkeypatch.setattr("drl_meshgen.store.source.installed_version", lambda _package: "other")
    assert before != digest_with(tmp_path, "two", {"base.py": "import numpy\n"})


def test_an_unknown_module_is_refused(tmp_path):
    with pytest.raises(ValueError, match=r"pack\.missing is not a module"):
        digest_with(tmp_path, "one", modules=("pack.missing",))
