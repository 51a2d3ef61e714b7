"""What makes many branches and many logs affordable: each branch is compiled once, and from what concerns it alone."""

import pytest

from rvaft import loads
from rvaft.coverage import Coverage
from rvaft.engine.compiled_tree import CompiledTree, TreeLetters
from rvaft.model.tree import RVAFT

BRANCHES = 20
TREE = (
    "".join(f"event e{n}(x) = {{ number: {n}, x: x }}; " for n in range(BRANCHES))
    + f"top or {' '.join(f's{n}' for n in range(BRANCHES))}; "
    + " ".join(f"s{n} sand a{n} b{n}; a{n} on e{n}(X); b{n} on e{(n + 1) % BRANCHES}(X);" for n in range(BRANCHES))
)


@pytest.mark.parametrize("semantics", ["strict", "projected", "scattered"])
def test_a_branch_is_compiled_once_and_alone(monkeypatch: pytest.MonkeyPatch, semantics: str) -> None:
    sizes: list[int] = []
    plain = TreeLetters.__init__

    def counting(self: TreeLetters, tree: RVAFT, compiled: CompiledTree) -> None:
        plain(self, tree, compiled)
        sizes.append(len(self.letters))

    monkeypatch.setattr(TreeLetters, "__init__", counting)
    coverage = Coverage(loads(TREE), semantics)
    assert len(sizes) == 1 + BRANCHES
    assert sum(sizes) == BRANCHES + 2 * BRANCHES
    for number in range(5):
        coverage.add(f"log {number}", [{"number": number, "x": 1}, {"number": number + 1, "x": 1}])
    assert len(sizes) == 1 + BRANCHES
    assert [branch.detected for branch in coverage.report().branches] == [1] * 5 + [0] * (BRANCHES - 5)


def test_an_event_of_another_branch_is_relevant_all_the_same() -> None:
    tree = loads("top or x y; x sand a b; y sand c d;")
    coverage = Coverage(tree, "projected", branch=1)
    coverage.add("log", [{"event": name} for name in ("a", "noise", "c", "b")])
    coverage.add("quiet", [{"event": name} for name in ("noise", "a", "noise", "b")])
    (branch,) = coverage.report().branches
    assert (branch.detected, branch.log, branch.event) == (1, "quiet", 4)


@pytest.mark.parametrize("semantics", ["strict", "projected", "scattered"])
def test_a_log_leaves_nothing_behind_for_the_next(semantics: str) -> None:
    coverage = Coverage(loads("event e(x) = { e: x }; top sand a b c; a on e(X); b on e(X); c on e(X);"), semantics)
    for log in range(4):
        coverage.add(f"log {log}", [{"e": log}])
    (branch,) = coverage.report().branches
    assert (branch.reached, branch.log, branch.event) == (1, "log 0", 1)
