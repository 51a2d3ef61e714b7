"""A backend of somebody else that cannot be loaded is an error like any other, and stops nobody else."""

from importlib import import_module
from importlib.metadata import EntryPoint

import pytest

import rvaft
from cross_check.comparison import Roster
from cross_check.participants import Absent, faithful_backends
from cross_check.results import Job
from rvaft import Backend, Metrics, Semantics, ToolFailed
from rvaft import backend as backends
from rvaft.backend import SpecificationText
from rvaft.capabilities import JSON_VALUES, Feature, Ties
from rvaft.core.property import PARTS, Property
from rvaft.model.guards import Operator
from tests.cli.runs import TREES, failed, run

TREE = TREES / "gates" / "and.rvaft"


USERS = ("cross_check.participants", "cross_check.counterexamples", "rvaft.cli.emit", "rvaft.backend")
"""Modules that ask which backends there are; each is imported before anything is changed."""


def install(monkeypatch: pytest.MonkeyPatch, known: dict[str, EntryPoint]) -> None:
    """Let there be these backends and no others."""
    for module in [import_module(name) for name in USERS]:
        monkeypatch.setattr(module, "all_backends", lambda: known)


@pytest.fixture
def broken(monkeypatch: pytest.MonkeyPatch) -> str:
    known = {**backends.all_backends(), "broken": EntryPoint("broken", "no_such_module:Backend", backends.GROUP)}
    install(monkeypatch, known)
    return "broken"


def test_it_is_named_with_the_reason(broken: str) -> None:
    with pytest.raises(ToolFailed, match="the backend broken failed: it cannot be loaded: ModuleNotFoundError"):
        rvaft.translate(rvaft.load(TREE), broken)
    failed(run("emit", TREE, "--to", broken), "the backend broken failed")
    failed(run("monitor", TREE, "--backend", broken, "--word", "a"), "the backend broken failed")


def test_a_comparison_names_it_and_goes_on(broken: str) -> None:
    assert broken in faithful_backends()
    candidates = Roster().candidates(rvaft.load(TREE), Job("tree", Semantics.STRICT))
    absent = [(name, found.status) for name, enlist in candidates if isinstance(found := enlist(), Absent)]
    assert (broken, "could not run") in absent
    assert "rml" not in dict(absent)


class Spoken(Backend):
    """A language that is only emitted."""

    name, language, suffix, default_limit, readable = "spoken", "spoken", ".txt", 1, False

    semantics, says, operators = frozenset(Semantics), frozenset(PARTS), frozenset(Operator)
    features, values, ties = frozenset(Feature), JSON_VALUES, Ties.ANY

    def write(self, prop: Property, semantics: Semantics, limit: int) -> SpecificationText:  # noqa: ARG002
        return SpecificationText(f"first {prop.tree.root}", Metrics(symbols=2))


def test_a_language_that_is_only_emitted_is_in_the_way_of_nobody(monkeypatch: pytest.MonkeyPatch) -> None:
    spoken = EntryPoint("spoken", f"{__name__}:Spoken", backends.GROUP)
    install(monkeypatch, {"rml": backends.all_backends()["rml"], "spoken": spoken})
    assert run("emit", TREE, "--to", "spoken").stdout == "first top\n"
    assert run("cross-check", TREE).exit_code == 0
    named = run("cross-check", TREE, "--backends", "spoken")
    assert named.exit_code == 2
    assert "could not run: spoken has no reader, so its texts cannot be compared" in named.stdout
    failed(run("monitor", TREE, "--backend", "spoken", "--word", "a"), "spoken is only emitted")
    assert "yes" in next(line for line in run("backends").stdout.splitlines() if line.startswith("spoken"))
