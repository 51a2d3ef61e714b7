"""Stages: what partial matches with the same progress have in common.

The progress of a partial match depends only on the outcomes of its decided guards, not on the bound
values. So the effect of an event is computed once per *stage*, node and outcomes.

Of many times that only windows bound, a partial match remembers the least and the greatest.
"""

from collections.abc import Callable, Collection, Hashable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from itertools import chain, product
from typing import Final, NamedTuple, TypeAlias, cast

from rvaft.core.times import Extreme, TimeDifference
from rvaft.engine.compiled_tree import NOW, EventClass, Register
from rvaft.engine.configuration import Configuration, Witness
from rvaft.engine.partial_matches import JointKey, Matching, PointTest, WindowKey
from rvaft.engine.settled_choices import SettledChoices
from rvaft.engine.stage_group import Bound, RankFunction
from rvaft.engine.subsumption import Rank, Ranking, Term, commits, ranking, repeats, tendency
from rvaft.model.guards import (
    OPERATORS,
    ORDERINGS,
    Guard,
    Operation,
    Operator,
    Predicate,
    evaluation,
    predicate,
    variables,
)
from rvaft.model.patterns import Binding, Variable
from rvaft.model.values import OWN_TYPES, Json, equal, is_number
from rvaft.support.bits import bits, mask_of

MEMORY: Final = 500_000
"""The maximum size of remembered stages."""
_MANY: Final = 4
"""The maximum number of joint guards to enumerate."""
_TIMES: Final = 3
"""The minimum number of times of a span: fewer are remembered as they are."""
Terms: TypeAlias = tuple[Callable[[Binding], Json], ...]
"""Functions from the values of variables to those of terms."""


class Span(NamedTuple):
    """Times of which only the least and the greatest matter, and the variables that have these."""

    names: tuple[str, ...]
    least: str
    greatest: str


@dataclass(slots=True, eq=False)
class Stage:
    """The progress of partial matches; `sample` is one with dummy values."""

    sample: Configuration
    is_match: bool
    names: tuple[str, ...]
    """The remembered variables."""
    ranking: Ranking
    rank: RankFunction
    deadlines: tuple[TimeDifference, ...] = ()
    """The time differences that must hold."""
    settled: bool = False
    """Whether settled choices may differ."""
    spans: tuple[Span, ...] = ()
    moves: dict[int, "StageMove | None"] = field(default_factory=dict)
    by_class: dict[EventClass, Sequence[tuple[int, "StageMove", int]]] = field(default_factory=dict)
    """The possible moves by events of a class (see `Stages.moves`)."""

    def configuration(self, binding: dict[str, Json], last: Witness | None) -> Configuration:
        """Return the partial match with these values and steps."""
        one = self.sample
        return replace(one, binding=binding, witness=last)

    def remembered(self, bound: Mapping[str, Json]) -> dict[str, Json]:
        """Return what a partial match of this stage remembers of these values."""
        if not self.spans:
            return {name: bound[name] for name in self.names}
        found = {name: bound.get(name) for name in self.names}
        for names, least, greatest in self.spans:
            times = [bound[name] for name in names if name in bound]
            found[least], found[greatest] = (None, None) if None in times else (min(times), max(times))
        return found

    def known(self, names: Iterable[str]) -> tuple[str, ...]:
        """Return the variables whose least or greatest value these have."""
        found = dict.fromkeys(names)
        for span in self.spans:
            if span.least in found:
                found.update(dict.fromkeys(span.names))
        return tuple(found)


class Scan(NamedTuple):
    """Necessary conditions for the partial matches that an event may extend."""

    names: tuple[str, ...]
    """The remembered variables that must equal `terms`, which are over the event's values."""
    terms: Terms
    orders: tuple["Order", ...]
    """The possible orders for the search; any order suffices."""


class Order(NamedTuple):
    """An order of partial matches, with the bounds of an event on it and a stop condition."""

    term: Term | None
    """None is the order of arrival."""
    bounds: tuple[Bound, ...]
    last_first: bool
    """Whether the last members are the best."""
    enough: tuple[tuple[Term, Extreme], ...] | None
    """The search stops when these terms have the event's own extremes; None: a full scan."""

    @classmethod
    def of(
        cls, move: "StageMove", term: Term, bounds: Iterable[Bound], target: Stage | None, equal_names: Collection[str]
    ) -> "Order":
        """Return the order by a term of the stage of a move.

        `target` is the common stage of all extensions; `equal_names` have equal values in all of
        them.
        """
        if target is None or not {*equal_names}.issuperset((*target.ranking.exact, *target.ranking.excluded)):
            return cls(term, tuple(bounds), False, None)
        last_first, ordered, others = True, False, list[tuple[Term, Extreme]]()
        ordering = {*move.stage.known(term.extreme.names)}
        noted = {one.least: Operator.MIN for one in move.registers}
        noted |= {one.greatest: Operator.MAX for one in move.registers}
        for one in target.ranking.terms:
            sign, operator, names = one.sign, one.extreme.operator, target.known(one.extreme.names)
            if len(names) == 1 and names[0] in noted:  # the extreme of the remembered time and the event's
                operator = noted[names[0]]
                names = (*(name for name in names if name in move.stage.names), NOW)
            far = {name for name in names if name not in equal_names}
            if not ordered and far == ordering and (len(far) == 1 or operator is term.extreme.operator):
                last_first, ordered = sign > 0, True
            elif far and (far.issuperset(names) or (operator is Operator.MIN) is not (sign > 0)):
                return cls(term, tuple(bounds), False, None)
            elif far:
                others.append((one, Extreme(operator, tuple(name for name in names if name in equal_names))))
        return cls(term, tuple(bounds), last_first, tuple(others))


@dataclass(slots=True, eq=False)
class StageMove:
    """The bound variables whose values the event must repeat."""

    stage: Stage
    node: int
    compared: tuple[str, ...]
    """The bound variables that the event must repeat."""
    alone: int
    """The guards that the event alone decides, as bits."""
    joint: dict[JointKey, Predicate]
    """The guards and windows that depend on remembered values too."""
    windows: dict[WindowKey, TimeDifference]
    registers: tuple[Register, ...]
    """The registers of the event's time."""
    scan: Scan | None = None
    outcomes: dict[tuple[int, tuple[bool, ...]], tuple[Stage, bool] | None] = field(default_factory=dict)
    """By outcomes: the target stage, and whether it subsumes the original."""

    def timed(self, bound: Mapping[str, Json]) -> Mapping[str, Json]:
        """Return the values after the event's time is noted."""
        if not self.registers:
            return bound
        noted = dict(bound)
        for register in self.registers:
            register.noted(noted, bound[NOW])
        return noted


def agree(names: Iterable[str], one: Mapping[str, Json], other: Mapping[str, Json]) -> bool:
    """Whether these variables have equal values."""
    for name in names:
        mine, its = one[name], other[name]
        if not (mine == its if type(mine) is type(its) and type(mine) in OWN_TYPES else equal(mine, its)):
            return False
    return True


class Stages:
    """The stages of a tree, computed when first needed.

    Without `choices`, no partial match replaces another, and the class of an event decides no
    guards.
    """

    def __init__(self, matching: Matching, choices: SettledChoices | None = None) -> None:
        self.matching = matching
        self.choices = choices
        self.size = 0
        """The number of nodes with flags, moves and outcomes."""
        self._known: dict[Hashable, Stage] = {}
        self._equalities: dict[tuple[frozenset[str], Stage], tuple[tuple[str, ...], Terms]] = {}

    @property
    def is_full(self) -> bool:
        """Whether to `clear` the stages."""
        return self.size > MEMORY

    def clear(self) -> None:
        """Forget the stages; partial matches of these go on to new ones."""
        for stage in self._known.values():
            stage.moves.clear()
            stage.by_class.clear()
        self._known.clear()
        self._equalities.clear()
        self.size = 0

    def of(self, configuration: Configuration) -> Stage:
        """Return the stage of a partial match."""
        place, settled = self._place(configuration)
        found = self._known.get(place)
        if found is None:
            self.size += 1 + len(configuration.flags)
            sample = replace(configuration, binding=dict.fromkeys(configuration.binding), witness=None)
            found = self._known[place] = self._made(sample, settled=settled)
        return found

    def place(self, stage: Stage) -> Hashable:
        """Return a value that is equal for stages with equal futures, whatever made them."""
        return self._place(stage.sample)[0]

    def _place(self, configuration: Configuration) -> tuple[Hashable, bool]:
        if self.choices is not None:
            return self.choices.place(configuration, self.matching.progress)
        names = tuple(sorted(configuration.binding))  # an event that rules out a node keeps the variables of the node
        return (configuration.place, names), False

    def _made(self, sample: Configuration, *, settled: bool) -> Stage:
        matching, choices = self.matching, self.choices
        ranks = Ranking(exact=tuple(sorted(sample.binding)))
        spans, deadlines = tuple[Span, ...](), tuple[TimeDifference, ...]()
        if choices is not None:
            spans = self._spans(sample)
            for span in spans:
                sample.binding = dict.fromkeys(name for name in sample.binding if name not in span.names)
                sample.binding.update({span.least: None, span.greatest: None})
            known = self._known.get(self._place(sample)[0])
            if known is not None:
                return known
            ranks = ranking(matching, sample)
            deadlines = tuple(
                one
                for node, differences in matching.early_differences.items()
                if not sample.closed >> node & 1 and self._has_to_hold(sample, node)
                for one in differences
                if not all(matching.is_bound(sample, name) for name in one.plus.names)
            )
            deadlines += matching.open_windows(sample) if matching.early else ()
            deadlines += tuple(
                one
                for guard in matching.compiled.pointed
                if matching.early and not sample.closed >> guard & 1 and self._has_to_hold(sample, guard)
                for one in matching.point_deadlines(sample, guard)
            )

        def rank(binding: Mapping[str, Json], last: Witness | None) -> Rank:
            found = ranks.of(binding)
            if not settled or choices is None:
                return found
            return found._replace(values=(*found.values, -choices.number(last)))

        is_match, names = matching.standing(sample)[0], tuple(sorted(sample.binding))
        found = Stage(sample, is_match, names, ranks, rank, deadlines, settled, spans)
        return self._known.setdefault(self._place(sample)[0], found)

    def _spans(self, sample: Configuration) -> tuple[Span, ...]:
        """Return the sets of at least `_TIMES` times that occur in the same windows only."""
        compiled = self.matching.compiled
        open_ = {node for name in sample.binding for node in compiled.guarded_by.get(name, ())}
        places: dict[str, list[tuple[int, int, bool]]] = {}
        for node in sorted(node for node in open_ if not sample.closed >> node & 1):
            for number, one in enumerate(self.matching.early_differences.get(node, ())):
                for extreme in one[:2] if one.is_window() and node in self.matching.windows else ():
                    for name in extreme.names:
                        if self.matching.is_bound(sample, name):
                            places.setdefault(name, []).append((node, number, extreme is one.plus))
        alike: dict[Hashable, list[str]] = {}
        for name, some in places.items():
            waiting = {node for node in compiled.guarded_by[name] if not sample.closed >> node & 1}
            if waiting == {node for node, _, _ in some} and not self.matching.progress.mentioned(sample, name):
                alike.setdefault(frozenset(some), []).append(name)
        sets = (tuple(sorted(names)) for names in alike.values() if len(names) >= _TIMES)
        return tuple(Span(names, names[0], names[1]) for names in sets)

    def _has_to_hold(self, sample: Configuration, node: int) -> bool:
        trial = sample.copy()
        return self.matching.compiled.certain >> node & 1 > 0 or not (
            self.matching.fail(trial, node) and any(self.matching.standing(trial))
        )

    def move(self, stage: Stage, node: int) -> StageMove | None:
        """Return the move by a node's event from a stage, or None."""
        if node not in stage.moves:
            found = None
            self.size += 1
            # `outcome` decides this too: a second search is worth it only under `scattered`
            possible = not stage.sample.taken >> node & 1
            if possible and (self.choices is None or self.matching.admits(stage.sample, node)):
                compiled, remembered = self.matching.compiled, stage.sample.binding
                names = compiled.exported[node]
                bound = {*remembered, *names}
                closing, narrowed = self.matching.decided(stage.sample, node)
                own = closing if self.choices is not None else ()
                alone = mask_of(guard for guard in own if remembered.keys().isdisjoint(compiled.needs[guard]))
                decided = ((guard, self.matching.test(guard, bound)) for guard in closing if not alone >> guard & 1)
                joint: dict[JointKey, Predicate] = {guard: holds for guard, holds in decided if holds is not None}
                for guard in narrowed:
                    # a time alone fails a guard only if it is undefined; under `scattered` a later event tells
                    if self.choices is None or not remembered.keys().isdisjoint(compiled.needs[guard]):
                        joint[guard] = self.matching.early_test(guard, bound)
                windows = self.matching.windows_over(stage.sample, node)
                joint.update((key, window.holds) for key, window in windows.items())
                joint.update(self.matching.point_tests(stage.sample, node))
                compared, registers = tuple(name for name in names if name in remembered), compiled.registers[node]
                found = StageMove(stage, node, compared, alone, joint, windows, registers)
            stage.moves[node] = found
        return stage.moves[node]

    def outcome(self, move: StageMove, held: int, outcomes: tuple[bool, ...]) -> tuple[Stage, bool] | None:
        """Return the target of a move for these outcomes: `held` of guards on the event alone,
        `outcomes` of joint guards.
        """
        place = (held & move.alone, outcomes)
        try:
            return move.outcomes[place]
        except KeyError:
            self.size += 1
        judged: dict[Hashable, bool] = {guard: bool(held >> guard & 1) for guard in bits(move.alone)}
        judged.update(zip(move.joint, outcomes, strict=True))
        before, node, found = move.stage.sample, move.node, None
        values = dict.fromkeys(self.matching.compiled.exported[node])
        after = self.matching.extended(before, node, values, 0, judged=judged)
        if after is not None:
            firsts = None if self.choices is None else self.choices.firsts
            ends = firsts is not None and commits(self.matching, before, after, node, firsts=firsts)
            found = self.of(after), ends
        move.outcomes[place] = found
        return found

    def scan(self, move: StageMove) -> Scan:
        """Return the query for a move."""
        if move.scan is None:
            compiled, joint = self.matching.compiled, [*move.joint]
            own, joined = compiled.exported[move.node], dict[str, Guard]()
            own = (*own, NOW) if move.registers else own
            orders: dict[Term, list[Bound]] = {}
            needed = [  # a guard over time points that does not hold may hold later
                one
                for one in joint
                if not isinstance(one, PointTest)
                and (
                    (one not in move.windows and compiled.certain >> cast("int", one) & 1)
                    or not self.outcome(move, move.alone, tuple(other != one for other in joint))
                )
            ]
            far = set(move.stage.names).difference(own)
            guards = [cast("int", one) for one in needed if one not in move.windows]
            over_times = [move.windows[one] for one in needed if one in move.windows]
            over_times += self._broken_for_good(move)
            for part, names, timed, differences in chain(*(compiled.conjuncts[one] for one in guards)):
                if timed:
                    over_times += differences or ()
                    continue
                distant = [name for name in names if name in far]
                if len(distant) == 1 and {*own, *distant}.issuperset(names):
                    name = distant[0]
                    if (other := repeats(part, name)) is not None and name not in joined:
                        joined[name] = other
                    elif isinstance(part, Operation) and part.operator in ORDERINGS and (sign := tendency(part, name)):
                        orders.setdefault(Term(1, Extreme(Operator.MAX, (name,))), []).append(_bound(part, name, sign))
            for difference in over_times:
                for term, bound in _time_bounds(difference, far, own):
                    orders.setdefault(term, []).append(bound)
            found = self.outcome(move, move.alone, (True,) * len(joint))
            target = found[0] if found and len(needed) == len(joint) and not found[0].settled else None
            terms = tuple(map(evaluation, (*map(Variable, move.compared), *joined.values())))
            equal_names = {*own, *joined}
            ranged = [Order.of(move, term, bounds, target, equal_names) for term, bounds in orders.items()]
            if terms and not ranged:
                ranged = [Order(None, (), last_first=False, enough=None)]
            move.scan = Scan((*move.compared, *joined), terms, tuple(ranged))
        return move.scan

    def _broken_for_good(self, move: StageMove) -> Iterator[TimeDifference]:
        """Iterate over the bounds of guards over time points without which a move is impossible."""
        joint = [*move.joint]
        for one in joint:
            if isinstance(one, PointTest) and one.later:
                outcomes = tuple(other not in (one, PointTest(one.guard, later=False)) for other in joint)
                after = self.matching.taken(move.stage.sample, move.node)
                if after is not None and not self.outcome(move, move.alone, outcomes):
                    for bound in self.matching.lasting_bounds(after, one.guard):
                        yield _with_event(bound, move)

    def equalities(self, names: frozenset[str], stage: Stage) -> tuple[tuple[str, ...], Terms]:
        """Return variables of a stage, and the terms over other variables that they must equal.

        All guards that are open in the stage must hold.
        """
        found = self._equalities.get((names, stage))
        if found is None:
            self.size += 1
            compiled = self.matching.compiled
            joined: dict[str, Guard] = {name: Variable(name) for name in stage.names if name in names}
            waiting = {node for name in stage.names for node in compiled.guarded_by.get(name, ())}
            for part in chain(*(compiled.conjuncts[one] for one in sorted(waiting))):
                for name in part.names if not part.over_times else ():
                    other = repeats(part.guard, name) if name in stage.names and name not in joined else None
                    if other is not None and names.issuperset(variables(other)):
                        joined[name] = other
            found = self._equalities[names, stage] = tuple(joined), tuple(map(evaluation, joined.values()))
        return found

    def moves(self, stage: Stage, event_class: EventClass) -> Sequence[tuple[int, StageMove, int]]:
        """Return the moves by events of a class that are possible for some values.

        Each has the place of its letter in the class, and of its node in the letter.
        """
        found = stage.by_class.get(event_class)
        if found is None:
            found = [
                (number, move, place)
                for number, letter in enumerate(event_class.serving)
                for place, node in enumerate(letter.nodes)
                if (move := self.move(stage, node)) is not None
                # the guards of a letter with several ways are not decided yet
                and (letter.reader.ways is not None or self._is_hopeful(move, event_class.held[number]))
            ]
            stage.by_class[event_class] = found
            self.size += 1 + len(found)
        return found

    def _is_hopeful(self, move: StageMove, held: int) -> bool:
        """Whether a move is possible for some outcomes of the joint guards."""
        ways = product((True, False), repeat=len(move.joint))
        return len(move.joint) > _MANY or any(self.outcome(move, held, outcomes) for outcomes in ways)


def _with_event(bound: TimeDifference, move: StageMove) -> TimeDifference:
    """Return the bound on the registers before an event, and on its time, in place of those after it."""
    noted = {one.least: Operator.MIN for one in move.registers}
    noted |= {one.greatest: Operator.MAX for one in move.registers}

    def changed(extreme: Extreme) -> Extreme:
        operator = noted.get(extreme.names[0])
        if operator is None:
            return extreme
        return Extreme(operator, (*(name for name in extreme.names if name in move.stage.names), NOW))

    return TimeDifference(changed(bound.plus), changed(bound.minus), bound.most)


def _time_bounds(
    difference: TimeDifference, far: Collection[str], own: Collection[str]
) -> Iterator[tuple[Term, Bound]]:
    """Return the bounds of a time difference on remembered times (`far`), given the event's
    (`own`).
    """
    plus, minus = difference.plus, difference.minus
    for rising, ours, theirs in ((True, plus, minus), (False, minus, plus)):
        mine, distant = ours.among(own), theirs.among(far)
        some_ours, some_theirs = (Operator.MAX, Operator.MIN) if rising else (Operator.MIN, Operator.MAX)
        bounded = ours.operator is some_ours or len(mine.names) == len(ours.names)
        bounded &= theirs.operator is some_theirs or len(distant.names) == len(theirs.names)
        if bounded and mine.names and distant.names:
            operator = distant.operator if len(distant.names) > 1 else Operator.MAX

            def holds(
                event: Mapping[str, Json], mine: Extreme = mine, sign: int = 1 if rising else -1
            ) -> Callable[[Json], bool]:
                time = mine.of(event)
                return lambda value: time is not None and bool(sign * (time - value) <= difference.most)

            yield Term(1, Extreme(operator, distant.names)), Bound(rising, holds)


def _bound(part: Operation, name: str, sign: int) -> Bound:
    left, right = part.operands
    facts, holds = OPERATORS[part.operator], predicate(part)
    other = right if left == Variable(name) else left
    operator = part.operator if other is right else facts.mirrored
    compare = OPERATORS[operator].compare if operator is not None and Variable(name) in part.operands else None
    evaluate = evaluation(other)

    def by(event: Mapping[str, Json]) -> Callable[[Json], bool]:
        if compare is None:
            return lambda one: holds({**event, name: one})
        than = evaluate(event)
        if is_number(than) and than - than == 0:
            return lambda one: type(one) is not str and compare(one, than)
        return lambda one: type(than) is str and type(one) is str and compare(one, than)

    return Bound(sign > 0, by)
