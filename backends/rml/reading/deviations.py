"""Where this reader means the language and the published compiler and monitor do something else, in one table.

Comparisons with the published tools leave out the pairs of text and trace that a row touches; nothing else may differ. The
predicates are conservative: they may name a pair that does not differ, never the other way round. The numbers only name the rows.
Not in the table, because nothing can be compared: the published compiler refuses field names that are blank or not ASCII and
integers beyond 32 bits, and its monitor does not return from an event type derived from itself, nor from a recursive equation
that is repeated `{0}` times or is generic and lacks its arguments.
"""

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from typing import Final

from backends.rml.reading import syntax as s
from backends.rml.reading import touched
from backends.rml.reading.parser import parse
from rvaft.values import Json


@dataclass(frozen=True, slots=True)
class Deviation:
    """One row: what the published tools do, what this reader does, and whether a text and a trace are touched by it."""

    number: int
    title: str
    published: str
    reader: str
    predicate: Callable[[s.Program, Sequence[Json]], bool]

    def touches(self, text: str | s.Program, trace: Iterable[Json]) -> bool:
        """Whether this deviation can show; raises `LanguageError` for a text that is not RML."""
        return self.predicate(parse(text) if isinstance(text, str) else text, list(trace))


def touching(text: str | s.Program, trace: Iterable[Json]) -> list[Deviation]:
    """The deviations that can show when the text runs on the trace."""
    program, events = parse(text) if isinstance(text, str) else text, list(trace)
    return [deviation for deviation in DEVIATIONS if deviation.touches(program, events)]


DEVIATIONS: Final = (
    Deviation(
        1,
        "guards over what is no number",
        "a string, a boolean, null, a list or an object in a `with` is an error that ends the monitor, with exit code 0",
        "two strings compare by code points; otherwise the event does not match",
        touched.no_number,
    ),
    Deviation(
        2,
        "tolerance of guards",
        "a `with` compares doubles up to 1e-10, integers included",
        "integers are exact, the rest are IEEE doubles, compared exactly",
        touched.inexact,
    ),
    Deviation(
        3,
        "unbound variables in guards",
        "a `with` over a variable that has no value yet holds, and is forgotten",
        "it does not hold",
        touched.unbound,
    ),
    Deviation(
        4,
        "1 and 1.0",
        "they differ in patterns, in arguments and as values of variables; in a `with` they are equal",
        "they are equal, as in JSON",
        touched.two_forms,
    ),
    Deviation(
        5,
        "objects as values of variables",
        "a variable that stands for an object matches every object that has at least its fields",
        "a variable matches what equals its value",
        touched.objects,
    ),
    Deviation(
        7,
        "guards of `not` types",
        "`not matches P with G` means ¬P ∧ G, and G holds where its variables have no value (see 3)",
        "it means ¬P ∧ G too, and G does not hold there",
        touched.negated_guard,
    ),
    Deviation(
        12,
        "`t | all`",
        "an operand of `|` that has become `all` is forgotten: the other one alone decides from then on",
        "it is kept, so that any event can be taken",
        touched.forgotten,
    ),
    Deviation(
        12,
        "`if` and the arguments of equations",
        "Prolog calculates: strings of one letter are numbers, and what has no value is an error that ends the monitor",
        "no rule applies where a condition has no value; an argument without value is false",
        touched.prolog_arithmetic,
    ),
)
