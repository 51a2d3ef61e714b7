"""What is worked out once for many events is what the patterns and guards say of each."""

from typing import Any

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from rvaft import Verdict, loads, monitor
from rvaft.analysis.pattern_index import MEMORY, WIDEST, Letter, PatternIndex, reader
from rvaft.model.guards import Guard, Operation, Operator, holds, predicate
from rvaft.model.patterns import Anything, ListPattern, Literal, ObjectPattern, Pattern, Variable, match, rigid

fields = st.sampled_from(["topic", "name", "value", "x"])
scalars = st.sampled_from(
    [None, True, False, 0, 1, 1.0, -0.0, 2, 2.5, 2**53 + 1, 2.0**53, 10**20, 1e20, "", "t", "u", "1"]
)
json = st.recursive(
    scalars, lambda inner: st.lists(inner, max_size=2) | st.dictionaries(fields, inner, max_size=2), max_leaves=4
)
events = st.dictionaries(fields, json, max_size=4)
names = st.sampled_from(["V", "W", "_local"])


def objects(parts: st.SearchStrategy[Any]) -> st.SearchStrategy[ObjectPattern]:
    return st.dictionaries(fields, parts, max_size=3).map(lambda found: ObjectPattern(tuple(found.items())))


leaves: st.SearchStrategy[Pattern] = st.one_of(scalars.map(Literal), names.map(Variable), st.just(Anything()))
inner: st.SearchStrategy[Pattern] = st.recursive(
    leaves,
    lambda parts: objects(parts) | st.lists(parts, max_size=2).map(lambda found: ListPattern(tuple(found))),
    max_leaves=3,
)
patterns: st.SearchStrategy[Pattern] = st.one_of(objects(leaves), objects(inner), inner)
comparisons = st.sampled_from([Operator.EQ, Operator.NE, Operator.LT, Operator.LE, Operator.GT, Operator.GE])
operands: st.SearchStrategy[Guard] = st.one_of(
    names.map(Variable),
    scalars.map(Literal),
    st.builds(lambda name, value: Operation(Operator.ADD, (Variable(name), Literal(value))), names, scalars),
)
guards: st.SearchStrategy[Guard] = st.recursive(
    st.builds(lambda sign, left, right: Operation(sign, (left, right)), comparisons, operands, operands)
    | st.builds(
        lambda sign, name, value: Operation(sign, (Variable(name), Literal(value))), comparisons, names, scalars
    )
    | names.map(Variable),
    lambda parts: (
        st.builds(
            lambda sign, left, right: Operation(sign, (left, right)),
            st.sampled_from([Operator.AND, Operator.OR]),
            parts,
            parts,
        )
        | parts.map(lambda part: Operation(Operator.NOT, (part,)))
    ),
    max_leaves=4,
)


@given(st.lists(patterns, max_size=6), st.lists(events, max_size=12))
@settings(max_examples=300)
def test_a_shape_decides_as_the_patterns_do(some: list[Pattern], trace: list[dict[str, Any]]) -> None:
    shapes = PatternIndex(some, lambda decided: decided)
    for event in trace:
        fits, open_ = shapes.of(event)
        matching = [number for number, pattern in enumerate(some) if match(pattern, event, {}) is not None]
        assert set(fits) <= set(matching) <= {*fits, *open_}
        assert not set(fits) & set(open_)
        assert [*fits] == sorted(fits)
        assert [*open_] == sorted(open_)


@given(patterns, st.none() | guards, st.lists(events, max_size=6))
@settings(max_examples=300)
def test_a_letter_is_read_as_it_says(pattern: Pattern, when: Guard | None, trace: list[dict[str, Any]]) -> None:
    shapes = PatternIndex([pattern], lambda decided: decided)
    read = reader(0, Letter(pattern, when))
    for event in trace:
        if shapes.of(event) == ((), ()):
            continue
        found = match(pattern, event, {})
        if found is not None and when is not None:
            found = found if _holds(when, found) else None
        assert read.admits(event) == (found is not None)
        assert read.read(event) == (None if found is None else rigid(found))


def _holds(guard: Guard, binding: dict[str, Any]) -> bool:
    try:
        return holds(guard, binding)
    except KeyError:
        return False


@given(guards, scalars | json, scalars | json, scalars)
@settings(max_examples=500)
def test_a_predicate_holds_where_the_guard_does(guard: Guard, v: Any, w: Any, local: Any) -> None:
    binding = {"V": v, "W": w, "_local": local}
    assert predicate(guard)(binding) is holds(guard, binding)


def test_one_and_true_are_two_shapes_where_a_pattern_tells_them_apart() -> None:
    shapes = PatternIndex(
        [ObjectPattern((("x", Literal(1)),)), ObjectPattern((("x", Literal(True)),))], lambda decided: decided
    )
    assert [shapes.of({"x": value}).fits for value in (1, True, 1.0, False, "1", [1], 1)] == [
        (0,),
        (1,),
        (0,),
        (),
        (),
        (),
        (0,),
    ]


@pytest.mark.parametrize("event", [{f"f{n}": n for n in range(100)}, {"x": "1"}])
def test_shapes_without_end_are_forgotten(event: dict[str, Any]) -> None:
    shapes = PatternIndex([ObjectPattern((("x", Literal("1")),))], lambda decided: decided)
    for number in range(2 * MEMORY):
        shapes.of({str(number): 1})
        shapes.of(event)
    assert len(shapes._memory) <= MEMORY
    assert shapes.of({"x": "1"}).fits == (0,)


def test_wide_events_are_not_remembered() -> None:
    shapes = PatternIndex([ObjectPattern((("x", Literal("1")),))], lambda decided: decided)
    for width, remembered in ((WIDEST, 1), (WIDEST + 1, 1), (10 * WIDEST, 1)):
        assert shapes.of({"x": "1", **{f"f{n}": n for n in range(width - 1)}}).fits == (0,)
        assert len(shapes._memory) == remembered


def test_a_monitor_reads_what_a_shape_leaves_open() -> None:
    tree = loads(
        'event a(v) = { topic: "/t", deep: { value: v } }; event b(v) = { topic: "/t", value: v };'
        "toplevel r; r and x y; x on a(V); y on b(V);"
    )
    both = {"topic": "/t", "deep": {"value": 1}, "value": 2}
    trace = [both, {"topic": "/t", "deep": {"value": 2}}]
    assert list(monitor(tree, semantics="scattered").run(trace))[-1] is Verdict.TRUE
    assert list(monitor(tree, semantics="scattered").run([both, both]))[-1] is Verdict.UNKNOWN
