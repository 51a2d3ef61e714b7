"""Texts of past MTL, run by Reelay: a comment that defines propositions, then a formula.

    /* rvaft
    time FIELD as FORMAT, bounds in UNIT
    NAME := PATTERN when GUARD when GUARD
    */

Several lines for one name are alternatives. Without a `time` line, time is discrete: bounds count
events. With it, time is dense: bounds are durations, and an event without a time has no distance
from others. Each event is then a pulse. The distances of pulses are the durations between events in
multiples of their common divisor, doubled for the events with equal times.

Reelay ends the whole process on malformed or too deep formulas, so it receives formulas that are
parsed here. Propositions are evaluated here per event and passed as Booleans.
"""

import re
from bisect import bisect_right
from collections import Counter
from collections.abc import Mapping, Sequence
from functools import cache, lru_cache
from itertools import pairwise
from math import gcd
from threading import Lock
from typing import Any, Final

from lark import Lark, Token
from lark.exceptions import UnexpectedInput
from lark.visitors import Transformer_NonRecursive

from rvaft.backend import Observed
from rvaft.errors import LanguageError, TooLarge, TraceError, error_at, installed
from rvaft.language.parser import parse_guard, parse_pattern, parse_time
from rvaft.model.event_time import UNITS, EventTime
from rvaft.model.guards import Operation, Operator
from rvaft.model.patterns import Literal, ObjectPattern, Pattern
from rvaft.model.values import Json

_DEEPEST: Final = 1_000
_FILE: Final = "<mtl>"
_EXACT: Final = 2**52
_GO: Final = "{go: true}"
_KNOWN: Final = "{known: true}"
_TIME: Final = re.compile(r"(time .*\S), bounds in (ns|us|ms|s)")
_HEADER: Final = re.compile(r"(?:\s*/\*(?! rvaft\n).*?\*/)*\s*/\* rvaft\n(.*?)\*/", re.DOTALL)
_LINE: Final = re.compile(r"(\w+) := (.*\S)")
_WHEN: Final = re.compile(r'"(?:[^"\\]|\\.)*"|(?<!\w)(when)(?!\w)')
_GRAMMAR: Final = r"""
?start: either
?either: both (_OR both)*
?both: chain (_AND chain)*
?chain: unary | unary "since" bounds? unary -> since
?unary: NOT unary -> negated
    | "once" bounds? unary -> once
    | "historically" bounds? unary -> always
    | "pre" unary -> pre
    | "(" either ")"
    | "{" NAME ":" "true" "}" -> atom
bounds: "[" NUMBER ":" [HIGH] "]" | "[" ":" HIGH "]" -> upper
_OR: "or" | "||"
_AND: "and" | "&&"
NOT: "not" | "!"
NUMBER: /[0-9]{1,9}/
HIGH: /0{0,8}[1-9][0-9]{0,8}/
NAME: /[A-Za-z_]\w*/
%ignore /\s+/
"""


@cache
def _parser() -> Lark:
    return Lark(_GRAMMAR, parser="lalr", maybe_placeholders=True)


class _Written(Transformer_NonRecursive[Token, tuple[str, int]]):
    """The formula for Reelay with its depth; `go` is false once between consecutive traces."""

    def __init__(self) -> None:
        super().__init__()
        self.names: dict[str, None] = {}

    def atom(self, parts: list[Any]) -> tuple[str, int]:
        self.names[str(parts[0])] = None
        return f"{{{_called(str(parts[0]))}: true}}", 1

    def bounds(self, parts: list[Any]) -> tuple[str, int]:
        return f"[{parts[0] or ''}:{parts[1] or ''}]", 0

    def upper(self, parts: list[Any]) -> tuple[str, int]:
        return self.bounds([None, *parts])

    def negated(self, parts: list[Any]) -> tuple[str, int]:
        return f"(not {parts[-1][0]})", parts[-1][1] + 1

    def pre(self, parts: list[Any]) -> tuple[str, int]:
        return f"(pre({_GO} and {parts[0][0]}))", parts[0][1] + 2

    def once(self, parts: list[Any]) -> tuple[str, int]:
        return self.since([(_GO, 1), *parts])

    def always(self, parts: list[Any]) -> tuple[str, int]:
        return self.negated([self.once([*parts[:-1], self.negated(parts)])])

    def since(self, parts: list[Any]) -> tuple[str, int]:
        (left, one), *bounds, (right, other) = parts
        within = "".join(text for text, _ in bounds)
        return f"(({_GO} and {left}) since{within} ({_GO} and {right}))", max(one, other) + 2

    def either(self, parts: list[Any]) -> tuple[str, int]:
        return f"({' or '.join(text for text, _ in parts)})", 1 + max(depth for _, depth in parts)

    def both(self, parts: list[Any]) -> tuple[str, int]:
        return f"({' and '.join(text for text, _ in parts)})", 1 + max(depth for _, depth in parts)


class _Dense(_Written):
    """The formula for Reelay in dense time, in which all operators look at events only.

    A bound of `unit` ns is `unit / common * 2 * apart` in Reelay, where `apart` is more than the
    number of places of events with one time; between two events there is a place without an event.
    `known` is true for events with a time.
    """

    def __init__(self, unit: int, common: int, apart: int) -> None:
        super().__init__()
        self._unit, self._common, self._apart = unit, common, apart
        self.bounds_found: list[int] = []

    def _length(self, bound: int) -> int:
        return bound * self._unit // self._common * 2 * self._apart

    def bounds(self, parts: list[Any]) -> tuple[str, int]:
        low, high = (None if one is None else int(one) for one in parts)
        self.bounds_found += [one for one in (low, high) if one is not None]
        begin = max(0, self._length(low or 0) - self._apart)
        return f"[{begin}:{'' if high is None else self._length(high) + self._apart}]", 0

    def pre(self, parts: list[Any]) -> tuple[str, int]:
        return f"(once[1:1]((not {_GO}) since ({_GO} and {parts[0][0]})))", parts[0][1] + 4

    def since(self, parts: list[Any]) -> tuple[str, int]:
        (left, one), *bounds, (right, other) = parts
        within, known = "".join(text for text, _ in bounds), f"{_KNOWN} and " if bounds else ""
        there = f"({_GO} and {known}{right})"
        if left == _GO:  # nothing is written twice, so that texts do not grow exponentially with their depth
            return f"({known}once{within}{there})", max(one, other) + 4
        text = f"(((not {_GO}) or {left}) since{within} {there})"  # Reelay leaves out the present, unless `left` holds
        text = f"({there} or {text})" if not bounds or within.startswith("[0:") else text
        return f"({known}{text})", max(one, other) + 4


class MtlProgram:
    """A compiled formula."""

    def __init__(self, formula: str, atoms: Mapping[str, Sequence[Observed]]) -> None:
        (self._monitor, self._lock), self._atoms = _monitor(formula), atoms

    def first_detections(self, traces: Sequence[Sequence[Json]]) -> list[int | None]:
        """Return per trace the number of the first event at which the formula holds, or None."""
        with self._lock:
            return [self._first(trace) for trace in traces]

    def left_open(self, trace: Sequence[Json]) -> str:  # noqa: ARG002
        """Return an empty string: every trace has a verdict."""
        return ""

    def _first(self, trace: Sequence[Json]) -> int | None:
        self._monitor.update({"go": False, **dict.fromkeys(map(_called, self._atoms), False)})
        for number, event in enumerate(trace, 1):
            values = {_called(name): fits(some, event) for name, some in self._atoms.items()}
            if self._monitor.update({"go": True, **values})["value"]:
                return number
        return None


@cache
def _reelay() -> tuple[Any, Any]:
    """Return the extension of Reelay and its monitor options, which are slow to create."""
    extension = installed("reelay._pybind11_module", "Reelay", "pip install '.[mtl]' in a checkout of rvaft")
    return extension, extension.monitor_options("time", "value", False, True)


@lru_cache(maxsize=128)
def _monitor(formula: str) -> tuple[Any, Lock]:
    """Return the monitor of a formula and its lock; Reelay's own constructor parses twice."""
    extension, options = _reelay()
    return extension.discrete_monitor.make(formula, options), Lock()


class DenseProgram:
    """A formula in dense time."""

    def __init__(self, formula: str, atoms: Mapping[str, Sequence[Observed]], time: EventTime, unit: int) -> None:
        self._formula, self._atoms, self._time, self._unit = formula, atoms, time, unit
        self._bounds = [one * unit for one in _densely(formula, unit, unit, 1)[1]]

    def first_detections(self, traces: Sequence[Sequence[Json]]) -> list[int | None]:
        """Return per trace the number of the first event at which the formula holds, or None.

        Raises `TraceError` for a trace that `left_open` refuses.
        """
        return [self._first(trace) for trace in traces]

    def _first(self, trace: Sequence[Json]) -> int | None:
        if why := self.left_open(trace):
            raise TraceError(why, line=None)
        if not trace:
            return None
        places, common, apart = self._places(trace)
        formula = _densely(self._formula, self._unit, common, apart)[0]
        events = [
            (
                place,
                self._time.read(event) is not None,
                tuple(fits(some, event) for some in self._atoms.values()),
            )
            for event, place in zip(trace, places, strict=True)
        ]
        first = _run_densely(formula, tuple(map(_called, self._atoms)), tuple(events))
        return None if first is None else bisect_right(places, first)

    def left_open(self, trace: Sequence[Json]) -> str:
        """Return why the trace has no verdict, or an empty string."""
        times = [time for event in trace if (time := self._time.read(event)) is not None]
        if any(later < earlier for earlier, later in pairwise(times)):
            return "times go backwards"
        if not trace:
            return ""
        places, common, apart = self._places(trace)
        most = max([places[-1], *(one // common * 2 * apart + apart for one in self._bounds)])
        return "the times are too many for the numbers of Reelay" if most >= _EXACT else ""

    def _places(self, trace: Sequence[Json]) -> tuple[list[int], int, int]:
        """Return the places of the events in Reelay's time, the common divisor of times and bounds in
        nanoseconds, and half the place that it takes.
        """
        read = [self._time.read(event) for event in trace]
        last = next((time for time in read if time is not None), 0)
        begin, moments = last, list[int]()
        for time in read:
            last = last if time is None else time
            moments.append(last - begin)
        common = gcd(*moments, *self._bounds) or 1
        most = max(Counter(moments).values())
        apart = 2 << most.bit_length()
        places, rank = list[int](), 0
        for number, moment in enumerate(moments):
            rank = rank + 1 if number and moment == moments[number - 1] else 0
            places.append(moment // common * 2 * apart + 2 * rank + 1)
        return places, common, apart


@lru_cache(maxsize=128)
def _densely(formula: str, unit: int, common: int, apart: int) -> tuple[str, tuple[int, ...]]:
    """Return the formula for Reelay in dense time, and the bounds in it."""
    writing = _Dense(unit, common, apart)
    written, _ = writing.transform(_parser().parse(formula))
    return f"{_GO} and {written}", tuple(writing.bounds_found)


@lru_cache(maxsize=4096)
def _run_densely(
    formula: str, names: tuple[str, ...], events: tuple[tuple[int, bool, tuple[bool, ...]], ...]
) -> int | None:
    """Return the first time at which a formula in dense time holds, or None.

    An event is its place, whether it has a time, and which propositions it fits. Reelay cannot
    begin anew, and takes milliseconds to read a formula. So answers are kept: prefixes and
    equivalent events ask for the same again.
    """
    extension, options = _reelay()
    monitor = extension.dense_monitor.make(formula, options)
    off = {"go": False, "known": False, **dict.fromkeys(names, False)}
    found = [*monitor.update({"time": 0, **off})]  # Reelay does not read values at 0
    for place, known, values in events:
        found += monitor.update({"time": place, "go": True, "known": known, **dict(zip(names, values, strict=True))})
        found += monitor.update({"time": place + 1, **off})
    found += monitor.update({"time": events[-1][0] + 2, **off})
    return next((one["time"] for one in found if one["value"]), None)


def _called(name: str) -> str:
    return f"p_{name}"


@lru_cache(maxsize=32)
def compiled(text: str, given: tuple[tuple[str, Pattern], ...]) -> MtlProgram | DenseProgram:
    """Return the program of a text; raises `LanguageError`, `TooLarge`, `ToolMissing`."""
    header, defined = _HEADER.match(text), definitions(text)
    start = 0 if header is None else header.end()
    writing = _Written()
    try:
        formula, depth = writing.transform(_parser().parse(text[start:]))
    except UnexpectedInput as error:
        place = start + max(error.pos_in_stream or 0, 0)
        zero = text[place : place + 1] == "0" and text[:place].rstrip().endswith(":")
        why = ": an upper bound is at least 1, since Reelay reads 0 as no bound" if zero else ""
        raise error_at(f"not a formula of past MTL{why}", text, place, _FILE) from None
    if depth > _DEEPEST:
        raise TooLarge("nested operators", limit=_DEEPEST)
    known = dict(given)
    named = {name: Observed(known.get(name) or ObjectPattern((("event", Literal(name)),))) for name in writing.names}
    atoms = {name: defined.get(name, (one,)) for name, one in named.items()}
    time, unit = _time(text)
    return MtlProgram(formula, atoms) if time is None else DenseProgram(text[start:], atoms, time, unit)


def _time(text: str) -> tuple[EventTime | None, int]:
    """Return the time of events that a header declares, and the unit of bounds in nanoseconds."""
    header = _HEADER.match(text)
    if header is None or not (line := _TIME.match(header[1])):
        return None, 1
    try:
        return parse_time(line[1], _FILE), UNITS[line[2]]
    except LanguageError as error:
        raise error_at(error.message, text, header.start(1), _FILE) from None


def fits(alternatives: Sequence[Observed], event: Json) -> bool:
    """Whether one of the alternative definitions of a proposition fits an event."""
    return any(one.fits(event) for one in alternatives)


def definitions(text: str) -> dict[str, tuple[Observed, ...]]:
    """Return the alternative definitions of each proposition of a header; raises `LanguageError`."""
    found: dict[str, tuple[Observed, ...]] = {}
    header = _HEADER.match(text)
    for line in re.finditer(r"[^\n]*\S", header[1]) if header else ():
        assert header is not None
        if line.start() == 0 and _TIME.fullmatch(line[0]):
            continue
        begin, content = header.start(1) + line.start(), _LINE.fullmatch(line[0])
        if content is None:
            raise error_at("expected a header line NAME := PATTERN when GUARD", text, begin, _FILE)
        cuts = [when.span(1) for when in _WHEN.finditer(content[2]) if when[1]]
        ends = [*(cut[0] for cut in cuts), len(content[2])]
        try:
            pattern = parse_pattern(content[2][: ends[0]])
            several = [parse_guard(content[2][cut[1] : end]) for cut, end in zip(cuts, ends[1:], strict=True)]
        except LanguageError as error:
            raise error_at(error.message, text, begin + content.start(2), _FILE) from None
        when = Operation(Operator.AND, tuple(several)) if len(several) > 1 else next(iter(several), None)
        found[content[1]] = (*found.get(content[1], ()), Observed(pattern, when))
    return found
