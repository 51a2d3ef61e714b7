"""The words of the language: the sorts of lexemes, and the meaning of each keyword.

Usage and meaning are those of `docs/reference/language.md`, where a test looks for them.
"""

from collections.abc import Mapping
from enum import StrEnum
from typing import Final, NamedTuple


class Sort(StrEnum):
    """What a piece of a text is."""

    BLANK = "blank"
    COMMENT = "comment"
    STATEMENT = "statement"
    GATE = "gate"
    CLAUSE = "clause"
    OPERATOR = "operator"
    FUNCTION = "function"
    CONSTANT = "constant"
    CHOICE = "choice"
    """A word of a closed list, such as a type, a format of times or a semantics."""
    NODE = "node"
    EVENT = "event"
    FIELD = "field"
    PARAMETER = "parameter"
    VARIABLE = "variable"
    ATTRIBUTE = "attribute"
    NAME = "name"
    """Another name, such as a publisher of a topic."""
    STRING = "string"
    NUMBER = "number"
    DURATION = "duration"
    SIGN = "sign"
    ERROR = "error"
    """A character that begins no lexeme of the language."""


class Word(NamedTuple):
    """A keyword with an example of its use, and its meaning in Markdown."""

    usage: str
    meaning: str


_TIME: Final = Word("time FIELD as FORMAT [late DURATION];", "says where events have their time.")
_TOPIC: Final = Word("topic NAME type TYPE from PUBLISHERS;", "a topic of ROS for")
_REPEAT: Final = Word("repeat by X;", "with `--repeat`, only the matches with the detected value of X start afresh")
_TOP_DOWN: Final = Word("causality top_down;", "the event of a node comes before the events of its descendants")
_SPARE: Final = "a warm or hot spare may fail before its use"
_TRIGGER: Final = Word("f fdep t d e;", "the trigger `t` fails its dependents; `f` never fails")
_TEXTS: Final = "whether a string starts or ends with another string, or contains it"
_POINTS: Final = "the times of the first and the last event of the part of n"
_AFTER: Final = Word(
    "without EVENT(…) for 5 s after", "in the 5 s after its last event; detected once a later time is seen"
)
_NUMBER: Final = "a number of these, or a string that writes one"
_LITERAL: Final = "a literal: a string, a number, `true`, `false` or `null`"
_LOGIC: Final = "disjunction, conjunction, negation"

WORDS: Final[Mapping[Sort, Mapping[str, Word]]] = {
    Sort.STATEMENT: {
        "toplevel": Word("toplevel NAME;", "names, or the only node without a parent."),
        "event": Word("event NAME(parameters) = pattern;", "describes an event."),
        "ignore": Word("ignore CALL [when GUARD];", "such events are never relevant; the variables are its own"),
        "import": Word('import "FILE";', "reads another tree, relative to the importing file, once"),
        "prune": Word("prune NAME …;", "removes nodes and what only they reach."),
        "causality": _TOP_DOWN,
        "semantics": Word(
            "semantics NAME;",
            "`strict`, `projected` (default), `consecutive` or `scattered`; the option `--semantics` wins",
        ),
        "time": _TIME,
        "assume": Word("assume types, present, case, exact, order 5 min;", "states what logs keep"),
        "show": Word("show X, Y;", "lists variables for reports: `rvaft check` accepts that they are used once."),
        "repeat": _REPEAT,
        "topic": Word("topic NAME type TYPE from PUBLISHERS;", "a topic of ROS for"),
        "param": Word("param x;", "Galileo's parameter of rates; read and not used"),
    },
    Sort.GATE: {
        "or": Word("or a b", "one child occurs"),
        "and": Word("and a b", "all children occur, in any order"),
        "sand": Word("sand a b", "all children occur, from left to right"),
        "sand_rl": Word("sand_rl a b", "all children occur, from right to left"),
        "pand": Word("pand a b", "all children occur, and each child ends before the next one ends"),
        "2of3": Word("2of3 a b c", "at least two of the three children occur; `vot2 a b c` is the same"),
        "seq": Word("a seq b c;", "parts fail from left to right; a `seq` without a parent detects nothing"),
        "wsp": Word("a wsp b c;", _SPARE),
        "hsp": Word("a hsp b c;", _SPARE),
        "csp": Word("a csp b c;", "a cold spare cannot"),
        "spare": Word("a spare b c;", "cold spares, or not"),
        "sor": Word("a sor b c;", "no event shows failed attempts"),
        "fdep": _TRIGGER,
        "pdep": _TRIGGER._replace(usage="f pdep=1 t d e;"),
        "por": Word("a por b c;", "b fails before c does"),
        "mutex": Word("a mutex b c;", "only one of b and c can fail"),
    },
    Sort.CLAUSE: {
        "on": Word("on radiation(Value, _)", "the runtime event of the node"),
        "when": Word("when Value >= 250", "the guard of the node"),
        "times": Word("times 20", "for a leaf: 20 such events, one after the other, with the same variables"),
        "distinct": Word("times 20 distinct Port", "they differ in Port"),
        "each": Word("each Port", "each has its own, for the guard of the leaf"),
        "within": Word(
            "within 10 min", "for a gate: the longest duration from the first event of its part to the last"
        ),
        "without": Word("without EVENT(…)", "an event that does not come; several are allowed"),
        "for": _AFTER,
        "after": _AFTER,
        "before": Word("without EVENT(…) for 5 s before", "in the 5 s before its first event"),
        "fault": Word("fault", "the kind"),
        "attack": Word("attack", "the kind"),
        "label": Word('label "text"', "a text for people"),
        "as": _TIME,
        "late": Word("late DURATION", "an event that is further behind an earlier event is **late**: no match uses it"),
        "year": Word("year N", "It is the year of the whole log: where a log passes new year, split it."),
        "zone": Word("zone", "Without `zone`, times are in UTC."),
        "type": _TOPIC,
        "from": _TOPIC,
        "by": _REPEAT,
        "top_down": _TOP_DOWN,
        "bottom_up": Word("causality bottom_up;", "the event of a node comes after the events of its descendants"),
    },
    Sort.OPERATOR: {
        "and": Word("and", _LOGIC),
        "or": Word("or", _LOGIC),
        "not": Word("not", _LOGIC),
        "in": Word('in (1, "a", null)', "comparison"),
    },
    Sort.FUNCTION: {
        "startswith": Word('startswith(X, "C:")', _TEXTS),
        "endswith": Word('endswith(X, ".exe")', _TEXTS),
        "contains": Word('contains(X, "..")', _TEXTS),
        "like": Word(
            'like(X, "*.exe")',
            "whether the whole string matches a literal pattern of at most 1,000 characters; "
            "`*` is any number of characters, `?` is one",
        ),
        "lower": Word("lower(X)", "the string in lower case"),
        "number": Word("number(X)", 'the number, or the number that a string writes: `"1e3"` is 1000'),
        "abs": Word("abs(X)", "of numbers"),
        "min": Word("min(X, Y, …)", "of numbers"),
        "max": Word("max(X, Y, …)", "of numbers"),
        "at": Word("at(n)", "in a guard: the time of the event of n"),
        "start": Word("start(n)", _POINTS),
        "end": Word("end(n)", _POINTS),
    },
    Sort.CONSTANT: {
        "true": Word("true", _LITERAL),
        "false": Word("false", _LITERAL),
        "null": Word("null", _LITERAL),
        "_": Word("_", "any value, but the field must be present"),
    },
    Sort.CHOICE: {
        "s": Word("s", _NUMBER),
        "ms": Word("ms", _NUMBER),
        "us": Word("us", _NUMBER),
        "ns": Word("ns", _NUMBER),
        "iso8601": Word("iso8601", "`2024-03-01T00:30:00.25+02:00`; UTC if there is no offset"),
        "ros": Word("ros", "`{sec, nanosec}` or `{secs, nsecs}`"),
        "filetime": Word("filetime", "100 ns since 1601 (Windows)"),
    },
}
"""The words of each sort; `2of3` stands for all votes."""
