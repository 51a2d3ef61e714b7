"""No import goes round in a circle: so each module imports alone, and in whatever order."""

import pkgutil
import subprocess
import sys

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

IN_A_CIRCLE = """
import builtins, importlib, sys
found, plain = [], builtins.__import__

def watched(name, space=None, local=None, wanted=(), level=0):
    for module in (name, *(f"{name}.{one}" for one in wanted or ())):
        spec, into = getattr(sys.modules.get(module), "__spec__", None), (space or {}).get("__name__", "")
        ours = module.partition(".")[0] in ("rvaft", "backends", "cross_check")
        if ours and getattr(spec, "_initializing", False) and not into.startswith(f"{module}."):  # a package is first
            found.append(f"{into} imports {module}, which is being imported")
    return plain(name, space, local, wanted, level)

builtins.__import__ = watched
for module in sys.argv[1:]:
    importlib.import_module(module)
sys.exit("\\n".join(found) or 0)
"""


def test_no_import_goes_round_in_a_circle() -> None:
    done = subprocess.run([sys.executable, "-c", IN_A_CIRCLE, *MODULES], capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
