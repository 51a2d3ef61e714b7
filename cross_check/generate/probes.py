"""Probes: detecting traces with the constants of a text that a person wrote.

A condition that few values meet, such as `user != "backup"`, stays unseen on random traces. So each
constant of the text is put into every field, and each of its numbers is exceeded as a distance.
"""

import math
import re
from collections.abc import Iterable, Iterator, Sequence
from contextlib import suppress
from dataclasses import replace
from itertools import chain, islice, product, zip_longest
from random import Random
from typing import Final

from cross_check.generate.assumptions import conforming
from cross_check.generate.times import MICROSECOND, timed
from cross_check.generate.traces import PLAIN, WILD, NoTraceFound, Scenarios, guided, noise
from cross_check.generate.values import COMMON, Path, field_at, places, put
from rvaft.model.event_time import UNITS
from rvaft.model.tree import RVAFT
from rvaft.model.values import NUMBER, Json, key
from rvaft.model.verdict import Semantics

Trace = list[Json]

_DRAWN: Final = 40
"""Number of detecting traces from which those with different events are taken."""
_BASES: Final = 6
_FIELDS: Final = 8
"""Maximum number of further fields of a text that events get."""
LONGEST: Final = 300
"""Maximum distance in events."""
_TEXT: Final = re.compile(r"\"((?:\\.|[^\"\\\n])*)\"|'((?:''|\\.|[^'\\\n])*)'|`([^`\n]*)`")
_WORD: Final = re.compile(r"[A-Za-z_@][\w.@-]*", re.ASCII)
_YAML: Final = re.compile(r"^[^#\n]*?(?::|-)[ \t]+([^\s\"'{\[#][^#\n]*?)[ \t]*$", re.MULTILINE)
_DIGITS: Final = re.compile(rf"(?<![\w.]){NUMBER.pattern}(?=(?:[nmu]?s|min|[mhd])?\b)", re.ASCII)
_DURATION: Final = re.compile(r"(?<![\w.])(\d+(?:\.\d+)?)([nmu]?s|min|[mhd])\b", re.ASCII)
_BESIDE: Final = (0, MICROSECOND)
_STARS: Final = str.maketrans("", "", "*%")


def constants(text: str) -> tuple[list[str], list[int | float], list[str]]:
    """Return the texts in quotes or of YAML, the numbers, and the words of a specification.

    >>> constants("a == 'x*' and b > 1.50 within 3m")
    (['x*', 'x'], [1.5, 3], ['a', 'and', 'b', 'within', 'm'])
    """
    quoted = [next(part for part in found.groups() if part is not None) for found in _TEXT.finditer(text)]
    bare = _TEXT.sub(" ", text)
    plain = [found[1] for found in _YAML.finditer(bare)]
    texts = [one for found in (*quoted, *plain) for one in (found, found.translate(_STARS))]
    numbers = [found[0] for one in (bare, *quoted) for found in _DIGITS.finditer(one)]
    exact = [int(one) if one.lstrip("-").isdigit() and len(one) < 20 else float(one) for one in numbers]
    words = [found[0] for found in _WORD.finditer(bare)]
    finite = [one for one in exact if math.isfinite(one)]
    return [*dict.fromkeys(texts)], [*dict.fromkeys(finite)], [*dict.fromkeys(words)]


def probes(
    tree: RVAFT, semantics: Semantics, written: str, known: str, *, seed: str, most: int
) -> tuple[list[Trace], str]:
    """Return up to `most` traces with the constants of a text, and what was not tried.

    Constants that a `known` text has too, the translation of the tree, come last.
    """
    random = Random(seed)  # noqa: S311 (no secret)
    texts, numbers, words = constants(written)
    before = {repr(one) for some in constants(known) for one in some}
    numbers.sort(key=lambda one: repr(one) in before)
    values: list[Json] = [*texts, *(value for number in numbers for value in (number, number + 1))]
    new = [one for one in values if repr(one) not in before]
    bases = _bases(random, tree, semantics)
    fields = _further_fields(bases, [one for one in (*texts, *words) if repr(one) not in before])
    ways = [
        chain(_with_values(bases, new), _with_fields(bases, new, fields), _with_values(bases, values)),
        _apart(random, tree, semantics, bases, [one for one in numbers if isinstance(one, int)]),
        _later(random, tree, bases, _distances(written, numbers)),
    ]
    unique: dict[str, Trace] = {}
    for trace in chain.from_iterable(zip_longest(*ways)):
        if trace is not None and len(unique) <= most:
            unique.setdefault(repr(trace), trace)
        elif len(unique) > most:
            break
    untried = ["some of its constants" * (len(unique) > most)]
    if semantics is not Semantics.STRICT and any(one > LONGEST for one in numbers):
        untried.append(f"distances over {LONGEST} events")
    missing = " and ".join(filter(None, untried))
    return [*unique.values()][:most], f"not tried: {missing}" if missing else ""


def _bases(random: Random, tree: RVAFT, semantics: Semantics) -> list[Trace]:
    """Return detecting traces of different shapes that keep the assumptions of the tree."""
    found: dict[str, Trace] = {}
    scenarios = Scenarios(tree)
    for number in range(_DRAWN):
        with suppress(NoTraceFound):
            manner = replace((PLAIN, WILD)[number % 2], attempts=5)
            trace = guided(random, tree, semantics, manner, scenarios)
            shape = repr([sorted(event) if isinstance(event, dict) else 0 for event in trace])
            found.setdefault(shape, conforming(tree, trace, tree.assumes))
        if len(found) == _BASES:
            break
    return [*found.values()]


def _further_fields(bases: Sequence[Trace], words: Iterable[str]) -> list[str]:
    known = {field_at(path) for trace in bases for path, _ in places(trace)}
    names = (word.removeprefix("$.").strip('"') for word in words)
    return [*islice(dict.fromkeys(one for one in names if _WORD.fullmatch(one) and one not in known), _FIELDS)]


def _with_values(bases: Sequence[Trace], values: Sequence[Json]) -> Iterator[Trace]:
    """Yield the traces with each value in place of another one: everywhere, first and last."""
    for base in bases:
        every = [(path, old) for path, old in places(base) if len(path) > 1 and not isinstance(old, dict | list)]
        where: dict[object, list[Path]] = {}
        for path, old in every:
            where.setdefault(key(old), []).append(path)
        for value in values:
            for old, paths in where.items():
                if old != key(value):
                    yield from (_put(base, some, value) for some in (paths, paths[:1], paths[-1:]))


def _with_fields(bases: Sequence[Trace], values: Sequence[Json], fields: Sequence[str]) -> Iterator[Trace]:
    """Yield the traces whose events have a further field with each value."""
    for base, field, value in product(bases, fields, values):
        yield [{**event, field: value} for event in base]


def _put(trace: Trace, paths: Iterable[Path], value: Json) -> Trace:
    for path in paths:
        trace = put(trace, path, value)
    return trace


def _apart(
    random: Random, tree: RVAFT, semantics: Semantics, bases: Sequence[Trace], numbers: Iterable[int]
) -> Iterator[Trace]:
    """Yield the traces with so many irrelevant events before an event."""
    if semantics is Semantics.STRICT:
        return
    for number in (one for one in numbers if 0 < one <= LONGEST):
        for base in bases:
            for at in range(len(base)):
                extra = [noise(random, tree, COMMON) for _ in range(number)]
                events = [event for event in extra if event is not None]
                yield [*base[:at], *_between(tree, base, at, events), *base[at:]]


def _between(tree: RVAFT, base: Trace, at: int, events: Trace) -> Trace:
    """Return the events with times that increase between those of the neighbours."""
    if tree.time is None:
        return events
    before = None if at == 0 else tree.time.read(base[at - 1])
    after = tree.time.read(base[at])
    if after is None:
        return events
    first = after - len(events) * MICROSECOND if before is None else before
    step = (after - first) // (len(events) + 1) // MICROSECOND * MICROSECOND
    plain = Random(0)  # noqa: S311 (no secret)
    return [timed(plain, tree, event, first + step * number, plain=True) for number, event in enumerate(events, 1)]


def _distances(written: str, numbers: Iterable[int | float]) -> list[int]:
    """Return the durations that a text may mean, in nanoseconds: those with a unit first."""
    stated = [float(number) * UNITS[{"m": "min"}.get(unit, unit)] for number, unit in _DURATION.findall(written)]
    every = (*stated, *(number * unit for number in numbers for unit in UNITS.values()))
    return [*dict.fromkeys(round(one) for one in every if 0 < one < 4_000 * UNITS["d"])]


def _later(random: Random, tree: RVAFT, bases: Sequence[Trace], distances: Sequence[int]) -> Iterator[Trace]:
    """Yield the traces with an event, and those after it, so much time after the event before it."""
    for base in bases if tree.time is not None else ():
        times = [None if tree.time is None else tree.time.read(event) for event in base]
        for at, by in product(range(len(base) - 1, 0, -1), (one + more for one in distances for more in _BESIDE)):
            before, own = times[at - 1], times[at]
            if before is not None and own is not None:
                yield [
                    event
                    if place < at or time is None
                    else timed(random, tree, event, time + before + by - own, plain=True)
                    for place, (event, time) in enumerate(zip(base, times, strict=True))
                ]
