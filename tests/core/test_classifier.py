"""What is worked out once for many events is what the patterns and guards say of each."""

from typing import Any

from hypothesis import given, settings
from hypothesis import strategies as st

from rvaft.core.classifier import MEMORY, WIDEST, Discriminators, Letter, PatternIndex, reader
from rvaft.model.guards import COMPARISONS, Guard, Operation, Operator, holds
from rvaft.model.guards import variables as guard_variables
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
sides: st.SearchStrategy[Guard] = names.map(Variable) | scalars.map(Literal)
guards: st.SearchStrategy[Guard] = st.recursive(
    st.builds(
        lambda sign, name, side: Operation(sign, (Variable(name), side)),
        st.sampled_from(sorted(COMPARISONS)),
        names,
        sides,
    ),
    lambda parts: st.builds(
        lambda sign, *both: Operation(sign, both), st.sampled_from([Operator.AND, Operator.OR]), parts, parts
    ),
    max_leaves=3,
)


@given(st.lists(patterns, max_size=6), st.lists(events, max_size=12))
@settings(max_examples=100)
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
@settings(max_examples=100)
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
    """Whether a guard holds; a guard with a variable that the pattern does not bind never does."""
    return set(guard_variables(guard)) <= binding.keys() and holds(guard, binding)


def test_one_and_true_are_two_shapes_where_a_pattern_tells_them_apart() -> None:
    shapes = PatternIndex([ObjectPattern((("x", Literal(one)),)) for one in (1, True)], lambda decided: decided)
    found = [shapes.of({"x": value}).fits for value in (1, True, 1.0, False, "1", [1], 1)]
    assert found == [(0,), (1,), (0,), (), (), (), (0,)]


def test_shapes_without_end_and_wide_events_are_not_remembered() -> None:
    shapes = PatternIndex([ObjectPattern((("x", Literal("1")),))], lambda decided: decided)
    for width, remembered in ((WIDEST, 1), (WIDEST + 1, 1), (10 * WIDEST, 1)):
        assert shapes.of({"x": "1", **{f"f{n}": n for n in range(width - 1)}}).fits == (0,)
        assert len(shapes._memory) == remembered
    for number in range(2 * MEMORY):
        shapes.of({str(number): 1})
    assert len(shapes._memory) <= MEMORY
    assert shapes.of({"x": "1"}).fits == (0,)


def strings(pattern: Pattern) -> dict[str, str]:
    parts = pattern.fields if isinstance(pattern, ObjectPattern) else ()
    literals = ((field, part.value) for field, part in parts if isinstance(part, Literal))
    return {field: value for field, value in literals if isinstance(value, str)}


@given(st.lists(objects(leaves), max_size=8), events)
def test_candidates_are_those_whose_strings_the_event_has(some: list[Pattern], event: dict[str, Any]) -> None:
    told = Discriminators(some)
    assert all(strings(pattern).keys() & set(told.fields) for pattern in some if strings(pattern))
    expected = tuple(
        number
        for number, pattern in enumerate(some)
        if all(event.get(field) == value for field, value in strings(pattern).items() if field in told.fields)
    )
    assert told.candidates(told.values(event)) == expected
    assert {number for number, pattern in enumerate(some) if match(pattern, event, {}) is not None} <= set(expected)


class Counting(tuple[dict[str, str], ...]):
    """Counts how often something is taken out of it."""

    taken = 0

    def __getitem__(self, place: Any) -> Any:
        type(self).taken += 1
        return super().__getitem__(place)


def test_an_event_meets_only_the_patterns_that_ask_for_its_value() -> None:
    told = Discriminators(ObjectPattern((("event", Literal(f"e{number}")),)) for number in range(1000))
    told._asked = Counting(told._asked)
    for number in range(1000):
        assert told.candidates(told.values({"event": f"e{number}"})) == (number,)
    assert told.candidates(told.values({"event": "other"})) == ()
    assert Counting.taken == 1000
