"""Mistakes planted into the product's own code, one place at a time.

Most are an edit of a function's source: the fragment to replace has to occur exactly once, so that a fault cannot silently
become none when the code changes.
"""

import inspect
from collections.abc import Callable, Hashable
from dataclasses import dataclass
from functools import cached_property
from importlib import import_module
from pkgutil import walk_packages
from sys import modules
from textwrap import dedent
from types import FunctionType, ModuleType
from typing import Any, Final, TypeAlias

from pytest import MonkeyPatch  # noqa: PT013

Plant: TypeAlias = Callable[[MonkeyPatch], None]

PLACES: Final = (
    "backends.rml",
    "backends.ltlf",
    "backends.automaton",
    "rvaft.engine",
    "rvaft.analysis.pattern_index",
    "rvaft.model.guards",
    "rvaft.analysis.pattern_index",
)
"""Where faults go: what no other participant, and least of all the reference, has in common with the faulty one."""

_APART: Final = ("backends.ltlf.mona", "backends.rml.paper", "backends.rml.prolog")
"""What is no part of a faithful participant, and may need tools of others."""


@dataclass(frozen=True, slots=True)
class Fault:
    """One mistake: the participant that it makes wrong, and why what comes out is not equivalent."""

    name: str
    participant: str
    why: str
    plant: Plant


def edit(where: str, old: str, new: str) -> Plant:
    """Replaces a fragment in the source of a function, a method or a property (`module:name` or `module:Class.name`)."""

    def plant(patch: MonkeyPatch) -> None:
        owner, name, found = _located(where)
        source = dedent(inspect.getsource(_function(found)))
        assert source.count(old) == 1, f"{where} has {old!r} {source.count(old)} times, not once"
        module = modules[_function(found).__module__]
        made: dict[str, Any] = {}
        exec(compile(source.replace(old, new), f"<fault in {where}>", "exec"), vars(module), made)
        if isinstance(made[name], cached_property):
            made[name].__set_name__(owner, name)
        _put(patch, owner, name, made[name])

    return plant


def put(where: str, new: Any) -> Plant:
    """Another function in its place; under a name that a module has imported or a class inherits, there alone."""

    def plant(patch: MonkeyPatch) -> None:
        owner, name, _ = _located(where)
        assert hasattr(owner, name), f"nothing is called {where}"
        patch.setattr(owner, name, new)

    return plant


def entry(where: str, key: Hashable, value: Any) -> Plant:
    """Another value in a table."""

    def plant(patch: MonkeyPatch) -> None:
        _, _, table = _located(where)
        assert table[key] != value
        patch.setitem(table, key, value)

    return plant


def both(*plants: Plant) -> Plant:
    """One mistake that takes two edits, since the first alone makes a text that nobody can read."""

    def plant(patch: MonkeyPatch) -> None:
        for one in plants:
            one(patch)

    return plant


def with_globals(function: Callable[..., Any], **others: Any) -> Callable[..., Any]:
    """A copy of a function that sees other things under these names of its module."""
    assert isinstance(function, FunctionType)
    assert others.keys() <= set(function.__code__.co_names), "the function does not use all of these names"
    return FunctionType(function.__code__, {**function.__globals__, **others}, function.__name__)


def import_all() -> None:
    """Import what is otherwise imported on use: a module first imported while a fault is planted would keep it."""
    for place in PLACES:
        for found in walk_packages(getattr(import_module(place), "__path__", ()), f"{place}."):
            if not found.name.startswith(_APART):
                import_module(found.name)


def clear_caches() -> None:
    """Forget everything that functions of the product remember."""
    for name, module in list(modules.items()):
        if name.startswith(("backends.", "rvaft.")):
            for value in list(vars(module).values()):
                if callable(clear := getattr(value, "cache_clear", None)) and value.__module__ == name:
                    clear()


def _located(where: str) -> tuple[Any, str, Any]:
    """Where a thing is kept, under which name, and the thing itself."""
    assert where.startswith(PLACES), f"{where} is code that others share"
    path, _, names = where.partition(":")
    *outer, name = names.split(".")
    owner: Any = import_module(path)
    for one in outer:
        owner = getattr(owner, one)
    return owner, name, vars(owner).get(name)


def _function(found: Any) -> Any:
    """The function behind a method, a property or a cache."""
    match found:
        case property():
            return found.fget
        case cached_property():
            return found.func
        case staticmethod() | classmethod():
            return found.__func__
        case _:
            return inspect.unwrap(found)


def _put(patch: MonkeyPatch, owner: Any, name: str, new: Any) -> None:
    """In its place, and wherever it was imported to."""
    old = vars(owner)[name]
    patch.setattr(owner, name, new)
    if isinstance(owner, ModuleType):
        for path, module in list(modules.items()):
            if path.startswith(PLACES) and vars(module).get(name) is old:
                patch.setattr(module, name, new)
