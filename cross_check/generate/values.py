"""Random values: those that affect a tree, those that satisfy guards, and typical log values.

Candidates for a variable come from its comparisons, solved for it if the other sides have values,
and from values of the tree. For example, `T2 >= T1 + 10` with T1 = 3 yields 12, 13 and 14. The
search is incomplete.
"""

import math
from collections import defaultdict
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import lru_cache, partial
from itertools import pairwise
from random import Random
from sys import float_info
from typing import Final, TypeAlias, TypeVar, cast

import networkx as nx

from rvaft.core.solver import bounds
from rvaft.model.guards import ARITHMETIC, COMPARISONS, Duration, Guard, Operation, Operator, conjuncts, holds
from rvaft.model.guards import variables as guard_variables
from rvaft.model.guards import walk as guard_walk
from rvaft.model.nodes import Assumption
from rvaft.model.patterns import (
    Anything,
    Binding,
    ListPattern,
    Literal,
    ObjectPattern,
    Pattern,
    SomeItem,
    Variable,
    walk,
)
from rvaft.model.tree import RVAFT
from rvaft.model.values import Json, is_number

T = TypeVar("T")
Path: TypeAlias = tuple[str | int, ...]

COMMON: Final[tuple[Json, ...]] = (
    *(0, 1, 1.0, 2, 3, 1.5, -1, "a", "b", "", True, False, None),
    *([1], [], {"k": 1}, {"k": 1.0, "l": 2}),
)


@lru_cache(maxsize=1)
def interesting_values(tree: RVAFT) -> tuple[Json, ...]:
    """Return values that affect a tree: literals, neighbours of guard constants, and all types."""
    parts: list[Pattern | Guard] = []
    for node in tree.top_down():
        pattern = tree.pattern(node.name)
        parts += walk(pattern) if pattern is not None else ()
        parts += guard_walk(node.when)
    for ignore in tree.ignores:
        parts += guard_walk(ignore.when)
    found: list[Json] = [part.value for part in parts if isinstance(part, Literal) and not isinstance(part, Duration)]
    found += [text for part in parts if isinstance(part, Operation) for text in _texts_for(part)]
    if Assumption.CASE in tree.assumes:
        found += [value.swapcase() for value in found if isinstance(value, str)]
    near = [value + d for value in found if is_number(value) for d in (-1, 1)]
    return (*found, *near, *COMMON)


def _texts_for(part: Operation) -> Iterator[Json]:
    for text in (one.value for operand in part.operands for one in guard_walk(operand) if isinstance(one, Literal)):
        match part.operator, text:
            case Operator.STARTSWITH | Operator.ENDSWITH | Operator.CONTAINS, str():
                yield from (text, f"{text}~", f"~{text}", f"~{text}~", text[:-1])
            case Operator.LIKE, str():
                yield from (text.replace("*", stars).replace("?", "~") for stars in ("", "~", "~.~"))
                yield text.replace("?", "").replace("*", "~")
            case _, str() if any(inner.operator is Operator.LOWER for inner in operations(part)):
                yield from (text.upper(), text.title(), text.swapcase())
            case _, int() | float() if is_number(text) and any(
                inner.operator is Operator.NUMBER for inner in operations(part)
            ):
                yield from (str(text), f"{text}e0", f" {text}", f"0{text}", f"{text}.0")
            case _:
                pass


def operations(guard: Guard | None) -> Iterator[Operation]:
    """Return the operations in a guard."""
    return (part for part in guard_walk(guard) if isinstance(part, Operation))


def built(random: Random, pattern: Pattern, binding: Binding, free: Callable[[str], Json]) -> Json:
    """Return a value that matches the pattern under a binding; `free` gives the rest by field.

    A list with some matching item may have another one, and an item that need not match.
    """
    chosen = dict(binding)

    def build(part: Pattern, field: str) -> Json:
        match part:
            case Literal(value):
                return value
            case Variable(name):
                return chosen[name] if name in chosen else chosen.setdefault(name, free(field))
            case Anything():
                return free(field)
            case ObjectPattern(fields):
                return {name: build(inner, name) for name, inner in fields}
            case ListPattern(items):
                return [build(item, field) for item in items]
            case SomeItem(item):
                others = [built(random, item, {}, free), free(field)][: random.randrange(3)]
                return random.sample(found := [build(item, field), *others], len(found))

    return build(pattern, "event")


def fitting(random: Random, pattern: Pattern, values: Sequence[Json], binding: Binding | None = None) -> Json:
    """Return a value that matches the pattern under a binding, otherwise random."""
    return built(random, pattern, binding or {}, lambda _: random.choice(values))


def around(bound: Json) -> list[Json]:
    """Return a value and its neighbours, within the finite doubles."""
    if is_number(bound):
        near = [bound - 1, bound, bound + 1]
        if isinstance(bound, float):
            near += [math.nextafter(bound, -math.inf), math.nextafter(bound, math.inf)]
        return [number for number in near if abs(number) <= float_info.max]
    if isinstance(bound, str):
        return [bound, f"{bound}a", bound[:-1]]
    return [bound]


# Paths in events, and their fields.


def places(whole: Json) -> list[tuple[Path, Json]]:
    """Return all values inside a value with their paths, in order."""
    found: list[tuple[Path, Json]] = []
    todo: list[tuple[Path, Json]] = [((), whole)]
    while todo:
        path, part = todo.pop()
        found.append((path, part))
        inner = part.items() if isinstance(part, dict) else enumerate(part) if isinstance(part, list) else ()
        todo += [((*path, step), below) for step, below in reversed(list(inner))]
    return found[1:]


def put(whole: T, path: Path, new: Json) -> T:
    """Return the value with a replacement at a path; only the path is copied."""
    owners: list[Json] = [whole]
    for step in path[:-1]:
        owners.append(owners[-1][step])
    for owner, step in zip(reversed(owners), reversed(path), strict=True):
        copy = owner.copy()
        copy[step] = new
        new = copy
    return cast("T", new)


def field_at(path: Path) -> str:
    """Return the field of a value, also within a list."""
    return next((step for step in reversed(path) if isinstance(step, str)), "event")


def leaves(pattern: Pattern, field: str = "event") -> Iterator[tuple[str, Pattern]]:
    """Yield the leaves of a pattern with their fields."""
    match pattern:
        case ObjectPattern(fields):
            for name, inner in fields:
                yield from leaves(inner, name)
        case ListPattern(items):
            for item in items:
                yield from leaves(item, field)
        case SomeItem(item):
            yield from leaves(item, field)
        case _:
            yield field, pattern


class EventFields:
    """The fields of a tree's events: variables, literals and comparisons."""

    def __init__(self, tree: RVAFT) -> None:
        self.of: dict[str, str] = {}
        """Field of each variable."""
        self.literals: dict[str, list[Json]] = defaultdict(list)
        for field, leaf in (pair for entry in tree.alphabet for pair in leaves(entry.pattern)):
            if isinstance(leaf, Literal):
                self.literals[field].append(leaf.value)
            elif isinstance(leaf, Variable):
                self.of.setdefault(leaf.name, field)
        guards = [*(node.when for node in tree.nodes.values()), *(ignore.when for ignore in tree.ignores)]
        self.operations = [part for guard in guards for part in operations(guard)]

    def bounds(self, path: Path, trace: Sequence[Json]) -> tuple[list[Json], list[Json]]:
        """Return the numbers compared with a value: constants, and values of compared fields in a
        trace.
        """
        field = field_at(path)
        constants, fields = list(self.literals[field]), {field}
        for part in self.operations:
            compared = {self.of.get(name, "") for name in guard_variables(part)}
            if part.operator in COMPARISONS and field in compared:
                constants += [one.value for one in guard_walk(part) if isinstance(one, Literal)]
                fields |= compared
        numbers = [one for path, one in places(trace) if is_number(one) and field_at(path) in fields]
        return [one for one in constants if is_number(one)], numbers


# Values that satisfy demands: guards of a scenario, and events that are not ignored.

TRIES: Final = 200
"""Number of values tried for connected variables; 20 more per variable."""
_ANY_ORDER: Final = 0.3


@dataclass(frozen=True, slots=True)
class Demand:
    """A condition of a node on some variables."""

    node: str
    needs: tuple[str, ...]
    test: Callable[[Binding], bool]
    guard: Guard | None = None


@dataclass
class Unmet(Exception):
    """No values were found; `refusing` are the last failed demands."""

    refusing: Sequence[Demand]


def guard_demands(node: str, guard: Guard | None) -> list[Demand]:
    """Return one demand per conjunct of a guard."""
    return [Demand(node, guard_variables(part), partial(holds, part), part) for part in conjuncts(guard)]


class ValueSearch:
    """A search for values; `some(variable)` is tried before `others`.

    Without `near`, neighbours of strings come last, and variables are assigned in order.
    """

    def __init__(
        self, random: Random, some: Callable[[str], Sequence[Json]], others: Sequence[Json], *, near: bool = True
    ) -> None:
        self.random = random
        self.some = some
        self.others = others
        self.near = near
        self._touching: dict[str, list[Demand]] = {}

    def meeting(self, demands: Sequence[Demand], names: Iterable[str]) -> dict[str, Json]:
        """Return values for these variables and those of the demands; raises `Unmet`."""
        refused = [demand for demand in demands if not demand.needs and not demand.test({})]
        if refused:
            raise Unmet(refused)
        graph = nx.Graph()
        graph.add_nodes_from(names)
        for demand in demands:
            graph.add_nodes_from(demand.needs)
            graph.add_edges_from((demand.needs[0], name) for name in demand.needs[1:])
        self._touching = {name: [] for name in graph}
        for demand in demands:
            for name in demand.needs:
                self._touching[name].append(demand)
        found: dict[str, Json] = {}
        place = {name: index for index, name in enumerate(graph)}
        for component in nx.connected_components(graph):
            # Mostly in binding order, so that times increase; another start may succeed instead.
            start = min(component, key=place.__getitem__)
            if self.near and self.random.random() < _ANY_ORDER:
                start = self.random.choice(sorted(component))
            found |= self._solve([start, *(name for _, name in nx.bfs_edges(graph, start))])
        return found

    def _solve(self, order: list[str]) -> dict[str, Json]:
        rank = {name: index for index, name in enumerate(order)}
        due = {name: [d for d in self._touching[name] if max(d.needs, key=rank.__getitem__) == name] for name in order}
        binding: dict[str, Json] = {}
        levels: list[tuple[Iterator[Json], set[int]]] = []
        deepest, refused = -1, list[Demand]()
        tries = TRIES + 20 * len(order)
        while len(binding) < len(order):
            if len(levels) == len(binding):
                levels.append((self._candidates(order[len(levels)], binding), set()))
            depth = len(levels) - 1
            name = order[depth]
            candidates, blamed = levels[-1]
            for candidate in candidates:
                tries -= 1
                binding[name] = candidate
                against = next((demand for demand in due[name] if not demand.test(binding)), None)
                if against is None:
                    break
                del binding[name]
                blamed.update(rank[other] for other in against.needs if other != name)
                if depth > deepest:
                    deepest, refused = depth, []
                if depth == deepest and against not in refused:
                    refused.append(against)
                if tries < 0:
                    raise Unmet(refused)
            else:
                if not blamed:
                    raise Unmet(refused)
                back = max(blamed)
                levels[back][1].update(blamed - {back})
                del levels[back + 1 :]
                for other in order[back:depth]:
                    del binding[other]
        return binding

    def _candidates(self, name: str, binding: Binding) -> Iterator[Json]:
        guards = [demand.guard for demand in self._touching[name] if demand.guard is not None]
        known = [bound for guard in guards for bound in bounds(guard, name, binding)]
        close = [value for bound in known for value in around(bound)]
        last = [] if self.near else [value for value in close if isinstance(value, str) and value not in known]
        first = [*(value for value in close if self.near or value not in last), *self.some(name)]
        self.random.shuffle(first)
        yield from first
        yield from last
        yield from self.random.sample(self.others, len(self.others))


# Typical log values: increasing times, and values suggested by field names. A field holds times if
# its name says so, or if guards use differences of its values. Open times are filled in last.

TIMES: Final = frozenset(
    {"t", "time", "times", "timestamp", "ts", "clock", "date", "datetime", "stamp", "when", "at_time", "epoch"}
)
NUMBERS: Final = frozenset(
    {"value", "amount", "size", "count", "number", "port", "level", "speed", "length", "bytes", "id", "pid", "code"}
)
PEOPLE: Final = ("alice", "bob", "carol", "dave", "erin")
NAMES: Final[Mapping[str, Sequence[str]]] = {
    **dict.fromkeys(("user", "who", "name", "owner", "account", "from", "to", "person"), PEOPLE),
    **dict.fromkeys(("src", "dst", "ip", "addr", "address"), tuple(f"10.0.0.{n}" for n in (4, 7, 12, 23, 31))),
    **dict.fromkeys(("host", "machine", "server"), tuple(f"host-{n}" for n in range(1, 6))),
    **dict.fromkeys(("file", "path"), tuple(f"/srv/data/{n}.txt" for n in ("plan", "report", "notes", "keys"))),
}
LOGGED: Final = ("heartbeat", "status", "log")
STEPS: Final = 9
"""Maximum number of seconds between events with open times."""
LATER: Final = object()
"""A placeholder for a time that is filled in when the trace is complete."""


class LogValues:
    """Typical values for the fields of a tree's events."""

    def __init__(self, random: Random, tree: RVAFT) -> None:
        self.random = random
        self._fields = fields = EventFields(tree)
        known = {field for entry in tree.alphabet for field, _ in leaves(entry.pattern)}
        self._times = {field for field in known if field.lower() in TIMES}
        self._numeric: set[str] = set()
        for part in fields.operations:
            names = {fields.of[name] for name in guard_variables(part) if name in fields.of}
            steps = any(one.operator in (Operator.ADD, Operator.SUB) for one in operations(part))
            if steps and part.operator in COMPARISONS and len(guard_variables(part)) == 2:
                self._times |= names
            constants = [one.value for one in part.operands if isinstance(one, Literal)]
            if part.operator in ARITHMETIC or any(map(is_number, constants)):
                self._numeric |= names

    def growing(self, patterns: Sequence[Pattern]) -> Iterator[list[Demand]]:
        """Yield demands that the times of these events increase by seconds, or at least do not
        decrease.
        """
        times: dict[str, dict[str, None]] = defaultdict(dict)
        for field, leaf in (pair for pattern in patterns for pair in leaves(pattern)):
            if isinstance(leaf, Variable) and field in self._times and not leaf.name.startswith("_"):
                times[field][leaf.name] = None
        steps = [pair for column in times.values() for pair in pairwise(column)]
        for most in (STEPS, 0) if steps else ():
            found: list[Demand] = []
            for earlier, later in steps:
                least: Guard = Variable(earlier)
                if most:
                    least = Operation(Operator.ADD, (least, Literal(self.random.randint(1, most))))
                found += guard_demands("", Operation(Operator.GE, (Variable(later), least)))
            yield found

    def values(self, variable: str) -> Sequence[Json]:
        """Return candidates for a variable, by its field."""
        return self._of(self._fields.of.get(variable, variable.lower()))

    def _of(self, field: str) -> Sequence[Json]:
        known = self._fields.literals.get(field, [])
        name = field.lower()
        if field in self._times:
            return [self.random.randint(1, 2 * STEPS) for _ in range(4)]
        if field in self._numeric or any(map(is_number, known)):
            return [*(value for value in known if is_number(value)), *self.random.sample(range(1, 10), 4)]
        if name in NAMES:
            return NAMES[name]
        if len(name) == 1 or name in NUMBERS:
            return self.random.sample(range(1, 10), 4)
        return [*known, *(f"{name}-{number}" for number in range(1, 5))]

    def event(self, pattern: Pattern, binding: Binding) -> Json:
        """Return an event that matches under a binding; open times are placeholders."""
        return built(
            self.random,
            pattern,
            binding,
            lambda field: LATER if field in self._times else self.random.choice(self._of(field)),
        )

    def noise(self) -> Json:
        """Return a typical irrelevant event."""
        times = {field: LATER for field in sorted(self._times) if field.lower() in TIMES}
        return {"event": self.random.choice(LOGGED), **times}

    def timed(self, trace: list[Json]) -> list[Json]:
        """Return the trace with placeholders replaced by times between their neighbours."""
        for field in sorted(self._times):
            stands = [[(path, one) for path, one in places(event) if field_at(path) == field] for event in trace]
            known = [[one for _, one in some if is_number(one)] for some in stands]
            now: int | float = next((min(some) for some in known if some), self.random.randint(1, STEPS) + len(trace))
            for index, some in enumerate(stands):
                late = [path for path, one in some if one is LATER]
                if known[index]:
                    now = max(known[index])
                elif late:
                    latest = next((min(some) for some in known[index:] if some), None)
                    if latest is None:
                        now += self.random.randint(1, STEPS)
                    elif any(known[:index]):
                        now += max(0, int((latest - now) // 2))
                    else:
                        now = max(0, latest - 1) if latest >= 1 else latest
                for path in late:
                    trace[index] = put(trace[index], path, now)
        return trace

    def in_time(self, trace: list[Json]) -> list[Json]:
        """Return the trace with non-decreasing times."""
        for field in sorted(self._times):
            latest = -math.inf
            for path, one in places(trace):
                if field_at(path) == field and is_number(one):
                    latest = max(latest, one)
                    trace = put(trace, path, latest)
        return trace
