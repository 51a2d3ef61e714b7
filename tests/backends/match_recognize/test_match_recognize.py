"""MATCH_RECOGNIZE: pinned texts, what is refused, their conditions run by SQLite, and the texts by
Flink where it is installed.
"""

import re
import sys
from dataclasses import replace
from importlib.util import find_spec
from random import Random

import pytest

from cross_check import comparison
from cross_check.judges import FLINK
from cross_check.published import flink
from cross_check.published.flink import RowHeader
from cross_check.results import Job, Status
from cross_check.traces import ONE_TREE
from rvaft import RVAFT, EventType, Gate, LanguageError, Node, On, Semantics, TooLarge, ToolFailed, ToolMissing, loads
from rvaft.backend import backend
from rvaft.model.guards import Operation, Operator
from rvaft.model.patterns import Literal, ObjectPattern, Variable, substitute
from rvaft.model.values import Json
from tests.backends.injections import INJECTIONS
from tests.backends.judged import all_show, cases, first
from tests.backends.match_recognize.joins import first_detections
from tests.tables import rows

installed = pytest.mark.skipif(find_spec("pyflink") is None, reason="Apache Flink is not installed")
of_flink = pytest.mark.filterwarnings(  # it uses what it deprecates, and leaves its process to the end of this one
    "ignore::DeprecationWarning", "ignore::ResourceWarning", "ignore::pytest.PytestUnraisableExceptionWarning"
)
EVENTS = "event e(v) = { e: v }; event p(v, w) = { v: v, w: w }; "


def emitted(tree: str | RVAFT, semantics: Semantics = Semantics.SCATTERED, **options: int) -> str:
    made = loads(tree) if isinstance(tree, str) else tree
    return backend("match-recognize").translate(made, semantics, **options).text


@pytest.mark.parametrize(("tree", "semantics", "text"), rows(__file__, "texts.txt"))
def test_texts(tree: str, semantics: str, text: str) -> None:
    assert emitted(tree, Semantics(semantics)) == text


def test_orders_are_bounded() -> None:
    with pytest.raises(TooLarge, match="events in all possible orders"):
        emitted(f"top and {' '.join(f'a{n}' for n in range(40))};")
    alike = f"event e() = {{ e: _ }}; top and {' '.join(f'a{n}' for n in range(12))}; "
    assert emitted(alike + "".join(f"a{n} on e();" for n in range(12))).count("MATCH_RECOGNIZE (") == 1


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("SELECT 1", "the text must begin with a comment"),
        ("/* rvaft\nis_a := { a: ", "the text must begin with a comment"),
        ("/* rvaft\nwhen X > 1\n*/", "not a definition of a name: when X > 1"),
        ("/* rvaft\nis_a := { a: \n*/", "."),
    ],
)
def test_what_is_no_header(text: str, said: str) -> None:
    with pytest.raises(LanguageError, match=said):
        RowHeader.read(text)


def test_rows_and_what_they_cannot_hold() -> None:
    tree = (
        'time t as s; event p(v, w) = { v: v, w: w }; top sand a b within 1 s; a on p(X, "*/ \'"); b on '
        "p(X, Y) when Y > X;"
    )
    header = RowHeader.read(emitted(tree))
    row = header.row({"v": 2.0, "w": "*/ '", "t": 2})
    assert row == {
        "is_a": True, "a_x_text": "2", "a_t1_time": 2_000_000_000, "is_b": False, "b_x_text": None, "b_t2_time": None,
    }  # fmt: skip
    assert (
        header.left_open([{"v": 1, "w": "*/ '", "t": 10**12}])
        == "times of 2.2e18 ns or more are not exact in this language"
    )
    assert header.left_open([{"v": 1, "w": "*/ '", "t": 2_190_000_000}]) == ""  # the year 2039
    sums = RowHeader.read(emitted(EVENTS + "top sand a b; a on e(X); b on e(Y) when Y + X > 3;"))
    assert sums.left_open([{"e": 2**46 - 1}]) == ""
    assert sums.left_open([{"e": 2**46}]) == "numbers of 2**46 or more are not exact in this language"


@pytest.mark.ci
def test_the_conditions_say_what_the_definition_says() -> None:
    detections = 0
    for text, traces, wanted in cases("match-recognize", RowHeader, Random("match"), 40, 2, limit=40):
        assert first_detections(text, traces) == wanted, text
        detections += sum(one is not None for one in wanted)
    assert detections > 100


ABSENT = {
    "values of the match": 'top sand a b without p(Q, W) when W > V and Q != U; a on p(U, V); b on p(U, "s");',
    "any value": "top and a b c without e(_); a on p(1, _); b on p(2, _); c on p(3, _);",
    "part of a match": "top sand x c; x sand a b without p(_, Q) when Q == 3; a on p(U, 1); b on p(U, 2); "
    "c on p(_, 3);",
    "events of the match": "top and x c; x and a b without p(3, _); a on p(1, V); b on p(2, V); c on p(3, _);",
    "a choice": "top or x y; x sand a b without p(3, _); y 2of3 a b c without p(_, 2); a on p(1, 1); b on p(2, 1); "
    "c on p(3, 3);",
}


@pytest.mark.parametrize("name", ABSENT)
def test_absent_events_are_conditions_on_skipped_rows(name: str) -> None:
    tree, random = loads(EVENTS + ABSENT[name]), Random(name)
    text = emitted(tree)
    values = (1, 2, 3)
    events: list[Json] = [{"v": v, "w": w} for v in values for w in (*values, "s")] + [{"e": 0}]
    traces = [[random.choice(events) for _ in range(7)] for _ in range(150)]
    wanted = [first(tree, Semantics.SCATTERED, one) for one in traces]
    assert first_detections(text, traces) == wanted, text
    assert any(wanted)
    without = re.sub(r", g\d+ AS [^\n]* IS NOT TRUE", "", text)
    assert without != text
    assert first_detections(without, traces) != wanted


def odd_tree(odd: str) -> RVAFT:
    """A tree with an odd name of nodes, of a field, and an odd string within a condition."""
    first = EventType(odd, ("v",), ObjectPattern(((odd, Literal(odd)), ("v", Variable("V")))))
    then = EventType("then", ("w",), ObjectPattern((("then", Literal(odd)), ("w", Variable("W")))))
    same = Operation(Operator.EQ, (Variable("V"), Literal(odd)))
    when = Operation(
        Operator.OR,
        (
            Operation(Operator.AND, (same, Operation(Operator.EQ, (Variable("W"), Literal(1))))),
            Operation(Operator.EQ, (Variable("V"), Variable("W"))),
        ),
    )
    events = [
        replace(one, pattern=substitute(one.pattern, {n: Variable(n.lower()) for n in "VW"})) for one in (first, then)
    ]
    nodes = [Node(f"{odd} ", Gate.SAND, (odd, "b"), when=when, label=odd), Node(odd, on=On(odd, (Variable("V"),)))]
    return RVAFT(f"{odd} ", [*nodes, Node("b", on=On("then", (Variable("W"),)))], events)


def odd_traces(odd: str, other: str) -> list[list[Json]]:
    """The first one is a detection of such a tree, and so is the last."""
    values: list[tuple[Json, Json]] = [(odd, 1), (other, 1), (odd, 2), (odd, odd)]
    return [[{odd: odd, "v": v}, {"then": odd, "w": w}] for v, w in values]


def test_names_and_strings_stay_inside() -> None:
    for place, odd in enumerate(INJECTIONS):
        traces = odd_traces(odd, INJECTIONS[place - 1])
        assert first_detections(emitted(odd_tree(odd)), traces) == [2, None, None, 2], odd


TIED = (
    "time t as s; event n(k, x) = { k: k, y: x }; event e(k, x) = { k: k, x: x }; top sand a both within 1 s; "
    "both and b c when Y < Z; a on n(1, Y); b on n(_, Z); c on e(2, X) when X == 1 or Y == 9;"
)
FAULTS = {
    "a gap dropped": ("(s g0*? e1 g1*? e2 g2*? e3)", "(s g0*? e1 e2 g2*? e3)"),
    "a gap before dropped": ("(s g0*? e1", "(s e1"),
    "another column": ("a_y_number < ", "a_y_number <= "),
    "a guard dropped": ("e1.a_y_number < e2.b_z_number", "TRUE"),
    "a window one unit off": ("<= 1000000000", "<= 999999999"),
    "undefined is true": ("e1.a_y_string < e2.b_z_string", "coalesce(e1.a_y_string < e2.b_z_string, TRUE)"),
}


@pytest.mark.ci
def test_planted_faults_show() -> None:
    """Each text that is edited detects something else than the tree, on one of these traces."""
    tree, random = loads(TIED), Random("faults")
    text = emitted(tree)
    events: list[Json] = [{"k": 1, "y": 1}, {"k": 1, "y": 2}, {"k": 1, "y": "s"}, {"k": 3, "y": 2}, {"k": 3, "y": "t"}]
    events += [{"k": 2, "x": 1}, {"k": 2, "x": 2}]
    traces: list[list[Json]] = [[{**random.choice(events), "t": n * 0.25} for n in range(6)] for _ in range(300)]
    wanted = [first(tree, Semantics.SCATTERED, one) for one in traces]
    assert first_detections(text, traces) == wanted
    assert sum(one is not None for one in wanted) >= 20
    one_order, _, others = text.partition("\nUNION ALL\n")
    assert (
        first_detections(one_order, traces)
        != wanted
        != first_detections(f"{text.partition('SELECT')[0]}{others}", traces)
    )
    all_show(FAULTS, text, lambda edited: first_detections(edited, traces))


def test_without_flink_it_is_missing(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "pyflink", None)
    monkeypatch.setitem(sys.modules, "pyflink.table", None)
    with pytest.raises(ToolMissing, match=r"Apache Flink is not installed: pip install '.\[flink\]'"):
        flink.first_detections([(emitted("top sand a b;"), [[{"event": "a"}]])])
    assert compared("top sand a b;")[FLINK] is Status.TOOL_MISSING


def compared(tree: str) -> dict[str, Status]:
    """How a comparison of Flink with the reference ends."""
    job = Job("tree", Semantics.SCATTERED)
    roster = comparison.Roster(backends=(), flink=True)
    found = comparison.Comparison(loads(tree), job, ONE_TREE).run(roster.candidates(loads(tree), job))
    return {one.participant: one.status for one in found}


@pytest.mark.slow
@installed
@of_flink
def test_flink_says_what_the_definition_says() -> None:
    some = [*cases("match-recognize", RowHeader, Random("flink"), 60, 2, limit=40)]
    found = flink.first_detections([(text, traces) for text, traces, _ in some])
    for (text, _, wanted), told in zip(some, found, strict=True):
        assert told == wanted, text


@pytest.mark.slow
@installed
@of_flink
def test_flink_reads_names_and_strings_as_they_are() -> None:
    asked = [(emitted(odd_tree(odd)), odd_traces(odd, INJECTIONS[place - 1])) for place, odd in enumerate(INJECTIONS)]
    assert flink.first_detections(asked) == [[2, None, None, 2]] * len(asked)
    with pytest.raises(ToolFailed, match="Apache Flink"):
        flink.first_detections([("/* rvaft\n*/\nSELECT nothing FROM events", [])])
    assert compared("top and a b;")[FLINK] is Status.TESTED


@pytest.mark.slow
@installed
@of_flink
def test_flink_misses_later_starts_where_a_pattern_has_no_first_row() -> None:
    """Why each text begins with the row before all events: of a pattern that begins anywhere Flink
    loses matches once there are gaps.
    """
    text = emitted(EVENTS + "top sand a b c; a on p(1, X); b on p(1, _); c on p(2, X);")
    trace: list[Json] = [{"v": v, "w": w} for v, w in ((1, 1), (1, 2), (1, 1), (2, 2))]
    anywhere = text.replace("(s g0*? e1", "(e1").replace("s AS s.pos = 0, ", "")
    assert anywhere != text
    assert flink.first_detections([(text, [trace]), (anywhere, [trace])]) == [[4], [None]]
