"""Properties to queries of the Kusto Query Language (KQL).

An event is a `let`, a scenario a chain of joins, and a guard a condition as soon as its events are
joined. The translation depends on these facts of the documentation:

- `join` without `kind=inner` drops rows of the left table that have equal keys.
- `==`, `in` and the functions that end in `_cs` are case-sensitive; `=~` and `startswith` are not.
- A text is never null: an absent one is empty. So no event can be required to have an empty text.
- `x != null` is true, `null or true` too. So `or`, `not` and `!=` apply to values that are present,
  and never to times. `max_of` and `min_of` skip null, so bounds of times are bounds of pairs.
- Keys of a join have one type; other variables are compared after the join.

A counted leaf is one row (`backends.joins`): `prev` finds its first event among sorted rows. Different
values are ranked by their latest event in the window, which a join finds.

The matches that a `without` breaks are joined with the absent events, and removed by `leftanti`. For
`without … after`, `summarize` finds the first later row whose time decides the clause.
"""

import json
import re
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from decimal import Decimal
from itertools import product
from typing import Final, NamedTuple, assert_never

from backends.counted_leaves import single_rows
from backends.joins import COUNTED, JoinedScenario, joined_scenarios, variable_paths
from backends.tables import Path, Table, TableHeader, column_types, time_line
from rvaft.backend import Metrics
from rvaft.core.overlaps import compatible
from rvaft.core.property import AtLeast, Event, Property, WithoutEvent, chooses
from rvaft.core.times import Extreme, differences, untimed
from rvaft.errors import NotExpressible, TooLarge, TreeError, unwritten
from rvaft.model.assumptions import places
from rvaft.model.event_time import UNITS
from rvaft.model.guards import COMPARISONS, UNDEFINED, Guard, Operation, Operator, conjuncts, value, variables
from rvaft.model.nodes import Assumption, Side, ValueType
from rvaft.model.patterns import Literal, Pattern, Variable, rigid_variables
from rvaft.model.values import EXACT_INTEGERS, has_surrogate

EVENTS: Final = 20
"""Maximum number of events of a scenario: each is a join."""
_TOKEN: Final = re.compile(r'"(?:[^"\\]|\\.)*"|[\w.$]+|[<>=!]=|\S')
_PLAIN: Final = re.compile(r"(?!has_|.*_cs$|.*__$)(?:[A-Z]|_(?!_)|[a-z]+[A-Z0-9_])[A-Za-z0-9_]*")
"""Names that are no keywords: most keywords are one word in small letters."""
_WORD: Final = re.compile("[A-Za-z][A-Za-z0-9_]*")
_OWN: Final = ("pos", "time", "trace", "one", "rank")
_NAME: Final = re.compile("[A-Za-z0-9_ .-]{1,1000}")
_SPANS: Final = {
    "d": UNITS["d"],
    "h": UNITS["h"],
    "m": UNITS["min"],
    "s": UNITS["s"],
    "ms": UNITS["ms"],
    "microsecond": UNITS["us"],
    "tick": 100,
}
_TICK: Final = 100
"""Nanoseconds: the resolution of a datetime."""
_NUMBERS: Final = frozenset({ValueType.INTEGER, ValueType.NUMBER})
_KEYS: Final = frozenset({ValueType.TEXT, ValueType.INTEGER})
_TESTS: Final = {one: f"{one.value}_cs" for one in (Operator.STARTSWITH, Operator.ENDSWITH, Operator.CONTAINS)}
_SIGNS: Final = {"*": ".*", "?": "."}


class _Term(NamedTuple):
    """An expression of a type, with the greatest magnitude of an integer."""

    type: ValueType
    text: str
    most: int = 0
    constant: bool = False


class _Condition(NamedTuple):
    """A condition with its events, to be tested when all of them are joined."""

    events: frozenset[Event]
    text: str


@dataclass
class _Steps:
    """The steps to the matches of a scenario, of which `first` is joined first."""

    scenario: JoinedScenario
    first: Event
    steps: list[str]
    decided: list[str] = field(default_factory=list)
    """The columns of the positions that decide clauses `after`."""


def identifier(name: str) -> str:
    """Return the name of a table or column, quoted where it may be a keyword.

    >>> identifier("UserId"), identifier("type"), identifier("src ip")
    ('UserId', "['type']", "['src ip']")
    """
    if _PLAIN.fullmatch(name):
        return name
    if not _NAME.fullmatch(name) or name.startswith("__") or name.endswith("__"):
        raise NotExpressible(unwritten(f"{json.dumps(name)} is no name in KQL: name another column with --columns"))
    return f"['{name}']"


def text_literal(text: str) -> str:
    """Return a string in KQL; raises `NotExpressible` for characters without an escape."""
    escapes = {"\\": "\\\\", '"': '\\"', "\n": "\\n", "\r": "\\r", "\t": "\\t"}
    if has_surrogate(text) or re.search("[\0-\x08\x0b\x0c\x0e-\x1f\x7f-\x9f\u2028\u2029]", text):
        raise NotExpressible(unwritten(f"KQL has no escape for a character of {json.dumps(text)}"))
    return f'"{"".join(escapes.get(one, one) for one in text)}"'


class KqlQuery:
    """One translation; raises `NotExpressible`, `TooLarge`, and `TreeError` without a feasible
    scenario.
    """

    def __init__(self, prop: Property, limit: int, table: Table) -> None:
        self.prop, self.types = prop, column_types(prop)
        units = prop.time is not None and prop.time.format in UNITS
        kind = table.kind or (str(prop.time.format) if prop.time is not None and units else "timestamp")
        self.header = TableHeader.of(table, prop, self.types, kind)
        if self.header.time and kind == "double":
            raise NotExpressible(
                unwritten("KQL rounds times in seconds: use a column of datetime, as in --time t:timestamp")
            )
        self.columns = {column.path: identifier(column.name) for column in self.header.columns}
        sorted_ = self.header.position == self.header.time != ""
        lateness = 0 if sorted_ else None if prop.tree.time is None else prop.tree.time.late
        found = joined_scenarios(JoinedScenario, prop, limit, most=COUNTED, minimal=not prop.absences)
        self.scenarios = tuple(single_rows(one, lateness, values=self._groups(one), starts=True) for one in found)
        if any(len(one.before) > EVENTS for one in self.scenarios):
            raise TooLarge("events joined in a scenario", limit=EVENTS)
        if not self.scenarios:
            root = prop.tree.root
            raise TreeError(f"no scenario of {root} is feasible", rule="no-scenario", nodes=[root])
        numbers = {event.source: place for place, event in enumerate(prop.events, 1)}
        self.number = {event: numbers[event.source] for one in self.scenarios for event in one.before}
        self.absent = {clause: place for place, clause in enumerate(prop.absences, len(prop.events) + 1)}
        self.deciding = len(prop.events) + len(prop.absences) + 1
        """The number of the rows that decide a clause `after`."""
        self.timed = any(one.times for one in self.scenarios) or prop.times_absences
        self.lets: dict[str, str] = {}
        """The names of the queries of events, by query."""
        variables = (name for one in self.scenarios for name in one.binders if name not in one.times)
        own_variables = sorted({name for clause in self.absent for name in rigid_variables(clause.pattern)})
        self._names = {name: number for number, name in enumerate(dict.fromkeys([*variables, *own_variables]), 1)}
        """The variables of events, each with its number."""
        own = {"trace", "detected", "branch", "nodes", *(f"v{place}" for place in range(len(self._names) + 1))}
        self._shown = {
            name: identifier(name)
            if _NAME.fullmatch(name) and name not in own and not name.startswith("__")
            else f"v{number}"
            for name, number in self._names.items()
        }
        """The columns of variables in the result."""
        distinct = (name for one in self.scenarios for count in one.counts_of.values() for name in count.distinct)
        self._own = {f"{column}_" for column in (*_OWN, *self._names, *(name[1:] for name in distinct))}
        self._taken = {*self.columns.values(), self.header.table}

    def text(self) -> tuple[str, Metrics]:
        """Return the text and its metrics."""
        queries = [self._scenario(one) for one in self.scenarios]
        lets = [f"let {name} = {query};\n" for query, name in self.lets.items()]
        if len(queries) > 1:
            names = [self._free(f"scenario_{number}") for number in range(1, len(queries) + 1)]
            lets += [f"let {name} = {query};\n" for name, query in zip(names, queries, strict=True)]
            queries = [f"union {', '.join(names)}"]
        text = f"{''.join(lets)}{queries[0]}\n"
        return f"{''.join(f'// {line}{chr(10)}' for line in self._header())}{text}", Metrics(len(_TOKEN.findall(text)))

    def _header(self) -> Iterator[str]:
        votes = any(isinstance(part, AtLeast) and chooses(part) for part in self.prop.parts)
        fewest = " with as few events as its votes need" if votes and not self.absent else ""
        yield "rvaft kql"
        fewest += ", with the first and the last event of counted leaves" * any(one.counts_of for one in self.scenarios)
        yield f"The attack-fault tree {json.dumps(self.prop.tree.root)} under scattered: every match{fewest}."
        yield from self.header.lines()
        if self.prop.time is not None:
            yield time_line(self.prop.time)
        if self.header.position == self.header.time:
            yield f"Rows with equal {json.dumps(self.header.position)} are not ordered."

    def _free(self, name: str) -> str:
        while name in self._taken or name.rstrip("0123456789") in self._own:
            name = f"{name}_1"
        return name

    # Events.

    def _leaf(
        self,
        pattern: Pattern,
        own: int,
        name: str,
        guards: Iterable[Guard],
        *,
        alone: bool,
        distinct: Iterable[str] = (),
    ) -> str:
        """Return the name of the `let` of an event; `alone` adds a constant to join on, `distinct` local variables."""
        where, columns = list[str](), variable_paths(pattern)
        for path, part, _ in places(pattern):
            if isinstance(part, Literal):
                where.append(self._literal_test(path, part))
            elif isinstance(part, Variable) and columns[part.name] != path:
                where.append(f"{self.columns[columns[part.name]]} == {self.columns[path]}")
        terms = {name: self._variable(path, self.columns[path]) for name, path in columns.items()}
        where += [self._truth(guard, terms) for guard in guards]
        project = {f"trace_{own}": self.header.trace, f"pos_{own}": self.header.position}
        shown = [f"{name} = {identifier(column)}" for name, column in project.items() if column]
        names = (*rigid_variables(pattern), *distinct)
        shown += [f"{self._column(name, own)} = {self.columns[columns[name]]}" for name in names]
        shown += [f"time_{own} = {identifier(self.header.time)}"] if self.timed else []
        shown += [f"one_{own} = 1"] if alone else []
        tests = f"\n| where {' and '.join(dict.fromkeys(where))}" if where else ""
        query = f"{identifier(self.header.table)}{tests}\n| project {', '.join(shown)}"
        return self._let(query, f"{name if _WORD.fullmatch(name) else 'event'}_{own}")

    def _let(self, query: str, name: str) -> str:
        """Return the name of the `let` of a query."""
        if query not in self.lets:
            self.lets[query] = self._free(name.replace("__", "_"))
            self._taken.add(self.lets[query])
        return self.lets[query]

    def _literal_test(self, path: Path, literal: Literal) -> str:
        column = self.columns[path]
        if literal.value == "":
            raise NotExpressible(
                unwritten(f"KQL does not distinguish an empty text from an absent one, as in {column}")
            )
        return f"{column} == {self._mixed(self._variable(path, column), self._literal(literal.value))[1]}"

    def _column(self, variable: str, event: Event | int) -> str:
        local = variable.removeprefix("_")
        plain = _WORD.fullmatch(local) and local not in _OWN
        name = local if plain else f"v{self._names[variable]}"
        return f"{name}_{event if isinstance(event, int) else self.number[event]}"

    # Scenarios.

    def _scenario(self, one: JoinedScenario) -> str:
        conditions = [*self._conditions(one)]
        homes: dict[Event, list[Guard]] = {event: [] for event in one.before}
        for guard, home in one.homes:
            if home is not None:
                homes[home] += [part for part in conjuncts(guard) if not one.times.keys() & {*variables(part)}]
        firsts = {count.first: last for last, count in one.counts_of.items() if count.first is not None}
        for first, last in firsts.items():
            homes[last] += [*homes[first], *one.counts_of[last].guards]
        joined, todo, steps = list[Event](), [event for event in one.before if event not in firsts], list[str]()
        pairs: dict[Event, list[tuple[str, str]]] = {}
        constant = set[Event]()
        while todo:
            keys = {event: [*self._keys(one, event, joined)] for event in todo}
            event = max(todo, key=lambda event: len(keys[event]))
            pairs[event] = keys[event]
            if joined and not keys[event]:
                pairs[event] = [(f"one_{self.number[joined[0]]}", f"one_{self.number[event]}")]
                constant |= {joined[0], event}
            joined.append(event)
            todo.remove(event)
        if one.absences and not self.header.trace:
            constant |= {joined[0]}
        seen = set[Event]()
        for event in joined:
            pattern, node, alone = untimed(event.pattern)[0], event.source.node, event in constant
            if event in one.counts_of:
                name = self._counted(one, event, homes[event], alone=alone)
            else:
                name = self._leaf(pattern, self.number[event], node, homes[event], alone=alone)
            keys_ = ", ".join(f"$left.{left} == $right.{right}" for left, right in pairs[event])
            steps.append(f"join kind=inner {name} on {keys_}" if steps else name)
            seen |= {event, *(first for first, last in firsts.items() if last == event)}
            ready = [condition for condition in conditions if condition.events <= seen]
            conditions = [condition for condition in conditions if condition not in ready]
            if ready:
                steps.append(f"where {' and '.join(dict.fromkeys(condition.text for condition in ready))}")
        if one.absences:
            steps = self._with_absences(one, joined[0], steps)
        steps.append(f"project {', '.join(self._result(one))}")
        return "\n| ".join(steps)

    def _keys(self, one: JoinedScenario, event: Event, joined: list[Event]) -> Iterator[tuple[str, str]]:
        if joined and self.header.trace:
            yield f"trace_{self.number[joined[0]]}", f"trace_{self.number[event]}"
        for variable, binders in one.binders.items():
            first = next((other for other in joined if other in binders), None)
            if event in binders and first is not None and self._type(one, variable) in _KEYS:
                yield self._column(variable, first), self._column(variable, event)

    def _type(self, one: JoinedScenario, variable: str) -> ValueType:
        """Return the type of a variable; NUMBER where its columns are integers and numbers."""
        if variable in one.times:
            return ValueType.TIME
        found = {self.types[variable_paths(event.pattern)[variable]] for event in one.binders[variable]}
        if len(found) > 1 and not found <= _NUMBERS:
            raise NotExpressible(
                unwritten(f"variable {variable} is of two types: columns of two types are not compared")
            )
        return ValueType.NUMBER if len(found) > 1 else next(iter(found))

    # Counted events.

    def _groups(self, one: JoinedScenario) -> list[str]:
        """Return the variables whose values rows are sorted and grouped by."""
        return [name for name in one.binders if name not in one.times and self._type(one, name) in _KEYS]

    def _counted(self, one: JoinedScenario, last: Event, guards: Sequence[Guard], *, alone: bool) -> str:
        """Return the name of the `let` of a counted leaf: its last event, each with the latest first one."""
        count, node, end = one.counts_of[last], last.source.node, self.number[last]
        assert count.first is not None, "kept by `starts`"
        start = self.number[count.first]
        pattern, other = (untimed(event.pattern)[0] for event in (last, count.first))
        keys = ["trace"] if self.header.trace else []
        columns = {name: (f"{name}_{start}", f"{name}_{end}") for name in (*keys, "pos", *["time"][: self.timed])}
        names = rigid_variables(pattern)
        columns |= {name: (self._column(name, start), self._column(name, end)) for name in names}
        keys += names
        same = [columns[key] for key in keys]
        known = f"isnotnull(time_{end})"
        if not count.distinct:
            steps = [self._leaf(pattern, end, node, guards, alone=alone), *[f"where {known}"][: count.timed]]
            steps.append(f"sort by {', '.join(f'{last_} asc' for _, last_ in (*same, columns['pos']))}")
            earlier = (f"{first} = prev({last_}, {count.count - 1})" for first, last_ in columns.values())
            steps.append(f"extend {', '.join(earlier)}")
            equal = (f"{first} == {last_}" for first, last_ in same)
            steps.append(f"where {' and '.join([f'isnotnull(pos_{start})', *equal])}")
            return self._let("\n| ".join(steps), f"{node if _WORD.fullmatch(node) else 'event'}_counted_1")
        pairs = same or [(f"one_{start}", f"one_{end}")]
        steps = [self._leaf(pattern, end, node, guards, alone=alone or not same)]
        values = self._leaf(other, start, node, guards, alone=not same, distinct=count.distinct)
        on = ", ".join(f"$left.{last_} == $right.{first}" for first, last_ in pairs)
        where = [f"pos_{start} <= pos_{end}"]
        if count.length is not None:
            where.append(f"time_{end} - time_{start} {self._bound(count.length)}")
        elif count.timed:
            where += [known, f"isnotnull(time_{start})"]
        latest = ", ".join(
            f"{first} = max({first})" for first, _ in (columns[one] for one in ("pos", "time") if one in columns)
        )
        by = [last_ for _, last_ in columns.values()] + [first for first, _ in same]
        by += [f"one_{end}"] * (alone or not same) + [self._column(name, start) for name in count.distinct]
        steps += [
            f"join kind=inner {values} on {on}",
            f"where {' and '.join(where)}",
            f"summarize {latest} by {', '.join(by)}",
        ]
        own = [columns[name][1] for name in (*keys, "pos")]  # several events may have one time as position
        new = " or ".join(f"{name} != prev({name})" for name in own)
        steps += [
            f"sort by {', '.join(f'{name} asc' for name in own)}, pos_{start} desc",
            f"extend rank_{end} = row_number(1, {new})",
            f"where rank_{end} == {count.count}",
        ]
        return self._let("\n| ".join(steps), f"{node if _WORD.fullmatch(node) else 'event'}_counted_1")

    # Absent events.

    def _with_absences(self, one: JoinedScenario, first: Event, steps: list[str]) -> list[str]:
        """Return the steps to the matches that no event breaks, with the positions that decide them."""
        times = {number for clause, part in one.absences if clause.duration is not None for number in self._of(part)}
        if times:
            steps = [*steps, f"where {' and '.join(f'isnotnull(time_{number})' for number in sorted(times))}"]
        where = [(clause, part, self._breaking(one, clause, part)) for clause, part in one.absences]
        late = None if self.prop.tree.time is None else self.prop.tree.time.late
        found = _Steps(one, first, steps)
        for number, (clause, part, conditions) in enumerate(where, 1):
            if clause.side is not Side.AFTER:
                self._remove(found, clause, conditions)
            elif late is not None:  # an event in time after the deciding one is late
                self._remove(found, clause, conditions)
                self._decide(found, clause, part, f"decided_{number}")
            else:
                self._decide(found, clause, part, f"decided_{number}")
                self._remove(found, clause, [*conditions, f"pos_{self.absent[clause]} < decided_{number}"])
        return found.steps

    def _of(self, part: Iterable[Event]) -> list[int]:
        return [self.number[event] for event in part]

    def _breaking(self, one: JoinedScenario, clause: WithoutEvent, part: Sequence[Event]) -> list[str]:
        """Return the conditions that an event breaks a clause, apart from keys and decisions."""
        row = self.absent[clause]
        first = [event for event in part if one.before[event].isdisjoint(part)]
        last = [event for event in part if not any(event in one.before[other] for other in part)]
        begin = _several("min_of", [f"pos_{number}" for number in self._of(first)])
        end = _several("max_of", [f"pos_{number}" for number in self._of(last)])
        match clause.side:
            case Side.DURING:
                found = [f"{begin} < pos_{row}", f"pos_{row} < {end}"]
            case Side.BEFORE:
                found = [f"pos_{row} < {begin}"]
                if clause.duration is not None:
                    start = _several("min_of", [f"time_{number}" for number in self._of(part)])
                    found.append(f"{start} - time_{row} {self._bound(clause.duration)}")
            case Side.AFTER:
                found = [f"{end} < pos_{row}", f"time_{row} - {self._end(part)} {self._bound(clause.duration or 0)}"]
            case _:
                assert_never(clause.side)
        match clause.side:  # the positions of the clause exclude some events of the match
            case Side.DURING:
                excluded = {
                    event for event in one.before if all(event in {other, *one.before[other]} for other in first)
                }
                excluded |= {event for event in one.before if {event, *one.before[event]}.issuperset(last)}
            case Side.BEFORE:
                excluded = {event for event in one.before if not {event, *one.before[event]}.isdisjoint(part)}
            case Side.AFTER:
                excluded = {*part}.union(*(one.before[event] for event in part))
            case _:
                assert_never(clause.side)
        used = [event for event in one.before if event not in excluded and compatible(clause.pattern, event.pattern)]
        found += [f"pos_{row} != pos_{number}" for number in self._of(used)]
        paths, terms = variable_paths(clause.pattern), self._terms(one)
        columns = {name: self._variable(paths[name], self._column(name, row)) for name in paths}
        for name in rigid_variables(clause.pattern):
            if name not in clause.own and not self._is_key(one, clause, name):
                found.append(self._compared(terms[name], Operator.EQ, columns[name]))
        binding = {**terms, **{name: columns[name] for name in clause.own & columns.keys()}}
        return [*found, *(self._truth(guard, binding) for guard in self._guards(clause, alone=False))]

    def _end(self, part: Sequence[Event]) -> str:
        return _several("max_of", [f"time_{number}" for number in self._of(part)])

    @staticmethod
    def _guards(clause: WithoutEvent, *, alone: bool) -> list[Guard]:
        """Return the conjuncts of a guard on the absent event alone, or the others."""
        names = variable_paths(clause.pattern).keys()
        return [guard for guard in conjuncts(clause.guard) if (names >= {*variables(guard)}) is alone]

    def _is_key(self, one: JoinedScenario, clause: WithoutEvent, name: str) -> bool:
        type_ = self.types[variable_paths(clause.pattern)[name]]
        return type_ in _KEYS and self._terms(one)[name].type is type_

    def _remove(self, found: _Steps, clause: WithoutEvent, conditions: Iterable[str]) -> None:
        """Remove the matches that an event breaks."""
        row, one, first = self.absent[clause], found.scenario, found.first
        names = [name for name in rigid_variables(clause.pattern) if name not in clause.own]
        terms = self._terms(one)
        keys = [(terms[name].text, self._column(name, row)) for name in names if self._is_key(one, clause, name)]
        if self.header.trace:
            keys.insert(0, (f"trace_{self.number[first]}", f"trace_{row}"))
        alone = not keys
        if alone:
            keys.append((f"one_{self.number[first]}", f"one_{row}"))
        absent = self._leaf(clause.pattern, row, "absent", self._guards(clause, alone=True), alone=alone)
        matched = self._let("\n| ".join(found.steps), "matched_1")
        on = ", ".join(f"$left.{left} == $right.{right}" for left, right in keys)
        values = [term.text for term in terms.values() if _WORD.fullmatch(term.text)]
        # several events may have one time as position: then values tell matches apart
        own = dict.fromkeys(
            [*(f"pos_{number}" for number in self._of(one.before)), *(left for left, _ in keys), *values]
        )
        shown = ", ".join(f"{name} = {name}" for name in own)
        broken = [matched, f"join kind=inner {absent} on {on}", f"where {' and '.join(conditions)}", f"project {shown}"]
        same = ", ".join(f"$left.{name} == $right.{name}" for name in own)
        removed = self._let("\n| ".join(broken), "broken_1")
        found.steps = [matched, f"join kind=leftanti {removed} on {same}"]

    def _decide(self, found: _Steps, clause: WithoutEvent, part: Sequence[Event], name: str) -> None:
        """Keep the matches whose clause is decided, with the position that decides it."""
        row, late = self.deciding, self.prop.tree.time.late if self.prop.tree.time is not None else None
        one, first = found.scenario, found.first
        own = {f"trace_{row}": self.header.trace, f"pos_{row}": self.header.position, f"time_{row}": self.header.time}
        shown = [f"{name} = {identifier(column)}" for name, column in own.items() if column]
        time = identifier(self.header.time)
        key = "trace" if self.header.trace else "one"
        shown += [] if self.header.trace else [f"one_{row} = 1"]
        table = f"{identifier(self.header.table)}\n| where isnotnull({time})\n| project {', '.join(shown)}"
        length = self._bound((clause.duration or 0) + (late or 0))
        longer = f">{length[2:]}" if length.startswith("<=") else f">={length[1:]}"
        last = _several("max_of", [f"pos_{event}" for event in self._of(part)])
        kept = [*self._carried(one, first), *found.decided]
        pair = f"$left.{key}_{self.number[first]} == $right.{key}_{row}"
        found.steps += [
            f"join kind=inner {self._let(table, f'time_{row}')} on {pair}",
            f"where {last} < pos_{row} and time_{row} - {self._end(part)} {longer}",
            f"summarize {name} = min(pos_{row}) by {', '.join(kept)}",
        ]
        found.decided.append(name)

    def _carried(self, one: JoinedScenario, first: Event) -> Iterator[str]:
        """Yield the columns of a match."""
        for event in one.before:
            number = self.number[event]
            yield from (f"{name}_{number}" for name in ("trace", "pos", "time") if name != "trace" or self.header.trace)
            yield from (self._column(name, event) for name in rigid_variables(untimed(event.pattern)[0]))
        if not self.header.trace:
            yield f"one_{self.number[first]}"

    def _terms(self, one: JoinedScenario) -> dict[str, _Term]:
        """Return the first column of each variable."""
        paths = ((name, events[0]) for name, events in one.binders.items() if name not in one.times)
        return {
            name: self._variable(variable_paths(event.pattern)[name], self._column(name, event))
            for name, event in paths
        }

    def _conditions(self, one: JoinedScenario) -> Iterator[_Condition]:
        row = self.number
        for event in one.before:
            for other in one.near(event):
                if event in one.counts_of and one.counts_of[event].first == other:
                    continue
                yield _Condition(frozenset({event, other}), f"pos_{row[other]} < pos_{row[event]}")
        for a, b in one.apart:
            yield _Condition(frozenset({a, b}), f"pos_{row[a]} != pos_{row[b]}")
        terms = self._terms(one)
        for variable, (first, *others) in one.binders.items():
            if (type_ := self._type(one, variable)) is not ValueType.TIME:
                column = self._column(variable, first)
                for other in others if type_ not in _KEYS else ():
                    yield _Condition(frozenset({first, other}), f"{column} == {self._column(variable, other)}")
        for guard, home in one.homes:
            for part in conjuncts(guard):
                if any(name in one.times for name in variables(part)):
                    yield from self._times(one, part)
                elif home is None:
                    events = frozenset(one.binders[name][0] for name in variables(part))
                    yield _Condition(events, self._truth(part, terms))

    def _result(self, one: JoinedScenario) -> Iterator[str]:
        early = frozenset[Event]().union(*one.before.values())
        lasts = [f"pos_{self.number[event]}" for event in one.before if event not in early]
        sides = [clause.side for clause, _ in one.absences]
        lasts += [f"decided_{number}" for number, side in enumerate(sides, 1) if side is Side.AFTER]
        if self.header.trace:
            yield f"trace = trace_{self.number[next(iter(one.before))]}"
        yield f"detected = {_several('max_of', lasts)}"
        yield f"branch = {one.branch}"
        rows: dict[str, list[str]] = {}
        for event in sorted(one.before, key=lambda event: event.source.number):
            rows.setdefault(event.source.node, []).append(f"pos_{self.number[event]}")
        nodes = (f"{text_literal(node)}, {_several('pack_array', found)}" for node, found in rows.items())
        yield f"nodes = bag_pack({', '.join(nodes)})"
        for name in sorted(one.binders.keys() - one.times.keys(), key=self._names.__getitem__):
            yield f"{self._shown[name]} = {self._column(name, one.binders[name][0])}"

    # Times.

    def _times(self, one: JoinedScenario, guard: Guard) -> Iterator[_Condition]:
        """Yield a guard on times as bounds of pairs of times."""
        bounds = differences(guard) if set(variables(guard)) <= one.times.keys() else None
        if bounds is None:
            raise NotExpressible(
                unwritten("in KQL a guard on times is a comparison of two times, without `or` and `!=`")
            )
        found: dict[tuple[Event, Event], int] = {}
        for plus, minus, most in bounds:
            wrong = {Operator.MIN: plus, Operator.MAX: minus}
            if any(len(side.names) > 1 and side.operator is extreme for extreme, side in wrong.items()):
                raise NotExpressible(
                    unwritten("KQL cannot bound the first of several times from above, or the last from below")
                )
            for pair in self._pairs(one, plus, minus, most):
                found[pair] = min(most, found.get(pair, most))
        for (later, sooner), most in found.items():
            first, second = (later, sooner) if most >= 0 else (sooner, later)
            difference = f"time_{self.number[first]} - time_{self.number[second]}"
            if most >= 0 and later != sooner and found.get((sooner, later)) == most:
                if self.number[later] < self.number[sooner]:
                    continue
                difference = f"abs({difference})"
            yield _Condition(frozenset({later, sooner}), f"{difference} {self._bound(most)}")

    def _pairs(self, one: JoinedScenario, plus: Extreme, minus: Extreme, most: int) -> Iterator[tuple[Event, Event]]:
        """Yield the pairs that decide a bound; positions that are times decide some of them."""
        ends, starts = ([one.times[name] for name in side.names] for side in (plus, minus))
        sorted_ = self.header.position == self.header.time and most >= 0
        if sorted_:
            ends = [end for end in ends if not any(end in one.before[other] for other in ends)]
            starts = [start for start in starts if not one.before[start].intersection(starts)]
        pairs = [(end, start) for end, start in product(ends, starts) if not (sorted_ and end in one.before[start])]
        yield from ((a, b) for a, b in pairs if a != b or most < 0 or len({*ends, *starts}) == 1)

    def _bound(self, most: int) -> str:
        datetimes = self.header.kind == "timestamp"
        unit = _TICK if datetimes else UNITS[self.header.kind]
        sign, length = ("<", most + 1) if most % unit and not (most + 1) % unit else ("<=", most - most % unit)
        if most < 0:  # a bound of the opposite difference
            sign, length = sign.replace("<", ">"), -length
        if not datetimes:
            return f"{sign} {length // unit}"
        word = next(word for word, size in _SPANS.items() if not length % size)
        return f"{sign} {length // _SPANS[word]}{word}" if length else f"{sign} 0s"

    # Guards.

    def _truth(self, guard: Guard, terms: Mapping[str, _Term]) -> str:
        found = self._term(guard, terms)
        if found.type is not ValueType.BOOLEAN:
            raise NotExpressible(unwritten(f"a condition in KQL is a Boolean, not {found.type}"))
        return found.text

    def _term(self, guard: Guard, terms: Mapping[str, _Term]) -> _Term:
        match guard:
            case Literal(constant):
                return self._literal(constant)
            case Variable(name):
                return terms[name]
            case Operation() if not variables(guard):
                if (constant := value(guard, {})) is UNDEFINED:
                    raise NotExpressible(unwritten("a part of a guard is undefined"))
                return self._literal(constant)
            case Operation(Operator.AND | Operator.OR as word, parts):
                found = f" {word.value} ".join(self._truth(part, terms) for part in parts)
                return _Term(ValueType.BOOLEAN, f"({found})")
            case Operation(Operator.NOT, (part,)):
                return _Term(ValueType.BOOLEAN, f"not({self._truth(part, terms)})")
            case Operation(Operator.IN, (part, *parts)):
                left, among = self._term(part, terms), [self._term(one, terms) for one in parts]
                if left.type in _KEYS and all(one.constant and one.type is left.type for one in among):
                    return _Term(ValueType.BOOLEAN, f"{left.text} in ({', '.join(one.text for one in among)})")
                found = " or ".join(self._compared(left, Operator.EQ, one) for one in among)
                return _Term(ValueType.BOOLEAN, f"({found})")
            case Operation(Operator.LIKE, (part, Literal(str() as glob))):
                found = "".join(_SIGNS.get(sign, re.sub(r"([\\.+*?()|\[\]{}^$])", r"\\\1", sign)) for sign in glob)
                regex = text_literal(rf"\A(?s:{found})\z")
                return _Term(ValueType.BOOLEAN, f"{self._text(part, terms)} matches regex {regex}")
            case Operation(operator, (part, Literal(str() as constant))) if operator in _TESTS and constant:
                tested = f"{self._text(part, terms)} {_TESTS[operator]} {text_literal(constant)}"
                return _Term(ValueType.BOOLEAN, tested)
            case Operation(operator, (left_, right_)) if operator in COMPARISONS:
                compared = self._compared(self._term(left_, terms), operator, self._term(right_, terms))
                return _Term(ValueType.BOOLEAN, compared)
            case Operation(operator, parts) if operator not in _TESTS:
                return self._calculated(operator, [self._term(part, terms) for part in parts])
            case Operation(operator):
                raise NotExpressible(
                    unwritten(f"`{operator.value}` needs a text that is not empty as its second operand")
                )
        raise NotExpressible(unwritten("KQL has no such guard"))

    def _text(self, part: Guard, terms: Mapping[str, _Term]) -> str:
        found = self._term(part, terms)
        if found.type is not ValueType.TEXT:
            raise NotExpressible(unwritten(f"KQL tests the characters of a text, not of {found.type}"))
        return found.text

    def _variable(self, path: Path, column: str) -> _Term:
        exact = Assumption.EXACT in self.prop.assumes
        return _Term(self.types[path], column, EXACT_INTEGERS - 1 if exact else 2**63)

    @staticmethod
    def _literal(constant: object) -> _Term:
        match constant:
            case bool():
                return _Term(ValueType.BOOLEAN, "true" if constant else "false", constant=True)
            case str():
                return _Term(ValueType.TEXT, text_literal(constant), constant=True)
            case int() | float() if abs(constant) < 2**63 and constant == int(constant):
                return _Term(ValueType.INTEGER, str(int(constant)), int(abs(constant)), constant=True)
            case float() if abs(constant) < 2**63:
                return _Term(ValueType.NUMBER, f"{Decimal(repr(constant)):f}", constant=True)
        raise NotExpressible(unwritten(f"{constant} is no number of 64 bits"))

    @staticmethod
    def _mixed(left: _Term, right: _Term) -> tuple[str, str]:
        """Return two terms that KQL compares exactly: it converts an integer beside a double."""
        if left.type is not right.type:
            if {left.type, right.type} != _NUMBERS:
                raise NotExpressible(unwritten(f"KQL does not compare {left.type} with {right.type}"))
            whole, other = (left, right) if left.type is ValueType.INTEGER else (right, left)
            if whole.most > EXACT_INTEGERS and not other.constant:
                raise NotExpressible(unwritten("KQL rounds integers that it compares with doubles: `assume exact;`"))
        return left.text, right.text

    def _compared(self, left: _Term, operator: Operator, right: _Term) -> str:
        a, b = self._mixed(left, right)
        if operator not in (Operator.EQ, Operator.NE) and left.type not in _NUMBERS:
            raise NotExpressible(unwritten(f"KQL does not order values of type {left.type}"))
        return f"{a} {operator.value} {b}"

    @staticmethod
    def _calculated(operator: Operator, terms: list[_Term]) -> _Term:
        """Return a calculation with integers that does not exceed 64 bits."""
        if any(term.type is not ValueType.INTEGER for term in terms):
            raise NotExpressible(unwritten(f"`{operator.value}` needs integers in KQL"))
        first, *others = [term.text for term in terms]
        most = sum(term.most for term in terms)
        match operator:
            case Operator.ADD | Operator.SUB:
                found = f"({first} {operator.value} {others[0]})"
            case Operator.NEGATE:
                found = f"(0 - {first})"
            case Operator.ABS:
                found = f"abs({first})"
            case Operator.MIN | Operator.MAX:
                found, most = _several(f"{operator.value}_of", [first, *others]), max(term.most for term in terms)
            case _:
                raise NotExpressible(unwritten(f"KQL has no exact `{operator.value}`"))
        if most >= 2**63 and operator not in (Operator.MIN, Operator.MAX):
            raise NotExpressible(unwritten(f"`{operator.value}` may exceed the 64 bits of KQL: `assume exact;`"))
        return _Term(ValueType.INTEGER, found, most)


def _several(function: str, parts: Sequence[str]) -> str:
    return parts[0] if len(parts) == 1 else f"{function}({', '.join(parts)})"
