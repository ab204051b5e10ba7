"""Digest of the source code a stage depends on, so that a changed algorithm is never answered from the store."""

import ast
import hashlib
import importlib.metadata
import inspect
import sys
from collections.abc import Callable, Iterator
from functools import lru_cache
from pathlib import Path

from drl_meshgen.store.canonical import digest

PACKAGE = Path(__file__).resolve().parents[1]


def _locate(root: Path, module: str) -> Path | None:
    """Return the file of a dotted module of the package in `root`, None where there is no such module."""
    parts = module.split(".")
    if parts[0] != root.name:
        return None
    stem = root.joinpath(*parts[1:])
    for candidate in (stem / "__init__.py", stem.with_suffix(".py")):
        if candidate.is_file() and (len(parts) > 1 or candidate.name == "__init__.py"):
            return candidate
    return None


def _statements(tree: ast.Module) -> Iterator[ast.AST]:
    """Yield all statements of a source file, in functions and branches too, but none of their expressions."""
    pending: list[ast.AST] = [tree]
    while pending:
        node = pending.pop()
        yield node
        for name in ("body", "orelse", "finalbody", "handlers", "cases"):
            below = getattr(node, name, None)
            if isinstance(below, list):
                pending += below


def _imports(root: Path, file: Path, module: str) -> Iterator[str]:
    """Yield every dotted name that a source file imports.

    `from a import b` yields `a.b` where that is a module of the package, else `a`.
    """
    package = module.split(".") if file.name == "__init__.py" else module.split(".")[:-1]
    for node in _statements(ast.parse(file.read_bytes(), str(file))):
        if isinstance(node, ast.Import):
            yield from (alias.name for alias in node.names)
        elif isinstance(node, ast.ImportFrom):
            base = package[: len(package) - node.level + 1] if node.level else []
            name = ".".join([*base, *([node.module] if node.module else [])])
            for alias in node.names:
                member = f"{name}.{alias.name}"
                yield member if _locate(root, member) is not None else name


@lru_cache(maxsize=1024)
def _scan(root: Path, module: str) -> tuple[str, tuple[str, ...], tuple[str, ...]]:
    """Return a module's file digest, the modules of the package it imports and the other packages it imports."""
    file = _locate(root, module)
    if file is None:
        raise ValueError(f"{module} is not a module of {root.name}")
    inside, outside = set(), set()
    for name in _imports(root, file, module):
        if name == root.name or name.startswith(f"{root.name}."):
            inside.add(name)
        else:
            outside.add(name.split(".")[0])
    known = sorted(name for name in inside if _locate(root, name) is not None)
    foreign = sorted(outside - sys.stdlib_module_names - {""})
    return hashlib.sha256(file.read_bytes()).hexdigest(), tuple(known), tuple(foreign)


def _members(root: Path, module: str) -> tuple[list[str], dict[str, str]]:
    """Expand a package to all its modules, and digest the data files (templates, weights) that lie beside them."""
    file = _locate(root, module)
    if file is None or file.name != "__init__.py":
        return [module], {}
    modules, data = [], {}
    for path in sorted(file.parent.rglob("*")):
        relative = path.relative_to(root)
        if not path.is_file() or "__pycache__" in relative.parts:
            continue
        if path.suffix == ".py":
            parts = relative.with_suffix("").parts
            modules.append(".".join([root.name, *(parts[:-1] if parts[-1] == "__init__" else parts)]))
        else:
            data[relative.as_posix()] = hashlib.sha256(path.read_bytes()).hexdigest()
    return modules, data


@lru_cache(maxsize=64)
def installed_version(package: str) -> str:
    """Return the version of a package; empty where no distribution has its name."""
    try:
        return importlib.metadata.version(package)
    except importlib.metadata.PackageNotFoundError:
        return ""


@lru_cache(maxsize=256)
def _closure(modules: tuple[str, ...], root: Path) -> tuple[dict[str, str], dict[str, str]]:
    """Return digests of modules, data files and what they import within the package, and versions of other packages."""
    pending, sources, versions = [], {}, {}
    for module in modules:
        if _locate(root, module) is None:
            raise ValueError(f"{module} is not a module of {root.name}")
        members, data = _members(root, module)
        pending += members
        sources.update(data)
    while pending:
        module = pending.pop()
        if module in sources:
            continue
        sources[module], inside, outside = _scan(root, module)
        pending += inside
        versions.update({name: installed_version(name) for name in outside})
    return sources, versions


def source_digest(modules: tuple[str, ...], root: Path = PACKAGE) -> str:
    """Return the SHA-256 over the source of `modules` and of everything they import within the package in `root`.

    A package stands for all its modules and data files. Imports are followed wherever they stand in the text, so lazy
    ones count; a module reached through an import does not pull in the `__init__` of its parent packages. Versions of
    the other packages that are imported join the digest, because a new Gmsh or SciPy is another algorithm.
    Computed once per process. Raises ValueError for a name that is not a module of the package.
    """
    sources, versions = _closure(modules, root)
    return digest({"sources": sources, "versions": versions})


def libraries(modules: tuple[str, ...], root: Path = PACKAGE) -> dict[str, str]:
    """Return the versions of the other packages that `modules` and what they import depend on, by name.

    Those are part of `source_digest`. Packages without a distribution of their name are left out.
    """
    versions = _closure(modules, root)[1]
    return {name: versions[name] for name in sorted(versions) if versions[name]}


@lru_cache(maxsize=256)
def function_source(function: Callable[..., object]) -> str:
    """Return the text of a function, without the decorators that `functools.wraps` reveals around it.

    Raises OSError or TypeError where it has none (built-in, typed at a prompt).
    """
    return inspect.getsource(inspect.unwrap(function))
