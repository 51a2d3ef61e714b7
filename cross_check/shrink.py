"""Shrinking of a tree and a trace on which participants disagree.

The search is greedy: it takes the first candidate of the reductions that still disagrees, and
repeats until none does. Candidates must be smaller by the lexicographic `_Pair.measure`, so the
search terminates. It is a form of delta debugging: A. Zeller, R. Hildebrandt, Simplifying and
Isolating Failure-Inducing Input, IEEE TSE 28(2), 2002.

Events of a changed runtime event may have to change too, so every smaller tree has several
candidate traces (`_followed`).
"""

import json
from collections import Counter
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from hashlib import blake2b
from itertools import chain, count, islice
from random import Random
from typing import Any, Final, TypeAlias

from cross_check.generate.times import with_time, without_time, written
from rvaft.errors import OptionError, RvaftError
from rvaft.model.event_time import EventTime, TextFormat, TimeFormat
from rvaft.model.guards import ARITHMETIC, COMPARISONS, JUNCTIONS, Duration, Guard, Operation, TimePoint, time_points
from rvaft.model.nodes import Causality, EventType, Gate, Ignore, Node, On
from rvaft.model.patterns import (
    Anything,
    ListPattern,
    Literal,
    ObjectPattern,
    Pattern,
    SomeItem,
    Variable,
    match,
    substitute,
    variables,
)
from rvaft.model.tree import RVAFT, reachable
from rvaft.model.values import Json, Scalar
from rvaft.rules.validity import require_valid

DEFAULT_STEPS: Final = 2_000
"""Default number of attempts."""
PLAIN: Final[tuple[Scalar, ...]] = (0, 1, "")
"""Literals that need no simplification, simplest first."""
_SIMPLEST: Final = sorted(Gate, key=lambda gate: gate.ordered)


class NotReproduced(RvaftError, ValueError):
    """The tree and trace to shrink show no disagreement."""


class _OutOfSteps(Exception):
    """The allowed number of attempts is used up."""


def shrink(
    tree: RVAFT, trace: Iterable[Json], disagrees: Callable[[RVAFT, list[Json]], bool], *, steps: int = DEFAULT_STEPS
) -> tuple[RVAFT, list[Json]]:
    """Return a smallest tree and trace on which `disagrees` holds; no single reduction remains.

    `disagrees` is called at most `steps` times, first on the input, and only on valid trees; an
    `RvaftError` counts as no disagreement. Without remaining steps, the smallest pair so far is
    returned. Raises `NotReproduced` if the input does not disagree, `TreeError` if it is invalid,
    and `OptionError` for a restricted tree (restrict it in `disagrees` instead) or less than one
    step.

    >>> from rvaft import dumps, loads
    >>> tree = loads("top and a b s; s sand c d;")
    >>> tree, trace = shrink(tree, [{"event": "c"}], lambda tree, _: "sand" in dumps(tree))
    >>> print(dumps(tree))
    toplevel s;
    s sand c;
    c;
    <BLANKLINE>
    """
    if steps < 1:
        raise OptionError(f"shrinking needs at least one step, not {steps}")
    if tree.restricted:
        raise OptionError("a restricted tree cannot be shrunk: shrink the whole tree, and restrict it in each step")
    require_valid(tree)
    pair, left, tried = _Pair.of(tree, trace), steps, set[bytes]()

    def holds(candidate: _Pair) -> bool:
        nonlocal left
        try:
            require_valid(candidate.tree)
            if left == 0:
                raise _OutOfSteps
            left -= 1
            return disagrees(candidate.tree, list(candidate.trace))
        except RvaftError:
            return False

    def takes(candidate: _Pair) -> bool:
        nonlocal pair
        if candidate.measure >= pair.measure or candidate.key in tried:
            return False
        tried.add(candidate.key)
        if taken := holds(candidate):
            pair = candidate
        return taken

    if not holds(pair):
        raise NotReproduced("this tree and trace show no disagreement to shrink")
    before = None
    try:
        while before is not pair:
            before = pair
            for reduction in _REDUCTIONS:
                failed, candidates = 0, reduction(pair)
                while (candidate := next(candidates, None)) is not None:
                    if takes(candidate):  # continue at the same place: earlier candidates mostly fail again
                        candidates = islice(reduction(pair), failed, None)
                    else:
                        failed += 1
    except _OutOfSteps:
        pass
    return pair.tree, list(pair.trace)


@dataclass(frozen=True, eq=False)
class _Pair:
    """A decomposed tree, and a trace.

    `patterns` are the nodes' own runtime events with arguments filled in. Original patterns keep
    their event types (`calls`, by pattern); others get new ones. `whole` is the tree until a part
    changes.
    """

    root: str
    nodes: Mapping[str, Node]
    patterns: Mapping[str, Pattern]
    ignores: tuple[tuple[Pattern, Guard | None], ...]
    stated: Mapping[str, Any]
    trace: tuple[Json, ...]
    calls: Mapping[str, tuple[On, EventType]]
    whole: RVAFT | None = None

    @classmethod
    def of(cls, tree: RVAFT, trace: Iterable[Json]) -> "_Pair":
        calls = [node.on for node in tree.nodes.values()] + [ignore.on for ignore in tree.ignores]
        calls += [clause.on for node in tree.nodes.values() for clause in node.without]
        return cls(
            tree.root,
            {name: replace(node, on=None, declared=True, places={}) for name, node in tree.nodes.items()},
            {name: tree.instantiate(node.on) for name, node in tree.nodes.items() if node.on is not None},
            tuple((tree.instantiate(ignore.on), ignore.when) for ignore in tree.ignores),
            {name: getattr(tree, name) for name in ("causality", "time", "semantics")},
            tuple(trace),
            {repr(tree.instantiate(on)): (on, tree.events[on.event]) for on in calls if on is not None},
            tree,
        )

    def pattern(self, name: str) -> Pattern | None:
        if name in self.nodes and name not in self.patterns and self.nodes[name].has_event:
            return ObjectPattern((("event", Literal(name)),))
        return self.patterns.get(name)

    @cached_property
    def tree(self) -> RVAFT:
        if self.whole is not None:
            return self.whole
        used: dict[str, EventType] = {}

        def call(pattern: Pattern) -> On:
            on, event = self.calls.get(repr(pattern)) or self._called(pattern, used)
            used[event.name] = event
            return on

        own = {name: call(self.patterns[name]) for name in self.nodes if name in self.patterns}
        nodes = [replace(node, on=own.get(name)) for name, node in self.nodes.items()]
        ignores = [Ignore(call(pattern), when) for pattern, when in self.ignores]
        declared = {event.name: event for _, event in self.calls.values()}
        used.update((one.on.event, declared[one.on.event]) for node in nodes for one in node.without)
        return RVAFT(self.root, nodes, used.values(), ignores=ignores, **self.stated)

    @property
    def time(self) -> EventTime | None:
        found: EventTime | None = self.stated["time"]
        return found

    def stating(self, **stated: Any) -> "_Pair":
        return replace(self, stated={**self.stated, **stated}, whole=None)

    def _called(self, pattern: Pattern, used: Mapping[str, EventType]) -> tuple[On, EventType]:
        """Return a pattern as a call of a similar used event type, or of a new one.

        Variables become parameters; a local variable that occurs repeatedly is called with `_`.
        """
        names = variables(pattern)
        parameters = tuple(f"p{number}" if len(names) > 1 else "p" for number, _ in enumerate(names, 1))
        shape = substitute(pattern, dict(zip(names, map(Variable, parameters), strict=True)))
        known = {*used, *(event.name for _, event in self.calls.values())}
        fresh = next(name for number in count() if (name := f"e{number or ''}") not in known)
        alike = (event for event in used.values() if (event.parameters, event.pattern) == (parameters, shape))
        event = next(alike, EventType(fresh, parameters, shape))
        arguments = (Anything() if name.startswith("_") else Variable(name) for name in names)
        return On(event.name, tuple(arguments)), event

    @cached_property
    def measure(self) -> tuple[int, ...]:
        """The size of the pair, most important first.

        Nodes, plus two per additional parent of a node; events; parts of the tree (gates,
        thresholds, runtime events, guards, patterns, annotations); the text of the trace.
        """
        nodes = self.nodes.values()
        parents = Counter(child for node in nodes for child in node.children)
        patterns = [*self.patterns.values(), *(pattern for pattern, _ in self.ignores)]
        guards = [when for when in (*(node.when for node in nodes), *(when for _, when in self.ignores)) if when]
        gates = sum(1 + _SIMPLEST.index(node.gate) + (node.threshold or 0) for node in nodes if node.gate)
        notes = sum((node.kind is not None) + (node.label is not None) + len(node.attributes) for node in nodes)
        notes += sum(3 + 3 * (one.when is not None) + _length(one.duration) for node in nodes for one in node.without)
        notes += sum(node.times - 1 + _length(node.within) for node in nodes) + (self.stated["semantics"] is not None)
        if self.time is not None:
            form = self.time.format
            size = len(str(form)) if isinstance(form, TextFormat) else list(TimeFormat).index(form)
            notes += 2 + size + len("".join(self.time.field)) + _length(self.time.late)
        terms = 2 * len(patterns) + len(guards) + sum(map(_size, (*patterns, *guards)))
        return (
            len(self.nodes) + 2 * sum(number - 1 for number in parents.values()),
            len(self.trace),
            gates + notes + terms + len(self.ignores) + list(Causality).index(self.stated["causality"]),
            len(json.dumps(self.trace)),
        )

    @cached_property
    def key(self) -> bytes:
        parts = (self.root, self.nodes, self.patterns, self.ignores, self.stated, self.trace)
        return blake2b(repr(parts).encode("utf-8", "backslashreplace"), digest_size=16).digest()

    @property
    def order(self) -> tuple[str, ...]:
        return tuple(reachable(self.root, lambda name: self.nodes[name].children))

    def having(
        self, *nodes: Node, root: str | None = None, patterns: Mapping[str, Pattern | None] | None = None
    ) -> "_Pair":
        """Return the pair with replaced nodes and another root, without unreachable nodes."""
        every = {**self.nodes, **{node.name: node for node in nodes}}
        reached = set(reachable(root or self.root, lambda name: every[name].children))
        own = {**self.patterns, **(patterns or {})}
        return replace(
            self,
            root=root or self.root,
            nodes={name: node for name, node in every.items() if name in reached},
            patterns={name: pattern for name, pattern in own.items() if name in reached and pattern is not None},
            whole=None,
        )

    def with_events_at(self, index: int, *events: Json) -> "_Pair":
        return replace(self, trace=_spliced(self.trace, index, *events))


def _spliced(items: Sequence[Any], index: int, *new: Any) -> tuple[Any, ...]:
    return (*items[:index], *new, *items[index + 1 :])


# Nested parts of patterns, guards and events.

_WEIGHTS: Final = {Anything: 1, Literal: 2, Variable: 3}


def _opened(whole: Any) -> tuple[list[tuple[Any, Any]], Callable[[Iterable[tuple[Any, Any]]], Any]]:
    match whole:
        case dict():
            return list(whole.items()), dict
        case list():
            return list(enumerate(whole)), lambda parts: [part for _, part in parts]
        case ObjectPattern(fields):
            return list(fields), lambda parts: ObjectPattern(tuple(parts))
        case ListPattern(items):
            return list(enumerate(items)), lambda parts: ListPattern(tuple(part for _, part in parts))
        case SomeItem(item):
            return [(0, item)], lambda parts: next((SomeItem(part) for _, part in parts), Anything())
        case Operation(operator, operands):
            return list(enumerate(operands)), lambda parts: Operation(operator, tuple(part for _, part in parts))
        case _:
            return [], lambda _: whole


def _length(duration: int | None) -> int:
    return 0 if duration is None else 2 + duration.bit_length()


def _size(term: Any) -> int:
    """Return the size; fields, items and operands count, so a term is larger than its parts."""
    parts, _ = _opened(term)
    if isinstance(term, Duration) and isinstance(term.value, int):
        return _length(term.value)
    return _WEIGHTS.get(type(term), 1 + len(parts)) + sum(_size(part) for _, part in parts)


def _smaller(whole: Any, simpler: Callable[[Any], Iterable[Any]]) -> Iterator[Any]:
    parts, made = _opened(whole)
    shrinks = not isinstance(whole, Operation) or (whole.operator in JUNCTIONS and len(parts) > 2)
    for index, (name, part) in enumerate(parts):
        if shrinks:
            yield made(_spliced(parts, index))
        for other in chain(simpler(part), _smaller(part, simpler)):
            yield made(_spliced(parts, index, (name, other)))


def _smaller_patterns(pattern: Pattern) -> Iterator[Pattern]:
    return _smaller(pattern, lambda part: [Anything(), *(map(Literal, PLAIN) if isinstance(part, Variable) else ())])


def _smaller_guards(guard: Guard | None) -> Iterator[Guard | None]:
    """Yield smaller guards: none, `true`, `false`, an operand, fewer operands, half a duration."""

    def simpler(part: Guard) -> list[Guard]:
        match part:
            case Duration(int() as value):
                return [Duration(0), Duration(value // 2)]
            case TimePoint():
                return []
            case Operation(operator, operands) if operator in ARITHMETIC and any(
                isinstance(one, TimePoint) for one in operands
            ):  # compare a difference of points with a duration, and a point with a point
                return [operands[0]] if isinstance(operands[1], Duration) else []
            case Operation(operator) if operator in COMPARISONS and time_points(
                part
            ):  # a time alone is not a condition
                return [Literal(True), Literal(False)]
        return [Literal(True), Literal(False), *(part.operands if isinstance(part, Operation) else ())]

    return iter(()) if guard is None else chain([None], simpler(guard), _smaller(guard, simpler))


def _fitted(pattern: Pattern, binding: Mapping[str, Json], value: Json) -> Json:
    match pattern:
        case Literal(constant):
            return constant
        case Variable(name):
            return binding.get(name, value)
        case Anything():
            return value
        case ObjectPattern(fields):
            there = value if isinstance(value, dict) else {}
            return {**there, **{name: _fitted(inner, binding, there.get(name, 0)) for name, inner in fields}}
        case ListPattern(items):
            known = [*(value if isinstance(value, list) else ()), *[0] * len(items)]
            return [_fitted(item, binding, inner) for item, inner in zip(items, known, strict=False)]
        case SomeItem(item):
            first, *others = value if isinstance(value, list) and value else [0]
            return [_fitted(item, binding, first), *others]


# Reductions: candidates in a fixed order; those that are not smaller or not trees are not tried.

Reduction: TypeAlias = Callable[[_Pair], Iterator[_Pair]]


def _followed(before: _Pair, after: _Pair) -> Iterator[_Pair]:
    """Yield a smaller tree with the same trace, and with events adapted to changed runtime events.

    Events of a removed runtime event are removed, those of a changed one are changed: all, then one
    by one. If a node gains a runtime event, any event may become it.
    """
    yield after
    single: list[tuple[int, tuple[Json, ...]]] = []
    every: dict[int, tuple[Json, ...]] = {}
    for name in dict.fromkeys((*before.nodes, *after.nodes)):
        old, new = before.pattern(name), after.pattern(name)
        for index, event in enumerate(before.trace if old != new else ()):
            binding = {} if old is None else match(old, event, {})
            if binding is not None:
                fitting = () if new is None else (_fitted(new, binding, {}), _fitted(new, binding, event))
                single += [(index, (event,)) for event in fitting] or [(index, ())]
                if old is not None:
                    every[index] = fitting[1:]
    changed = (every.get(index, (event,)) for index, event in enumerate(before.trace))
    yield replace(after, trace=tuple(chain.from_iterable(changed)))
    yield from (after.with_events_at(index, *events) for index, events in single)


def _shorter_trace(pair: _Pair) -> Iterator[_Pair]:
    """Yield the trace without runs of events: halves, then shorter runs down to single events, last
    first.
    """
    size = length = len(pair.trace)
    while size:
        for end in range(length, 0, -size):
            yield replace(pair, trace=(*pair.trace[: max(end - size, 0)], *pair.trace[end:]))
        size //= 2


def _fewer_nodes(pair: _Pair) -> Iterator[_Pair]:
    for name in pair.order:
        yield from _followed(pair, pair.having(root=name))
    for name in pair.order[1:]:
        for child in pair.nodes[name].children:
            parents = [node for node in pair.nodes.values() if name in node.children]
            yield from _followed(pair, pair.having(*(_instead(parent, name, child) for parent in parents)))
    for name in pair.order:
        node = pair.nodes[name]
        if node.gate is not None:
            yield from _followed(pair, pair.having(replace(node, gate=None, children=(), threshold=None, within=None)))
            for child in reversed(node.children):
                fewer = _instead(node, child)
                for less in range(2 if node.threshold else 1):
                    threshold = None if node.threshold is None else node.threshold - 1 + less
                    yield from _followed(pair, pair.having(replace(fewer, threshold=threshold)))


def _instead(parent: Node, name: str, *children: str) -> Node:
    kept = tuple(dict.fromkeys(_spliced(parent.children, parent.children.index(name), *children)))
    return replace(parent, children=kept, threshold=parent.threshold and min(parent.threshold, len(kept)))


def _fewer_notes(pair: _Pair) -> Iterator[_Pair]:
    bare = [replace(node, kind=None, label=None, attributes=()) for node in pair.nodes.values()]
    yield pair.having(*bare)
    yield from map(pair.having, bare)
    yield pair.stating(causality=Causality.TOP_DOWN)
    yield pair.stating(semantics=None)


def _smaller_terms(pair: _Pair) -> Iterator[_Pair]:
    for name in pair.order:
        node, pattern = pair.nodes[name], pair.patterns.get(name)
        for guard in _smaller_guards(node.when):
            yield from _followed(pair, pair.having(replace(node, when=guard)))
        if pattern is not None:
            yield from _followed(pair, pair.having(patterns={name: None}))
            for smaller in _smaller_patterns(pattern):
                yield from _followed(pair, pair.having(patterns={name: smaller}))
    for index, (pattern, when) in enumerate(pair.ignores):
        guarded = ((pattern, guard) for guard in _smaller_guards(when))
        for ignores in chain([()], zip(guarded), (((smaller, when),) for smaller in _smaller_patterns(pattern))):
            yield replace(pair, ignores=_spliced(pair.ignores, index, *ignores), whole=None)


def _simpler_nodes(pair: _Pair) -> Iterator[_Pair]:
    for name in pair.order:
        node = pair.nodes[name]
        simpler: list[dict[str, Any]] = []
        if node.gate is not None:
            simpler += [{"gate": gate, "threshold": None} for gate in _SIMPLEST[: _SIMPLEST.index(node.gate)]]
        simpler += [{"threshold": threshold} for threshold in range(1, node.threshold or 1)]
        simpler += [{"times": times} for times in sorted({1, node.times - 1}) if times]
        simpler += [{"within": within} for within in _shorter(node.within)]
        for place, clause in enumerate(node.without):
            changed = [] if clause.when is None else [replace(clause, when=None)]
            changed += [replace(clause, duration=one) for one in _shorter(clause.duration) if one is not None]
            simpler += [{"without": _spliced(node.without, place, *some)} for some in ((), *zip(changed))]
        yield from (pair.having(replace(node, **changes)) for changes in simpler)


def _shorter(duration: int | None) -> list[int | None]:
    return [] if duration is None else [None, 0, duration // 2]


def _simpler_times(pair: _Pair) -> Iterator[_Pair]:
    """Yield trees without times or `late`, and with times from 0 in seconds in the field `t`."""
    old = pair.time
    if old is None:
        return
    yield pair.stating(time=None)
    yield from (pair.stating(time=replace(old, late=late)) for late in _shorter(old.late))
    known = [instant for event in pair.trace if (instant := old.read(event)) is not None]
    for form, field in ((TimeFormat.SECONDS, ("t",)), (TimeFormat.NANOSECONDS, ("t",)), (old.format, old.field)):
        new = replace(old, format=form, field=field)
        for begin in (min(known, default=0), 0):
            trace = tuple(_retimed(event, old, new, begin) for event in pair.trace)
            yield replace(pair.stating(time=new), trace=trace)


def _retimed(event: Json, old: EventTime, new: EventTime, begin: int) -> Json:
    instant = old.read(event)
    if instant is None:
        return event
    value = written(Random(0), new.format, instant - begin, plain=True)  # noqa: S311 (plain: nothing is drawn)
    return with_time(without_time(event, old.field), new.field, value) or event


def _smaller_events(pair: _Pair) -> Iterator[_Pair]:
    for index, event in enumerate(pair.trace):
        for smaller in _smaller(event, lambda _: PLAIN):
            yield pair.with_events_at(index, smaller)


_REDUCTIONS: Final[tuple[Reduction, ...]] = (
    _shorter_trace,
    _fewer_nodes,
    _fewer_notes,
    _smaller_terms,
    _simpler_nodes,
    _simpler_times,
    _smaller_events,
)
"""All reductions, the most effective first."""
