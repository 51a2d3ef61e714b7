"""The reader, as a monitor of any RML text: verdicts, deviations, errors, states, texts that are long or deep."""

from random import Random

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from backends.rml import RmlBackend
from backends.rml.reader import monitor as rules
from cross_check.published.rml_deviations import DEVIATIONS, touching
from rvaft.errors import LanguageError, TooLarge
from rvaft.model.values import Json
from rvaft.monitors import Monitor
from tests.backends.rml.programs import CASES, LETTERS, Case, Programs, event, events, letters, trace
from tests.tables import rows

read = RmlBackend().read


@pytest.mark.parametrize("case", CASES, ids=lambda case: case.name)
def test_the_reader_says_what_was_observed(case: Case) -> None:
    assert case.runs
    assert {trace: letters(case.text, events(trace)) for trace in case.runs} == case.runs


def test_names_are_distinct_and_random_programs_reach_every_verdict() -> None:
    assert len({case.name for case in CASES}) == len(CASES)
    random = Random(20)
    texts = [Programs(random).text() for _ in range(60)]
    assert {"T", "F", "?"} <= {letters(text, trace(random, text))[-1] for text in texts for _ in range(3)}


SHOWN = rows(__file__, "deviations.txt")


@pytest.mark.parametrize(("number", "text", "trace", "published", "reader"), SHOWN)
def test_the_reader_says_otherwise_and_the_row_is_touched(
    number: int, text: str, trace: list[Json], published: str, reader: str
) -> None:
    assert letters(text, trace) == reader
    assert number in [deviation.number for deviation in touching(text, trace)]


def test_every_row_is_shown_to_differ() -> None:
    assert {row[0] for row in SHOWN if row[3] != row[4]} == {deviation.number for deviation in DEVIATIONS}


UNTOUCHED = (
    ("a matches {e:'a'};\nMain = a all;", [{"e": "a", "v": 1.0}]),
    ("g(x) matches {v:x} with x > 1;\nMain = g(x) all;", [{"e": "a", "v": 2}]),
    ("a(x) matches {v:x};\nMain = {let x; a(x) a(x) all};", [{"v": [1, "b"]}, {"v": None}]),
    ("a matches {e:'a'};\nb matches {e:'b'};\nMain = (a | b) all;", [{"e": "a"}]),
    ("a(n) matches {v:n};\nMain = G<2>;\nG<n> = if (n > 0) a(n) G<n-1> else all;", [{"v": 2}, {"v": 1}]),
)


def test_the_predicates_are_not_always_true() -> None:
    assert [touching(*row) for row in UNTOUCHED] == [[]] * len(UNTOUCHED)
    runs = [(case.text, events(trace)) for case in CASES for trace in case.runs]
    assert sum(not touching(*run) for run in runs) > 0.8 * len(runs)


A = "a matches {e:'a'};\n"
ERRORS = [
    *rows(__file__, "errors.txt"),
    (f"a matches {{v:{'9' * 5000}}};\nMain = a;", 1, 14, "too many digits"),
    (f"a matches {{v:{'9' * 400}.0}};\nMain = a;", 1, 14, "too large"),
    (A + "Main = " + "a " * 5000 + ");", 2, 10008, "unexpected ')'"),
]


@pytest.mark.parametrize(("text", "line", "column", "words"), ERRORS, ids=lambda v: repr(v)[:40])
def test_errors_say_what_and_where(text: str, line: int, column: int, words: str) -> None:
    with pytest.raises(LanguageError) as caught:
        read(text)
    error = caught.value
    assert words in error.message
    assert (error.line, error.column) == (line, column)
    assert "\n" not in error.message
    assert len(error.source) <= 200
    assert error.caret.partition("\n")[0] == error.source
    assert error.__cause__ is None


def test_types_derived_from_each_other_have_a_limit() -> None:
    chain = "".join(f"t{i} matches t{i + 1};\n" for i in range(1000))
    with pytest.raises(TooLarge):
        read(chain + "t1000 matches {e:'a'};\nMain = t0;")


NAMES = "a b x S T Main matches not with all empty let var if else any none true false null abs max _ 1 2.5 'x' 'y' //"
SIGNS = "( ) { } [ ] < > << >> >= <= == != = ; : , . ... | || /\\ \\/ & && * + - / ^ ? !"


@settings(max_examples=200)
@given(
    st.lists(st.sampled_from(["\n", *NAMES.split(), *SIGNS.split()]), max_size=30).map(" ".join) | st.text(max_size=40)
)
def test_any_text_is_read_or_refused(words: str) -> None:
    for text in (words, A + f"Main = {words};"):
        try:
            monitor = read(text)
        except LanguageError:
            continue
        monitor.step({"e": "a", "v": 1})


def _after(text: str, events: list[Json]) -> Monitor:
    list((monitor := read(text)).run(events))
    return monitor


@pytest.mark.parametrize(("text", "one", "other", "same"), rows(__file__, "states.txt"))
def test_states_that_mean_the_same_are_the_same(text: str, one: str, other: str, same: bool) -> None:
    states = [_after(LETTERS + text, events(trace)).state for trace in (one, other)]
    assert (states[0] == states[1]) is same
    assert not same or hash(states[0]) == hash(states[1])


@pytest.mark.parametrize("seed", range(24))
def test_equal_states_have_equal_futures(seed: int) -> None:
    random = Random(seed)
    text = Programs(random).text()
    known: dict[object, list[Json]] = {}
    for _ in range(40):
        past = [event(random) for _ in range(random.randint(0, 4))]
        try:
            before = known.setdefault(_after(text, past).state, past)
            for _ in range(2):
                future = [event(random) for _ in range(5)]
                runs = [list(read(text).run([*start, *future]))[len(start) :] for start in (past, before)]
                assert runs[0] == runs[1]
        except TooLarge:
            return


def _deep(value: Json, around: str, times: int) -> Json:
    for _ in range(times):
        value = {"k": value} if around == "{" else [value]
    return value


def _chain(guard: str) -> str:
    return "Main = E0;\n" + "".join(f"E{i} = {guard}E{i + 1};\n" for i in range(1500)) + "E1500 = b all;"


TOTAL = "+1" * 5000
FORTY = [f"x{i}" for i in range(40)]
CHOICES = " /\\ ".join(f"t{i}(x{i})" for i in range(40))
MANY = "".join(f"t{i}(x) matches {{v:x}} | {{w:x}};\n" for i in range(40))
A_, B_, NESTED = {"e": "a"}, {"e": "b"}, _deep(1, "[", 5000)
LONG = [
    ("a sequence", f"Main = {'a ' * 2000} all;", [A_] * 2000, "T"),
    ("what may be left out", f"Main = {'a? ' * 2000} b all;", [B_], "T"),
    ("a shuffle", f"Main = ({' | '.join(['a'] * 1999)} | b) c;", [B_, A_, A_], "?"),
    ("a union", "Main = " + " \\/ ".join(["a"] * 2000) + " \\/ b;", [B_], "T"),
    ("a conjunction", "Main = " + " /\\ ".join(["a b"] * 1500) + ";", [A_, B_], "T"),
    ("equations", _chain("a "), [*[A_] * 1500, B_], "T"),
    ("equations without events", _chain(""), [B_], "T"),
    ("a pattern", f"p matches {'{k:' * 3000}'x'{'}' * 3000};\nMain = p all;", [_deep("x", "{", 3000)], "T"),
    ("a sum", f"p(x) matches {{v:x}} with x{TOTAL} > 5000;\nMain = p(x) all;", [{"v": 1}], "T"),
    ("parentheses", f"p(x) matches {{v:x}} with {'(' * 3000}x{')' * 3000} > 0;\nMain = p(x) all;", [{"v": 1}], "T"),
    (
        "an argument",
        f"p(x) matches {{v:x}};\nMain = G<1>;\nG<n> = if (n{TOTAL} > 5000) any else p(n);",
        [{"v": 2}],
        "T",
    ),
    ("a bound value", "Main = {let x; av(x) bv(x) all};", [{"e": "a", "v": NESTED}, {"e": "b", "v": NESTED}], "T"),
    ("choices in a conjunction do not explode", f"{MANY}Main = {{let {', '.join(FORTY)}; ({CHOICES}) all}};",
     [{"v": 1, "w": 2}], "T"),
]  # fmt: skip


@pytest.mark.parametrize(("what", "text", "trace", "last"), LONG, ids=[row[0] for row in LONG])
def test_what_is_long(what: str, text: str, trace: list[Json], last: str) -> None:
    assert letters(LETTERS + text, trace)[-1] == last


DEEP = ["(|)", "(|)*", "(b \\/ |)", "(c # |)", "(a /\\ |)", "(b? |)", "(| c)", "b >> (|) : any*", "{let x; |}"]


@pytest.mark.parametrize("around", [*DEEP, "if (1 < 2) (|) else b", "(|){2}"])
def test_what_is_deep(around: str) -> None:
    before, after = (part.replace("#", "|") * 1200 for part in around.split("|"))
    assert len(letters(LETTERS + f"Main = {before}a{after};", events("a c"))) == 2


@pytest.mark.parametrize("body", ["a G<0>", "a (b | G<0>)"], ids=["may halt", "step"])
def test_unfolding_without_an_event_has_a_limit(body: str, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(rules, "DEPTH_LIMIT", 1000)
    monitor = read(A + f"b matches {{e:'b'}};\nMain = {body};\nG<n> = (if (n >= 0) empty else a) G<n+1>;")
    with pytest.raises(TooLarge):
        list(monitor.run(events("a c")))
