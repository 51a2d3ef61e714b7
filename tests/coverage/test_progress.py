"""How far, in small trees where it is easy to see; and what makes many branches and many logs affordable."""

import pytest

from rvaft import loads
from rvaft.coverage import BranchCoverage, Coverage
from rvaft.engine.compiled_tree import CompiledTree, TreeLetters
from tests.tables import rows


def covered(tree: str, logs: dict[str, str], semantics: str) -> BranchCoverage:
    """The first branch after some logs of words."""
    coverage = Coverage(loads(tree), semantics, branch=1)
    for name, words in logs.items():
        coverage.add(name, [{"event": word} for word in words.split()])
    (branch,) = coverage.report().branches
    return branch


@pytest.mark.parametrize(("tree", "words", "semantics", "expected"), rows(__file__, "progress.txt"))
def test_progress(tree: str, words: str, semantics: str, expected: list[object]) -> None:
    branch = covered(tree, {"log": words}, semantics)
    awaited = " ".join(sorted(one.node for one in branch.awaited))
    assert [branch.reached, branch.needed, branch.event, awaited] == expected


@pytest.mark.parametrize("semantics", ["strict", "projected", "scattered"])
def test_a_branch_is_compiled_once_and_alone(monkeypatch: pytest.MonkeyPatch, semantics: str) -> None:
    count = 20
    text = f"top or {' '.join(f's{n}' for n in range(count))}; "
    for n in range(count):
        text += f"event e{n}(x) = {{ number: {n}, x: x }}; "
        text += f"s{n} sand a{n} b{n}; a{n} on e{n}(X); b{n} on e{(n + 1) % count}(X);"
    sizes: list[int] = []
    plain = TreeLetters.__init__

    def counting(self: TreeLetters, compiled: CompiledTree, *, decide: bool = False) -> None:
        plain(self, compiled, decide=decide)
        sizes.append(len(self.letters))

    monkeypatch.setattr(TreeLetters, "__init__", counting)
    coverage = Coverage(loads(text), semantics)
    assert (len(sizes), sum(sizes)) == (1 + count, count + 2 * count)
    for number in range(5):
        coverage.add(f"log {number}", [{"number": number, "x": 1}, {"number": number + 1, "x": 1}])
    assert len(sizes) == 1 + count
    assert [branch.detected for branch in coverage.report().branches] == [1] * 5 + [0] * (count - 5)


def test_an_event_of_another_branch_is_relevant_all_the_same() -> None:
    logs = {"log": "a noise c b", "quiet": "noise a noise b"}
    branch = covered("top or x y; x sand a b; y sand c d;", logs, "projected")
    assert (branch.detected, branch.log, branch.event) == (1, "quiet", 4)


@pytest.mark.parametrize("semantics", ["strict", "projected", "scattered"])
def test_a_log_leaves_nothing_behind_for_the_next(semantics: str) -> None:
    tree = "event e(x) = { event: x }; top sand a b c; a on e(X); b on e(X); c on e(X);"
    branch = covered(tree, {f"log {log}": str(log) for log in range(4)}, semantics)
    assert (branch.reached, branch.log, branch.event) == (1, "log 0", 1)
