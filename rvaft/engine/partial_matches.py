"""The extension of partial matches."""

from collections.abc import Callable, Collection, Hashable, Iterable, Iterator, Mapping
from dataclasses import replace
from functools import partial
from typing import Final, NamedTuple, TypeAlias

from rvaft.core.times import Extreme, TimeDifference
from rvaft.engine.compiled_tree import NOW, AbsenceClause, CompiledTree, Register, window_over
from rvaft.engine.configuration import DONE, MORE, SURE, TOUCHED, Configuration, Mark, PartProgress, Witness
from rvaft.engine.shared_nodes import SharedNodes
from rvaft.model.guards import Operator, Predicate
from rvaft.model.nodes import Side
from rvaft.model.patterns import Binding
from rvaft.model.values import Json, equal
from rvaft.monitors import AwaitedAbsence
from rvaft.support.bits import bits, mask_of
from rvaft.support.budget import StepWork

REMEMBERED: Final = 10_000
"""Maximum number of partial matches that a replay remembers."""
NEW: Final = 4
"""The visits that a new partial match stands for."""
LATER: Final = "later"
"""The variable of the time of an event that has yet to come."""
WindowKey: TypeAlias = int | tuple[int, int, int]
"""A window, or a window over shared nodes and two elements below it."""


class PointTest(NamedTuple):
    """What an event decides of a guard over time points: whether it holds, or whether it may hold later."""

    guard: int
    later: bool


JointKey: TypeAlias = WindowKey | PointTest
"""A guard, a window, or a test of a guard over time points."""


class Matching:
    """The partial matches of a tree; `limit` bounds one search through shared nodes, and those of one step.

    With `early`, which requires a semantics without ⊥, guards over times fail as soon as they
    cannot hold any more.
    """

    def __init__(self, compiled: CompiledTree, *, limit: int, early: bool = False) -> None:
        self.compiled = compiled
        self.early = early
        self.progress = PartProgress(compiled)
        self.effort = StepWork(limit)
        """The work of the present step."""
        self.shared = SharedNodes(compiled, self.progress, self.effort, limit=limit, early=early)
        self.early_differences: dict[int, tuple[TimeDifference, ...]] = {}
        """For nodes with guards over times, the time differences that can fail early."""
        for node, parts in enumerate(compiled.conjuncts if early else ()):
            found = tuple(one for part in parts for one in part.differences or ())
            if found and node not in compiled.pointed:
                self.early_differences[node] = found
        self.windows = frozenset(
            node for node in self.early_differences if all(part.differences for part in compiled.conjuncts[node])
        )
        """The nodes whose guards are differences of times only."""
        self._after: dict[int, tuple[Witness, Configuration | None]] = {}
        """The partial matches after steps that were replayed lately, by the id of the last step."""
        self._admitted: dict[Hashable, frozenset[str]] = {}
        self.under: dict[Hashable, tuple[Matching, ...]] = {}
        """The same under choices, for each alternative."""

    def start(self) -> Configuration:
        """Return the partial match before any event."""
        return Configuration(0, self.compiled.closed)

    def standing(self, configuration: Configuration) -> tuple[bool, bool]:
        """Return whether this is a match, and otherwise whether it is a partial match."""
        if self.compiled.core:
            failing = configuration.failing
            for guard in self.compiled.pointed_from.get(-1, ()) if failing else ():
                if failing >> guard & 1:
                    self.effort.spend(len(self.compiled.names), "ways in which guards over time points can hold")
                    ways = [self.standing(way) for way in self.progress.repaired(configuration, guard)]
                    is_match = any(one for one, _ in ways)
                    return is_match, not is_match and any(other for _, other in ways)
            return self.shared.classify(configuration)
        flags = self.progress.flags(configuration, self.compiled.root)
        return flags & SURE > 0, flags & MORE > 0

    def part_flags(self, configuration: Configuration, node: int) -> int:
        """Return the flags of a part with an absent event; one over shared nodes is below no choice."""
        if node not in self.compiled.members:
            return self.progress.flags(configuration, node)
        events = self.compiled.events_inside(node)
        taken = configuration.taken & events
        done = taken == events
        return (TOUCHED if taken else 0) | (DONE | SURE if done else MORE)

    def is_open(self, configuration: Configuration, clause: AbsenceClause) -> bool:
        """Whether an event may still break a clause, or another event of its part may come."""
        flags = self.part_flags(configuration, clause.target)
        if not flags & TOUCHED or flags & MORE:
            return True
        return clause.part.side is Side.AFTER and not configuration.decided >> clause.node & 1

    def open_clauses(self, configuration: Configuration) -> list[AbsenceClause]:
        """Return the clauses that a later event may break, whatever other events follow."""
        found = list[AbsenceClause]()
        for clause in self.compiled.clauses.values():
            flags = self.part_flags(configuration, clause.target)
            match clause.part.side:
                case Side.DURING:
                    is_open = flags & TOUCHED and flags & MORE
                case Side.AFTER:
                    is_open = flags & TOUCHED and flags & DONE and not configuration.decided >> clause.node & 1
                case Side.BEFORE:
                    is_open = False
            found += [clause] if is_open else []
        return found

    def awaited_absences(self, configuration: Configuration) -> list[AwaitedAbsence]:
        """Return the events that must not come until a time."""
        found = list[AwaitedAbsence]()
        for clause in self.open_clauses(configuration) if self.compiled.clauses else ():
            end = configuration.binding.get(self.compiled.register(clause.target).greatest)
            if clause.part.duration is not None and type(end) is int:
                found.append(AwaitedAbsence(clause.place[0], clause.event, end + clause.part.duration))
        return found

    def marked(self, configuration: Configuration, mark: Mark, node: int, position: int) -> Configuration | None:
        """Return the partial match after a mark at a node, or None if it is ruled out."""
        new, compiled = configuration.copy(), self.compiled
        clause = compiled.clauses.get(node)
        match mark:
            case Mark.FINISHED:
                new.ended |= 1 << compiled.root
            case Mark.DECIDED:
                new.decided |= 1 << node
            case Mark.BROKEN:
                assert clause is not None, "only clauses are broken"
                target, during = clause.target, clause.part.side is Side.DURING
                if target in compiled.members:
                    goes_on = self.part_flags(new, target) & MORE > 0
                    return None if during is goes_on else new
                new.ended |= during << target
                new.unanswered |= (not during) << target
                if not self.progress.refresh(new, target):
                    return None
        if compiled.pointed and not self._finished_points(new):
            return None
        self._drop_variables(new, [name for name in new.binding if name in compiled.absent_with])
        self._drop_registers(new)
        new.witness = Witness(configuration.witness, mark.at(node), position, {})
        return new if any(self.standing(new)) else None

    def extended(
        self,
        configuration: Configuration,
        node: int,
        values: Mapping[str, Json],
        position: int,
        *,
        reuse: bool = False,
        judged: Mapping[Hashable, bool] | None = None,
    ) -> Configuration | None:
        """Return the (partial) match after a node's event, or None.

        With `reuse`, the argument changes in place. `judged` holds the outcomes of guards and windows
        that can be decided now.
        """
        compiled, bound = self.compiled, configuration.binding
        names = compiled.exported[node]
        if configuration.taken >> node & 1:
            return None
        for name in names:
            if name in bound and not equal(bound[name], values[name]):
                return None
        points = self.pointed(configuration, node) if compiled.pointed else ()
        new = self.taken(configuration, node, reuse=reuse)
        if new is None or (compiled.registers[node] and not self._note_time(new, node, values.get(NOW), judged)):
            return None
        if names:
            for name in names:
                new.binding.setdefault(name, values[name])
            settled = set(names)
            for waiting in self.closing(new, names):
                new.closed |= 1 << waiting
                settled.update(compiled.needs[waiting])
                holds = self.test(waiting)
                if holds is not None and not (holds(new.binding) if judged is None else judged[waiting]):
                    new.dead |= 1 << waiting
                if waiting not in compiled.members and not self.progress.refresh(new, waiting):
                    return None
            for waiting in self.narrowed(new, names):
                if not (self.early_test(waiting)(new.binding) if judged is None else judged.get(waiting, True)):
                    settled.update(name for name in compiled.needs[waiting] if name in new.binding)
                    if not self.fail(new, waiting):
                        return None
            self._drop_variables(new, settled)
        if compiled.pointed and not self._judge_points(new, points, judged):
            return None
        if compiled.absent_with:
            self._drop_variables(new, [name for name in new.binding if name in compiled.absent_with])
        self._drop_registers(new)
        new.witness = Witness(configuration.witness, node, position, values)
        return new if any(self.standing(new)) else None

    def _drop_variables(self, configuration: Configuration, names: Iterable[str]) -> None:
        """Drop those of some variables that no later event, guard or clause mentions."""
        compiled = self.compiled
        for name in [name for name in names if name not in compiled.kept]:
            waiting = compiled.guarded_by.get(name, ())
            clauses = (compiled.clauses[node] for node in compiled.absent_with.get(name, ()))
            if (
                all(configuration.closed >> node & 1 for node in waiting)
                and not self.progress.mentioned(configuration, name)
                and not any(self.is_open(configuration, clause) for clause in clauses)
            ):
                configuration.binding.pop(name, None)

    def _drop_registers(self, configuration: Configuration) -> None:
        compiled, closed = self.compiled, configuration.closed
        register_of = compiled.register_of
        for name in [name for name in configuration.binding if name in register_of] if register_of else ():
            waits = any(not closed >> guard & 1 for guard in compiled.guarded_by.get(name, ()))
            if not waits and not self.grows(configuration, register_of[name].node):
                del configuration.binding[name]

    # Guards over time points of nodes with choices.

    def pointed(self, configuration: Configuration, node: int) -> list[int]:
        """Return the guards over time points that a node's event may change, if all else in them is known."""
        compiled, found = self.compiled, list[int]()
        noted = {one.node for one in compiled.registers[node]}
        names = {*compiled.exported[node]}
        for one in compiled.pointed.values():
            if configuration.closed >> one.node & 1 or (noted.isdisjoint(one.points) and names.isdisjoint(one.others)):
                continue
            known = all(name in names or self.is_bound(configuration, name) for name in one.others)
            begun = all(name in configuration.binding or compiled.register_of[name].node in noted for name in one.times)
            found += [one.node] if known and begun else []
        return found

    def point_tests(self, configuration: Configuration, node: int) -> dict[JointKey, Predicate]:
        """Return the tests of guards over time points that a node's event needs.

        They are over the remembered values, those of the event, and its time (`NOW`).
        """
        compiled, found = self.compiled, dict[JointKey, Predicate]()
        guards = self.pointed(configuration, node) if compiled.pointed else ()
        after = self.taken(configuration, node) if guards and self.early else None
        for guard in guards:
            holds = compiled.predicates[guard]
            assert holds is not None, "a guard has a test"
            registers = compiled.registers[node]
            found[PointTest(guard, later=False)] = partial(_after_event, holds, registers)
            bounds = () if after is None else tuple(self.lasting_bounds(after, guard))
            if bounds:
                found[PointTest(guard, later=True)] = partial(_after_event, partial(_may_hold, bounds), registers)
        return found

    def _judge_points(
        self, configuration: Configuration, guards: Iterable[int], judged: Mapping[Hashable, bool] | None
    ) -> bool:
        """Note which guards over time points hold after an event; return False if a touched node is ruled out."""
        for guard in guards:
            if judged is None:
                predicate = self.compiled.predicates[guard]
                holds = predicate is not None and predicate(configuration.binding)
                bounds = self.lasting_bounds(configuration, guard) if self.early and not holds else ()
                later = holds or _may_hold(bounds, configuration.binding)
            else:
                holds = judged[PointTest(guard, later=False)]
                later = holds or judged.get(PointTest(guard, later=True), True)
            bit = 1 << guard
            configuration.held = configuration.held | bit if holds else configuration.held & ~bit
            configuration.failing = configuration.failing & ~bit if holds or not later else configuration.failing | bit
            if not later and not self._close_point(configuration, guard, holds=False):
                return False
        return self._finished_points(configuration)

    def _finished_points(self, configuration: Configuration) -> bool:
        """Decide the guards whose parts can have no more events; return False if a touched node is ruled out."""
        compiled, members = self.compiled, self.compiled.members
        for one in compiled.pointed.values():
            if (configuration.held | configuration.failing) >> one.node & 1 and all(
                self.is_final(configuration, point) for point in one.points
            ):
                holds = configuration.held >> one.node & 1 > 0
                if not self._close_point(configuration, one.node, holds=holds):
                    return False
        tops = {guard: compiled.pointed[guard].top for guard in bits(configuration.held | configuration.failing)}
        changed = [*(guard for guard in tops if guard not in members), *(top for top in tops.values() if top >= 0)]
        return all(self.progress.refresh(configuration, node) for node in sorted({*changed}, reverse=True))

    def _close_point(self, configuration: Configuration, guard: int, *, holds: bool) -> bool:
        """Decide a guard over time points; return False if a touched node is ruled out."""
        bit = 1 << guard
        configuration.held &= ~bit
        configuration.failing &= ~bit
        configuration.closed |= bit
        configuration.dead |= 0 if holds else bit
        self._drop_variables(
            configuration, [n for n in self.compiled.pointed[guard].others if n in configuration.binding]
        )
        top = self.compiled.pointed[guard].top
        nodes = [node for node in (guard, top) if node >= 0 and node not in self.compiled.members]
        return all(self.progress.refresh(configuration, node) for node in nodes)

    def is_final(self, configuration: Configuration, node: int) -> bool:
        """Whether a touched part can have no more events."""
        flags = self.progress.flags(configuration, node)
        return flags & TOUCHED > 0 and (not flags & MORE or self.progress.over(configuration, node))

    def _is_lasting(self, configuration: Configuration, name: str, *, falls: bool) -> bool:
        """Whether the value of a variable cannot fall, or not rise, in a partial match."""
        register = self.compiled.register_of.get(name)
        if register is None or falls is not (name == register.least):
            return register is not None or self.is_bound(configuration, name)
        prop = self.compiled.prop
        is_first = name == register.least and prop.time is not None and prop.time.late == 0
        return is_first or self.is_final(configuration, register.node)

    def lasting_bounds(self, configuration: Configuration, guard: int) -> Iterator[TimeDifference]:
        """Iterate over the bounds of a guard that stay broken once they are broken."""
        for part in self.compiled.conjuncts[guard]:
            for one in part.differences or ():
                if all(self._is_lasting(configuration, name, falls=True) for name in one.plus.names) and all(
                    self._is_lasting(configuration, name, falls=False) for name in one.minus.names
                ):
                    yield one

    def point_deadlines(self, configuration: Configuration, guard: int) -> Iterator[TimeDifference]:
        """Iterate over the bounds of an open guard whose later time point has yet to come."""
        for part in self.compiled.conjuncts[guard]:
            for one in part.differences or ():
                names = one.minus.among(configuration.binding).names
                is_late = all(self._is_to_come(configuration, name) for name in one.plus.names)
                if (
                    is_late
                    and len(names) == len(one.minus.names)
                    and all(self._is_lasting(configuration, name, falls=False) for name in names)
                ):
                    yield one._replace(plus=Extreme(Operator.MAX, (LATER,)))

    def _is_to_come(self, configuration: Configuration, name: str) -> bool:
        """Whether a variable has the time of an event that has yet to come."""
        register = self.compiled.register_of.get(name)
        if register is None:
            return not self.is_bound(configuration, name)
        flags = self.progress.flags(configuration, register.node)
        return not flags & (TOUCHED if name == register.least else DONE)

    def is_window(self, node: int) -> bool:
        """Whether the times of the events of a node's part matter for a window."""
        compiled = self.compiled
        return node in compiled.windows or any(compiled.below[one] & compiled.below[node] for one in compiled.over_core)

    def _note_time(
        self, configuration: Configuration, node: int, now: Json, judged: Mapping[Hashable, bool] | None
    ) -> bool:
        """Note the time of a node's event for the windows above; return False if the node is ruled out."""
        binding = {**configuration.binding, NOW: now}
        for key, window in self.windows_over(configuration, node).items():
            if window.holds(binding) if judged is None else judged[key]:
                continue
            if isinstance(key, tuple):
                configuration.broken |= {key}
                continue
            configuration.unfit |= 1 << key
            if self.early or not self.progress.refresh(configuration, key):
                return False
        for register in self.compiled.registers[node]:
            register.noted(configuration.binding, now)
        return True

    def windows_over(self, configuration: Configuration, node: int) -> dict[WindowKey, TimeDifference]:
        """Return the conditions of windows on the time of a node's event and the times of those taken.

        A window over shared nodes has a condition for each element that may be below it too.
        """
        compiled, found = self.compiled, dict[WindowKey, TimeDifference]()
        for register in compiled.registers[node]:
            if register.node in compiled.windows and register.node not in compiled.members:
                found[register.node] = window_over([register], compiled.windows[register.node])
        if compiled.over_core:
            own = compiled.part_of[node]
            elements = [own, *(one for one in bits(self.shared.touched(configuration)) if one != own)]
            for window in compiled.over_core:
                below = [one for one in elements if compiled.below[one] & compiled.below[window]]
                for one in below if own in below else ():
                    registers = {each: compiled.register(each) for each in (own, one)}
                    pair = (window, min(own, one), max(own, one))
                    found[pair] = window_over(registers.values(), compiled.windows[window])
        return found

    def open_windows(self, configuration: Configuration) -> tuple[TimeDifference, ...]:
        """Return the conditions on later events: windows that have a register and need another event."""
        compiled, found = self.compiled, list[TimeDifference]()
        for name in configuration.binding if compiled.windows else ():
            register = compiled.register_of.get(name)
            if register is None or name != register.least:
                continue
            node = register.node
            if node in compiled.windows and not self.progress.flags(configuration, node) & DONE:
                found.append(window_over([register], compiled.windows[node]))
            for window in compiled.over_core:
                if node in compiled.surely_below(window) and self._needs_more(configuration, window):
                    found.append(window_over([register], compiled.windows[window]))
        return tuple(found)

    def _needs_more(self, configuration: Configuration, window: int) -> bool:
        elements = self.compiled.surely_below(window)
        inner, taken = self.compiled.members, configuration.taken
        return any(
            (self.compiled.own[one] and not taken >> one & 1)
            if one in inner
            else not self.progress.flags(configuration, one) & DONE
            for one in elements
        )

    def grows(self, configuration: Configuration, node: int) -> bool:
        """Whether the part with a register may have another event."""
        compiled = self.compiled
        timed = (one for one in compiled.clauses_of.get(node, ()) if one.part.duration is not None)
        if any(self.is_open(configuration, clause) for clause in timed):
            return True
        own = node in compiled.windows and node not in compiled.members
        if own and self.progress.flags(configuration, node) & MORE and not self.progress.over(configuration, node):
            return True
        windows = (one for one in compiled.over_core if compiled.below[one] & compiled.below[node])
        return any(compiled.below[one] & ~configuration.taken for one in windows)

    def taken(self, configuration: Configuration, node: int, *, reuse: bool = False) -> Configuration | None:
        """Return the partial match with a node taken, before its values decide guards, or None."""
        in_core = node in self.compiled.members
        around = self.compiled.absent_around[node] if self.compiled.clauses else 0
        if configuration.ended & (around | 1 << self.compiled.root):
            return None
        if not in_core and self.progress.over(configuration, node):
            return None
        new = configuration if reuse else configuration.copy()
        if self.compiled.core:
            new.inversions |= self.shared.inverted(configuration, node)
        new.taken |= 1 << node
        if new.failing:  # whether such a guard holds is decided after the event
            noted = {one.node for one in self.compiled.registers[node]}
            for one in self.compiled.pointed.values():
                new.failing &= ~(0 if noted.isdisjoint(one.points) else 1 << one.node)
        answered = new.unanswered & around
        new.unanswered ^= answered
        new.decided &= ~mask_of(clause.node for clause in self.compiled.clauses_around(node))
        if in_core:
            return new
        ends = self.progress.reordered(new, node)
        changed = (node, *ends, *(one for one in reversed([*bits(answered)]) if one not in self.compiled.members))
        return new if all(self.progress.refresh(new, one) for one in changed) else None

    def replayed(self, steps: Iterable[tuple[int, Mapping[str, Json], int]]) -> Configuration | None:
        """Return the partial match after these steps, or None."""
        configuration: Configuration | None = self.start()
        for node, values, position in steps:
            if configuration is not None and node < 0:
                configuration = self.marked(configuration, *Mark.of(node), position)
            elif configuration is not None:
                configuration = self.extended(configuration, node, values, position, reuse=True)
        return configuration if configuration is not None and any(self.standing(configuration)) else None

    def after(self, last: Witness | None) -> Configuration | None:
        """Return the partial match after a step and those before it, as `replayed`, but remembered."""
        steps = []
        while last is not None and id(last) not in self._after:
            steps.append(last)
            last = last.before
        configuration = self.start() if last is None else self._after[id(last)][1]
        if len(self._after) > REMEMBERED:
            self._after.clear()
        for step in reversed(steps):
            if configuration is not None and step.node < 0:
                configuration = self.marked(configuration, *Mark.of(step.node), step.position)
            elif configuration is not None:
                configuration = self.extended(configuration, step.node, step.values, step.position)
            self._after[id(step)] = step, configuration
        return configuration if configuration is not None and any(self.standing(configuration)) else None

    def admits(self, configuration: Configuration, node: int) -> bool:
        """Whether a node's event could come next, for some values."""
        if configuration.taken >> node & 1:
            return False
        if configuration.unfit or configuration.failing:  # an event below may come, even if it completes the part
            above = mask_of(one.node for one in self.compiled.registers[node])
            configuration = replace(configuration.copy(), unfit=configuration.unfit & ~above)
        new = self.taken(configuration, node)
        return new is not None and (not self.compiled.core or self.shared.possible(new, node))

    def admitted(self, configuration: Configuration) -> frozenset[str]:
        """Return the nodes whose event could come next."""
        place = configuration.place
        found = self._admitted.get(place)
        if found is None:
            compiled = self.compiled
            able = (node for node, own in enumerate(compiled.own) if own and self.admits(configuration, node))
            found = frozenset(compiled.names[node] for node in able)
            if len(self._admitted) < REMEMBERED:
                self._admitted[place] = found
        return found

    def closing(self, configuration: Configuration, names: Iterable[str]) -> Iterator[int]:
        """Iterate over the nodes whose guard waited for these variables only, now bound."""
        guarded_by, needs = self.compiled.guarded_by, self.compiled.needs
        for node in dict.fromkeys(node for name in names for node in guarded_by.get(name, ())):
            if not configuration.closed >> node & 1 and all(self.is_bound(configuration, name) for name in needs[node]):
                yield node

    def decided(self, configuration: Configuration, node: int) -> tuple[list[int], list[int]]:
        """Return the guards that a node's event decides, and those that it may make fail early."""
        names = self.compiled.exported[node]
        bound = replace(configuration, binding={**configuration.binding, **dict.fromkeys(names)})
        return list(self.closing(bound, names)), list(self.narrowed(bound, names))

    def is_bound(self, configuration: Configuration, name: str) -> bool:
        """Whether a variable has a value for good, perhaps one that is not remembered (see `stages`)."""
        if name in self.compiled.register_of:
            return False
        return name in configuration.binding or self.compiled.mentions.get(name, 0) & configuration.taken > 0

    def test(self, node: int, names: Collection[str] | None = None) -> Predicate | None:
        """Return the test of the guard of a node, once its variables are bound."""
        return self.early_test(node, names) if node in self.windows else self.compiled.predicates[node]

    def early_test(self, node: int, names: Collection[str] | None = None) -> Predicate:
        """Return the test whether a guard over times can still hold.

        With `names`, windows are tested on these times only.
        """
        differences = self.early_differences[node]
        if names is not None:
            differences = tuple(one.among(names) if one.is_window() else one for one in differences)
        return partial(_may_hold, differences)

    def narrowed(self, configuration: Configuration, names: Iterable[str]) -> Iterator[int]:
        """Iterate over the nodes whose guard waits for more variables and may have failed."""
        if self.early_differences:
            for node in dict.fromkeys(node for name in names for node in self.compiled.guarded_by.get(name, ())):
                waits = node in self.early_differences and not configuration.closed >> node & 1
                if waits and not all(self.is_bound(configuration, name) for name in self.compiled.needs[node]):
                    yield node

    def fail(self, configuration: Configuration, node: int) -> bool:
        """Mark a guard as failed; return False if a touched node is ruled out."""
        configuration.closed |= 1 << node
        configuration.dead |= 1 << node
        return node in self.compiled.members or self.progress.refresh(configuration, node)


def _after_event(holds: Callable[[Binding], bool], registers: Iterable[Register], bound: Mapping[str, Json]) -> bool:
    """Whether a condition holds with the time of an event in its registers."""
    noted = dict(bound)
    for register in registers:
        register.noted(noted, bound[NOW])
    return holds(noted)


def _may_hold(differences: Iterable[TimeDifference], binding: Mapping[str, Json]) -> bool:
    return all(one.holds(binding) for one in differences)
