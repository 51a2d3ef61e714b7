"""Each module imports alone."""

import pkgutil
import subprocess
import sys

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


@pytest.mark.slow
def test_each_module_imports_alone() -> None:
    done = subprocess.run([sys.executable, "-c", ALONE, *MODULES], capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stdout + done.stderr
