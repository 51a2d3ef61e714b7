"""Shrinking: a tree and a trace on which somebody disagrees, made as small as they get together.

Greedy, to a fixpoint: of the candidates that the reductions offer, in a fixed order, the first that still disagrees is taken, and
the reductions are asked again, until none of their candidates disagrees. Only a smaller pair is ever taken, by a measure of
natural numbers compared from the left (`Pair.measure`), so this ends, and the same input gives the same result.
The idea is delta debugging: A. Zeller, R. Hildebrandt, Simplifying and Isolating Failure-Inducing Input, IEEE TSE 28(2), 2002.

A reduction changes one part of the tree. What served a node whose runtime event it changed may have to change as well, so every
smaller tree comes with several traces (`_followed`).
"""

import json
from collections import Counter
from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import dataclass, field, replace
from functools import cached_property
from hashlib import blake2b
from itertools import chain, count, islice
from typing import Final, TypeAlias

from rvaft.errors import OptionError, RvaftError, TreeError
from rvaft.model.guards import JUNCTIONS, Guard, Operation
from rvaft.model.guards import substitute as substitute_guard
from rvaft.model.nodes import Argument, Causality, EventType, Gate, Ignore, Node, On
from rvaft.model.patterns import (
    Anything,
    ListPattern,
    Literal,
    ObjectPattern,
    Pattern,
    Variable,
    match,
    substitute,
    variables,
    walk,
)
from rvaft.model.tree import RVAFT, reachable
from rvaft.model.values import Json, Scalar
from rvaft.rules import require_valid

Disagrees: TypeAlias = Callable[[RVAFT, list[Json]], bool]
Path: TypeAlias = tuple[str | int, ...]

DEFAULT_STEPS: Final = 2_000
"""How often a tree and a trace are tried."""
PLAIN: Final[tuple[Scalar, ...]] = (0, 1, "")
"""The literals that need no simplification, simplest first."""


class NotReproduced(RvaftError, ValueError):
    """There is nothing to shrink: the tree and the trace that were given do not show a disagreement."""


def shrink(
    tree: RVAFT, trace: Iterable[Json], disagrees: Disagrees, *, steps: int = DEFAULT_STEPS
) -> tuple[RVAFT, list[Json]]:
    """A smallest tree and trace on which `disagrees` is still true, no single reduction of which is left to make.

    `disagrees` is asked at most `steps` times, the first time about the input, and only about trees that keep the rules; where it raises
    an `RvaftError`, that is no disagreement. When the steps are used up, the smallest pair so far is the result.

    Raises `NotReproduced` where the input itself does not disagree, `TreeError` where it breaks a rule, and `OptionError` for
    a restricted tree (shrink the whole, and restrict it in `disagrees`) or fewer than one step.

    >>> from rvaft import dumps, loads
    >>> tree, trace = shrink(loads("top and a b s; s sand c d;"), [{"event": "c"}], lambda tree, _: "sand" in dumps(tree))
    >>> print(dumps(tree))
    toplevel s;
    s sand c;
    c;
    <BLANKLINE>
    """
    if steps < 1:
        raise OptionError(f"shrinking takes one step at least, not {steps}")
    if tree.restricted:
        raise OptionError("a part of a tree cannot be shrunk: shrink the whole tree, and take the part in each step")
    require_valid(tree)
    search = _Reducing(Pair.of(tree, trace), disagrees, steps)
    if not search.holds(search.pair):
        raise NotReproduced("there is no disagreement on this tree and trace, so there is nothing to shrink")
    search.run()
    return search.pair.tree, list(search.pair.trace)


class _OutOfSteps(Exception):
    """`disagrees` was asked as often as it may be."""


@dataclass(slots=True)
class _Reducing:
    """The smallest pair so far, and what has been tried."""

    pair: "Pair"
    disagrees: Disagrees
    steps: int
    failed: set[bytes] = field(default_factory=set)

    def run(self) -> None:
        """Reduce to a fixpoint, or until the steps are used up."""
        before = None
        try:
            while before is not self.pair:
                before = self.pair
                for reduction in REDUCTIONS:
                    self._exhaust(reduction)
        except _OutOfSteps:
            pass

    def _exhaust(self, reduction: "Reduction") -> None:
        """Take what one reduction offers. After a success go on where it was: what failed before will mostly fail again."""
        tried = 0
        candidates = reduction(self.pair)
        while (candidate := next(candidates, None)) is not None:
            if self._takes(candidate):
                candidates = islice(reduction(self.pair), tried, None)
            else:
                tried += 1

    def _takes(self, candidate: "Pair") -> bool:
        if candidate.measure >= self.pair.measure or candidate.key in self.failed:
            return False
        if candidate.valid and self.holds(candidate):
            self.pair = candidate
            return True
        self.failed.add(candidate.key)
        return False

    def holds(self, candidate: "Pair") -> bool:
        """Whether the pair disagrees."""
        if self.steps == 0:
            raise _OutOfSteps
        self.steps -= 1
        try:
            return self.disagrees(candidate.tree, list(candidate.trace))
        except RvaftError:
            return False


@dataclass(frozen=True, eq=False)
class Pair:
    """A tree taken apart, and a trace.

    `patterns` are the runtime events that nodes have of their own, with their arguments filled in. Those that the tree was given with
    keep their event types (`calls`, by what is called), for others there are new ones. Until a part changes, the tree is the `whole` one.
    """

    root: str
    nodes: Mapping[str, Node]
    patterns: Mapping[str, Pattern]
    ignores: tuple[tuple[Pattern, Guard | None], ...]
    causality: Causality
    trace: tuple[Json, ...]
    calls: Mapping[str, tuple[On, EventType]]
    whole: RVAFT | None = None

    @classmethod
    def of(cls, tree: RVAFT, trace: Iterable[Json]) -> "Pair":
        """Take a whole tree apart."""
        calls = [node.on for node in tree.nodes.values()] + [ignore.on for ignore in tree.ignores]
        return cls(
            tree.root,
            {name: replace(node, on=None, declared=True, places={}) for name, node in tree.nodes.items()},
            {name: tree.instantiate(node.on) for name, node in tree.nodes.items() if node.on is not None},
            tuple((tree.instantiate(ignore.on), ignore.when) for ignore in tree.ignores),
            tree.causality,
            tuple(trace),
            {repr(tree.instantiate(on)): (on, tree.events[on.event]) for on in calls if on is not None},
            tree,
        )

    def pattern(self, name: str) -> Pattern | None:
        """The runtime event of a node, its own or the default one, if it has any."""
        if name in self.nodes and name not in self.patterns and self.nodes[name].has_event:
            return ObjectPattern((("event", Literal(name)),))
        return self.patterns.get(name)

    @cached_property
    def tree(self) -> RVAFT:
        """The tree; raises `TreeError` where the parts make none."""
        if self.whole is not None:
            return self.whole
        used: dict[str, EventType] = {}

        def call(pattern: Pattern) -> On:
            on, event = self.calls.get(repr(pattern)) or _called(pattern, used, self.calls)
            used[event.name] = event
            return on

        own = {name: call(self.patterns[name]) for name in self.nodes if name in self.patterns}
        nodes = [replace(node, on=own.get(name)) for name, node in self.nodes.items()]
        ignores = [Ignore(call(pattern), when) for pattern, when in self.ignores]
        return RVAFT(self.root, nodes, used.values(), ignores=ignores, causality=self.causality)

    @property
    def valid(self) -> bool:
        """Whether the parts make a tree that keeps the rules."""
        try:
            require_valid(self.tree)
        except TreeError:
            return False
        return True

    @cached_property
    def measure(self) -> tuple[int, ...]:
        """How large the pair is, most important first.

        Nodes, and two more for every parent of a node beyond its first; events; parts of the tree (gates by how much they ask for,
        thresholds, runtime events, guards, patterns, annotations); the text of the trace.
        """
        nodes = self.nodes.values()
        parents = Counter(child for node in nodes for child in node.children)
        patterns = [*self.patterns.values(), *(pattern for pattern, _ in self.ignores)]
        guards = [when for when in (*(node.when for node in nodes), *(when for _, when in self.ignores)) if when]
        gates = sum(1 + list(Gate).index(node.gate) + (node.threshold or 0) for node in nodes if node.gate)
        notes = sum((node.kind is not None) + (node.label is not None) + len(node.attributes) for node in nodes)
        terms = sum(2 + sum(map(_part_size, walk(pattern))) for pattern in patterns) + sum(map(_guard_size, guards))
        return (
            len(self.nodes) + 2 * sum(number - 1 for number in parents.values()),
            len(self.trace),
            gates + notes + terms + len(guards) + len(self.ignores) + list(Causality).index(self.causality),
            len(json.dumps(self.trace)),
        )

    @cached_property
    def key(self) -> bytes:
        """Equal for pairs that are written the same way (so 1 and 1.0 differ)."""
        parts = (self.root, self.nodes, self.patterns, self.ignores, self.causality, self.trace)
        return blake2b(repr(parts).encode("utf-8", "backslashreplace"), digest_size=16).digest()

    @property
    def order(self) -> tuple[str, ...]:
        """The reachable nodes, the root first."""
        return tuple(reachable(self.root, lambda name: self.nodes[name].children))

    def having(
        self, *nodes: Node, root: str | None = None, patterns: Mapping[str, Pattern | None] | None = None
    ) -> "Pair":
        """With these nodes in place of those of the same name, and another root, without what that does not reach."""
        every = {**self.nodes, **{node.name: node for node in nodes}}
        root = root or self.root
        reached = set(reachable(root, lambda name: every[name].children))
        kept = {name: node for name, node in every.items() if name in reached}
        own = {
            name: p for name, p in {**self.patterns, **(patterns or {})}.items() if name in reached and p is not None
        }
        return replace(self, root=root, nodes=kept, patterns=own, whole=None)

    def ignoring(self, index: int, *ignores: tuple[Pattern, Guard | None]) -> "Pair":
        """With these declarations in place of one of what is ignored."""
        return replace(self, ignores=(*self.ignores[:index], *ignores, *self.ignores[index + 1 :]), whole=None)

    def with_events_at(self, index: int, *events: Json) -> "Pair":
        """With these events in place of one of the trace."""
        return replace(self, trace=(*self.trace[:index], *events, *self.trace[index + 1 :]))


def _called(
    pattern: Pattern, used: Mapping[str, EventType], taken: Mapping[str, tuple[On, EventType]]
) -> tuple[On, EventType]:
    """A pattern as a call of an event type: one of those used that is like it, or a new one.

    Its variables become parameters; a local one is a parameter that stands more than once, called with `_`.
    """
    names = variables(pattern)
    parameters = tuple(f"p{number}" if len(names) > 1 else "p" for number, _ in enumerate(names, 1))
    shape = substitute(pattern, dict(zip(names, map(Variable, parameters), strict=True)))
    arguments: list[Argument] = [Anything() if name.startswith("_") else Variable(name) for name in names]
    known = {*used, *(event.name for _, event in taken.values())}
    fresh = next(name for number in count() if (name := f"e{number or ''}") not in known)
    alike = (event for event in used.values() if (event.parameters, event.pattern) == (parameters, shape))
    event = next(alike, EventType(fresh, parameters, shape))
    return On(event.name, tuple(arguments)), event


# -- terms and values ---------------------------------------------------------------------------------------------


def _part_size(part: Pattern) -> int:
    """Fields and items count too, so a pattern is larger than any part of it."""
    match part:
        case Anything():
            return 1
        case Literal():
            return 2
        case Variable():
            return 3
        case ObjectPattern(parts) | ListPattern(parts):
            return 1 + len(parts)


def _guard_size(guard: Guard) -> int:
    """Operators and operands; a variable counts more than a literal."""
    return 1 + sum(map(_guard_size, guard.operands)) if isinstance(guard, Operation) else _part_size(guard) - 1


def _smaller_guards(guard: Guard) -> Iterator[Guard]:
    """`true` or `false`, an operand for an operation, a conjunction or disjunction without one operand; here or further in."""
    yield Literal(True)
    yield Literal(False)
    if not isinstance(guard, Operation):
        return
    yield from guard.operands
    for index, operand in enumerate(guard.operands):
        before, after = guard.operands[:index], guard.operands[index + 1 :]
        if guard.operator in JUNCTIONS and len(guard.operands) > 2:
            yield replace(guard, operands=(*before, *after))
        yield from (replace(guard, operands=(*before, part, *after)) for part in _smaller_guards(operand))


def _smaller_patterns(pattern: Pattern, *, outermost: bool = True) -> Iterator[Pattern]:
    """A pattern without a field or an item, with `_` or a literal for a part; the outermost stays an object."""
    if not outermost:
        yield Anything()
    match pattern:
        case Variable():
            yield from map(Literal, PLAIN)
        case ObjectPattern(fields):
            for index, (name, inner) in enumerate(fields):
                before, after = fields[:index], fields[index + 1 :]
                yield ObjectPattern((*before, *after))
                for part in _smaller_patterns(inner, outermost=False):
                    yield ObjectPattern((*before, (name, part), *after))
        case ListPattern(items):
            for index, inner in enumerate(items):
                for parts in ((), *((part,) for part in _smaller_patterns(inner, outermost=False))):
                    yield ListPattern((*items[:index], *parts, *items[index + 1 :]))
        case _:
            pass


def _fitted(pattern: Pattern, binding: Mapping[str, Json], value: Json) -> Json:
    """A value that matches the pattern, as much as possible the given one."""
    match pattern:
        case Literal(constant):
            return constant
        case Variable(name):
            return binding.get(name, value)
        case Anything():
            return value
        case ObjectPattern(fields):
            there = value if isinstance(value, Mapping) else {}
            return {**there, **{name: _fitted(inner, binding, there.get(name, 0)) for name, inner in fields}}
        case ListPattern(items):
            list_there = value if isinstance(value, list) else []
            found = [*list_there, *[0] * len(items)]
            return [_fitted(item, binding, inner) for item, inner in zip(items, found, strict=False)]


def _places(event: Json) -> Iterator[Path]:
    """The paths to every value inside an event, outer ones first."""
    inner = event.items() if isinstance(event, dict) else enumerate(event) if isinstance(event, list) else ()
    for step, value in inner:
        yield (step,)
        yield from ((step, *path) for path in _places(value))


def _put(event: Json, path: Path, *values: Json) -> Json:
    """A copy of an event with another value at a place, or without the field or item there."""
    step, *below = path
    new = [_put(event[step], tuple(below), *values)] if below else values
    if isinstance(event, list):
        return [*event[: int(step)], *new, *event[int(step) + 1 :]]
    others = {name: value for name, value in event.items() if name != step}
    return others if not new else {name: new[0] if name == step else value for name, value in event.items()}


# -- reductions ---------------------------------------------------------------------------------------------------

Reduction: TypeAlias = Callable[[Pair], Iterator[Pair]]
"""Candidates to go on with instead of a pair, in a fixed order. Those that are not smaller, or no trees, are not tried."""


def _followed(before: Pair, after: Pair) -> Iterator[Pair]:
    """A smaller tree with the trace as it is, and with events that follow what has become of the runtime events they matched.

    What matched a runtime event that is gone leaves, what matched one that is another now is changed to match it: all of it, then
    one by one; where a node has a runtime event only now, any event may become that.
    """
    yield after
    single: list[tuple[int, tuple[Json, ...]]] = []
    every: dict[int, tuple[Json, ...]] = {}
    for name in dict.fromkeys((*before.nodes, *after.nodes)):
        old, new = before.pattern(name), after.pattern(name)
        if old == new:
            continue
        for index, event in enumerate(before.trace):
            binding = {} if old is None else match(old, event, {})
            if binding is not None:
                fitting = () if new is None else (_fitted(new, binding, {}), _fitted(new, binding, event))
                single += [(index, (event,)) for event in fitting] or [(index, ())]
                if old is not None:
                    every[index] = fitting
    for version in (0, 1):
        changed = (every[i][version : version + 1] if i in every else (event,) for i, event in enumerate(before.trace))
        yield replace(after, trace=tuple(chain.from_iterable(changed)))
    kept = [pattern for name in after.nodes if (pattern := after.pattern(name)) is not None]
    needed = {i for i in every if any(match(pattern, before.trace[i], {}) is not None for pattern in kept)}
    yield replace(after, trace=tuple(e for i, e in enumerate(before.trace) if i not in every or i in needed))
    yield from (after.with_events_at(index, *events) for index, events in single)


def _shorter_trace(pair: Pair) -> Iterator[Pair]:
    """Without a run of events: half of them, then shorter and shorter runs down to single events, the last first."""
    size = length = len(pair.trace)
    while size:
        for end in range(length, 0, -size):
            yield replace(pair, trace=(*pair.trace[: max(end - size, 0)], *pair.trace[end:]))
        size //= 2


def _fewer_nodes(pair: Pair) -> Iterator[Pair]:
    """Another root, a child in its gate's place, a leaf for a gate, a gate without one of its children (with K, and with one less)."""
    for name in pair.order:
        yield from _followed(pair, pair.having(root=name))
    for name in pair.order[1:]:
        for child in pair.nodes[name].children:
            parents = [node for node in pair.nodes.values() if name in node.children]
            yield from _followed(pair, pair.having(*(_instead(parent, name, child) for parent in parents)))
    for name in pair.order:
        node = pair.nodes[name]
        if node.gate is not None:
            yield from _followed(pair, pair.having(replace(node, gate=None, children=(), threshold=None)))
            for child in reversed(node.children):
                fewer = _instead(node, child)
                for less in range(2 if node.threshold else 1):
                    threshold = None if node.threshold is None else node.threshold - 1 + less
                    yield from _followed(pair, pair.having(replace(fewer, threshold=threshold)))


def _instead(parent: Node, name: str, *children: str) -> Node:
    """The parent with these children for one of its children, each once."""
    after = chain.from_iterable(children if old == name else (old,) for old in parent.children)
    kept = tuple(dict.fromkeys(after))
    return replace(parent, children=kept, threshold=parent.threshold and min(parent.threshold, len(kept)))


def _fewer_notes(pair: Pair) -> Iterator[Pair]:
    """No label, attributes and kind, at all or at one node; causality as it is by default, with the trace as it is or turned round."""
    bare = [replace(node, kind=None, label=None, attributes=()) for node in pair.nodes.values()]
    yield pair.having(*bare)
    yield from map(pair.having, bare)
    turned = replace(pair, causality=Causality.TOP_DOWN, whole=None)
    yield turned
    yield replace(turned, trace=turned.trace[::-1])


def _simpler_gates(pair: Pair) -> Iterator[Pair]:
    """A simpler gate for a gate, with its children as they are or turned round, or a smaller K."""
    for name in pair.order:
        node = pair.nodes[name]
        for gate in list(Gate)[: list(Gate).index(node.gate)] if node.gate else ():
            for children in (node.children, node.children[::-1]):
                yield pair.having(replace(node, gate=gate, threshold=None, children=children))
        for threshold in range(1, node.threshold or 1):
            yield pair.having(replace(node, threshold=threshold))


def _smaller_terms(pair: Pair) -> Iterator[Pair]:
    """No guard or a smaller one, no runtime event or a smaller one; the same of what is ignored, or none of that."""
    for name in pair.order:
        node, pattern = pair.nodes[name], pair.patterns.get(name)
        guards = [] if node.when is None else [None, *_smaller_guards(node.when)]
        for guard in guards:
            yield from _followed(pair, pair.having(replace(node, when=guard)))
        if pattern is not None:
            yield from _followed(pair, pair.having(patterns={name: None}))
            yield from _followed(pair, pair.having(replace(node, when=None), patterns={name: None}))
            for smaller in _smaller_patterns(pattern):
                yield from _followed(pair, pair.having(patterns={name: smaller}))
    for index, (pattern, when) in enumerate(pair.ignores):
        yield pair.ignoring(index)
        yield from (
            pair.ignoring(index, (pattern, g)) for g in ([] if when is None else [None, *_smaller_guards(when)])
        )
        yield from (pair.ignoring(index, (smaller, when)) for smaller in _smaller_patterns(pattern))


def _constants(pair: Pair) -> Iterator[Pair]:
    """A literal for a variable, wherever that stands: what the trace gives it, or a plain one."""
    values: dict[str, list[Scalar]] = {}
    for pattern in pair.patterns.values():
        for name in variables(pattern):
            found = (match(pattern, event, {}) for event in pair.trace)
            given = [binding[name] for binding in found if binding is not None]
            values.setdefault(name, []).extend(v for v in given if not isinstance(v, dict | list))
    for name, known in values.items():
        for value in {repr(value): value for value in (*known, *PLAIN)}.values():
            by = {name: Literal(value)}
            nodes = [replace(node, when=node.when and substitute_guard(node.when, by)) for node in pair.nodes.values()]
            yield pair.having(*nodes, patterns={n: substitute(old, by) for n, old in pair.patterns.items()})


def _smaller_events(pair: Pair) -> Iterator[Pair]:
    """An event with nothing in it, without a field or item, or with a simpler value."""
    for index, event in enumerate(pair.trace):
        yield pair.with_events_at(index, {})
        for path in _places(event):
            yield pair.with_events_at(index, _put(event, path))
            for plain in PLAIN:
                yield pair.with_events_at(index, _put(event, path, plain))


REDUCTIONS: tuple[Reduction, ...] = (
    _shorter_trace,
    _fewer_nodes,
    _shorter_trace,
    _fewer_notes,
    _smaller_terms,
    _simpler_gates,
    _constants,
    _smaller_events,
)
"""All of them, those first that take most away."""
