"""The examples in docstrings run, and every public name has one."""

import doctest
import importlib
import inspect
import pkgutil
from importlib.util import find_spec
from types import ModuleType

import pytest

import backends
import cross_check
import rvaft
from tests.docs.examples import ROOT

EXTRAS = ("hypothesis", "matplotlib", "pandas", "spot", "websockets", "yaml")
"""What an example may need that is not everywhere."""
MODULES = sorted(
    found.name
    for package in (rvaft, backends, cross_check)
    for found in pkgutil.walk_packages(package.__path__, f"{package.__name__}.")
    if not found.name.endswith("__main__")
)


def examples(module: ModuleType) -> list[doctest.DocTest]:
    """The examples of a module and of everything in it."""
    return [test for test in doctest.DocTestFinder(exclude_empty=True).find(module) if test.examples]


@pytest.mark.parametrize("name", MODULES)
def test_examples_run(name: str, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(ROOT)
    absent = [library for library in EXTRAS if find_spec(library) is None]
    try:
        found = examples(importlib.import_module(name))
    except ImportError as error:
        if error.name not in EXTRAS:
            raise
        pytest.skip(f"needs {error.name}")
    said: list[str] = []
    for test in found:
        text = "".join(example.source for example in test.examples)
        if "spot" in absent and ("ltlf" in text or "automaton" in text):
            continue
        doctest.DocTestRunner(optionflags=doctest.ELLIPSIS | doctest.IGNORE_EXCEPTION_DETAIL).run(test, out=said.append)
    assert not said, "".join(said)


@pytest.mark.parametrize("name", [name for name in rvaft.__all__ if name != "__version__"])
def test_every_public_name_shows_how_it_is_used(name: str) -> None:
    assert ">>> " in (inspect.getdoc(getattr(rvaft, name)) or "")
