"""What a log might hold: times that grow, and for every field a value that its name suggests, where the tree leaves it open.

A field holds times where it is called so, or where guards look at differences of its values. Times that guards leave open are filled
in last, between those of the events before and after.
"""

import math
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from itertools import pairwise
from random import Random
from typing import Final

from cross_check.generate.values import Demand, guard_demands
from rvaft.model.guards import ARITHMETIC, COMPARISONS, Guard, Operation, Operator, variables, walk
from rvaft.model.patterns import Anything, Binding, ListPattern, Literal, ObjectPattern, Pattern, Variable
from rvaft.model.tree import RVAFT
from rvaft.model.values import Json, is_number

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
"""The most seconds between two events whose times the tree leaves open."""


class _Later:
    """Stands for a time that is filled in when the whole trace is there."""


LATER: Final = _Later()


class LogValues:
    """What the fields of a tree's events look like."""

    def __init__(self, random: Random, tree: RVAFT) -> None:
        self.random = random
        self._fields: dict[str, str] = {}
        """The field in which a variable stands."""
        self._literals: dict[str, list[Json]] = {}
        for pattern in (entry.pattern for entry in tree.alphabet):
            for field, leaf in _leaves(pattern):
                if isinstance(leaf, Literal):
                    self._literals.setdefault(field, []).append(leaf.value)
                elif isinstance(leaf, Variable):
                    self._fields.setdefault(leaf.name, field)
        guards = [node.when for node in tree.nodes.values() if node.when is not None]
        guards += [ignore.when for ignore in tree.ignores if ignore.when is not None]
        parts = [part for guard in guards for part in walk(guard) if isinstance(part, Operation)]
        self._times = {self._fields.get(name, "") for part in parts for name in _differing(part)} - {""}
        known = {field for pattern in (entry.pattern for entry in tree.alphabet) for field, _ in _leaves(pattern)}
        self._times |= {field for field in known if field.lower() in TIMES}
        self._numeric = {self._fields.get(name, "") for part in parts if _counts(part) for name in variables(part)}

    def growing(self, patterns: Sequence[Pattern]) -> Iterator[list[Demand]]:
        """Demands that the times of these events, one after the other, grow: by some seconds each, or at least do not fall."""
        times: dict[str, list[str]] = {}
        for pattern in patterns:
            for field, leaf in _leaves(pattern):
                if isinstance(leaf, Variable) and field in self._times and not leaf.name.startswith("_"):
                    column = times.setdefault(field, [])
                    if leaf.name not in column:
                        column.append(leaf.name)
        if not any(len(column) > 1 for column in times.values()):
            return
        for most in (STEPS, 0):
            found: list[Demand] = []
            for column in times.values():
                for earlier, later in pairwise(column):
                    least: Guard = Variable(earlier)
                    if most:
                        least = Operation(Operator.ADD, (least, Literal(self.random.randint(1, most))))
                    found += guard_demands("", Operation(Operator.GE, (Variable(later), least)))
            yield found

    def values(self, variable: str) -> Sequence[Json]:
        """What a variable may be, by the field it stands in."""
        return self._of(self._fields.get(variable, variable.lower()))

    def _of(self, field: str) -> Sequence[Json]:
        known = self._literals.get(field, [])
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
        """An event that matches, with these values for its variables; open times are left for later."""
        chosen = dict(binding)

        def build(part: Pattern, field: str) -> Json:
            match part:
                case Literal(value):
                    return value
                case Variable(name):
                    return chosen[name] if name in chosen else chosen.setdefault(name, self._open(field))
                case Anything():
                    return self._open(field)
                case ObjectPattern(fields):
                    return {name: build(inner, name) for name, inner in fields}
                case ListPattern(items):
                    return [build(item, field) for item in items]

        return build(pattern, "event")

    def _open(self, field: str) -> Json:
        return LATER if field in self._times else self.random.choice(self._of(field))

    def noise(self) -> Json:
        """An event of a system that is up."""
        times = {field: LATER for field in sorted(self._times) if field.lower() in TIMES}
        return {"event": self.random.choice(LOGGED), **times}

    def timed(self, trace: list[Json]) -> list[Json]:
        """The trace with a time wherever one was left for later, not before those known, and not after."""
        for field in sorted(self._times):
            known = [[v for f, v in _scalars(event) if f == field and is_number(v)] for event in trace]
            now: int | float = next((min(some) for some in known if some), self.random.randint(1, STEPS) + len(trace))
            for index, event in enumerate(trace):
                if known[index]:
                    now = max(known[index])
                elif any(f == field and v is LATER for f, v in _scalars(event)):
                    latest = next((min(some) for some in known[index:] if some), None)
                    if latest is None:
                        now += self.random.randint(1, STEPS)
                    elif any(known[:index]):
                        now += max(0, int((latest - now) // 2))
                    else:
                        now = max(0, latest - 1) if latest >= 1 else latest
                    trace[index] = _mapped(event, lambda f, v: now if f == field and v is LATER else v)  # noqa: B023
        return trace

    def in_time(self, trace: list[Json]) -> list[Json]:
        """The trace with no time before an earlier one, wherever events have changed places."""
        for field in sorted(self._times):
            latest = -math.inf

            def passed(name: str, value: Json, field: str = field) -> Json:
                nonlocal latest
                if name != field or not is_number(value):
                    return value
                latest = max(latest, value)
                return latest

            trace = [_mapped(event, passed) for event in trace]
        return trace


def _differing(part: Operation) -> Iterable[str]:
    """The variables of a comparison with a difference of two."""
    names = variables(part)
    inner = [one for operand in part.operands for one in walk(operand) if isinstance(one, Operation)]
    shifts = any(one.operator in (Operator.ADD, Operator.SUB) for one in inner)
    return names if part.operator in COMPARISONS and len(names) == 2 and shifts else ()


def _counts(part: Operation) -> bool:
    """Whether a term calculates, or compares with a number."""
    return part.operator in ARITHMETIC or any(isinstance(o, Literal) and is_number(o.value) for o in part.operands)


def _leaves(pattern: Pattern, field: str = "event") -> Iterator[tuple[str, Pattern]]:
    match pattern:
        case ObjectPattern(fields):
            for name, inner in fields:
                yield from _leaves(inner, name)
        case ListPattern(items):
            for item in items:
                yield from _leaves(item, field)
        case _:
            yield field, pattern


def _scalars(value: Json, field: str = "event") -> Iterator[tuple[str, Json]]:
    if isinstance(value, dict):
        for name, inner in value.items():
            yield from _scalars(inner, name)
    elif isinstance(value, list):
        for inner in value:
            yield from _scalars(inner, field)
    else:
        yield field, value


def _mapped(value: Json, change: Callable[[str, Json], Json], field: str = "event") -> Json:
    """The value with its scalars changed, by the field they stand in."""
    if isinstance(value, dict):
        return {name: _mapped(inner, change, name) for name, inner in value.items()}
    return [_mapped(inner, change, field) for inner in value] if isinstance(value, list) else change(field, value)
