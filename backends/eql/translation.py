"""From a tree to queries: each scenario's events in each order that it allows, as a sequence of conditions on single events.

EQL compares values of one type, and does not tell a field with null from none; a guard is written as what is true where it holds and
nowhere else, whichever types the fields of an event have.
"""

import re
from collections import Counter
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import chain, groupby
from typing import Final, cast

from backends.orders import Orders, merged
from rvaft.core.conditions import (
    ComparisonTest,
    ConditionTest,
    EqualityTest,
    TruthConditions,
    TruthTest,
    spelled,
)
from rvaft.core.property import Event, Part, Property, Within
from rvaft.core.scenarios import Scenario
from rvaft.errors import NotExpressible, TooLarge
from rvaft.model import guards
from rvaft.model.event_time import UNITS
from rvaft.model.expressions import time_text
from rvaft.model.guards import OPERATORS, Guard, Operation, Operator
from rvaft.model.patterns import Anything, ListPattern, Literal, ObjectPattern, Pattern, Variable
from rvaft.model.tree import reachable
from rvaft.model.values import is_finite

OPENING: Final = "// rvaft: any of these queries is a detection"
_WORDS: Final = "and any as by const false fork in join like macro maxspan not null of or regex runs sample sequence true until where with"
_PLAIN: Final = re.compile(rf"(?!(?:{_WORDS.replace(' ', '|')})\b)[a-z_]\w*", re.IGNORECASE | re.ASCII)
_ESCAPES: Final = str.maketrans({sign: f"\\{letter}" for sign, letter in zip('\\"\n\r\t\b\f', '\\"nrtbf', strict=True)})
_TOKEN: Final = re.compile(r'"(?:[^"\\]|\\.)*"|`[^`]*`|[\w.]+|[^\s\w]')
_SPANS: Final = {"d": UNITS["d"], "h": UNITS["h"], "m": UNITS["min"], "s": UNITS["s"], "ms": UNITS["ms"]}
_RUNS: Final = 100
"""So many at most takes Elasticsearch of `with runs`."""
_O: Final = Operator
_FUNCTIONS: Final = {_O.STARTSWITH: "startsWith", _O.ENDSWITH: "endsWith", _O.CONTAINS: "stringContains"}


@dataclass(frozen=True, slots=True)
class Item:
    """One event of a sequence, which takes no longer than `span`: a condition holds for it, and it has in `keys` what all others have in theirs."""

    conditions: tuple[str, ...]
    keys: tuple[str, ...] = ()
    span: int | None = None

    def __str__(self) -> str:
        several = len(self.conditions) > 1
        return f"any where {' or '.join(f'({one})' if several and ' and ' in one else one for one in self.conditions)}"


def _union(items: Sequence[Item]) -> Item:
    return replace(items[0], conditions=tuple(dict.fromkeys(chain.from_iterable(item.conditions for item in items))))


def query(items: Sequence[Item]) -> str:
    """The text of a sequence, or of a query for one event."""
    if len(items) == 1:
        return str(items[0])
    shared, span = {item.keys for item in items}, items[0].span
    keys = f" by {', '.join(items[0].keys)}" if len(shared) == 1 and items[0].keys else ""
    if span is not None:
        unit = next(unit for unit, size in _SPANS.items() if span % size == 0)
        keys += f" with maxspan={span // _SPANS[unit]}{unit}"
    lines = [f"sequence{keys}"]
    for item, run in groupby(items):
        own, count = f" by {', '.join(item.keys)}" if len(shared) > 1 else "", len([*run])
        runs = [_RUNS] * (count // _RUNS) + [count % _RUNS] * (count % _RUNS > 0)
        lines += [f"  [{item}]{own}" + (f" with runs={some}" if some > 1 else "") for some in runs]
    return "\n".join(lines)


class EqlText:
    """One translation. Raises `NotExpressible`, `TooLarge`, and `TreeError` without a feasible scenario."""

    def __init__(self, prop: Property, limit: int) -> None:
        self._time = prop.time if any(isinstance(part, Within) for part in prop.parts) else None
        if len(prop.events) > limit:
            raise TooLarge("events of all orders in which they may come", limit=limit)
        self._orders = Orders(prop, limit=limit)
        self._seen: dict[Event, tuple[list[str], dict[str, str]]] = {}

    def text(self) -> tuple[str, int]:
        """The text, and how many symbols its queries have."""
        orders = self._orders
        some = ((one, items) for one in orders.scenarios() if (items := self._items(one)) is not None)
        words = chain.from_iterable(orders.words(one, items) for one, items in some)
        alternatives = merged(words, _union, lambda item: (item.keys, item.span))
        texts = [query(word) for word in alternatives] or ["any where false"]
        header = OPENING if self._time is None else f"{OPENING}\n// {time_text(self._time)}"
        return f"{header}\n" + ";\n".join(texts) + "\n", sum(len(_TOKEN.findall(text)) for text in texts)

    def _span(self, scenario: Scenario) -> int | None:
        """The shortest of the windows of a scenario, which must be over all its events."""
        found = [part for part in scenario.kept if isinstance(part, Within)]
        for window in found:
            node = window.source.node
            below = reachable(cast(Part, window), scenario.kept.__getitem__)
            if sum(isinstance(one, Event) for one in below) < len(scenario.events):
                raise NotExpressible("`maxspan` is over a whole sequence, not over a part of it", nodes=[node])
            if len(scenario.events) == 1:
                raise NotExpressible("a window over one event only asks for its time", nodes=[node])
            if window.duration % UNITS["ms"]:
                raise NotExpressible("a `maxspan` is of whole milliseconds", nodes=[node])
        return min((window.duration for window in found), default=None)

    def _items(self, scenario: Scenario) -> dict[Event, Item] | None:
        """What each event of a scenario is asked, None where a guard never holds."""
        groups = self._orders.groups
        paths = {event: {} if event in groups else self._look(event)[1] for event in scenario.events}
        several = "a condition of EQL looks at one event"
        asked = self._orders.asked(scenario, paths, lambda node, _: NotExpressible(several, nodes=[node]))
        if asked is None:
            return None
        holders = Counter(chain.from_iterable(paths.values()))
        shared = [variable for variable, count in holders.items() if count > 1]
        for variable in shared:
            if holders[variable] < len(paths):
                having = dict.fromkeys(event.source.node for event in paths if variable in paths[event])
                raise NotExpressible(f"`by` ties all events of a sequence, and {variable} only some", nodes=having)
        span = self._span(scenario)
        return {
            event: Item(self._conditions(event, asked[event]), tuple(paths[event][one] for one in shared), span)
            for event in scenario.events
        }

    # The conditions on one event.

    def _conditions(self, event: Event, asked: Iterable[Guard]) -> tuple[str, ...]:
        """Conditions on an event of which one holds."""
        if event in self._orders.groups:
            each = chain.from_iterable(self._conditions(*leaf) for leaf in self._orders.groups[event])
            return tuple(dict.fromkeys(one for one in each if one != "false")) or ("false",)
        texts, paths = self._look(event)
        found = _all([*texts, *(self._truth(guard, paths, event.source.node) for guard in asked)])
        self._orders.spend(len(found))
        return (found,)

    def _look(self, event: Event) -> tuple[list[str], dict[str, str]]:
        """What the pattern of an event asks, and where its variables stand."""
        if event not in self._seen:
            found: dict[str, str] = {}
            texts = list(self._matches(event.pattern, "", event.source.node, found))
            self._seen[event] = texts, {one: path for one, path in found.items() if not one.startswith("_")}
        return self._seen[event]

    def _matches(self, pattern: Pattern, path: str, node: str, found: dict[str, str]) -> Iterator[str]:
        """What says that a pattern matches what stands at a path; notes where variables stand."""
        match pattern:
            case Variable(name) if name in found:
                raise NotExpressible("EQL compares no field with another one", nodes=[node])
            case Variable() | Anything():
                if isinstance(pattern, Variable):
                    found[pattern.name] = path
                yield f"{path} != null" if path else "true"
            case Literal(value):
                yield f"{path} == {self._literal(value, node)}" if path else "false"
            case ListPattern(()) | ObjectPattern(()) if path:
                raise NotExpressible("EQL does not tell an object without fields from an empty list", nodes=[node])
            case ListPattern(parts):
                yield f"length({path}) == {len(parts)}" if path else "false"
                for index, inner in enumerate(parts):
                    yield from self._matches(inner, f"{path}[{index}]", node, found)
            case ObjectPattern(fields):
                for name, inner in fields:
                    if not name or any(sign in "`\r\n" or "\ud800" <= sign <= "\udfff" for sign in name):
                        raise NotExpressible(
                            "the name of a field in EQL has a letter, no line break and no `", nodes=[node]
                        )
                    written = name if _PLAIN.fullmatch(name) else f"`{name}`"
                    yield from self._matches(inner, f"{path}.{written}" if path else written, node, found)

    def _literal(self, value: object, node: str) -> str:
        if value is None:
            raise NotExpressible("EQL does not tell a field with null from none", nodes=[node])
        if not isinstance(value, str):
            return str(value).lower() if isinstance(value, bool) else repr(value)
        if any("\ud800" <= sign <= "\udfff" for sign in value):
            raise NotExpressible("a text of EQL has no half of a surrogate pair", nodes=[node])
        return f'"{value.translate(_ESCAPES)}"'

    def _truth(self, guard: Guard, paths: Mapping[str, str], node: str) -> str:
        """What holds of an event exactly where a guard is true."""

        def test(one: ConditionTest) -> str:
            match one:
                case TruthTest(Variable(name), wanted):
                    return f"{paths[name]} == {str(wanted).lower()}"
                case TruthTest(Operation(operator, (Variable(name), Literal(value))), wanted) if operator in _FUNCTIONS:
                    text = f"{_FUNCTIONS[operator]}({paths[name]}, {self._literal(value, node)})"
                    return text if wanted else f'(not {text} and stringContains({paths[name]}, ""))'
                case EqualityTest(Variable(name), Literal(value), wanted) | EqualityTest(
                    Literal(value), Variable(name), wanted
                ):
                    path, constant = paths[name], self._literal(value, node)
                    same = f"{path} == {constant}"
                    found = same if wanted else f"(({same}) == null or {path} != {constant})"
                    return found if is_finite(value) else "false"
                case ComparisonTest(_, Variable(name), sign, Literal(value)):
                    return f"{paths[name]} {sign} {self._literal(value, node)}" if is_finite(value) else "false"
                case ComparisonTest(sort, Literal() as left, sign, Variable() as right):
                    return test(ComparisonTest(sort, right, str(OPERATORS[Operator(sign)].mirrored), left))
                case _:
                    signs = [part.operator for part in guards.walk(guard) if isinstance(part, Operation)]
                    unsaid = [sign for sign in signs if sign in guards.ARITHMETIC | guards.FUNCTIONS - {*_FUNCTIONS}]
                    word = f"; it has no exact `{unsaid[0]}`" if unsaid else ""
                    raise NotExpressible(f"a condition of EQL compares a field with a constant{word}", nodes=[node])

        def join(every: bool, parts: list[str]) -> str:
            found = _all(parts) if every else _any(parts)
            self._orders.spend(len(found))
            return found

        return spelled(TruthConditions().of(guard), test, join)


def _all(texts: Iterable[str]) -> str:
    found = list(dict.fromkeys(text for text in texts if text != "true"))
    return "false" if "false" in found else " and ".join(found) or "true"


def _any(texts: Iterable[str]) -> str:
    found = list(dict.fromkeys(text for text in texts if text != "false"))
    if "true" in found or len(found) < 2:
        return "true" if "true" in found else found[0] if found else "false"
    return f"({' or '.join(f'({one})' if ' and ' in one else one for one in found)})"
