"""Each module imports alone, and the public names are those that are promised."""

import ast
import pkgutil
import subprocess
import sys
from collections.abc import Iterator
from importlib.util import find_spec
from pathlib import Path

import networkx
import pytest

import backends
import cross_check
import rvaft

PACKAGES = (rvaft, backends, cross_check)
MODULES = sorted(
    found.name
    for package in PACKAGES
    for found in pkgutil.walk_packages(package.__path__, f"{package.__name__}.")
    if not found.name.endswith("__main__")
)


ALONE = """
import importlib, os, sys
for library in "click lark msgspec networkx rich sympy spot hypothesis matplotlib.figure websockets".split():
    try:  # what is slow to import, and not ours
        importlib.import_module(library)
    except ImportError:
        pass
failed = []
for module in sys.argv[1:]:
    child = os.fork()
    if child == 0:
        try:
            importlib.import_module(module)
        except BaseException as error:
            print(module, repr(error), flush=True)
            os._exit(1)
        os._exit(0)
    failed += [module] if os.waitpid(child, 0)[1] else []
sys.exit(bool(failed))
"""


def imported(module: str) -> Iterator[str]:
    """Which of our modules this one imports as soon as it is imported itself."""
    spec = find_spec(module)
    assert spec is not None
    assert spec.origin is not None
    for statement in ast.parse(Path(spec.origin).read_text(encoding="utf-8")).body:
        match statement:
            case ast.Import(names=names):
                wanted = [name.name for name in names]
            case ast.ImportFrom(module=str(base), names=names):
                wanted = [inner if (inner := f"{base}.{name.name}") in MODULES else base for name in names]
            case _:
                continue
        yield from (name for name in wanted if name in MODULES)


def test_no_module_imports_itself_in_a_circle() -> None:
    graph = networkx.DiGraph((module, other) for module in MODULES for other in imported(module))
    assert list(networkx.simple_cycles(graph)) == []


@pytest.mark.slow
def test_each_module_imports_alone() -> None:
    done = subprocess.run([sys.executable, "-c", ALONE, *MODULES], capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stdout + done.stderr


def test_no_public_function_shares_its_name_with_a_submodule() -> None:
    submodules = {found.name for found in pkgutil.iter_modules(rvaft.__path__)}
    functions = {name for name in rvaft.__all__ if callable(getattr(rvaft, name))}
    assert not submodules & functions


def test_rvaft_alone_imports_no_library() -> None:
    heavy = {"networkx", "lark", "sympy", "spot", "rich", "hypothesis", "click"}
    code = f"import sys, rvaft; print(sorted({heavy!r} & set(sys.modules)))"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.strip() == "[]"
