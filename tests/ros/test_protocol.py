"""What a message is answered, without a network."""

import json
from typing import Final

import pytest
from hypothesis import given
from hypothesis import strategies as st

from rvaft import Verdict, load, loads, monitor
from rvaft.analysis.pattern_index import TreeReads
from rvaft.model.tree import RVAFT
from rvaft.model.values import Json
from rvaft.monitoring.monitor_set import Per
from rvaft.monitoring.reader import decode
from rvaft.ros.protocol import Polarity, Protocol, Session, Vocabulary
from tests.cli.runs import PRUNED
from tests.monitoring.test_reader import BAD

SEQUENCE: Final = loads("top sand a b; a attack; b fault;")
A, B = '{"event": "a"}', '{"event": "b"}'
BROKEN: Final[tuple[str | bytes, ...]] = (
    *("", " ", "null", '{"event": NaN}', '{"event": "a", "event": "b"}', "[" * 900_000, '{"x": ' + "9" * 900_000 + "}"),
    *(line for name, line in BAD.items() if not name.startswith("for a tree")),
)
"""Messages that are no events."""


def answers(speaking: Protocol, to: Session, *messages: str | bytes) -> list[Json]:
    return [json.loads(json.dumps(speaking.reply(message, to))) for message in messages]


def replies(tree: RVAFT, *messages: str | bytes, **options: object) -> list[Json]:
    return answers(Protocol(tree, **options), Session(tree), *messages)  # type: ignore[arg-type]


def verdicts(tree: RVAFT, *messages: str | bytes, **options: object) -> list[Json]:
    return [reply["verdict"] for reply in replies(tree, *messages, **options)]


def test_a_detection_comes_with_its_explanation() -> None:
    tree = loads("event e(x) = {p: x}; top or c s; c; s sand a b; a attack on e(X); b fault on e(Y) when Y > X;")
    *before, found, after = replies(tree, '{"p": 3}', "{}", '{"p": 4, "branch": "mine"}', "{}")
    assert all(set(reply) <= {"p", "verdict"} for reply in before)
    explanation = {
        "branch": 2,
        "kinds": ["attack", "fault"],
        "matched": [{"node": "a", "event": 1}, {"node": "b", "event": 3}],
        "variables": {"X": 3, "Y": 4},
    }
    assert found == {"p": 4, **explanation, "verdict": False}
    assert after == {**explanation, "verdict": False}


@pytest.mark.parametrize("semantics", ["projected", "scattered"])
def test_a_matched_event_says_when_and_where_it_happened(semantics: str) -> None:
    tree = loads('event e(x) = {topic: "/c", p: x}; top sand a b c; a on e(1); b on e(2); c;')
    speaking, first = Protocol(tree), Session(tree, semantics)
    said: list[Json] = [{"topic": "c", "time": 0.5, "p": 1}, {"topic": "/other", "time": 1}]
    answers(speaking, first, *map(json.dumps, said), "[]", '{"topic": "/c", "p": 2, "time": {"secs": 3}}')
    to = first.fork()
    for _ in range(2):
        (reply,) = answers(speaking, to, '{"event": "c", "data": 1}')
        assert reply["matched"] == [
            {"node": "a", "event": 1, "time": 0.5, "topic": "c"},
            {"node": "b", "event": 3, "time": {"secs": 3}, "topic": "/c"},
            {"node": "c", "event": 4},
        ]
    assert len(to.buffer.known) == 3
    assert len(first.buffer.known) == 2


@pytest.mark.parametrize(
    ("message", "error"),
    [
        ("", "not JSON: expecting value"),
        ("{\n'a': 1}", "not JSON: expecting property name enclosed in double quotes"),
        (b"\xff", "not UTF-8"),
        ("[]", "not a JSON object but a list"),
        ("\ufeff{}", "a byte order mark before the event; send the event alone"),
    ],
)
def test_an_error_speaks_of_messages_and_not_of_lines(message: str | bytes, error: str) -> None:
    assert replies(SEQUENCE, message) == [{"error": error, "verdict": "currently_true"}]


def test_an_error_of_the_event_comes_back() -> None:
    event = {"event": "a", "error": "mine", "verdicts": 1, "branch": 7, "matched": 8}
    assert replies(SEQUENCE, json.dumps(event)) == [{**event, "verdict": "currently_true"}]
    assert replies(SEQUENCE, A, json.dumps({**event, "event": "b"}))[1]["error"] == "mine"


@pytest.mark.parametrize(
    ("polarity", "vocabulary", "expected"),
    [
        ("property", "rml", ("currently_true", False, True)),
        ("property", "strings", ("currently_true", "false", "true")),
        ("detection", "rml", ("currently_false", True, False)),
        ("detection", "strings", ("currently_false", "true", "false")),
    ],
)
def test_the_words(polarity: str, vocabulary: str, expected: tuple[Json, Json, Json]) -> None:
    unknown, detected, impossible = expected
    options = {"polarity": Polarity(polarity), "vocabulary": Vocabulary(vocabulary)}
    for told, wanted in (
        (verdicts(SEQUENCE, A, "{}", B, A, **options), [unknown, unknown, detected, detected]),
        (verdicts(SEQUENCE, A, A, B, **options), [unknown, impossible, impossible]),
    ):
        assert [(type(word), word) for word in told] == [(type(word), word) for word in wanted]


@pytest.mark.parametrize("message", BROKEN)
def test_what_is_no_event_gets_an_error_with_the_verdict_so_far(message: str | bytes) -> None:
    """Without `verdict` ROSMonitoring would take the reply for a definitive `true` and stop."""
    first, a, again, b, end = replies(SEQUENCE, message, A, message, B, message)
    for reply, verdict in ((first, "currently_true"), (again, "currently_true"), (end, False)):
        assert set(reply) == {"error", "verdict"}
        assert "\n" not in reply["error"]
        assert len(reply["error"]) < 200
        assert reply["verdict"] is verdict if verdict is False else reply["verdict"] == verdict
    assert (a["verdict"], b["verdict"]) == ("currently_true", False)
    assert b["matched"] == [{"node": "a", "event": 1}, {"node": "b", "event": 2}]


def test_a_message_of_the_greatest_length_is_read_and_a_longer_one_is_not() -> None:
    speaking = Protocol(SEQUENCE, longest=len(A.encode()))
    taken, refused = answers(speaking, Session(SEQUENCE), A, f"{A} ")
    assert taken["event"] == "a"
    assert refused["error"] == "a message of 15 bytes; the longest that is read has 14"


def test_a_monitor_that_gives_up_says_so_and_has_no_verdict_any_more() -> None:
    tree = loads("event e(x) = {p: x}; top sand a b; a on e(X); b on e(Y) when Y == X - 1;")
    to = Session(tree, "scattered", per=Per.BRANCH, limit=3)
    to.monitors["1"] = Session(tree, "scattered", per=Per.BRANCH).monitors["1"]
    *_, gave_up, later = answers(Protocol(tree), to, *(f'{{"p": {number}}}' for number in range(10)))
    for reply in (gave_up, later):
        assert reply["verdict"] == "unknown"
        assert reply["error"].startswith("too large")
        assert reply["verdicts"] == {"1": "currently_true"}
    (error,) = answers(Protocol(tree), to.fork(), "[]")
    assert error["verdict"] == "unknown"
    (found,) = answers(Protocol(tree), to, '{"p": 1}')
    assert found["verdicts"] == {"1": False}


# -- a verdict for each branch or kind ---------------------------------------------------------------------------------


def test_a_verdict_for_each_branch() -> None:
    tree = loads("top or a b; a attack; b fault;")
    speaking, to = Protocol(tree), Session(tree, per=Per.BRANCH)
    (reply,) = answers(speaking, to, B)
    assert reply["verdict"] is False
    assert reply["verdicts"] == {"1": True, "2": False}
    assert reply["branch"] == 2


def test_a_verdict_for_each_kind() -> None:
    tree = load(PRUNED)
    for kind in ("attack", "fault"):
        to = Session(tree, per=Per.KIND)
        alone = {name: monitor(tree, kind=name) for name in ("attack", "fault")}
        whole = monitor(tree)
        for file in sorted((PRUNED.parent / "pruned.traces").iterdir()):
            for line in file.read_bytes().splitlines():
                reply = Protocol(tree, polarity=Polarity.DETECTION, vocabulary=Vocabulary.STRINGS).reply(line, to)
                for told, one in [(reply["verdicts"][kind], alone[kind]), (reply["verdict"], whole)]:
                    expected = one.step(decode(line))
                    assert told == ("currently_false" if expected is Verdict.UNKNOWN else expected.value)


# -- names -------------------------------------------------------------------------------------------------------------

NAMED: Final = """
event command(x) = {{topic: "{topic}", x: x}};
event call() = {{service: "{service}"}};
top sand a b; a on command(X); b on call();
"""


@pytest.mark.parametrize("slash", ["", "/"])
@pytest.mark.parametrize("other", ["", "/"])
def test_names_match_with_and_without_the_leading_slash(slash: str, other: str) -> None:
    tree = loads(NAMED.format(topic=f"{slash}arm/command", service=f"{slash}stop"))
    sent: list[dict[str, Json]] = [{"topic": f"{other}arm/command", "x": 1}, {"service": f"{other}stop"}]
    *_, last = told = replies(tree, *map(json.dumps, sent))
    assert last["verdict"] is False
    assert [{key: reply[key] for key in event} for reply, event in zip(told, sent, strict=True)] == sent


@pytest.mark.parametrize(
    ("tree", "event"),
    [
        ('event e() = {topic: "/a"}; a on e();', {"topic": "//a"}),
        ('event e() = {topic: "/a"}; a on e();', {"topic": "a/"}),
        ('event e() = {topic: "/a"}; a on e();', {"topic": ["a"]}),
        ('event e() = {name: "/a"}; a on e();', {"name": "a"}),
        ('event e() = {x: {topic: "/a"}}; a on e();', {"x": {"topic": "a"}}),
        (
            'event e() = {topic: "/a", x: 1}; event f() = {topic: "a", x: 2}; top or a b; a on e(); b on f();',
            {"topic": "a", "x": 1},
        ),
        ('event e(t) = {topic: t}; a on e(T) when T == "/a";', {"topic": "a"}),
    ],
)
def test_nothing_else_is_renamed(tree: str, event: Json) -> None:
    assert verdicts(loads(f"toplevel {'top' if 'top or' in tree else 'a'}; {tree}"), json.dumps(event)) != [False]


def test_a_name_given_as_an_argument_or_to_be_ignored_counts_as_spelled_out() -> None:
    tree = loads('event e(t) = {topic: t}; top sand a b; a on e("/a"); b on e("b"); ignore e("/c");')
    told = verdicts(tree, '{"topic": "a"}', '{"topic": "c"}', '{"topic": "/b"}')
    assert told == ["currently_true", "currently_true", False]


# -- any sequence of messages ------------------------------------------------------------------------------------------

VALID: Final = st.sampled_from(["a", "b", "c", "d"]).map(lambda name: json.dumps({"event": name}))
FORMS: Final = st.sampled_from(
    [
        "top sand a b c; a; b; c;",
        "top or s c; s sand a b; a attack; b; c fault;",
        "top 2of3 a b c; a; b; c;",
        'top and a b; a; b; ignore c(); event c() = {event: "c"};',
    ]
)


@given(
    FORMS,
    st.sampled_from(["strict", "projected", "scattered"]),
    st.lists(VALID | VALID.map(str.encode) | st.sampled_from(BROKEN) | st.binary(max_size=8) | st.text(max_size=8)),
)
def test_any_messages_get_the_verdicts_of_the_monitor_on_the_events_among_them(
    form: str, semantics: str, messages: list[str | bytes]
) -> None:
    tree = loads(form)
    alone, to = monitor(tree, semantics=semantics), Session(tree, semantics)
    speaking = Protocol(tree, polarity=Polarity.DETECTION, vocabulary=Vocabulary.STRINGS)
    for message in messages:
        reply = json.loads(json.dumps(speaking.reply(message, to)))
        try:
            event = decode(message.encode() if isinstance(message, str) else message, reads=TreeReads(tree))
        except ValueError:
            assert "error" in reply
        else:
            alone.step(event)
            assert {key: reply[key] for key in event if key != "verdict"} == {
                key: value for key, value in event.items() if key != "verdict"
            }
        assert reply["verdict"] == ("currently_false" if alone.verdict is Verdict.UNKNOWN else alone.verdict.value)
        assert ("branch" in reply) == (alone.verdict is Verdict.TRUE and "error" not in reply)
