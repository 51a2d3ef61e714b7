"""What an engine says it waits for, held against the partial matches of the reference."""

from collections.abc import Iterator
from contextlib import suppress
from itertools import islice
from random import Random
from typing import Any

import pytest

import rvaft
from cross_check.generate.traces import random_trace
from rvaft.core.restriction import restrict
from rvaft.engine import Engine
from rvaft.errors import TreeError
from rvaft.model.nodes import Kind
from rvaft.model.tree import RVAFT
from rvaft.model.verdict import Verdict
from rvaft.monitors import Awaited, Ended, Pending
from rvaft.semantics import Reference, branches
from rvaft.semantics.events import observe
from rvaft.semantics.reference import Partial
from tests.engine.checking import Trace, small_valid_trees
from tests.engine.dense import SHAPES, WILD, dense_trace, living_trace, tree_of
from tests.engine.windowed import timed_trace, windowed_trees
from tests.tables import sampled


def cases(shape: str) -> Iterator[tuple[Random, RVAFT, list[dict[str, Any]]]]:
    """Random trees with a trace each that is alive for a while, whatever the semantics, and then goes on anyhow."""
    random = Random(f"pending {shape}")
    if shape == "apart":
        yield from (
            (random, tree, timed_trace(random, tree, 9)) for tree in islice(windowed_trees(random, late=""), 40)
        )
        return
    for tree in islice(small_valid_trees(lambda: tree_of(random, shape)), 8 if shape in SHAPES else 16):
        if shape in SHAPES:
            start, end = living_trace(random, tree, shape, "strict", 4), dense_trace(random, SHAPES[shape], 2)
        else:
            start = random_trace(random, tree)
            start, end = start[: random.randint(0, 3)], random_trace(random, tree)[::-1]
        yield random, tree, [*start, *end]


def references(tree: RVAFT, semantics: str, kind: str | None = None) -> dict[int, Reference]:
    """A reference for every feasible branch that the monitor of a tree looks at."""
    found = {}
    for number, nodes in enumerate(branches(tree), 1):
        if kind is None or any(tree.nodes[name].kind is Kind(kind) for name in nodes):
            with suppress(TreeError):
                found[number] = Reference(tree, semantics, branch=number)
    return found


def enabled(reference: Reference, partial: Partial) -> frozenset[str]:
    """The nodes whose occurrences come next in a partial match."""
    scenario = reference.scenarios[partial.scenario]
    left = scenario.occurrences - partial.assigned
    before = scenario.orders[partial.order]
    return frozenset(scenario.observing[name].name for name in left if before[name] <= partial.assigned)


def defined(by_branch: dict[int, Reference]) -> dict[Any, set[str]]:
    """The nodes that each branch waits for, by definition."""
    parts = ((number, [enabled(r, p) for p in r._partials.values()]) for number, r in by_branch.items())
    return {number: set().union(*nodes) for number, nodes in parts if nodes}


def names(record: Pending) -> set[str]:
    return {awaited.node for awaited in record.awaited}


def told(pending: tuple[Pending, ...]) -> dict[Any, set[str]]:
    """The nodes that each branch waits for, as a monitor says."""
    return {one.branch: set().union(*(names(p) for p in pending if p.branch == one.branch)) for one in pending}


def check_variables(by_branch: dict[int, Reference], pending: tuple[Pending, ...]) -> None:
    """Each record belongs to partial matches with these values; each partial match has a record."""
    for number, reference in by_branch.items():
        partials = [(p.binding, enabled(reference, p)) for p in reference._partials.values()]
        records = [(record.variables.items(), names(record)) for record in pending if record.branch == number]
        agree = [[all(n in b and b[n] == v for n, v in values) for b, _ in partials] for values, _ in records]
        for (_, awaited), fits in zip(records, agree, strict=True):
            assert awaited <= set().union(*(nodes for (_, nodes), fit in zip(partials, fits, strict=True) if fit))
        for place, (_, nodes) in enumerate(partials if reference.semantics != "scattered" else ()):
            assert any(fits[place] and nodes <= awaited for (_, awaited), fits in zip(records, agree, strict=True))


def follow(tree: RVAFT, trace: Trace, semantics: str, kind: str | None = None) -> tuple[int, bool]:
    """How many times the engine waited for what the definition says, and whether it ended."""
    by_branch = references(tree, semantics, kind)
    if not by_branch:
        return 0, False
    engine = Engine(restrict(tree, kind=kind), semantics)
    before = engine.pending()
    assert told(before) == defined(by_branch)
    for position, event in enumerate(trace, 1):
        engine.step(event)
        for reference in by_branch.values():
            reference.step(event)
        if engine.verdict.final:
            assert engine.pending() == ()
            expected = Ended(position, before) if engine.verdict is Verdict.FALSE else None
            assert engine.ended == expected
            return position - 1, expected is not None
        assert engine.ended is None
        before = engine.pending()
        assert told(before) == defined(by_branch), trace[:position]
        check_variables(by_branch, before)
        assert told(engine.pending(limit=0)) == {None: set().union(*defined(by_branch).values())}
    return len(trace), False


@pytest.mark.parametrize("shape", sampled([*SHAPES, *WILD], 9, ci=2))
@pytest.mark.parametrize("semantics", ["strict", "projected"])
def test_pending_is_what_the_definition_says(shape: str, semantics: str) -> None:
    compared = ended = 0
    for random, tree, trace in cases(shape):
        kind = random.choice([None, None, "fault"])
        if kind is not None and not any(tree.nodes[n].kind is Kind(kind) for b in branches(tree) for n in b):
            kind = None
        steps, end = follow(tree, trace, semantics, kind)
        compared, ended = compared + steps, ended + end
    assert compared
    assert ended


NV = "event n(v) = { n: v }; event w(v) = { w: v }; event f(v, w) = { f: v, g: w }; "
KNOWN: list[tuple[str, list[dict[str, Any]]]] = [
    # after `t` alone `p` is out of the question, and `s` is in nothing else
    ("top or p q; p sand s t; q and t r;", [{"event": "t"}]),
    ("top 1of2 p q; p sand s t; q and t r;", [{"event": "t"}]),
    # a guard that waits for the last event does not hide it
    (f"{NV} top and p q g; p and a s; q and s b; a on n(X); b on w(Y); g when X != Y;", [{"n": 1}, {"event": "s"}]),
    # both matches have taken the same occurrences, but one of them in an order that `p` does not allow
    (
        (
            f"{NV} a on n(X); s on n(Y); t on f(X, Y); top and x y t; x 1of2 p q; p and p1 p2; p1 sand a s; q "
            "and a s q2; y and s r;"
        ),
        [{"n": 1}, {"n": 2}],
    ),
]


@pytest.mark.parametrize(("tree", "trace"), KNOWN)
def test_what_was_once_hard(tree: str, trace: list[dict[str, Any]]) -> None:
    assert follow(rvaft.loads(tree), trace, "strict") == (len(trace), False)


@pytest.mark.parametrize("shape", sampled([*SHAPES, *WILD, "apart"], 9, ci=4))
def test_scattered_waits_for_nothing_else_and_for_all_that_matters(shape: str) -> None:
    """Partial matches that another can replace are not followed, so not all that the definition has is waited for.

    But nothing that is not waited for changes what is waited for, and the last event of a match was waited for.
    """
    compared = passed = detected = 0
    for _, tree, trace in cases(shape):
        by_branch = references(tree, "scattered")
        engine = Engine(tree, "scattered")
        for event in [*trace, *trace]:
            pending = engine.pending()
            waited, expected = told(pending), defined(by_branch)
            assert set(waited) == set(expected)
            assert all(waited[number] <= expected[number] for number in expected)
            assert tree.absences or all(waited.values())
            check_variables(by_branch, pending)
            engine.step(event)
            for reference in by_branch.values():
                reference.step(event)
            if engine.verdict.final:
                explanation = engine.explanation
                assert explanation is not None
                assert tree.absences or explanation.matched[-1].node in waited[explanation.branch]
                detected += 1
                break
            compared += 1
            if not tree.absences and not any(
                observe(tree, tree.nodes[name], event, {}) for nodes in waited.values() for name in nodes
            ):
                passed += 1
                assert engine.pending() == pending
    assert compared
    assert passed or "absen" in shape
    assert detected


def test_the_text_of_events_and_the_values_so_far() -> None:
    text = 'top or x y; x sand a b; y sand a2 c; a on e("a", V); b on e("b", V); a2 on e("a", _); c;'
    engine = Engine(rvaft.loads("event e(n, v) = { n: n, v: v };" + text), "projected")
    first, second = (Awaited("a", 'e("a", V)'), Awaited("b", 'e("b", V)'))
    assert engine.pending() == (Pending(1, (first,), {}), Pending(2, (Awaited("a2", 'e("a", _)'),), {}))
    engine.step({"n": "a", "v": 7})
    expected = (Pending(1, (second,), {"V": 7}), Pending(2, (Awaited("c", "c"),), {}))
    assert engine.pending() == expected
    assert engine.step({"n": "b", "v": 8}) is Verdict.FALSE
    assert engine.ended == Ended(2, expected)


def test_below_a_gate_that_waits_for_its_own_event_nothing_is_left() -> None:
    tree = rvaft.loads('causality bottom_up; event e(n) = { event: n }; top and v z; v 1of2 a b on e("v");')
    engine = Engine(tree, "scattered")
    engine.step({"event": "a"})
    assert told(engine.pending()) == {1: {"v", "z"}}


@pytest.mark.parametrize("semantics", ["strict", "scattered"])
def test_many_branches_are_taken_together(semantics: str) -> None:
    gates = " ".join(f"g{n} or a{n} b{n};" for n in range(20))
    engine = Engine(rvaft.loads(f"top and {' '.join(f'g{n}' for n in range(20))}; {gates}"), semantics)
    engine.step({"event": "a3"})
    assert told(engine.pending()) == {None: {f"{side}{n}" for n in range(20) for side in "ab" if n != 3}}


@pytest.mark.parametrize(
    ("semantics", "waits"), [("strict", "b"), ("projected", "b"), ("consecutive", "a"), ("scattered", "a")]
)
def test_what_its_times_rule_out_is_left_out_where_no_verdict_waits_for_its_end(semantics: str, waits: str) -> None:
    tree = "time ts as s; event n(v) = { n: v }; top sand a b within 1 s; a on n(1); b on n(2);"
    engine = Engine(rvaft.loads(tree), semantics)
    engine.step({"n": 1})
    assert told(engine.pending()) == {1: {waits}}


def test_an_undefined_time_rules_out_a_window_also_below_a_choice() -> None:
    tree = "time ts as s; event n(v) = { n: v }; top or x within 1 s; x sand a b; a on n(1); b on n(2);"
    engine = Engine(rvaft.loads(tree), "consecutive")
    engine.step({"n": 1})
    assert told(engine.pending()) == {1: {"a"}}


@pytest.mark.parametrize("semantics", ["consecutive", "scattered"])
def test_an_undefined_time_rules_out_one_branch(semantics: str) -> None:
    guarded = "b on n(2) when at(b) - at(a) <= 3 s;"
    engine = Engine(
        rvaft.loads(f"time ts as s; event n(v) = {{ n: v }}; top sand a x; x or b c; a on n(1); {guarded} c on n(3);"),
        semantics,
    )
    engine.step({"n": 1})
    assert told(engine.pending()) == {1: {"a"}, 2: {"a", "c"}}
    engine.step({"n": 1, "ts": 5})
    assert told(engine.pending()) == {1: {"a", "b"}, 2: {"a", "c"}}
