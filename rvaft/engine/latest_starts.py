"""The strategy for `scattered` without joins: each node remembers its match that starts last.

It applies to `units`, if the times of the events in use never decrease (`late 0 s`) or no window
asks for them. Then a match that starts later can do all that one that starts earlier can: what
follows it, and what it must follow, is decided by its first event, and its window is shorter. So a
node needs one match, whatever the number of ways to make its choices:

- a choice takes the child that starts last; `and` starts with its first child, k of n with the
  first of the k children that start last;
- a sequence remembers the match of its first children that starts last. An event of a later child
  remembers that match as it was when the event came;
- a counted leaf remembers its last events.

The instances of a unit are found by the values of its key. One is forgotten when its window has
passed. The branch of a detection is found by a run over the remembered events of its instance,
once for each choice.
"""

from collections.abc import Hashable, Iterable, Iterator, Mapping, Sequence
from math import inf
from typing import Any, Final, NamedTuple, Self, TypeAlias

from rvaft.core.property import Property
from rvaft.core.units import Unit, UnitLeaf
from rvaft.engine.compiled_tree import NOTHING, Admission, EventClass, Inert, Occurrences, Reading, TreeLetters
from rvaft.engine.explanation import (
    Choices,
    FoundMatch,
    MatchSearch,
    Step,
    Waiting,
    explained_match,
    explanation_of,
    kept_nodes,
    pending,
)
from rvaft.engine.pointed_run import FORGOTTEN, PointedRun
from rvaft.engine.strategy import BatchEvent, Noted, Strategy
from rvaft.engine.unit_run import (
    EVENTS,
    HEAD,
    KEY,
    TIME,
    WATERMARK,
    Match,
    OrderedRun,
    State,
    Take,
    UnitRun,
    copied,
    plain_key,
)
from rvaft.engine.unordered_run import UnorderedRun
from rvaft.errors import TooLarge
from rvaft.model.patterns import rigid_variables
from rvaft.model.values import Json, is_finite
from rvaft.model.verdict import Verdict
from rvaft.monitors import Explanation, Pending, twin
from rvaft.support.budget import StepWork

INSTANCES: Final = 20
"""The number of instances for each partial match that the limit allows."""
SWEEP: Final = 1_000
"""The number of instances before the first search for those that can be forgotten."""
MEMORY: Final = 4096
"""The maximum number of cached event classes."""
_UNKNOWN: Final = Verdict.UNKNOWN
_new: Final = tuple.__new__  # twice as fast as the constructors of the classes


class Served(NamedTuple):
    """A leaf that events of a class serve, and how they name its instance.

    `field` has the value of a key of one variable; `named` tells that the instances of other keys,
    or of a value that is no text or integer, have to be found by the values of the event.
    """

    unit: int
    leaf: UnitLeaf
    timed: bool
    begins: bool
    """Whether an event can begin an instance."""
    take: Take
    field: str | None
    named: bool
    admission: Admission
    plain: bool
    """Whether the event has no variables besides the key."""


Name: TypeAlias = Hashable
"""The value of a key of one variable, or the values of a key as a tuple; None for an undefined one."""


class Detected(NamedTuple):
    """A match of an instance."""

    unit: int
    name: Name
    state: State
    match: Match


class LatestStarts(Strategy):
    """The instances of the units of a tree; raises `TooLarge` beyond `INSTANCES` times `limit` of them."""

    joins = True

    def __init__(self, prop: Property, found: Sequence[Unit], *, limit: int) -> None:
        self.prop = prop
        self.limit = limit
        self._effort = StepWork(limit)
        late = None if prop.time is None else prop.time.late
        self.runs = tuple([self._run(unit, ordered=late == 0) for unit in found])
        self._added, self._most_added = 0, limit
        """The number of events taken since the last count of matches, and before the next."""
        self._leaves = [(number, leaf) for number, run in enumerate(self.runs) for leaf in run.unit.leaves]
        self.letters = TreeLetters(
            Occurrences(
                prop, tuple(leaf.pattern for _, leaf in self._leaves), tuple(leaf.guard for _, leaf in self._leaves)
            )
        )
        self._served: dict[EventClass, tuple[Served, ...]] = {}
        self._time = self.letters.time
        self._timed = any(leaf.timed for _, leaf in self._leaves)
        self._instances: list[dict[Name, State]] = [{} for _ in self.runs]
        self._watermark: int | None = None
        self._sweep_at = [SWEEP] * len(self.runs)
        self._detected: list[Detected] = []
        self.noted = True

    def _run(self, unit: Unit, *, ordered: bool) -> UnitRun:
        if unit.bounds:
            return PointedRun(unit, self._effort, ordered=ordered, remedy=self.prop.remedy)
        return UnorderedRun(unit, self._effort) if unit.timed and not ordered else OrderedRun(unit)

    def read(self, event: Mapping[str, Json], event_class: EventClass) -> Reading:
        """Return the event with its class if it may serve a leaf."""
        return _new(Reading, (False, (event, event_class))) if event_class.serving else NOTHING

    def inert(self, event_class: EventClass) -> Inert | None:
        """Return that no event of a class changes anything if each needs one that has not come."""
        for unit, leaf, *_ in self._served.get(event_class) or self._serving(event_class):
            instances = self._instances[unit]
            if leaf.after < 0 or (instances and self.runs[unit].unit.key):
                return None
            if instances and instances[()][HEAD + leaf.after] is not None:
                return None
        return Inert((), frozenset())

    def _serving(self, event_class: EventClass) -> tuple[Served, ...]:
        if len(self._served) >= MEMORY:
            self._served.clear()
        found = []
        for admission in event_class.serving:
            for number in admission.nodes:
                unit, leaf = self._leaves[number]
                key, fields = self.runs[unit].unit.key, admission.reader.fields
                plain = set(rigid_variables(leaf.pattern)) == {*key}
                field = fields[key[0]] if fields is not None and len(key) == 1 else None
                named = fields is None or len(key) > 1
                take = self.runs[unit].takes[leaf.node]
                served = Served(unit, leaf, leaf.timed, leaf.after < 0, take, field, named, admission, plain)
                found.append((number, served))
        # an event that serves two nodes of a sequence follows the events before it at both
        found.sort(key=lambda one: -one[0])
        made = self._served[event_class] = tuple(one for _, one in found)
        return made

    def advance(self, reading: Reading, position: int) -> Verdict:
        """Return the verdict after one more event."""
        self.noted = False
        if not reading.hits:
            return _UNKNOWN
        event, event_class = reading.hits
        time = self._time(event) if self._timed else None
        return self._take(event, event_class, time, position)

    def advance_to(self, one: BatchEvent, noted: Noted, projects: bool) -> Verdict:  # noqa: ARG002
        """As `advance_all`, for one event; this is a strategy for `scattered`."""
        number, event, classes, time, watermark = one
        if watermark is not None:
            self._watermark = watermark
        if not classes[0].serving:
            return _UNKNOWN
        noted.concerned.append(one)
        self.noted = False
        verdict = self._take(event, classes[0], time, number)
        if self.noted:
            noted.served.append(one)
        return verdict

    def _take(self, event: Mapping[str, Json], event_class: EventClass, time: int | None, position: int) -> Verdict:
        found: list[Detected] | None = None
        self._effort.spent = 0  # faster than `begin`
        for unit, leaf, timed, begins, take, field, named, admission, plain in self._served.get(
            event_class
        ) or self._serving(event_class):
            if timed and time is None:
                continue
            instances = self._instances[unit]
            name: Name = ()
            if field is not None:
                name = event[field]
            pairs: Iterable[tuple[Name, Any]]
            if named or not (field is None or type(name) is str or type(name) is int):
                pairs = self._named(self.runs[unit], leaf, admission, event)
            else:
                pairs = ((name, None if plain else admission.reader.values(event)),)
            for name, values in pairs:
                state = instances.get(name)
                if state is None:
                    if not begins:
                        continue
                    state = self._begun(unit, name, values)
                self.noted = True
                state[WATERMARK] = self._watermark
                match = take(state, position, time, values)
                self._added += 1
                if match is not None:
                    found = found or []
                    found.append(Detected(unit, name, state, match))
        if self._added > self._most_added:
            self._count()
        if found is None:
            return _UNKNOWN
        self._detected = found
        return Verdict.TRUE

    def _begun(self, unit: int, name: Name, values: Mapping[str, Json] | None) -> State:
        """Return a new instance; one of an undefined value is not kept."""
        run, instances = self.runs[unit], self._instances[unit]
        state = run.start()
        key = run.unit.key
        if values is not None and key and not all(type(values[one]) is str or type(values[one]) is int for one in key):
            state[KEY] = {one: values[one] for one in key}
        if name is not None:
            if len(instances) >= self._sweep_at[unit]:
                self._sweep(unit)
            instances[name] = state
        return state

    def _count(self) -> None:
        """Raise `TooLarge` beyond the limit of matches where times may decrease."""
        pairs = [*zip(self.runs, self._instances, strict=True)]

        def count() -> int:
            return sum(run.kept(state) for run, instances in pairs for state in instances.values())

        kept = count()
        if kept > self.limit:
            for number in range(len(pairs)):
                self._drop_expired(number)
            kept = count()
        if kept > self.limit:
            names = ", ".join(dict.fromkeys(name for run, _ in pairs for name in run.unit.names if name))
            what = f"partial matches to follow; too many ways to match {names}"
            raise TooLarge(what, limit=self.limit, remedy=self.prop.remedy)
        self._added, self._most_added = 0, self.limit - kept + self.limit // 4

    def _named(
        self, run: UnitRun, leaf: UnitLeaf, admission: Admission, event: Mapping[str, Json]
    ) -> Iterator[tuple[Name, Mapping[str, Json]]]:
        """Iterate over the instances that an event may serve, with values."""
        seen, single = set[Hashable](), len(run.unit.key) == 1
        for values in self.letters.ways(admission, event, None):
            finite = all(is_finite(values[name]) for name in run.unit.key)
            if not all(is_finite(values[name]) for name in leaf.own):
                continue  # an undefined value agrees with no other
            keys = tuple([plain_key(values[name]) for name in run.unit.key])
            name = None if not finite else keys[0] if single else keys
            place = name, tuple([plain_key(values[one]) for one in leaf.own])
            if not finite or place not in seen:
                seen.add(place)
                yield name, values

    def _sweep(self, number: int) -> None:
        """Forget the instances of a unit whose window has passed; raises `TooLarge`."""
        unit, instances = self.runs[number].unit, self._instances[number]
        self._drop_expired(number)
        most = INSTANCES * self.limit
        if len(instances) >= most:
            what = f"values of {' and '.join(unit.key)} to follow"
            raise TooLarge(what, limit=most, remedy=self.prop.remedy)
        self._sweep_at[number] = min(2 * len(instances) + SWEEP, most)

    def _drop_expired(self, number: int) -> None:
        """Forget the instances of a unit that no later event can complete."""
        run, instances, watermark = self.runs[number], self._instances[number], self._watermark
        least = self._horizon(run.unit)
        if least is not None:
            for name in [name for name, state in instances.items() if state[TIME] < least]:
                del instances[name]
        if watermark is not None:
            for name in [name for name, state in instances.items() if run.expires(state, watermark)]:
                del instances[name]

    def forget(self, watermark: int) -> None:
        """Set the watermark, the minimum time of later events."""
        self._watermark = watermark

    @property
    def until(self) -> float:
        """The greatest time of an event with which those so far can be in a match."""
        found = -inf
        for run, instances in zip(self.runs, self._instances, strict=True):
            if instances and run.unit.window is None:
                return inf
            for state in instances.values():
                found = max(found, state[TIME] + run.unit.window)
        return found

    def _horizon(self, unit: Unit) -> int | None:
        """Return the least time of the last event of an instance that can still detect; None for any."""
        if unit.window is None or self._watermark is None:
            return None
        return self._watermark - unit.window

    def restart(self, name: str) -> None:
        """Forget the instances with the detected values of a variable of all keys."""
        keys = [run.unit.key for run in self.runs]
        found = {_component(keys[one.unit], one.name, name) for one in self._detected if one.name is not None}
        for own, instances in zip(keys, self._instances, strict=True):
            gone = found if len(own) == 1 else [one for one in instances if _component(own, one, name) in found]
            for one in gone:
                instances.pop(one, None)

    def fork(self) -> Self:
        """Return an independent copy."""
        made = twin(self)
        made._instances, made._sweep_at = _copies(self._instances), [*self._sweep_at]  # noqa: SLF001 (its own)
        return made

    @property
    def state(self) -> Hashable:
        """Equal states have equal futures."""
        pairs = zip(self.runs, self._instances, strict=True)
        return tuple(
            frozenset((name, run.future(state)) for name, state in instances.items()) for run, instances in pairs
        )

    def snapshot(self) -> object:
        """Return the state for `restore`."""
        return _copies(self._instances), [tuple(one) for one in self._detected], self._watermark

    def restore(self, snapshot: Any) -> None:
        """Restore a snapshot of the same tree."""
        instances, detected, self._watermark = snapshot
        self._instances = _copies(instances)
        self._detected = [Detected(*one) for one in detected]
        self._sweep_at = [2 * len(one) + SWEEP for one in instances]

    def explain(self) -> Explanation:
        """Return a match of the lowest-numbered branch."""
        found, explained = explained_match(_InstanceSearch(self))
        return explanation_of(self.prop.tree, found.steps, explained)

    def pending(self, limit: int, *, before: int | None = None) -> tuple[Pending, ...]:  # noqa: ARG002 (never ⊥)
        """Return the awaited events of each live branch."""
        return pending(_InstanceSearch(self), limit=limit)

    @property
    def living(self) -> Iterator[tuple[int, Name, State]]:
        """The instances that can still detect, and for each unit a new one."""
        for number, (run, instances) in enumerate(zip(self.runs, self._instances, strict=True)):
            if () not in instances:
                yield number, None, run.start()
            least = self._horizon(run.unit)
            for name, state in instances.items():
                if least is None or state[TIME] >= least:
                    yield number, name, state

    @property
    def detected(self) -> Sequence[Detected]:
        """The matches, after a detection."""
        return self._detected

    @property
    def effort(self) -> StepWork:
        """The work of the present step."""
        return self._effort

    @property
    def watermark(self) -> int | None:
        """The minimum time of later events, if known."""
        return self._watermark


class _InstanceSearch(MatchSearch):
    """Runs an instance again over its remembered events, under choices."""

    def __init__(self, strategy: LatestStarts) -> None:
        self.prop = strategy.prop
        self._effort = strategy.effort
        self._strategy = strategy
        self._came = {(unit, event[2]) for unit, _, state, _ in strategy.detected for event in state[EVENTS] or ()}

    def find(self, choices: Choices) -> FoundMatch | None:
        """Return a match with these choices, or None."""
        self._effort.begin()
        for number, name, state, match in self._strategy.detected:
            run = self._strategy.runs[number]
            without = _without(run.unit, choices)
            if without is None:
                continue
            found: Match | None = match
            if without:
                _, found = run.again(run.concerning(state), without)
            if found is not None:
                names = _values(run.unit, name, state)
                return self._found(run, run.steps(found, names))
        return None

    def _found(self, run: UnitRun, steps: Sequence[tuple[int, Step]]) -> FoundMatch:
        unit = run.unit
        taken = {node for node, _ in steps}
        agenda = [*taken]
        while agenda:
            gate = unit.places[agenda.pop()].gate
            if gate >= 0 and gate not in taken:
                taken.add(gate)
                agenda.append(gate)
        chosen: dict[str, tuple[str, ...]] = {gate: (child,) for gate, child in unit.chosen.items()}
        for node, names in unit.kept.items():
            if node in taken:
                pairs = zip(unit.children[node], names, strict=True)
                chosen[unit.names[node]] = tuple(kept for child, kept in pairs if child in taken)
        return FoundMatch([step for _, step in steps], kept_nodes(self.prop.tree, chosen))

    def waiting(self, choices: Choices | None) -> Iterator[Waiting]:
        """Iterate over the awaited nodes under these choices, by the values of the key."""
        for number, name, state in self._strategy.living:
            self._effort.begin()
            run = self._strategy.runs[number]
            without = _without(run.unit, choices or {})
            if without is not None:
                events = state[EVENTS] or ()
                known = not (events and events[0][2] == FORGOTTEN)
                own = run.again(events, without)[0] if without and known else state
                names = {
                    *run.awaits(own, without, self._strategy.watermark, begun=name is not None and bool(run.unit.key))
                }
                yield Waiting(names, _values(run.unit, name, state))

    def is_possible(self, gate: str, child: str) -> bool:
        """Return False if no match can keep this child of a choice."""
        first = self.prop.tree.nodes[gate].children[0] == child
        for number, _, _, _ in self._strategy.detected:
            if (number, FORGOTTEN) in self._came:
                return True
            unit = self._strategy.runs[number].unit
            below = unit.choices.get(gate, {}).get(child)
            if unit.chosen.get(gate, child if first else None) == child and (below is None or first):
                return True
            if below is not None and any((number, leaf) in self._came for leaf in below):
                return True
        return False


def _component(own: Sequence[str], name: Name, variable: str) -> Hashable:
    """Return the part of the name of an instance that stands for a variable of its key."""
    if len(own) == 1:
        return name
    assert isinstance(name, tuple), "one value for each variable"
    value: Hashable = name[own.index(variable)]
    return value


def _copies(some: Iterable[Mapping[Name, State]]) -> list[dict[Name, State]]:
    """Return independent copies of the instances of units."""
    return [{name: copied(state) for name, state in instances.items()} for instances in some]


def _values(unit: Unit, name: Name, state: State) -> Mapping[str, Json]:
    """Return the values of the key of an instance; none if they are undefined, or for a new one."""
    if name is None or state[KEY] is not None:
        return state[KEY] or {}
    values = (name,) if len(unit.key) == 1 else name
    assert isinstance(values, tuple), "one value for each variable"
    return dict(zip(unit.key, values, strict=True))


def _without(unit: Unit, choices: Choices) -> frozenset[int] | None:
    """Return the leaves that these choices exclude, or None if they exclude the unit."""
    if any(unit.chosen.get(gate, child) != child for gate, child in choices.items()):
        return None
    found = frozenset[int]()
    for gate, ways in unit.choices.items():
        if gate in choices:
            found = found.union(*(below for child, below in ways.items() if child != choices[gate]))
    return found
