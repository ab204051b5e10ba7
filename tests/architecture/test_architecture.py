"""Rules of the house that a machine can check."""

import ast
import subprocess
import sys
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
CORE = sorted((ROOT / "src/drl_meshgen").rglob("*.py"))
PICKLING = {"pickle", "shelve", "marshal", "joblib", "dill", "cloudpickle"}
ALL = [*CORE, *sorted((ROOT / "tasks").glob("*.py")), *sorted((ROOT / "flows").glob("*.py"))]


def test_imports_keep_their_direction():
    script = "from importlinter.cli import lint_imports; raise SystemExit(lint_imports(no_cache=True))"
    result = subprocess.run([sys.executable, "-c", script], cwd=ROOT, capture_output=True, text=True, check=False)
    assert result.returncode == 0, result.stdout + result.stderr


def test_modules_stay_short():
    length = {str(path.relative_to(ROOT)): len(path.read_text().splitlines()) for path in ALL}
    assert {name: lines for name, lines in length.items() if lines > 500} == {}


def forbidden(path):
    for node in ast.walk(ast.parse(path.read_text())):
        where = f"{path.relative_to(ROOT)}:{getattr(node, 'lineno', 0)}"
        if isinstance(node, ast.Assert):
            yield f"{where} assert"
        elif isinstance(node, ast.Name) and node.id in {"eval", "exec"}:
            yield f"{where} {node.id}"
        elif isinstance(node, (ast.Import, ast.ImportFrom)):
            modules = [node.module or ""] if isinstance(node, ast.ImportFrom) else [a.name for a in node.names]
            yield from (f"{where} {name}" for name in modules if name.partition(".")[0] in PICKLING)
        elif isinstance(node, ast.Attribute) and node.attr in {"read_pickle", "to_pickle"}:
            yield f"{where} {node.attr}"
        elif isinstance(node, ast.keyword) and node.arg in {"allow_pickle", "weights_only"}:
            yield f"{where} {node.arg}"
        elif isinstance(node, ast.Attribute) and isinstance(node.value, ast.Name):
            yield from [f"{where} torch.load"] * ((node.value.id, node.attr) == ("torch", "load"))


def test_code_has_no_assert_eval_or_pickle():
    assert [found for path in ALL for found in forbidden(path)] == []


def test_the_package_loads_without_prefect_and_heavy_libraries():
    script = "import drl_meshgen, sys; print(*{'prefect', 'torch', 'vtk', 'gmsh', 'pymeshlab'} & set(sys.modules))"
    result = subprocess.run([sys.executable, "-c", script], cwd=ROOT, capture_output=True, text=True, check=True)
    assert result.stdout.split() == []


def test_a_surface_is_meshed_without_the_libraries_that_learning_and_pictures_need():
    script = (
        "import sys; from drl_meshgen.pipeline import MeshOptions, run; "
        "run('hemisphere', MeshOptions().sized(100), triangles=5000); "
        "print(*{'prefect', 'torch', 'matplotlib', 'gmsh', 'jinja2'} & set(sys.modules))"
    )
    result = subprocess.run([sys.executable, "-c", script], cwd=ROOT, capture_output=True, text=True, check=True)
    assert result.stdout.split() == []
