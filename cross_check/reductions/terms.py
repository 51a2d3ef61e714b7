"""Simpler terms: literals and `_` for variables, patterns with fewer parts, event types with fewer parameters, plain literals."""

from collections.abc import Callable, Iterable, Iterator
from dataclasses import replace
from typing import TypeAlias, cast

from cross_check.reductions.events import with_value, without_value
from cross_check.reductions.pair import Pair
from cross_check.reductions.sizes import PLAIN, Path, Step, literal_size, literals, places, written
from rvaft.guards import Guard, Operation
from rvaft.model import Argument, EventType, On
from rvaft.patterns import Anything, ListPattern, Literal, ObjectPattern, Pattern, Variable, match, substitute
from rvaft.patterns import variables as pattern_variables
from rvaft.values import Json, Scalar

Leaf: TypeAlias = Literal | Variable | Anything


def constant_variables(pair: Pair) -> Iterator[Pair]:
    """A literal for a variable, everywhere in the nodes: what the trace gives it, or a plain one."""
    for name in pair.tree.variables:
        for value in _values_of(pair, name):
            yield _nodes_mapped(pair, _exchange(Variable(name), Literal(value)))


def _values_of(pair: Pair, variable: str) -> list[Scalar]:
    found: list[Scalar] = []
    for node in pair.order:
        pattern = pair.tree.pattern(node)
        matches = [] if pattern is None else [match(pattern, event, {}) for event in pair.trace]
        found += [one[variable] for one in matches if one is not None and variable in one]
    scalars = [value for value in found if not isinstance(value, (dict, list))]
    return list({written(value): value for value in (*scalars, *PLAIN)}.values())


def smaller_arguments(pair: Pair) -> Iterator[Pair]:
    """`_` for a variable in all runtime events, or for one argument of a node or an `ignore`; there also a literal."""
    for variable in pair.tree.variables:
        yield _calls_mapped(pair, _exchange(Variable(variable), Anything()))
    for node in pair.nodes.values():
        for on in [] if node.on is None else _smaller_calls(node.on, ()):
            yield replace(pair, nodes={**pair.nodes, node.name: replace(node, on=on)})
    for index, ignore in enumerate(pair.ignores):
        for on in _smaller_calls(ignore.on, PLAIN):
            yield replace(pair, ignores=(*pair.ignores[:index], replace(ignore, on=on), *pair.ignores[index + 1 :]))


def _smaller_calls(on: On, plain: tuple[Scalar, ...]) -> Iterator[On]:
    for index, argument in enumerate(on.arguments):
        smaller: list[Argument] = [Anything()] if not isinstance(argument, Anything) else []
        smaller += [Literal(value) for value in plain] if isinstance(argument, Variable) else []
        for one in smaller:
            yield replace(on, arguments=(*on.arguments[:index], one, *on.arguments[index + 1 :]))


def simpler_patterns(pair: Pair) -> Iterator[Pair]:
    """An event type without a parameter (`_`, or what all uses give it), without a field, with `_` for a part.

    A list pattern loses an item only together with the lists of the trace that it could match: a shorter one matches other lists.
    """
    for event in pair.events.values():
        calls = [node.on for node in pair.nodes.values()] + [ignore.on for ignore in pair.ignores]
        uses = [on for on in calls if on is not None and on.event == event.name]
        for index, parameter in enumerate(event.parameters):
            given = {repr(on.arguments[index]): on.arguments[index] for on in uses}
            alike = [argument for argument in given.values() if not isinstance(argument, Variable) and len(given) == 1]
            for argument in (Anything(), *alike):
                yield _redefined(pair, event, substitute(event.pattern, {parameter: argument}))
        for pattern in smaller_patterns(event.pattern):
            yield _redefined(pair, event, pattern)
        for path, length in list_items(event.pattern):
            trace = [_without_item(one, path, length) for one in pair.trace]
            yield _redefined(pair, event, _without_part(event.pattern, path)).with_trace(trace)


def smaller_patterns(pattern: Pattern) -> Iterator[Pattern]:
    """A pattern without one field, here or further in, or with `_` for a part; the outermost stays an object."""
    match pattern:
        case ObjectPattern(fields):
            for index, (name, inner) in enumerate(fields):
                before, after = fields[:index], fields[index + 1 :]
                yield ObjectPattern((*before, *after))
                yield ObjectPattern((*before, (name, Anything()), *after))
                yield from (ObjectPattern((*before, (name, part), *after)) for part in smaller_patterns(inner))
        case ListPattern(items):
            for index, inner in enumerate(items):
                for part in (Anything(), *smaller_patterns(inner)):
                    yield ListPattern((*items[:index], part, *items[index + 1 :]))
        case _:
            pass


def list_items(pattern: Pattern) -> Iterator[tuple[Path, int]]:
    """Where a pattern has an item of a list, and how long that list is."""
    inner: Iterable[tuple[Step, Pattern]] = ()
    match pattern:
        case ObjectPattern(fields):
            inner = fields
        case ListPattern(items):
            yield from (((index,), len(items)) for index in range(len(items)))
            inner = enumerate(items)
    for step, part in inner:
        yield from (((step, *path), length) for path, length in list_items(part))


def _without_part(pattern: Pattern, path: Path) -> Pattern:
    step, *below = path
    match pattern:
        case ObjectPattern(fields):
            changed = [(name, _without_part(inner, tuple(below)) if name == step else inner) for name, inner in fields]
            return ObjectPattern(tuple(changed))
        case ListPattern(items):
            kept = [_without_part(item, tuple(below)) if n == step and below else item for n, item in enumerate(items)]
            return ListPattern(tuple(item for n, item in enumerate(kept) if below or n != step))
        case _:
            return pattern


def _without_item(event: Json, path: Path, length: int) -> Json:
    """An event without the item at a place, where it has a list of that length there."""
    around = dict(places(event)).get(path[:-1])
    return without_value(event, path) if isinstance(around, list) and len(around) == length else event


def _redefined(pair: Pair, event: EventType, pattern: Pattern) -> Pair:
    """With another pattern for an event type; the parameters that it lost are lost in all uses."""
    left = pattern_variables(pattern)
    kept = [index for index, parameter in enumerate(event.parameters) if parameter in left]
    changed = EventType(event.name, tuple(event.parameters[index] for index in kept), pattern)

    def call(on: On) -> On:
        return replace(on, arguments=tuple(on.arguments[i] for i in kept)) if on.event == event.name else on

    nodes = {n: replace(node, on=None if node.on is None else call(node.on)) for n, node in pair.nodes.items()}
    ignores = tuple(replace(ignore, on=call(ignore.on)) for ignore in pair.ignores)
    return replace(pair, nodes=nodes, ignores=ignores, events={**pair.events, event.name: changed})


def simpler_literals(pair: Pair) -> Iterator[Pair]:
    """A plain literal for a literal, everywhere in the tree, and for the value in the trace, or in the tree alone."""
    found = {written(value): value for value in literals(pair.nodes, pair.events, pair.ignores)}
    for value in found.values():
        for plain in PLAIN:
            if literal_size(plain) < literal_size(value):
                changed = _literal_changed(pair, value, plain)
                yield changed.with_trace(_value_changed(event, value, plain) for event in pair.trace)
                yield changed


def _literal_changed(pair: Pair, value: Scalar, plain: Scalar) -> Pair:
    def exchange(leaf: Leaf) -> Leaf:
        same = isinstance(leaf, Literal) and written(leaf.value) == written(value)
        return Literal(plain) if same else leaf

    changed = _nodes_mapped(pair, exchange)
    ignores = tuple(
        replace(
            ignore, on=_call(ignore.on, exchange), when=None if ignore.when is None else _guard(ignore.when, exchange)
        )
        for ignore in pair.ignores
    )
    events = {name: replace(event, pattern=_pattern(event.pattern, exchange)) for name, event in pair.events.items()}
    return replace(changed, ignores=ignores, events=events)


def _value_changed(event: Json, value: Scalar, plain: Scalar) -> Json:
    for path, inner in list(places(event)):
        if not isinstance(inner, (dict, list)) and written(inner) == written(value):
            event = with_value(event, path, plain)
    return event


# -- terms with other leaves ------------------------------------------------------------------------------------

Exchange: TypeAlias = Callable[[Leaf], Leaf]


def _exchange(old: Leaf, new: Leaf) -> Exchange:
    return lambda leaf: new if leaf == old else leaf


def _nodes_mapped(pair: Pair, exchange: Exchange) -> Pair:
    nodes = {
        name: replace(
            node,
            on=None if node.on is None else _call(node.on, exchange),
            when=None if node.when is None else _guard(node.when, exchange),
        )
        for name, node in pair.nodes.items()
    }
    return replace(pair, nodes=nodes)


def _calls_mapped(pair: Pair, exchange: Exchange) -> Pair:
    nodes = {
        n: node if node.on is None else replace(node, on=_call(node.on, exchange)) for n, node in pair.nodes.items()
    }
    return replace(pair, nodes=nodes)


def _call(on: On, exchange: Exchange) -> On:
    return replace(on, arguments=tuple(map(exchange, on.arguments)))


def _guard(guard: Guard, exchange: Exchange) -> Guard:
    if isinstance(guard, Operation):
        return replace(guard, operands=tuple(_guard(operand, exchange) for operand in guard.operands))
    return cast("Guard", exchange(guard))


def _pattern(pattern: Pattern, exchange: Exchange) -> Pattern:
    match pattern:
        case ObjectPattern(fields):
            return ObjectPattern(tuple((name, _pattern(inner, exchange)) for name, inner in fields))
        case ListPattern(items):
            return ListPattern(tuple(_pattern(item, exchange) for item in items))
        case _:
            return exchange(pattern)
