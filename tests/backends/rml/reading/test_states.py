"""States of monitors, and texts that are long or deep."""

from random import Random

import pytest

from backends.rml.reader import monitor as rules
from backends.rml.reader.monitor import read
from rvaft.errors import TooLarge
from rvaft.model.values import Json
from rvaft.monitors import Monitor
from tests.backends.rml.reading.letters import letters
from tests.backends.rml.reading.programs import Programs, event

A = "a matches {e:'a'};\nb matches {e:'b'};\nc matches {e:'c'};\nav(x) matches {e:'a', v:x};\nbv(x) matches {e:'b', v:x};\n"
EVENTS = [{"e": "a"}, {"e": "b"}, {"e": "c"}]


def _after(text: str, events: list[Json]) -> Monitor:
    monitor = read(text)
    for one in events:
        monitor.step(one)
    return monitor


@pytest.mark.parametrize(
    ("text", "one", "other", "same"),
    [
        ("Main = (a b \\/ b b) c all;", "a", "b", True),
        ("Main = (a | b) c all;", "a b", "b a", True),
        ("Main = a Main \\/ b all;", "a", "a a a", True),
        ("Main = a b a all;", "a", "a b", False),
        ("Main = {let x; (av(x) b) | (a b)};", "a", "b", False),
    ],
)
def test_states_that_mean_the_same_are_the_same(text: str, one: str, other: str, same: bool) -> None:
    states = [_after(A + text, [{"e": e} for e in events.split()]).state for events in (one, other)]
    assert (states[0] == states[1]) is same
    assert not same or hash(states[0]) == hash(states[1])


def test_values_are_part_of_the_state() -> None:
    text = A + "Main = {let x; av(x) bv(x) all};"
    states = [_after(text, [{"e": "a", "v": v}]).state for v in (1, 2, 1, True)]
    assert states[0] == states[2]
    assert len(set(states)) == 3


def test_a_bound_loop_has_few_states() -> None:
    text = A + "nobv(x) not matches bv(x);\nMain = {let x; nobv(x) Loop};\nLoop = c Loop \\/ bv(x) all;"
    monitor = read(text)
    seen = set()
    for one in [{"e": "a"}, *[{"e": "c"}] * 20]:
        monitor.step(one)
        seen.add(monitor.state)
    assert len(seen) == 1


@pytest.mark.parametrize("seed", range(40))
def test_equal_states_have_equal_futures(seed: int) -> None:
    random = Random(seed)
    text = Programs(random).text()
    known: dict[object, list[Json]] = {}
    for _ in range(60):
        past = [event(random) for _ in range(random.randint(0, 4))]
        try:
            before = known.setdefault(_after(text, past).state, past)
            for _ in range(2):
                future = [event(random) for _ in range(5)]
                runs = [letters(text, [*start, *future])[len(start) :] for start in (past, before)]
                assert runs[0] == runs[1]
        except TooLarge:
            return


# -- long and deep -----------------------------------------------------------------------------------------------------


def _run(text: str, events: list[Json]) -> str:
    return letters(A + text, events)[-1]


def test_a_long_sequence() -> None:
    assert _run(f"Main = {'a ' * 5000} all;", [EVENTS[0]] * 5000) == "T"


def test_a_long_sequence_of_what_may_be_left_out() -> None:
    assert _run(f"Main = {'a? ' * 5000} b all;", [EVENTS[1]]) == "T"


def test_a_long_shuffle() -> None:
    text = f"Main = ({' | '.join(['a'] * 2999)} | b) c;"
    assert _run(text, [EVENTS[1], EVENTS[0], EVENTS[0]]) == "?"


def test_a_long_union_and_a_long_conjunction() -> None:
    assert _run("Main = " + " \\/ ".join(["a"] * 3000) + " \\/ b;", [EVENTS[1]]) == "T"
    assert _run("Main = " + " /\\ ".join(["a b"] * 3000) + ";", EVENTS[:2]) == "T"


@pytest.mark.parametrize("guard", ["a ", ""])
def test_a_chain_of_equations(guard: str) -> None:
    chain = "".join(f"E{i} = {guard}E{i + 1};\n" for i in range(5000))
    text = f"Main = E0;\n{chain}E5000 = b all;"
    assert _run(text, [*([EVENTS[0]] * (5000 if guard else 0)), EVENTS[1]]) == "T"


@pytest.mark.parametrize(
    ("before", "after", "trace"),
    [
        ("(", ")", [0]),
        ("(", ")*", [0]),
        ("(b \\/ ", ")", [0]),
        ("(c | ", ")", [0]),
        ("(a /\\ ", ")", [0]),
        ("(b? ", ")", [0]),
        ("(", " c)", [0, 2]),
        ("b >> (", ") : any*", [0]),
        ("{let x; ", "}", [0]),
        ("if (1 < 2) (", ") else b", [0]),
        ("(", "){2}", [0]),
    ],
)
def test_deep_nesting(before: str, after: str, trace: list[int]) -> None:
    text = f"Main = {before * 3000}a{after * 3000};"
    assert len(letters(A + text, [EVENTS[i] for i in trace])) == len(trace)


def test_deep_patterns_and_data() -> None:
    deep = "{k:" * 3000 + "'x'" + "}" * 3000
    value: Json = "x"
    for _ in range(3000):
        value = {"k": value}
    assert letters(f"p matches {deep};\nMain = p all;", [value]) == "T"
    total = "+1" * 5000
    assert letters(f"p(x) matches {{v:x}} with x{total} > 5000;\nMain = p(x) all;", [{"v": 1}]) == "T"
    nested = "(" * 3000 + "x" + ")" * 3000
    assert letters(f"p(x) matches {{v:x}} with {nested} > 0;\nMain = p(x) all;", [{"v": 1}]) == "T"
    assert (
        letters(f"p(x) matches {{v:x}};\nMain = G<1>;\nG<n> = if (n{total} > 5000) any else p(n);", [{"v": 2}]) == "T"
    )


def test_a_deep_value_is_bound() -> None:
    value: Json = 1
    for _ in range(5000):
        value = [value]
    assert _run("Main = {let x; av(x) bv(x) all};", [{"e": "a", "v": value}, {"e": "b", "v": value}]) == "T"


@pytest.mark.parametrize("body", ["a G<0>", "a (b | G<0>)"], ids=["may halt", "step"])
def test_unfolding_without_an_event_has_a_limit(body: str, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(rules, "DEPTH_LIMIT", 1000)
    monitor = read(A + f"Main = {body};\nG<n> = (if (n >= 0) empty else a) G<n+1>;")
    with pytest.raises(TooLarge):
        list(monitor.run([{"e": "a"}, {"e": "c"}]))


def test_choices_in_a_conjunction_do_not_explode() -> None:
    types = "".join(f"t{i}(x) matches {{v:x}} | {{w:x}};\n" for i in range(40))
    parts = " /\\ ".join(f"t{i}(x{i})" for i in range(40))
    variables = ", ".join(f"x{i}" for i in range(40))
    assert letters(types + f"Main = {{let {variables}; ({parts}) all}};", [{"v": 1, "w": 2}]) == "T"
