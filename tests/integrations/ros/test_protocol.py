"""What a message is answered, without a network."""

import json
from typing import Any, Final

import pytest
from hypothesis import given
from hypothesis import strategies as st

from rvaft import Verdict, load, loads, monitor
from rvaft.core.fields_to_read import TreeReads
from rvaft.integrations.ros.protocol import MAX_MESSAGE, MessageProtocol, Polarity, Session, Vocabulary, reply_of_all
from rvaft.model.values import Json
from rvaft.readers.json_lines import decode
from rvaft.stream.monitor_set import Per
from tests.cli.runs import LOGS, PRUNED
from tests.readers.test_json_lines import BAD, STRICT
from tests.tables import rows

SEQUENCE: Final = loads("top sand a b; a attack; b fault;")
A, B = '{"event": "a"}', '{"event": "b"}'
BROKEN: Final[tuple[str | bytes, ...]] = (
    *("", " ", "null", '{"event": "a", "event": "b"}', "[" * 900_000, '{"x": ' + "9" * 900_000 + "}"),
    *(line for name, line in BAD.items() if not name.startswith("for a tree")),
)
"""Messages that are no events."""
DETECTION: Final[dict[str, Any]] = {"polarity": Polarity.DETECTION, "vocabulary": Vocabulary.STRINGS}


def answers(speaking: MessageProtocol, to: Session, *messages: str | bytes) -> list[Any]:
    return [json.loads(json.dumps(speaking.reply(message, to))) for message in messages]


def word(verdict: Verdict) -> str:
    """A verdict as `DETECTION` has it."""
    return "currently_false" if verdict is Verdict.UNKNOWN else verdict.value


@pytest.mark.parametrize("row", rows(__file__, "replies.txt"), ids=lambda row: row[0])
def test_a_conversation(row: list[Any]) -> None:
    _, text, options, messages, expected = row
    speaking = MessageProtocol(
        tree := loads(text),
        polarity=Polarity(options.get("polarity", "property")),
        vocabulary=Vocabulary(options.get("vocabulary", "rml")),
        longest=options.get("longest", MAX_MESSAGE),
        definitive=options.get("definitive", False),
    )
    repeating = {name: options[name] for name in ("repeat", "cooldown") if name in options}
    to = Session(tree, options.get("semantics", "projected"), per=Per(options.get("per", "tree")), **repeating)
    for message, wanted in zip(messages, expected, strict=True):
        sent = bytes(message) if isinstance(message, list) else message
        reply = speaking.reply(json.dumps(sent) if isinstance(sent, dict) else sent, to)
        told = reply if isinstance(wanted, dict) else reply["verdict"]
        assert json.dumps(told, sort_keys=True) == json.dumps(wanted, sort_keys=True)  # true is not 1


JOINT: Final = [
    ("??", "currently_true"),
    ("T?", "currently_false"),
    ("TT", False),
    ("TF", False),
    ("?F", "currently_true"),
    ("FF", "currently_true"),
    ("T!", False),
    ("!?", "unknown"),
    ("!!", "unknown"),
]
"""What each of two trees says (! for a monitor that failed), and what is said of both."""


@pytest.mark.parametrize(("each", "word"), JOINT)
def test_several_trees_have_one_verdict_and_each_its_own(each: str, word: object) -> None:
    """A tree is detected with the first event, or can no longer be, or neither."""
    texts = {"T": "top and a; a;", "?": "semantics scattered; top and a b; a; b;", "F": "top sand b a; b; a;"}
    trees = {f"{number}": loads(texts[one.replace("!", "?")]) for number, one in enumerate(each)}
    protocols = {name: MessageProtocol(tree) for name, tree in trees.items()}
    sessions = {name: Session(tree) for name, tree in trees.items()}
    for name, one in zip(sessions, each, strict=True):
        if one == "!":
            sessions[name].failures["tree"] = "too large"
    reply: Any = reply_of_all(protocols, '{"event": "a", "x": 1}', sessions)
    assert (reply["event"], reply["x"], reply["verdict"]) == ("a", 1, word)
    assert [reply["trees"][name].get("error") for name in trees] == [
        "too large" if one == "!" else None for one in each
    ]
    alone = [MessageProtocol(trees[name]).reply('{"event": "a"}', Session(trees[name])) for name in trees]
    for name, one, own in zip(trees, each, alone, strict=True):
        assert one == "!" or {"event": "a", **reply["trees"][name]} == own
    wrong: Any = reply_of_all(protocols, "[]", sessions)
    assert "error" in wrong
    assert sessions["0"].events == 1


def test_what_the_time_detects_is_told_by_the_next_reply() -> None:
    """Once, also if the monitor has begun again."""
    tree = loads("semantics scattered; time t as s; event e(x) = { e: x }; lost on e(X) without e(X) for 2 s after;")
    for repeat, words in ((False, [False, False]), (True, ["currently_false", "currently_true"])):
        speaking, to = MessageProtocol(tree), Session(tree, repeat=repeat)
        answers(speaking, to, '{"e": 7, "t": 0}')
        for time, detections in ((2, 0), (2.5, 1), (3, 1)):
            to.pass_time(time)
            assert to.count.notified == detections
        first, second = answers(speaking, to, '{"t": 3}', '{"t": 3.5}')
        assert [first["verdict"], second["verdict"]] == words
        assert (first["variables"], first["absent"][0]["before"]) == ({"X": 7}, None)


@pytest.mark.parametrize(("statement", "options"), [("", {"repeat_by": "R"}), ("repeat by R; ", {"repeat": True})])
def test_only_the_detected_value_begins_again(statement: str, options: dict[str, Any]) -> None:
    """So 2 goes on after the detection of 1, and is detected with its second beat."""
    text = f"semantics scattered; {statement}event beat(r) = {{ beat: r }}; two on beat(R) times 2;"
    tree = loads(text)
    replies = answers(
        MessageProtocol(tree), Session(tree, **options), *(f'{{"beat": {one}}}' for one in (1, 2, 1, 2, 1))
    )
    told = [(reply["verdict"], reply.get("detection")) for reply in replies]
    going_on, found = "currently_true", "currently_false"
    assert told == [(going_on, None), (going_on, None), (found, 1), (found, 2), (going_on, None)]


def test_a_fork_remembers_for_itself_when_and_where_events_came() -> None:
    tree = loads('event e(x) = {topic: "/c", p: x}; top sand a b; a on e(1); b on e(2);')
    speaking, first = MessageProtocol(tree), Session(tree)
    answers(speaking, first, '{"topic": "c", "p": 1, "time": 0.5}', '{"topic": "/other"}')
    (reply,) = answers(speaking, to := first.fork(), '{"topic": "/c", "p": 2}')
    assert [match.get("time") for match in reply["matched"]] == [0.5, None]
    assert (len(to.buffer.known), len(first.buffer.known), first.verdict()) == (2, 1, Verdict.UNKNOWN)


def test_what_could_be_missed_is_counted_and_a_number_that_is_not_finite_comes_back() -> None:
    text = 'event e(x) = {topic: "/c", p: x}; time t as s late 1 s; top sand a b; a on e(X) when X > 1; b on e(2);'
    speaking, to = MessageProtocol(tree := loads(text)), Session(tree)
    said = '{"topic": "c", "p": NaN, "t": 5}', '{"topic": "c", "p": "x"}', '{"topic": "c", "p": 2, "t": 3}'
    assert json.dumps(speaking.reply(said[0], to)) == '{"topic": "c", "p": NaN, "t": 5, "verdict": "currently_true"}'
    answers(speaking, to, *said[1:])
    assert list(to.fork().data_warnings.lines) == [
        "undefined number in 1 event: p is NaN (first: event 1)",
        'undefined guard in 1 event: X > 1 of a, where X is a string ("x") (first: event 2)',
        "no readable time in 1 event: the field t is missing (first: event 2)",
        "1 event later than 1 s, which no match uses: t is 3, 2 s behind the latest (first: event 3)",
        "1 event late after one time that is more than 1 s ahead: event 1 is 2 s ahead (first: event 3)",
    ]


@pytest.mark.parametrize("message", [*BROKEN, '{"x": 1e999}', *STRICT.values()])
def test_what_is_no_event_gets_an_error_with_the_verdict_so_far(message: str | bytes) -> None:
    """Without `verdict` ROSMonitoring would take the reply for a definitive `true` and stop."""
    speaking = MessageProtocol(SEQUENCE, strict_json=message not in BROKEN)
    first, a, again, b, end = answers(speaking, Session(SEQUENCE), message, A, message, B, message)
    for reply in (first, again, end):
        assert set(reply) == {"error", "verdict"}
        assert "\n" not in reply["error"]
        assert len(reply["error"]) < 200
    assert [reply["verdict"] for reply in (first, a, again)] == ["currently_true"] * 3
    assert b["verdict"] is end["verdict"] is False
    assert b["matched"] == [{"node": "a", "occurrence": 1, "event": 1}, {"node": "b", "occurrence": 1, "event": 2}]


def test_a_monitor_that_gives_up_says_so_and_has_no_verdict_any_more() -> None:
    tree = loads("event e(x) = {p: x}; top sand a b; a on e(X); b on e(Y) when Y == X - 1;")
    to = Session(tree, "scattered", per=Per.BRANCH, limit=3)
    to.monitors["1"] = Session(tree, "scattered", per=Per.BRANCH).monitors["1"]
    *_, gave_up, later = answers(MessageProtocol(tree), to, *(f'{{"p": {number}}}' for number in range(10)))
    for reply in (gave_up, later):
        assert reply["verdict"] == "unknown"
        assert reply["error"].startswith("too large")
        assert reply["verdicts"] == {"1": "currently_true"}
    (error,) = answers(MessageProtocol(tree), to.fork(), "[]")
    assert error["verdict"] == "unknown"
    (found,) = answers(MessageProtocol(tree), to, '{"p": 1}')
    assert found["verdicts"] == {"1": False}


def test_a_verdict_for_each_kind() -> None:
    tree = load(PRUNED)
    to, whole = Session(tree, per=Per.KIND), monitor(tree)
    alone = {name: monitor(tree, kind=name) for name in ("fault", "attack")}
    for file in sorted(LOGS.iterdir()):
        for line in file.read_bytes().splitlines():
            (reply,) = answers(MessageProtocol(tree, **DETECTION), to, line)
            assert reply["verdict"] == word(whole.step(decode(line)))
            assert reply["verdicts"] == {name: word(one.step(decode(line))) for name, one in alone.items()}


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
    for message in messages:
        (reply,) = answers(MessageProtocol(tree, **DETECTION), to, message)
        event: dict[str, Json] = {}
        try:
            event = decode(message.encode() if isinstance(message, str) else message, reads=TreeReads(tree))
        except ValueError:
            assert "error" in reply
        else:
            alone.step(event)
        assert {**reply, **event, "verdict": word(alone.verdict)} == reply
        assert ("branch" in reply) == (alone.verdict is Verdict.TRUE and "error" not in reply)
