"""Properties to Sigma: a rule per event, and correlations of rules.

A correlation knows only the time of its last event, and requires rules, not distinct events: one
event can satisfy two unordered rules. In `temporal_ordered` each event is later than the previous
one. Sequences therefore become chains of single events, combined by and/or. Events that may
coincide are tried in every order. Sigma is untyped, so constants that it confuses with other values
are refused.
"""

import re
from collections.abc import Iterable, Iterator
from dataclasses import replace
from functools import reduce
from itertools import chain, combinations, count, product, takewhile
from typing import Any, Final, NamedTuple, NoReturn, TypeAlias

from backends.nests import NEVER, WINDOW, Nest, Nesting, in_every_order
from backends.sigma.rules import EventRule, detection_of
from rvaft.core.passes import Pass, expand_times
from rvaft.core.property import All, Condition, Event, One, PartKind, Property, Sequence, Source, Times, Within
from rvaft.errors import NotExpressible, TooLarge, installed, naming, unwritten
from rvaft.export.rule_metadata import about, origin, rule_id, rule_metadata
from rvaft.model.assumptions import Declared, declared
from rvaft.model.event_time import UNITS
from rvaft.model.expressions import time_text
from rvaft.model.guards import Guard, conjuncts
from rvaft.model.nodes import Assumption
from rvaft.model.patterns import Literal, ObjectPattern, Pattern, Variable, rigid_variables
from rvaft.model.values import equal

FOREVER: Final = "200y"
"""The timespan without a window, which a correlation has to state: longer than the times that the reader takes."""
_SECOND: Final = UNITS["s"]
_LONGEST: Final = 200 * 365 * UNITS["d"]
_SPANS: Final = {"d": UNITS["d"], "h": UNITS["h"], "m": UNITS["min"], "s": UNITS["s"]}
_UNIT: Final = "rules of the correlation"
_MIXED: Final = "one event can match two rules, and a correlation would count it twice"
_WINDOW: Final = "a correlation has one timespan from its first event, and passes on only the time of its last one"
_UNTIMED: Final = "a window over one event only requires that it has a time, and a rule cannot test the time"

Chain: TypeAlias = tuple[Nest, ...]
"""Consecutive single events, each possibly a choice; the first may be a nest with a window."""


class Junction(NamedTuple):
    """At least `need` of the parts."""

    need: int
    parts: "list[Chain | Junction]"


class CountedValues(NamedTuple):
    """Events with values of their own, alone in a tree, and the window over them."""

    events: Times
    guards: tuple[Guard, ...]
    within: int | None

    @classmethod
    def of(cls, prop: Property) -> "CountedValues | None":
        """Return those of a property that has nothing else, or None."""
        part, windows = prop.root, list[int]()
        while True:
            match part:
                case Within(parts=(inner,), duration=duration):
                    windows.append(duration)
                    part = inner
                case Times():
                    return cls(part, (), min(windows, default=None))
                case All(parts=(Times() as events, Condition(guard=guard))):
                    return cls(events, tuple(conjuncts(guard)), min(windows, default=None))
                case All(parts=(inner,)) | Sequence(parts=(inner,)) | One(parts=(inner,)):
                    part = inner
                case _:
                    return None


def _expand_tied(prop: Property, limit: int) -> Property:
    own = [part for part in prop.parts if isinstance(part, Times) and part.own and part.count > 1]
    if not own:
        return expand_times(prop, limit)
    if CountedValues.of(prop) is None:
        why = "events with values of their own are counted by a correlation, which has nothing beside them"
        raise NotExpressible(unwritten(why), nodes=[part.source.node for part in own])
    return prop


expand_tied: Final = Pass("expand_tied", frozenset(), _expand_tied)
"""`expand_times` for events whose values are equal; others stay if they are all that there is."""


class SigmaRules:
    """One translation of a property; `limit` counts rules and correlations."""

    def __init__(self, prop: Property, limit: int) -> None:
        self._prop, self._limit = prop, limit
        self._attributes = dict(prop.tree.nodes[prop.tree.root].attributes)
        self._cased = Assumption.CASE not in prop.assumes
        self._documents: dict[str, dict[str, Any]] = {}
        self._names: dict[object, str] = {}
        self._bound: dict[str, dict[str, str]] = {}
        """For each rule, the fields of its variables."""
        self._written = 0
        self._windows = [part for part in reversed(prop.parts) if isinstance(part, Within)]
        self._time = time_text(prop.time) if self._windows and prop.time is not None else None
        self._groups = self._grouped()

    def text(self) -> tuple[str, int]:
        """Return the documents and their number of symbols."""
        if any(isinstance(part, Times) for part in self._prop.parts) and (found := CountedValues.of(self._prop)):
            return self._ended(self._counting(found))
        nest = Nesting(self._prop, self._inseparable, limit=10 * self._limit, unit=_UNIT, free=self._groups).nest()
        if nest == NEVER:
            self._refuse("a guard never holds, and no rule can express that", [self._prop.tree.root])
        if nest.within is None and self._is_step(nest):
            return self._alone(rule_metadata(self._prop.tree), nest)
        self._fits(len(set(map(self._key, self._single(nest)))))  # each has its rule
        return self._ended(self._correlation(nest))

    def _ended(self, correlation: dict[str, Any]) -> tuple[str, int]:
        """Return the documents with the last correlation, and their number of symbols."""
        whole = {**rule_metadata(self._prop.tree), "correlation": correlation}
        whole |= {} if self._time is None else {"rvaft": self._time}
        documents = [*sorted(self._documents.values(), key=lambda one: "correlation" in one), whole]
        return self._written_as(documents)

    def _counting(self, counted: CountedValues) -> dict[str, Any]:
        """Return the correlation that counts events, or the different values of one of their fields."""
        events, node = counted.events, counted.events.source.node
        event = Event(Source(node, 1), events.pattern)
        fields = dict(_places(events.pattern, ()))
        if lacking := [name for name in (*rigid_variables(events.pattern), *events.distinct) if name not in fields]:
            self._refuse(f"a correlation groups by fields, and {lacking[0]} is none", [node])
        if len(events.distinct) > 1:
            self._refuse("a correlation counts the values of one field", [node])
        self._groups = {name: fields[name] for name in rigid_variables(events.pattern)}
        rule = self._rule(Nest(PartKind.EVENT, event=event, guards=counted.guards, size=1), 0)
        condition: dict[str, Any] = {"gte": events.count}
        if not events.distinct:
            return self._of("event_count", [rule], counted.within, condition=condition)
        condition |= {"field": fields[events.distinct[0]]}
        return self._of("value_count", [rule], counted.within, condition=condition)

    def _alone(self, about: dict[str, Any], step: Nest) -> tuple[str, int]:
        """Return a rule without correlation, for a single event or a choice of events."""
        if self._windows:
            self._refuse(_UNTIMED, (one.source.node for one in self._windows))
        return self._written_as([{**about, **self._detected([*filter(_observes, step.inside())])}])

    def _written_as(self, documents: Iterable[dict[str, Any]]) -> tuple[str, int]:
        documents = list(documents)
        symbols = len(re.findall(r"\w+|\S", "---\n".join(self._dumped(map(self._bare, documents)))))
        return "---\n".join(self._dumped(documents)), symbols

    def _dumped(self, documents: Iterable[dict[str, Any]]) -> list[str]:
        yaml = installed("yaml", "PyYAML", "pip install '.[sigma]' in a checkout of rvaft")
        return [yaml.safe_dump(one, sort_keys=False, allow_unicode=False, width=10_000) for one in documents]

    def _bare(self, document: dict[str, Any]) -> dict[str, Any]:
        """Return a rule as it is counted: a title, a log source, and what it detects."""
        plain = {"title": document.get("name", self._prop.tree.root), "logsource": {"category": "rvaft"}}
        names = ("title", "name", "logsource", "detection", "correlation", "rvaft")
        return {name: plain.get(name, document[name]) for name in names if name in document}

    def _inseparable(self, why: str, nodes: Iterable[str]) -> NoReturn:
        self._refuse(_WINDOW if why == WINDOW else "a rule is about one event, and a guard about several", nodes)

    def _refuse(self, reason: str, nodes: Iterable[str]) -> NoReturn:
        raise NotExpressible(unwritten(reason), nodes=dict.fromkeys(nodes))

    def _fits(self, size: int) -> None:
        if size > self._limit:
            raise TooLarge(_UNIT, limit=self._limit)

    # Correlations.

    def _correlation(self, nest: Nest) -> dict[str, Any]:
        within, nest = nest.within, replace(nest, within=None)
        if mixed := self._mixed(nest):
            nest = self._in_every_order(mixed, _MIXED)
        ordered = any(one.op is PartKind.SEQUENCE or one.within for one in nest.inside())
        if ordered and within is not None and nest.op is not PartKind.ONE and not self._is_chain(nest):
            nest = self._in_every_order(nest.nodes(), _WINDOW)
        if self._is_chain(nest):
            return self._sequence(nest.parts, within)
        formula: Chain | Junction
        if ordered and within is not None:  # each alternative has its own timespan
            formula, within = Junction(1, [(one.during(within),) for one in nest.parts]), None
        else:
            formula = self._after((), nest)
        if not isinstance(formula, Junction) and len(formula) > 1:
            return self._sequence(formula, within)
        names: dict[str, None] = {}
        condition = self._condition(formula, names)
        further: dict[str, Any] = {}
        if isinstance(formula, Junction) and len(names) > 1 and condition != f"({' and '.join(names)})":
            flat = len(names) == len(formula.parts) and not any(isinstance(one, Junction) for one in formula.parts)
            further = {"condition": {"gte": formula.need} if flat else condition}
        return self._of("temporal", [*names], within, **further)

    def _sequence(self, steps: Chain, within: int | None) -> dict[str, Any]:
        """Return the correlation of a sequence; equal events at its beginning are counted.

        Others have a rule each: a count has the time of its last event, so its first ones may come
        before the events before it.
        """
        equal_ones = len([*takewhile(lambda one: self._key(one) == self._key(steps[0]), steps)])
        counted = equal_ones > 1 and (within is None or equal_ones == len(steps))
        names = list[str]()
        if counted:
            counting = self._of("event_count", [self._rule(steps[0], 0)], within, condition={"gte": equal_ones})
            if equal_ones == len(steps):
                return counting
            names, steps = [self._child(counting)], steps[equal_ones:]
        keys = [self._key(one) for one in steps]
        names += [self._rule(one, keys[:number].count(keys[number])) for number, one in enumerate(steps)]
        return self._of("temporal_ordered", names, within)

    def _of(self, kind: str, names: list[str], within: int | None, **further: Any) -> dict[str, Any]:
        if within is not None and (within < _SECOND or within % _SECOND or within > _LONGEST):
            self._refuse("a timespan has whole seconds, at least one", (one.source.node for one in self._windows))
        bound = {name: self._bound[name] for name in names if name in self._bound}
        aliases = {
            alias: {name: bound[name][one] for name in bound}
            for one, alias in self._groups.items()
            if alias.startswith("rvaft_")
        }
        found: dict[str, Any] = {"type": kind, "rules": names}
        found |= {"aliases": aliases} if bound and aliases else {}
        found |= {"group-by": [*dict.fromkeys(self._groups.values())]} if self._groups else {}
        return found | {"timespan": FOREVER if within is None else _timespan(within), **further}

    def _child(self, correlation: dict[str, Any]) -> str:
        if (key := str(correlation)) not in self._names:
            times = "_times" if correlation["type"] == "event_count" else ""
            name = self._named(key, "_".join(correlation["rules"])[:60] + times)
            self._documents[name] = {
                "title": name,
                "id": rule_id(self._prop.tree, name),
                "name": name,
                "correlation": correlation,
            }
            self._fits(len(self._documents))
        return self._names[key]

    def _grouped(self) -> dict[str, str]:
        fields = {event: _shared_places(event.pattern) for event in self._prop.events}
        names = list(dict.fromkeys(chain.from_iterable(fields.values())))
        shared = sorted(name for name in names if sum(name in one for one in fields.values()) > 1)
        for name in shared:
            if lacking := [event.source.node for event, one in fields.items() if name not in one]:
                self._refuse(f"a correlation groups by fields of all its events, and some lack {name}", lacking)
        by = {name: {one[name] for one in fields.values()} for name in shared}
        several = [name for name in shared if len(by[name]) > 1]
        return {name: f"rvaft_{several.index(name)}" if name in several else min(by[name]) for name in shared}

    # Order.

    def _after(self, before: Chain | Junction, nest: Nest, *, step: bool = False) -> Chain | Junction:
        self._written += 1
        self._fits(self._written // 100)
        if isinstance(before, Junction) and (step or nest.op is PartKind.EVENT):
            return Junction(before.need, [self._after(one, nest, step=step) for one in before.parts])
        if nest.within is not None and before:
            self._refuse(_WINDOW, nest.nodes())
        if step or nest.op is PartKind.EVENT or nest.within is not None:
            return (*before, nest)
        if nest.op is PartKind.SEQUENCE:
            return reduce(lambda done, one: self._after(done, one, step=self._is_step(one)), nest.parts, before)
        need = len(nest.parts) if nest.op is PartKind.ALL else max(1, nest.need)
        return Junction(need, [self._after(before, one) for one in nest.parts])

    def _condition(self, formula: Chain | Junction, names: dict[str, None]) -> str:
        if not isinstance(formula, Junction):
            name = self._rule(formula[0], 0) if len(formula) == 1 else self._child(self._sequence(formula, None))
            names[name] = None
            return name
        texts = [self._condition(one, names) for one in formula.parts]
        ways = list[str]()
        for way in [texts] if formula.need == 1 else combinations(texts, formula.need):
            ways.append(f"({(' or ' if formula.need == 1 else ' and ').join(way)})")
            self._fits(sum(map(len, ways)) // 200)
        return ways[0] if len(ways) == 1 else f"({' or '.join(ways)})"

    def _mixed(self, nest: Nest) -> list[str]:
        for one, other in combinations(nest.parts, 2) if nest.op in (PartKind.ALL, PartKind.AT_LEAST) else ():
            for events in product(one.events(), other.events()):
                if not disjoint(*(event.pattern for event in events)):
                    return [event.source.node for event in events]
        return next(filter(None, map(self._mixed, nest.parts)), [])

    def _in_every_order(self, nodes: Iterable[str], reason: str) -> Nest:
        """Return the tree as a choice of all event orders, or refuse it if a part has a window."""
        if any(window is not self._prop.root for window in self._windows):
            self._refuse(reason, nodes)
        return in_every_order(self._without_window(), self._inseparable, limit=10 * self._limit)

    def _without_window(self) -> Property:
        root = self._prop.root
        return self._prop.with_root(root.parts[0] if isinstance(root, Within) else root)

    def _is_step(self, nest: Nest) -> bool:
        if nest.within is not None or nest.op is PartKind.EVENT:
            return nest.within is None
        several = nest.op is PartKind.ONE and not self._groups and all(one.op is PartKind.EVENT for one in nest.parts)
        return several and all(self._logsource(one) == self._logsource(nest.parts[0]) for one in nest.parts)

    def _single(self, nest: Nest) -> Iterator[Nest]:
        """Yield the steps of one event."""
        if nest.op is PartKind.EVENT:
            yield nest
        elif not self._is_step(nest):
            for part in nest.parts:
                yield from self._single(part)

    def _is_chain(self, nest: Nest) -> bool:
        return nest.op is PartKind.SEQUENCE and all(map(self._is_step, nest.parts))

    # Rules.

    def _named(self, key: object, wish: str) -> str:
        word = re.sub(r"[^a-z0-9_]", "_", wish.lower()) or "_"
        word = f"e_{word}" if word in ("and", "or", "not", "of") or not word[0].isalpha() else word
        names = chain([word], (f"{word}_{number}" for number in count(2)))
        return self._names.setdefault(key, next(name for name in names if name not in self._documents))

    def _key(self, step: Nest) -> object:
        if step.within is not None:
            return step
        leaves = filter(_observes, step.inside())
        return tuple(
            (one.event and one.event.pattern, one.guards, self._declared(one), str(self._logsource(one)))
            for one in leaves
        )

    def _rule(self, step: Nest, number: int) -> str:
        """Return the name of the rule for a step and number, or of the correlation for a windowed
        nest.
        """
        if step.within is not None:
            return self._child(self._correlation(step))
        if (key := (self._key(step), number)) not in self._names:
            events = step.events()
            name = self._named(key, events[0].source.node)
            self._documents[name] = self._detecting(name, number, [*filter(_observes, step.inside())])
            self._bound[name] = _shared_places(events[0].pattern)
            self._fits(len(self._documents))
        return self._names[key]

    def _detecting(self, name: str, number: int, leaves: list[Nest]) -> dict[str, Any]:
        """Return the rule of a correlation's event; equal events get numbered titles."""
        tree = self._prop.tree
        found = about(tree, name, tree.nodes[leaves[0].nodes()[0]])
        found["title"] += f" {number + 1}" if number else ""
        return {**found, **origin(tree), "level": "informational", "name": name, **self._detected(leaves)}

    def _detected(self, leaves: list[Nest]) -> dict[str, Any]:
        return {"logsource": self._logsource(leaves[0]), "detection": detection_of(map(self._event_rule, leaves))}

    def _logsource(self, leaf: Nest) -> dict[str, str]:
        """Return the log source of an event, from the attributes of its node and of the root."""
        attributes = {**self._attributes, **dict(self._prop.tree.nodes[leaf.nodes()[0]].attributes)}
        found: dict[str, str] = {
            key: attributes[key] for key in ("category", "product", "service") if key in attributes
        }
        return found or {"category": "rvaft"}

    def _event_rule(self, leaf: Nest) -> EventRule:
        assert leaf.event is not None, "a leaf"
        with naming(leaf.event.source.node):
            return EventRule(leaf.event.pattern, leaf.guards, self._declared(leaf), cased=self._cased)

    def _declared(self, leaf: Nest) -> Declared:
        assert leaf.event is not None, "a leaf"
        return declared(self._prop.tree, leaf.event.source.node, self._prop.assumes)


def _timespan(length: int) -> str:
    """Return a number of seconds in the largest unit.

    >>> _timespan(600 * _SECOND), _timespan(90 * _SECOND)
    ('10m', '90s')
    """
    unit = next(unit for unit, size in _SPANS.items() if not length % size)
    return f"{length // _SPANS[unit]}{unit}"


def _observes(nest: Nest) -> bool:
    return nest.event is not None


def _shared_places(pattern: Pattern) -> dict[str, str]:
    """Return the fields of the variables that are not local."""
    return {name: field for name, field in _places(pattern, ()) if not name.startswith("_")}


def _places(pattern: Pattern, way: tuple[str, ...]) -> Iterator[tuple[str, str]]:
    match pattern:
        case Variable(name):
            yield name, ".".join(way)
        case ObjectPattern(fields):
            for step, inner in fields:
                yield from _places(inner, (*way, step))


def disjoint(one: Pattern, other: Pattern) -> bool:
    """Return whether two patterns require different constants in a field."""
    match one, other:
        case ObjectPattern(fields), ObjectPattern(others):
            known = dict(others)
            return any(name in known and disjoint(inner, known[name]) for name, inner in fields)
        case Literal(value), Literal(another):
            return not equal(value, another)
        case _:
            return False
