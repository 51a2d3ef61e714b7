"""Properties to EQL queries: a sequence of conditions on single events per order of a scenario.

EQL compares values of one type, and does not distinguish a null field from a missing one. A guard
becomes a condition that is true exactly when the guard holds, for all types of the fields.
"""

import re
from collections import Counter
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import chain, groupby
from typing import ClassVar, Final, NoReturn, cast

from backends.absences import clauses_of
from backends.field_conditions import DialectTest, FieldConditions, FieldPath
from backends.orders import GuardedEvent, Orders, merged
from rvaft.core.overlaps import overlaps
from rvaft.core.property import Event, Part, Property, Within, WithoutEvent
from rvaft.core.scenarios import Scenario
from rvaft.errors import NotExpressible, Reason, TooLarge, cannot, naming, unwritten
from rvaft.model.assumptions import Declared, declared
from rvaft.model.event_time import UNITS
from rvaft.model.expressions import time_text
from rvaft.model.guards import Guard, Operator
from rvaft.model.nodes import Side
from rvaft.model.tree import reachable
from rvaft.model.values import Json, has_surrogate
from rvaft.support.terminal import escaped

OPENING: Final = "// rvaft: any of these queries is a detection"
_WORDS: Final = (
    "and any as by const false fork in join like macro maxspan not null of or regex runs "
    "sample sequence true until where with"
)
_PLAIN: Final = re.compile(rf"(?!(?:{_WORDS.replace(' ', '|')})\b)[a-z_]\w*", re.IGNORECASE | re.ASCII)
_ESCAPES: Final = str.maketrans({sign: f"\\{letter}" for sign, letter in zip('\\"\n\r\t\b\f', '\\"nrtbf', strict=True)})
_TOKEN: Final = re.compile(r'"(?:[^"\\]|\\.)*"|`[^`]*`|[\w.]+|[^\s\w]')
_SPANS: Final = {"d": UNITS["d"], "h": UNITS["h"], "m": UNITS["min"], "s": UNITS["s"], "ms": UNITS["ms"]}
_RUNS: Final = 100
"""Maximum of `with runs` in Elasticsearch."""
NO_NULL: Final = cannot("EQL does not distinguish a null field from a missing one")


@dataclass(frozen=True, slots=True)
class Item:
    """One event of a sequence: alternative conditions, join keys, and the `maxspan` in ns and the
    `until` of the sequence; or a single event before which another one is `missing` for its span.
    """

    conditions: tuple[str, ...]
    keys: tuple[str, ...] = ()
    span: int | None = None
    until: "Item | None" = None
    missing: "Item | None" = None

    def __str__(self) -> str:
        several = len(self.conditions) > 1
        return f"any where {' or '.join(f'({one})' if several and ' and ' in one else one for one in self.conditions)}"


def _union(items: Sequence[Item]) -> Item:
    return replace(items[0], conditions=tuple(dict.fromkeys(chain.from_iterable(item.conditions for item in items))))


def query(items: Sequence[Item]) -> str:
    """Return the text of a sequence, or of a query for one event."""
    span, until, missing = items[0].span, items[0].until, items[0].missing
    if len(items) == 1 and missing is None:
        return str(items[0])
    shared = {item.keys for item in (*items, *(one for one in (until, missing) if one is not None))}
    keys = f" by {', '.join(items[0].keys)}" if len(shared) == 1 and items[0].keys else ""
    if span is not None:
        unit = next(unit for unit, size in _SPANS.items() if span % size == 0)
        keys += f" with maxspan={span // _SPANS[unit]}{unit}"
    lines = [f"sequence{keys}"]
    if missing is not None:
        lines.append(f"  ![{missing}]" + (f" by {', '.join(missing.keys)}" if len(shared) > 1 else ""))
    for item, run in groupby(items):
        own, count = f" by {', '.join(item.keys)}" if len(shared) > 1 else "", len([*run])
        runs = [_RUNS] * (count // _RUNS) + [count % _RUNS] * (count % _RUNS > 0)
        lines += [f"  [{item}]{own}" + (f" with runs={some}" if some > 1 else "") for some in runs]
    if until is not None:
        lines.append(f"  until [{until}]" + (f" by {', '.join(until.keys)}" if len(shared) > 1 else ""))
    return "\n".join(lines)


class EqlText:
    """One translation; raises `NotExpressible`, `TooLarge`, and `TreeError` without a feasible
    scenario.
    """

    def __init__(self, prop: Property, limit: int, *, missing: bool = False) -> None:
        self._prop, self._missing = prop, missing
        self._time = prop.time if any(isinstance(part, Within) for part in prop.parts) else None
        if len(prop.events) > limit:
            raise TooLarge("events in all possible orders", limit=limit)
        self._orders = Orders(prop, limit=limit)
        self._dialect = EqlConditions(self._orders.spend)
        self._seen: dict[Event, dict[str, str]] = {}

    def text(self) -> tuple[str, int]:
        """Return the text and its number of symbols."""
        orders = self._orders
        some = ((one, items) for one in orders.scenarios() if (items := self._items(one)) is not None)
        words = chain.from_iterable(orders.words(one, items) for one, items in some)
        alternatives = merged(words, _union, lambda item: (item.keys, item.span, item.until, item.missing))
        texts = [query(word) for word in alternatives] or ["any where false"]
        time = self._prop.time if any(one.missing for word in alternatives for one in word) else self._time
        header = OPENING if time is None else f"{OPENING}\n// {time_text(time)}"
        return f"{header}\n" + ";\n".join(texts) + "\n", sum(len(_TOKEN.findall(text)) for text in texts)

    def _span(self, scenario: Scenario) -> int | None:
        found = [part for part in scenario.kept if isinstance(part, Within)]
        for window in found:
            node = window.source.node
            below = reachable(cast(Part, window), scenario.kept.__getitem__)
            if sum(isinstance(one, Event) for one in below) < len(scenario.events):
                raise NotExpressible(
                    unwritten("`maxspan` covers a whole sequence, and is not written for a part of it"), nodes=[node]
                )
            if len(scenario.events) == 1:
                raise NotExpressible(
                    unwritten("a window over one event only requires that it has a time"), nodes=[node]
                )
            if window.duration % UNITS["ms"]:
                raise NotExpressible(unwritten("a `maxspan` has whole milliseconds"), nodes=[node])
        return min((window.duration for window in found), default=None)

    def _items(self, scenario: Scenario) -> dict[Event, Item] | None:
        groups = self._orders.groups
        paths = {event: {} if event in groups else self._paths(event) for event in scenario.events}
        several = "a guard over several events, and conditions are written of one event"
        guards = self._orders.assigned_guards(
            scenario, paths, lambda node, _: NotExpressible(unwritten(several), nodes=[node])
        )
        if guards is None:
            return None
        holders = Counter(chain.from_iterable(paths.values()))
        shared = [variable for variable, count in holders.items() if count > 1]
        for variable in shared:
            if holders[variable] < len(paths):
                having = dict.fromkeys(event.source.node for event in paths if variable in paths[event])
                raise NotExpressible(
                    unwritten(f"`by` joins all events of a sequence, and some lack {variable}"), nodes=having
                )
        span = self._span(scenario)
        if self._missing and (before := [one for one in scenario.absences if one[0].duration is not None]):
            (event,) = self._single(scenario, before)
            missing = self._before(event, paths[event], [clause for clause, _ in before])
            keys = tuple(paths[event][name] for name in sorted(before[0][0].shared))
            return {event: Item(self._conditions(event, guards[event]), keys, missing.span, missing=missing)}
        until = self._until(scenario, shared)
        return {
            event: Item(self._conditions(event, guards[event]), tuple(paths[event][one] for one in shared), span, until)
            for event in scenario.events
        }

    def _single(self, scenario: Scenario, before: Iterable[tuple[WithoutEvent, Sequence[Event]]]) -> tuple[Event]:
        """Return the only event of a scenario with clauses that all are `for D before`."""
        for clause, _ in before:
            if clause.side is not Side.BEFORE:
                why = "Elasticsearch reports a missing event at the end before its time has passed"
                self._refuse(clause.source.node, why)
            if len(scenario.events) > 1:
                why = "Elasticsearch measures `maxspan` from a missing event to the last event of its sequence"
                self._refuse(clause.source.node, why)
        for clause, _ in scenario.absences:
            if clause.side is Side.BEFORE and clause.duration is None:
                self._refuse(clause.source.node, "a missing event needs a `maxspan`, and this one has no duration")
        return (scenario.events[0],)

    def _before(self, event: Event, paths: Mapping[str, str], clauses: Sequence[WithoutEvent]) -> Item:
        """Return the event that is missing before another one."""
        found = list[Item]()
        for clause in clauses:
            node, duration = clause.source.node, clause.duration or 0
            if not duration or duration % UNITS["ms"]:
                self._refuse(node, "a `maxspan` has whole milliseconds, at least 1")
            if {*clause.shared} - {*paths}:
                self._refuse(node, "an absent event that shares a variable of a choice")
            with naming(node):
                own = self._dialect.paths(clause.pattern)
                guards = [] if clause.guard is None else [clause.guard]
                condition = self._dialect.of(clause.pattern, guards, Declared())
            if {*clause.shared} - {*own}:
                self._refuse(node, "a guard over a missing event and the event after it")
            found.append(Item((condition,), tuple(own[one] for one in sorted(clause.shared)), duration))
        if len({(one.keys, one.span) for one in found}) > 1 or len({one.shared for one in clauses}) > 1:
            self._refuse(event.source.node, "absent events of different durations or variables")
        return _union(found)

    def _until(self, scenario: Scenario, shared: Sequence[str]) -> Item | None:
        """Return what ends a sequence, without the clauses that nothing can break."""
        clauses, found = clauses_of(scenario), list[Item]()
        for clause in dict.fromkeys(chain.from_iterable(clauses.values())):
            node, inside = clause.source.node, [event for event in scenario.events if clause in clauses[event]]
            leaves = chain.from_iterable(
                (leaf.event for leaf in self._orders.groups.get(event, (GuardedEvent(event),)))
                for event in scenario.events
            )
            if clause.side is Side.BEFORE and clause.duration is not None:
                self._refuse(
                    node, "`until` ends a sequence that has begun; `--missing-events` may write it for Elastic"
                )
            if clause.side is not Side.DURING:
                self._refuse(
                    node, "`until` ends a sequence that has begun, and is not written for events before and after it"
                )
            if len(inside) == 1:
                continue
            if len(inside) < len(scenario.events):
                self._refuse(node, "`until` is of a whole sequence, and is not written for a part of it")
            if self._time is not None:
                self._refuse(node, "an event without a time is in no sequence with `maxspan`, and would not end it")
            if any(overlaps(clause.pattern, leaf.pattern) for leaf in leaves):
                self._refuse(node, "`until` is not written for an event that the sequence may use")
            with naming(node):
                paths = self._dialect.paths(clause.pattern)
                if {*clause.shared} != {*shared} or not {*shared} <= {*paths}:
                    self._refuse(node, "`until` has the keys of its sequence, and no other variables of the tree")
                guards = [] if clause.guard is None else [clause.guard]
                condition = self._dialect.of(clause.pattern, guards, Declared())
            found.append(Item((condition,), tuple(paths[one] for one in shared)))
        if len({one.keys for one in found}) > 1:
            self._refuse(next(iter(clauses.values()))[0].source.node, "a sequence has one `until`")
        return _union(found) if found else None

    @staticmethod
    def _refuse(node: str, why: str) -> NoReturn:
        raise NotExpressible(unwritten(why), nodes=[node])

    # Conditions on one event.

    def _conditions(self, event: Event, guards: Iterable[Guard]) -> tuple[str, ...]:
        if event in self._orders.groups:
            each = chain.from_iterable(self._conditions(*leaf) for leaf in self._orders.groups[event])
            return tuple(dict.fromkeys(one for one in each if one != "false")) or ("false",)
        with naming(event.source.node):
            known = declared(self._prop.tree, event.source.node, self._prop.assumes)
            return (self._dialect.of(event.pattern, guards, known),)

    def _paths(self, event: Event) -> dict[str, str]:
        if event not in self._seen:
            with naming(event.source.node):
                found = self._dialect.paths(event.pattern)
            self._seen[event] = {name: path for name, path in found.items() if not name.startswith("_")}
        return self._seen[event]


class EqlConditions(FieldConditions):
    """The conditions of EQL; `spend` receives the length of each."""

    exists, equals, is_truth, length = "{p} != null", "{p} == {v}", "{p} == {v}", "length({p}) == {n}"
    differs = "(({p} == {v}) == null or {p} != {v})"
    functions: ClassVar[Mapping[Operator, str]] = {
        Operator.STARTSWITH: "startsWith({p}, {v})",
        Operator.ENDSWITH: "endsWith({p}, {v})",
        Operator.CONTAINS: "stringContains({p}, {v})",
    }
    denied = '(not {t} and stringContains({p}, ""))'
    plainly_differs, plainly_denied = "{p} != {v}", "not {t}"
    reasons: ClassVar[Mapping[DialectTest, Reason]] = {
        DialectTest.TWO_FIELDS: unwritten("a condition is written as a field and a constant, not as two fields"),
        DialectTest.CONTAINER: unwritten("EQL does not distinguish an empty object from an empty list"),
        DialectTest.CALCULATION: unwritten("a condition is written as a field and a constant"),
        DialectTest.NULL: NO_NULL,
        DialectTest.SURROGATE: unwritten("an EQL string cannot contain half of a surrogate pair"),
        DialectTest.TEXT_FUNCTION: unwritten(
            "`like` is written for a prefix, a suffix or a part of a text alone: `a*`, `*a`, `*a*`"
        ),
        DialectTest.FIELD_NAME: unwritten("an EQL field name needs a character, and cannot contain a line break or `"),
    }

    def __init__(self, spend: Callable[[int], None]) -> None:
        self._spend = spend

    def path(self, way: FieldPath) -> str:
        """Return field names joined by dots, and list indices in brackets."""
        text = ""
        for step in way:
            if isinstance(step, int):
                text += f"[{step}]"
                continue
            if not step or has_surrogate(step) or not {*"`\r\n"}.isdisjoint(step):
                raise self.lacks(DialectTest.FIELD_NAME)
            text += ("." if text else "") + (step if _PLAIN.fullmatch(step) else f"`{step}`")
        return text

    def literal(self, value: Json) -> str:
        """Return a constant of EQL."""
        match value:
            case None:
                raise self.lacks(DialectTest.NULL)
            case bool():
                return str(value).lower()
            case str():
                if has_surrogate(value):
                    raise self.lacks(DialectTest.SURROGATE)
                inner = escaped(value.translate(_ESCAPES), lambda one: rf"\u{{{ord(one):04x}}}")
                return f'"{inner}"'
            case _:
                return repr(value)

    def function(self, operator: Operator, path: str, text: str, *, wanted: bool) -> str:
        """Return the test of a text function; `like` is one for a prefix, a suffix or a part."""
        if operator is Operator.LIKE:
            inner = text.strip("*")
            before, after = text.startswith("*"), text.endswith("*")
            if not (before or after) or not inner or "*" in inner or "?" in inner:
                raise self.lacks(DialectTest.TEXT_FUNCTION)
            both = Operator.CONTAINS if before else Operator.STARTSWITH
            operator, text = both if after else Operator.ENDSWITH, inner
        return super().function(operator, path, text, wanted=wanted)

    def all(self, texts: Iterable[str]) -> str:
        """Return the conjunction, and spend its length."""
        found = super().all(texts)
        self._spend(len(found))
        return found

    def operand(self, text: str) -> str:
        """Return the condition, in parentheses if it is a conjunction."""
        return f"({text})" if " and " in text else text
