"""From a tree to queries: each scenario's events in each order that it allows, as a sequence of conditions on single events.

EQL compares values of one type, and does not tell a field with null from none; a guard is written as what is true where it holds and
nowhere else, whichever types the fields of an event have.
"""

import re
from collections import Counter
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import chain, groupby
from typing import Final

from backends.orders import Orders, merged
from rvaft.analysis.scenarios import Kept
from rvaft.core.conditions import (
    ComparisonTest,
    ConditionTest,
    EqualityTest,
    TruthConditions,
    TruthTest,
    spelled,
)
from rvaft.errors import NotExpressible, TooLarge
from rvaft.model import guards
from rvaft.model.event_time import UNITS
from rvaft.model.expressions import time_text
from rvaft.model.guards import OPERATORS, Guard, Operation, Operator
from rvaft.model.patterns import Anything, ListPattern, Literal, ObjectPattern, Pattern, Variable
from rvaft.model.tree import RVAFT, reachable
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

    def __init__(self, tree: RVAFT, plain: RVAFT, limit: int) -> None:
        self._windows = {node.name: node.within for node in tree.nodes.values() if node.within is not None}
        self._time = tree.time if self._windows else None
        if max(node.times for node in tree.nodes.values()) > limit:
            raise TooLarge("events of all orders in which they may come", limit=limit)
        self._windows = {
            name: self._windows[old] for name in plain.nodes if (old := plain.origins.get(name, name)) in self._windows
        }
        self._orders, self._tree = Orders(plain, limit=limit, apart=self._windows), plain
        self._seen: dict[str, tuple[list[str], dict[str, str]]] = {}

    def _refusal(self, reason: str, nodes: Iterable[str] = ()) -> NotExpressible:
        return NotExpressible(reason, nodes=nodes)

    def text(self) -> tuple[str, int]:
        """The text, and how many symbols its queries have."""
        orders = self._orders
        some = ((kept, items) for kept in orders.scenarios() if (items := self._items(kept)) is not None)
        words = chain.from_iterable(orders.words(kept, items) for kept, items in some)
        alternatives = merged(words, _union, lambda item: (item.keys, item.span))
        texts = [query(word) for word in alternatives] or ["any where false"]
        header = OPENING if self._time is None else f"{OPENING}\n// {time_text(self._time)}"
        return f"{header}\n" + ";\n".join(texts) + "\n", sum(len(_TOKEN.findall(text)) for text in texts)

    def _span(self, kept: Kept, names: Sequence[str]) -> int | None:
        """The shortest of the windows of a scenario, which must be over all its events."""
        found = [name for name in kept if name in self._windows]
        for name in found:
            if not {*reachable(name, kept.__getitem__)}.issuperset(names):
                raise self._refusal("`maxspan` is over a whole sequence, not over a part of it", [name])
            if len(names) == 1:
                raise self._refusal("a window over one event only asks for its time", [name])
            if self._windows[name] % UNITS["ms"]:
                raise self._refusal("a `maxspan` is of whole milliseconds", [name])
        return min((self._windows[name] for name in found), default=None)

    def _items(self, kept: Kept) -> dict[str, Item] | None:
        """What each event of a scenario is asked, None where a guard never holds."""
        names = [name for name in kept if self._orders.tree.nodes[name].has_event]
        paths = {name: {} if name in self._orders.groups else self._look(name)[1] for name in names}
        asked = self._orders.asked(
            kept, paths, lambda node, _: self._refusal("a condition of EQL looks at one event", [node])
        )
        if asked is None:
            return None
        holders = Counter(chain.from_iterable(paths.values()))
        shared = [variable for variable, count in holders.items() if count > 1]
        for variable in shared:
            if holders[variable] < len(names):
                having = [name for name in names if variable in paths[name]]
                raise self._refusal(f"`by` ties all events of a sequence, and {variable} only some", having)
        span = self._span(kept, names)
        return {
            name: Item(self._conditions(name, asked[name]), tuple(paths[name][one] for one in shared), span)
            for name in names
        }

    # The conditions on one event.

    def _conditions(self, name: str, asked: Iterable[Guard]) -> tuple[str, ...]:
        """Conditions on an event of which one holds."""
        if name in self._orders.groups:
            inside = ((one, guards.conjuncts(self._tree.nodes[one].when)) for one in self._orders.groups[name])
            each = chain.from_iterable(self._conditions(one, asked) for one, asked in inside)
            return tuple(dict.fromkeys(one for one in each if one != "false")) or ("false",)
        texts, paths = self._look(name)
        found = _all([*texts, *(self._truth(guard, paths, name) for guard in asked)])
        self._orders.spend(len(found))
        return (found,)

    def _look(self, name: str) -> tuple[list[str], dict[str, str]]:
        """What the pattern of a node asks of an event, and where its variables stand."""
        if name not in self._seen:
            found: dict[str, str] = {}
            texts = list(self._matches(self._tree.pattern(name) or Anything(), "", name, found))
            self._seen[name] = texts, {one: path for one, path in found.items() if not one.startswith("_")}
        return self._seen[name]

    def _matches(self, pattern: Pattern, path: str, node: str, found: dict[str, str]) -> Iterator[str]:
        """What says that a pattern matches what stands at a path; notes where variables stand."""
        match pattern:
            case Variable(name) if name in found:
                raise self._refusal("EQL compares no field with another one", [node])
            case Variable() | Anything():
                if isinstance(pattern, Variable):
                    found[pattern.name] = path
                yield f"{path} != null" if path else "true"
            case Literal(value):
                yield f"{path} == {self._literal(value, node)}" if path else "false"
            case ListPattern(()) | ObjectPattern(()) if path:
                raise self._refusal("EQL does not tell an object without fields from an empty list", [node])
            case ListPattern(parts):
                yield f"length({path}) == {len(parts)}" if path else "false"
                for index, inner in enumerate(parts):
                    yield from self._matches(inner, f"{path}[{index}]", node, found)
            case ObjectPattern(fields):
                for name, inner in fields:
                    if not name or any(sign in "`\r\n" or "\ud800" <= sign <= "\udfff" for sign in name):
                        raise self._refusal("the name of a field in EQL has a letter, no line break and no `", [node])
                    written = name if _PLAIN.fullmatch(name) else f"`{name}`"
                    yield from self._matches(inner, f"{path}.{written}" if path else written, node, found)

    def _literal(self, value: object, node: str) -> str:
        if value is None:
            raise self._refusal("EQL does not tell a field with null from none", [node])
        if not isinstance(value, str):
            return str(value).lower() if isinstance(value, bool) else repr(value)
        if any("\ud800" <= sign <= "\udfff" for sign in value):
            raise self._refusal("a text of EQL has no half of a surrogate pair", [node])
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
                    raise self._refusal(f"a condition of EQL compares a field with a constant{word}", [node])

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
