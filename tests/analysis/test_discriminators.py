"""Which patterns an event can fit at all, by the fields that tell event types apart."""

from typing import Any

from hypothesis import given
from hypothesis import strategies as st

from rvaft.analysis.pattern_index import Discriminators
from rvaft.model.patterns import Literal, ObjectPattern, Pattern, Variable, match

fields = st.sampled_from(["topic", "name", "kind"])
parts: st.SearchStrategy[Pattern] = st.sampled_from([Literal("t"), Literal("u"), Literal(1), Variable("V")])
patterns: st.SearchStrategy[list[Pattern]] = st.lists(
    st.dictionaries(fields, parts, max_size=3).map(lambda found: ObjectPattern(tuple(found.items()))), max_size=8
)
events = st.dictionaries(fields, st.sampled_from(["t", "u", "other", 1, True, None]), max_size=3)


def strings(pattern: Pattern) -> dict[str, str]:
    assert isinstance(pattern, ObjectPattern)
    literals = ((field, part.value) for field, part in pattern.fields if isinstance(part, Literal))
    return {field: value for field, value in literals if isinstance(value, str)}


@given(patterns, events)
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
