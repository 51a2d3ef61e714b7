"""Fault trees in Galileo's format against the failures themselves (`failures.py`): each tree that is read detects
its top failure at the event at which it fails, and at no other.
"""

from collections import Counter
from collections.abc import Iterator
from contextlib import suppress
from itertools import permutations
from pathlib import Path
from random import Random

import pytest

from rvaft import RVAFT, Gate, LanguageError, TreeError, Verdict, load, monitor
from rvaft.language.parser import parse
from tests.language.failures import NEVER, FaultTree, failures, orders, random_spares, random_text, read
from tests.language.test_galileo_corpus import FILES, needs_corpus
from tests.tables import rows, sampled

MAX_PERMUTED = 4
"""The number of events of which all orders are tried."""


def detected(tree: RVAFT, order: list[str]) -> int:
    """Return the position (from 1) of the event that detects, or NEVER."""
    try:
        watching = monitor(tree)
    except TreeError as error:
        if error.rule != "no-scenario":
            raise
        return NEVER
    for position, name in enumerate(order, 1):
        if watching.step({"event": name}) == Verdict.TRUE:
            return position
    return NEVER


def agree(tree: RVAFT, facts: FaultTree, order: list[str]) -> int:
    """Compare a tree with the failures in one order, and return when the top fails."""
    at = failures(facts, order)[facts.top]
    assert detected(tree, order) == at, order
    return at


@pytest.mark.parametrize(("text", "order", "position"), sampled(rows(__file__, "priority.txt"), 4))
def test_priority_gates(text: str, order: str, position: int | None) -> None:
    tree, facts = parse(text, "tree.dft").build(), read(text)
    assert failures(facts, order.split())[facts.top] == (position or NEVER)
    for some in permutations(facts.events) if len(facts.events) <= MAX_PERMUTED else orders(facts, Random(text), 10):
        agree(tree, facts, list(some))
    agree(tree, facts, order.split())


@pytest.mark.parametrize(("text", "error"), rows(__file__, "refused_priority.txt"))
def test_what_has_no_exact_translation_is_refused(text: str, error: str) -> None:
    with pytest.raises(LanguageError) as caught:
        parse(text, "tree.dft")
    assert error in str(caught.value)
    parse(text, "tree.rvaft").build()  # where `pand` is that of this language


def test_a_leaf_with_an_event_of_its_own(tmp_path: Path) -> None:
    """Its absence has its pattern and guard, for any value of what it alone binds."""
    (tmp_path / "tree.dft").write_text("toplevel T; T pand X B; X or x y; B or b c; x; y; c;")
    (tmp_path / "more.rvaft").write_text(
        'import "tree.dft"; X fault label "First"; event stall(axis, amp) = { stall: axis, amp: amp };'
        'b on stall("b", A) when A > 5 attack;'
    )
    tree = load(tmp_path / "more.rvaft")
    for amp, expected in ((9, NEVER), (4, 3)):
        watching = monitor(tree)
        told = [watching.step(event) for event in ({"stall": "b", "amp": amp}, {"event": "x"}, {"event": "c"})]
        assert (told.index(Verdict.TRUE) + 1 if Verdict.TRUE in told else NEVER) == expected
    assert [*monitor(tree, kind="attack").run([{"event": "y"}, {"event": "c"}])] == [Verdict.UNKNOWN] * 2
    assert [*monitor(tree, kind="attack").run([{"event": "y"}, {"stall": "b", "amp": 6}])][-1] == Verdict.TRUE


@pytest.mark.parametrize(("text", "order", "position"), rows(__file__, "spares.txt"))
def test_shared_spares(text: str, order: str, position: int | None) -> None:
    """Also when a cold spare fails before it is taken."""
    tree, facts = parse(text, "tree.dft").build(), read(text)
    assert failures(facts, order.split())[facts.top] == (position or NEVER)
    for some in permutations(facts.events) if len(facts.events) <= MAX_PERMUTED else some_orders(facts, 12):
        agree(tree, facts, list(some))
    agree(tree, facts, order.split())


def some_orders(facts: FaultTree, number: int) -> Iterator[list[str]]:
    random = Random(facts.top)
    for _ in range(number):
        yield random.sample(facts.events, len(facts.events))


def holds(tree: RVAFT, order: list[str]) -> int:
    """Return the position (from 1) at which the root holds, where each leaf is observed at most once, or NEVER.

    Then all gates see a leaf at one position, and a sequence whose later part is a leaf asks that it comes last.
    """
    at: dict[str, int] = {name: position for position, name in enumerate(order, 1)}
    for node in tree.bottom_up():
        below = [at.get(child, NEVER) for child in node.children]
        match node.gate:
            case None:
                continue
            case Gate.SAND | Gate.PAND:
                later = [tree.nodes[child] for child in node.children[1:]]
                assert node.gate is Gate.PAND or all(one.leaf for one in later)
                found = below[-1] if below == sorted(set(below)) else NEVER
            case Gate.AND:
                found = max(below)
            case _:
                found = sorted(below)[(node.threshold or 1) - 1]
        at[node.name] = found
    return at.get(tree.root, NEVER)


def test_random_shared_spares_in_all_orders() -> None:
    """By the positions of failures, which is quick, for trees without absent events."""
    found: Counter[str] = Counter()
    for seed in range(150):
        text = random_spares(Random(f"spares {seed}"))
        facts = read(text)
        try:
            tree = parse(text, "tree.dft").build()
        except LanguageError as error:
            found["refused" if "share" in str(error) or "spare" in str(error) else str(error)] += 1
            continue
        if facts.shared and not any(node.without for node in tree.nodes.values()):
            few = len(facts.events) <= MAX_PERMUTED + 1
            for some in permutations(facts.events) if few else some_orders(facts, 120):
                order = list(some)
                at = failures(facts, order)[facts.top]
                assert holds(tree, order) == at, (text, order)
                found["fails" if at < NEVER else "works"] += 1
    assert set(found) == {"refused", "fails", "works"}
    assert min(found["fails"], found["works"]) > 500


def test_monitors_of_random_shared_spares() -> None:
    compared = 0
    for seed in range(60):
        text = random_spares(Random(f"spares {seed}"))
        facts = read(text)
        with suppress(LanguageError):
            tree = parse(text, "tree.dft").build()
            if facts.shared and tree.nodes[tree.root].gate is Gate.OR and len(facts.events) < 6:
                compared += sum(agree(tree, facts, order) > 0 for order in some_orders(facts, 4))
    assert compared > 20


def test_random_fault_trees() -> None:
    translated = failed = 0
    for seed in range(80):
        random = Random(f"failures {seed}")
        text = random_text(random)
        try:
            tree = parse(text, "tree.dft").build()
        except LanguageError:
            continue
        translated += any(node.without for node in tree.nodes.values())
        facts = read(text)
        for order in orders(facts, random, 2):
            failed += agree(tree, facts, order) < NEVER
    assert translated >= 3
    assert failed >= 80


@needs_corpus
@pytest.mark.parametrize("path", [p for p in FILES if " pand " in p.read_text()], ids=lambda path: path.stem)
def test_files_of_the_corpus_with_priority_gates(path: Path) -> None:
    compare(path, number=4)


@needs_corpus
@pytest.mark.ci
@pytest.mark.parametrize("path", FILES, ids=lambda path: str(path.stem))
def test_files_of_the_corpus(path: Path) -> None:
    compare(path, number=20 if " pand " in path.read_text() else 3)


def compare(path: Path, *, number: int) -> None:
    """Compare a file with the failures, if it is read, in some or all orders."""
    facts = read(path.read_text())
    try:
        tree = load(path)
    except LanguageError:
        return
    if facts.shared:  # monitors of so many shared nodes are too slow
        tried = orders(facts, Random(path.stem), number) if facts.enforced else some_orders(facts, 10 * number)
        for order in tried:
            assert holds(tree, order) == failures(facts, order)[facts.top], order
        return
    free = not facts.enforced and len(facts.events) <= MAX_PERMUTED
    for some in permutations(facts.events) if free else orders(facts, Random(path.stem), number):
        agree(tree, facts, list(some))
