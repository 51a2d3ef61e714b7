"""The probability of a tree within a horizon, given the log so far (semantics, section 8).

Rates are constant, so what has happened is all that counts: a state of the chain of each part, and
the leaves seen outside of these. The numbers of a chain are solved once for all its states.
"""

from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass, replace
from typing import Any, Final, NamedTuple, Self, TypeAlias

from rvaft.core.overlaps import Overlaps, overlaps
from rvaft.core.pattern_index import FirstLiterals, flat
from rvaft.errors import TooLarge
from rvaft.model.guards import Predicate, predicate
from rvaft.model.guards import variables as guard_variables
from rvaft.model.patterns import Pattern, rigid, rigid_variables, ways
from rvaft.model.tree import RVAFT
from rvaft.model.values import Json, key
from rvaft.monitors import twin
from rvaft.risk.chain import DEFAULT_STATES, Machine, State
from rvaft.risk.model import Leaf, RiskError, RiskTree
from rvaft.risk.probability import Analysis, leaf_probability
from rvaft.risk.transient import chain, within

DEFAULT_INSTANCES: Final = 100_000
"""The default number of bindings of variables that are followed."""
_REMEMBERED: Final = 100_000

_EXCLUDED: Final = -1

Whole: TypeAlias = tuple[tuple[State, ...], tuple[int, ...], frozenset[str]]
"""The states of the parts, how many events of each other leaf have happened, and which leaves with a guard over values
of other events have had one."""
Binding: TypeAlias = tuple[tuple[str, Any], ...]


class Next(NamedTuple):
    """A leaf that is awaited, and the risk if its event comes now."""

    leaf: str
    risk: float


@dataclass(frozen=True, slots=True)
class Outlook:
    """The risk after an event: of the most advanced match, with the values of its variables.

    `next` are the awaited leaves, those that raise the risk most first. `contradictions` counts the
    events that the model excludes, such as a second failure of one part.
    """

    risk: float
    values: Mapping[str, Json]
    next: tuple[Next, ...]
    contradictions: int


class Lookup:
    """The probability within the horizon of each state of one part; a new state is solved on demand."""

    def __init__(self, tree: RiskTree, part: str, horizon: float, states: int) -> None:
        self.machine = Machine(tree, part)
        self._horizon, self._states = horizon, states
        self._known: dict[State, float] = {}

    def probability(self, state: State) -> float:
        """Return the probability that the part happens within the horizon, from a state."""
        return sum(weight * self._resolved(one) for one, weight in self.machine.resolved(state).items())

    def _resolved(self, state: State) -> float:
        found = self._known.get(state)
        if found is None:
            solved = chain(self.machine, states=self._states, start=state)
            values = within(solved, [self._horizon])[0]
            self._known.update({one: float(values[number]) for one, number in solved.index.items()})
            found = self._known[state]
        return found


class RiskMonitor:
    """Follows the events of a log, and tells the risk after each.

    `tree` has the patterns of the events, `form` the gates and numbers. The horizon is in the unit of
    the rates. Raises `RiskError` for what cannot be analysed, and `TooLarge`.

    >>> import rvaft
    >>> from rvaft.risk.model import of_tree
    >>> tree = rvaft.loads("t sand x y; x lambda=.5; y lambda=.2;")
    >>> watching = RiskMonitor(tree, of_tree(tree), 1.0)
    >>> round(watching.risk, 10), round(watching.step({"event": "x"}), 10), watching.outlook().next[0].leaf
    (0.039802518, 0.1812692469, 'y')
    """

    def __init__(
        self,
        tree: RVAFT,
        form: RiskTree,
        horizon: float,
        *,
        states: int = DEFAULT_STATES,
        instances: int = DEFAULT_INSTANCES,
    ) -> None:
        self._analysis = Analysis(form, states=states)
        self._horizon, self._limit = horizon, instances
        diagram = self._analysis.diagram
        self._parts = tuple(name for name in diagram.variables if name in self._analysis.parts)
        self._lookups = tuple(Lookup(form, part, horizon, states) for part in self._parts)
        self._others = tuple(form.leaves[name] for name in diagram.variables if name not in self._analysis.parts)
        for leaf in self._others:
            if leaf.numbers.shape != 1:
                raise RiskError(f"the rate of {leaf.node} changes with time (`shape`): its risk depends on its age")
        self._all = tuple(self._leaves())
        self._patterns = list(leaf_patterns(tree, self._all))
        self._shared = {one.leaf.name: one for one in self._patterns if not {*one.names} <= {*one.variables}}
        literals = [plain.literals if (plain := flat(one.pattern)) else {} for one in self._patterns]
        self._index = FirstLiterals(literals)
        self._time = tree.time
        self._place = {leaf.name: place for place, leaf in enumerate(self._others)}
        self._part_of = {leaf.name: place for place, one in enumerate(self._lookups) for leaf in one.machine.leaves}
        self._wholes: list[Whole] = []
        self._ids: dict[Whole, int] = {}
        self._risks: list[float | None] = []
        self._moves: dict[tuple[int, str], int] = {}
        starts = tuple([one.machine.start() for one in self._lookups])
        self._first = self._id((starts, (0,) * len(self._others), frozenset()))
        self._begin()

    def _begin(self) -> None:
        self._latest: int | None = None
        self._values: dict[Binding, dict[str, Json]] = {(): {}}
        self._states: dict[Binding, list[int]] = {(): [self._first]}
        self._groups = _Groups()
        self._groups.add(())
        self.contradictions = 0
        """The number of events that the model excludes."""
        self._best: tuple[float, Binding, int] = (self._risk(self._first), (), self._first)

    def fresh(self) -> Self:
        """Return a monitor that has read no event, and shares what is solved."""
        made = twin(self)
        made._begin()  # noqa: SLF001 (its own)
        return made

    def _id(self, whole: Whole) -> int:
        found = self._ids.get(whole)
        if found is None:
            found = self._ids[whole] = len(self._wholes)
            self._wholes.append(whole)
            self._risks.append(None)
        return found

    def _leaves(self) -> Iterator[Leaf]:
        yield from self._others
        for one in self._lookups:
            yield from one.machine.leaves

    @property
    def risk(self) -> float:
        """The probability that the tree is detected within the horizon."""
        return self._best[0]

    def step(self, event: Json) -> float:
        """Read an event and return the risk after it; raises `TooLarge`."""
        candidates = self._index.candidates(event)
        if self._time is not None:
            late, self._latest = self._time.is_late(event, self._latest)
            if late:
                return self.risk
        if not candidates:
            return self.risk
        read = [reading for number in candidates for reading in self._patterns[number].readings(event)]
        if not read:
            return self.risk
        if len(read) == len(self._states) == len(self._states[()]) == 1 and not (read[0][1] or read[0][0].guard):
            [state] = self._states[()]
            after = self._after(state, read[0][0].leaf.name)
            if after == _EXCLUDED:
                self.contradictions += 1
            elif after != state:
                self._keep((), self._values[()], [after])
            return self.risk
        new: dict[Binding, tuple[dict[str, Json], list[int]]] = {}
        excluded = False
        for (joined, old), values in self._targets(read).items():
            states = self._states[old]
            if joined != old and self._shared:
                states = [state for state in states if self._allowed(state, values)]
            mine, news = frozenset(joined), frozenset(joined).difference(old)
            moved: list[int] = []
            left: set[int] = set()
            begun = joined == old
            for leaf, binding, _ in read:
                if not mine.issuperset(binding) or not leaf.holds(values):
                    continue
                undecided = not all(name in values for name in leaf.names)
                for state in states:
                    after = self._after(state, leaf.leaf.name)
                    if after == _EXCLUDED:
                        excluded = True
                    elif after != state:
                        moved.append(after)
                        begun = begun or not news.isdisjoint(binding)
                        if not undecided:
                            left.add(state)
            if moved and begun:  # a state in which no leaf can happen, or none should, goes on
                found = new.setdefault(joined, (values, []))[1]
                found.extend(moved)
                found.extend(state for state in states if state not in left)
        self.contradictions += excluded and not new
        for joined, (values, found) in new.items():
            self._keep(joined, values, list(dict.fromkeys(found)))
        return self.risk

    def _targets(self, read: "list[Reading]") -> dict[tuple[Binding, Binding], dict[str, Json]]:
        """Return the bindings that an event leads to, each with one that it comes from, and their values."""
        found: dict[tuple[Binding, Binding], dict[str, Json]] = {}
        for _, binding, own in read:
            for old in self._groups.compatible(binding) if binding else self._states:
                joined = old if not binding or old == binding else _joined(old, binding)
                # the states of a binding have read all that those of a lesser one have
                if joined == old or joined not in self._states:
                    found[joined, old] = self._values[old] if joined == old else {**self._values[old], **own}
        return found

    def _allowed(self, state: int, values: Mapping[str, Json]) -> bool:
        """Whether the guards hold of the events that a state has used, as far as their variables are bound."""
        return all(self._shared[name].holds(values) for name in self._wholes[state][2])

    def _keep(self, binding: Binding, values: dict[str, Json], states: list[int]) -> None:
        if binding not in self._states:
            if len(self._states) >= self._limit:
                raise TooLarge("values of variables for which a risk is followed", limit=self._limit)
            self._groups.add(binding)
        if len(states) > self._limit:
            raise TooLarge("states that a log leaves open", limit=self._limit)
        self._values[binding], self._states[binding] = values, states
        top = self._top(binding)
        if top[0] >= self._best[0]:
            self._best = top
        elif self._best[1] == binding:  # it has become less likely
            self._best = top if len(self._states) == 1 else max(map(self._top, self._states), key=lambda one: one[0])

    def _top(self, binding: Binding) -> tuple[float, Binding, int]:
        return max(((self._risk(state), binding, state) for state in self._states[binding]), key=lambda one: one[0])

    def _after(self, state: int, name: str) -> int:
        """Return the state after an event of a leaf, or `_EXCLUDED` if the model excludes it."""
        found = self._moves.get((state, name))
        if found is None:
            if len(self._moves) >= _REMEMBERED:
                self._moves.clear()
            whole = self._moved(self._wholes[state], name)
            found = self._moves[state, name] = _EXCLUDED if whole is None else self._id(whole)
        return found

    def _moved(self, state: Whole, name: str) -> Whole | None:
        parts, counts, used = state
        if name in self._shared:
            used = used | {name}
        part = self._part_of.get(name)
        if part is not None:
            machine = self._lookups[part].machine
            if machine.excludes(parts[part], name):
                return None
            after = machine.after(parts[part], name)
            return state if after == parts[part] else ((*parts[:part], after, *parts[part + 1 :]), counts, used)
        place = self._place[name]
        leaf = self._others[place]
        if counts[place] >= leaf.times:
            return None if leaf.once else state
        return parts, (*counts[:place], counts[place] + 1, *counts[place + 1 :]), used

    def _risk(self, state: int) -> float:
        found = self._risks[state]
        if found is None:
            parts, counts, _ = self._wholes[state]
            chances: dict[str, float] = {
                name: one.probability(part) for name, one, part in zip(self._parts, self._lookups, parts, strict=True)
            }
            for leaf, count in zip(self._others, counts, strict=True):
                chances[leaf.name] = _remaining(leaf, count, self._horizon)
            found = self._risks[state] = float(self._analysis.diagram.probability(chances))
        return found

    def outlook(self, most: int = 5) -> Outlook:
        """Return the risk with what may come next, at most `most` leaves."""
        risk, binding, state = self._best
        awaited = {one.leaf.name: self._after(state, one.leaf.name) for one in self._patterns}
        coming = [Next(name, self._risk(after)) for name, after in awaited.items() if after not in (_EXCLUDED, state)]
        coming = [one for one in coming if one.risk > risk]
        coming.sort(key=lambda one: -one.risk)
        return Outlook(risk, self._values[binding], tuple(coming[:most]), self.contradictions)


def _remaining(leaf: Leaf, count: int, horizon: float) -> float:
    """Return the probability that the missing events of a leaf come within the horizon."""
    if count >= leaf.times:
        return 1.0
    if leaf.numbers.chance is not None or not count:
        return leaf_probability(leaf, horizon)
    return leaf_probability(replace(leaf, times=leaf.times - count), horizon)


class LeafPattern(NamedTuple):
    """What shows a leaf: the pattern of its node, and the guard with its variables."""

    leaf: Leaf
    pattern: Pattern
    guard: Predicate | None
    names: tuple[str, ...]

    @property
    def variables(self) -> tuple[str, ...]:
        """The variables that an event of the leaf binds."""
        return rigid_variables(self.pattern)

    def readings(self, event: Json) -> "Iterator[Reading]":
        """Yield the values of the variables with which an event is one of the leaf's."""
        seen: set[Binding] = set()
        for found in ways(self.pattern, event, {}):
            values = rigid(found)
            binding = tuple(sorted((name, key(value)) for name, value in values.items()))
            if binding not in seen:
                seen.add(binding)
                yield self, binding, values

    def holds(self, values: Mapping[str, Json]) -> bool:
        """Whether the guard holds, as far as its variables are bound."""
        return self.guard is None or not all(name in values for name in self.names) or self.guard(values)


Reading: TypeAlias = tuple[LeafPattern, Binding, dict[str, Json]]
"""A leaf that an event shows, and the values of its variables."""


def leaf_patterns(tree: RVAFT, leaves: Iterable[Leaf]) -> Iterator[LeafPattern]:
    """Yield the leaves that events show."""
    for leaf in leaves:
        node = tree.nodes.get(leaf.node)
        pattern = None if node is None or leaf.guard else tree.pattern(leaf.node)
        if node is None or pattern is None or leaf.name.startswith(("dependence of ", "chance of ")):
            continue
        if node.own_values:
            raise RiskError(f"{node.name} counts different values, which no rate describes")
        guard = tree.guard(leaf.node)
        yield LeafPattern(
            leaf, pattern, None if guard is None else predicate(guard), () if guard is None else guard_variables(guard)
        )


def confused(form: RiskTree) -> tuple[str, str] | None:
    """Return two leaves that one event may show, or None: for a monitor, the events of one are also those of the other.

    >>> import rvaft
    >>> from rvaft.risk.model import of_tree
    >>> text = "event e(k) = {k: k}; t sand a b c; a on e(1) lambda=1; b on e(2) lambda=1; c on e(K) lambda=1;"
    >>> confused(of_tree(rvaft.loads(text)))
    ('a', 'c')
    """
    if form.tree is None:
        return None
    leaves = [form.leaves[name] for name in form.order() if name in form.leaves]
    some = list(leaf_patterns(form.tree, leaves))
    for one, other in Overlaps([leaf.pattern for leaf in some]).pairs():
        if overlaps(some[one].pattern, some[other].pattern):
            return some[one].leaf.node, some[other].leaf.node
    return None


def _joined(one: Binding, other: Binding) -> Binding:
    """Return two bindings that give no variable two values as one."""
    values = dict(one)
    return tuple(sorted({**values, **dict(other)}.items()))


class _Groups:
    """Bindings, found by the values that they share with another."""

    def __init__(self) -> None:
        self._by_names: dict[tuple[str, ...], list[Binding]] = {}
        self._tables: dict[tuple[tuple[str, ...], tuple[str, ...]], dict[Binding, list[Binding]]] = {}

    def add(self, binding: Binding) -> None:
        """Add a binding."""
        names = tuple(name for name, _ in binding)
        self._by_names.setdefault(names, []).append(binding)
        for (of, shared), table in self._tables.items():
            if of == names:
                table.setdefault(_part(binding, shared), []).append(binding)

    def compatible(self, binding: Binding) -> Iterator[Binding]:
        """Yield the bindings that give no variable another value."""
        mine = {name for name, _ in binding}
        for names, all_of_them in self._by_names.items():
            shared = tuple(name for name in names if name in mine)
            if not shared:
                yield from all_of_them
                continue
            table = self._tables.get((names, shared))
            if table is None:
                table = self._tables[names, shared] = {}
                for one in all_of_them:
                    table.setdefault(_part(one, shared), []).append(one)
            yield from table.get(_part(binding, shared), ())


def _part(binding: Binding, names: tuple[str, ...]) -> Binding:
    return tuple([pair for pair in binding if pair[0] in names])
