"""Properties to past MTL: a disjunction of event orders, each a chain of earlier events."""

import re
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from itertools import chain, combinations, product
from typing import Final, NamedTuple, NoReturn, assert_never

from backends.absences import clauses_of, gaps
from backends.nests import NOTHING, WINDOW, Nest, Nesting
from backends.orders import Orders, merged
from rvaft.core.overlaps import overlaps
from rvaft.core.property import Event, PartKind, Property, Within, WithoutEvent
from rvaft.core.scenarios import Scenario, most_events
from rvaft.errors import NotExpressible, unwritten
from rvaft.model import patterns
from rvaft.model.event_time import UNITS
from rvaft.model.expressions import guard_text, pattern_text
from rvaft.model.guards import Guard
from rvaft.model.nodes import Side
from rvaft.model.patterns import Pattern
from rvaft.model.verdict import Semantics

_STRING: Final = re.compile(r'"(?:[^"\\]|\\.)*"')
_TOKEN: Final = re.compile(r"\w+|[^\s\w]")
_DEEPEST: Final = 200
_LONGEST: Final = 1_000_000_000
_NEVER: Final = "never"
_RELEVANT: Final = "relevant"
_IGNORED: Final = "ignored"


@dataclass(frozen=True, slots=True)
class Syntax:
    """The operators of past MTL in one syntax.

    `before` is one event ago, `earlier` at any event ago, `since` the second formula at an event
    from which on the first holds. `recent` is once within a bound.
    """

    atom: str
    either: str
    both: str
    negated: str
    once: str
    before: str
    earlier: str
    since: str
    recent: str = ""


REELAY: Final = Syntax(
    "{{{}: true}}",
    " or ",
    " and ",
    "not {}",
    "once({})",
    "pre({})",
    "pre(once({}))",
    "({} since ({}))",
    "once[0:{}]({})",
)


def c2po(horizon: int) -> Syntax:
    """Return the syntax of C2PO, in which all operators have bounds."""
    earlier = f"(true S[1,{horizon}] ({{}}))"
    return Syntax("{}", " || ", " && ", "!{}", "{}", "(true S[1,1] ({}))", earlier, f"({{}} S[0,{horizon}] ({{}}))")


class WordLetter(NamedTuple):
    """One event of an order: a choice of propositions, of which none of `absent` holds between the
    previous one and it.

    If it is `timed`, it has a time. None of the propositions `before` holds so many nanoseconds before it, and none
    of those `after` so many after it, which a later event decides.
    """

    some: tuple[str, ...]
    absent: tuple[str, ...] = ()
    timed: bool = False
    before: tuple[tuple[str, int], ...] = ()
    after: tuple[tuple[str, int], ...] = ()

    @property
    def names(self) -> tuple[str, ...]:
        """All propositions, those of the event first."""
        return (*self.some, *self.absent, *(name for name, _ in (*self.before, *self.after)))

    def renamed(self, names: Mapping[str, str]) -> "WordLetter":
        """Return the letter with other names."""
        some, absent = (tuple(names[one] for one in each) for each in (self.some, self.absent))
        near, later = (tuple((names[one], within) for one, within in each) for each in (self.before, self.after))
        return WordLetter(some, absent, self.timed, near, later)


@dataclass(frozen=True, slots=True)
class Chains:
    """The event orders of a property as words."""

    definitions: tuple[tuple[str, str], ...]
    """The definitions of the propositions, as `PATTERN when GUARD`; those of one name are alternatives."""
    words: tuple[tuple[WordLetter, ...], ...]
    semantics: Semantics
    unit: str = ""
    """The unit of bounds; empty without durations."""

    @property
    def propositions(self) -> tuple[str, ...]:
        """The names of the propositions."""
        return tuple(dict.fromkeys(name for name, _ in self.definitions))

    def formula(self, dialect: Syntax) -> str:
        """Return the formula; in `REELAY` it holds from the detection on, in C2PO at the detection."""
        return dialect.either.join(dialect.once.format(self._decided(word, dialect)) for word in self.words)

    def _recent(self, part: str, within: int, dialect: Syntax) -> str:
        """Return that a part was true now or before, at an event with a time, at most a duration ago."""
        return dialect.recent.format(within // UNITS[self.unit], part)

    def _decided(self, word: Sequence[WordLetter], dialect: Syntax) -> str:
        """Return that a word has come, and that an event now decides that none has come `after` it.

        An event with a time that came within the duration broke it. Since then no such event came, so it is enough that
        the first match since then ended longer ago than the duration.
        """
        match = self._chain(word, dialect)
        if not word[-1].after:
            return match
        within, last = word[-1].after[0][1], dialect.atom.format(word[-1].some[0])
        breaking = dialect.either.join(dialect.atom.format(name) for name, _ in word[-1].after)
        breaking = dialect.both.join([f"({breaking})", self._recent(breaking, 1 * UNITS[self.unit], dialect)])
        since = dialect.before.format(dialect.since.format(dialect.negated.format(f"({breaking})"), match))
        first = dialect.both.join([match, dialect.negated.format(since)])
        timed = self._recent(f"{last}{dialect.either}{dialect.negated.format(last)}", 1 * UNITS[self.unit], dialect)
        return dialect.both.join([timed, since, dialect.negated.format(self._recent(first, within, dialect))])

    def _chain(self, word: Sequence[WordLetter], dialect: Syntax) -> str:
        """Return the formula that the last event of a word is now, and the others are before it."""

        def atom(name: str) -> str:
            return dialect.atom.format(name)

        def negated(part: str) -> str:
            return dialect.negated.format(part)

        def before(part: str, skipped: Sequence[str]) -> str:
            """Return that a part was true at some event before, and `skipped` at all those since then."""
            both = skipped[0] if len(skipped) == 1 else f"({dialect.both.join(skipped)})"
            return dialect.before.format(dialect.since.format(both, part))

        names, found = self.propositions, ""
        relevant, ignored = atom(_RELEVANT), negated(atom(_IGNORED)) if _IGNORED in names else ""
        counts = f"({relevant}{dialect.both}{ignored})" if ignored else relevant
        for letter in word:
            absent = [negated(atom(name)) for name in letter.absent]
            some = [atom(name) for name in letter.some]
            now = some[0] if len(some) == 1 else f"({dialect.either.join(some)})"
            never = [negated(dialect.earlier.format(atom(name))) for name in letter.absent]
            match self.semantics:
                case Semantics.SCATTERED if found:
                    past = [before(found, absent) if absent else dialect.earlier.format(found)]
                case Semantics.STRICT if found:
                    past = [dialect.before.format(found)]
                case Semantics.STRICT:
                    past = [negated(dialect.before.format(f"({some[0]}{dialect.either}{negated(some[0])})"))]
                case Semantics.PROJECTED | Semantics.CONSECUTIVE if found:
                    past = [before(found, [negated(counts), *absent])]
                case Semantics.PROJECTED:
                    past = [negated(dialect.earlier.format(counts)), *never]
                case Semantics.SCATTERED | Semantics.CONSECUTIVE:
                    past = never
                case _:
                    assert_never(self.semantics)
            known = self._recent(now, UNITS[self.unit], dialect) if letter.timed else ""
            near = [negated(self._recent(atom(name), within, dialect)) for name, within in letter.before]
            found = dialect.both.join(filter(None, (now, known, *near, ignored, *past)))
        return found


def symbols(formula: str) -> int:
    """Return the number of tokens of a formula."""
    return len(_TOKEN.findall(formula))


def translation(prop: Property, semantics: Semantics, limit: int) -> Chains:
    """Return the event orders of a property; if there are none, a proposition that never holds."""
    unit = _unit(prop)
    minimal = semantics is Semantics.SCATTERED and not prop.absences  # an absent event may be one that is used
    orders = Orders(prop, limit=limit, minimal=minimal)

    def letters(scenario: Scenario) -> dict[Event, tuple[tuple[str, ...], tuple[WithoutEvent, ...]]] | None:
        bound = {event: {*patterns.rigid_variables(event.pattern)} for event in scenario.events}
        reason = unwritten("a proposition is about one event, and a guard compares several")
        guards = orders.assigned_guards(scenario, bound, lambda node, _: NotExpressible(reason, nodes=[node]))
        if guards is None:
            return None
        leaves = {event: orders.groups.get(event, ((event, guards[event]),)) for event in scenario.events}
        clauses = clauses_of(scenario)
        _require_apart(scenario, (one for some in leaves.values() for one, _ in some))
        return {
            event: (tuple(dict.fromkeys(_definition(one.pattern, its) for one, its in some)), clauses[event])
            for event, some in leaves.items()
        }

    def spelled(word: Sequence[tuple[tuple[str, ...], tuple[WithoutEvent, ...]]]) -> tuple[WordLetter, ...]:
        absent = gaps([clauses for _, clauses in word]) if semantics is not Semantics.STRICT else [[]] * len(word)
        letters = [
            WordLetter(some, tuple(dict.fromkeys(map(_breaking, own))))
            for (some, _), own in zip(word, absent, strict=True)
        ]
        for clause in dict.fromkeys(chain.from_iterable(clauses for _, clauses in word)):
            if clause.duration is not None:
                _add(letters, clause, [place for place, (_, clauses) in enumerate(word) if clause in clauses])
        return tuple(letters)

    some = ((one, found) for one in orders.scenarios() if (found := letters(one)) is not None)
    words = merged(
        map(spelled, chain.from_iterable(orders.words(one, found) for one, found in some)),
        lambda several: several[0]._replace(
            some=tuple(dict.fromkeys(chain.from_iterable(one.some for one in several)))
        ),
        lambda letter: letter[1:],
    )
    if any(len(word) > _DEEPEST for word in words):
        raise NotExpressible(unwritten(f"Reelay aborts on formulas deeper than {_DEEPEST} events"))
    if not words:
        return Chains(((_NEVER, "{ } when false"),), ((WordLetter((_NEVER,)),),), Semantics.SCATTERED)
    each = list(chain.from_iterable(words))
    definitions = dict.fromkeys(
        chain.from_iterable((*(one.some for one in each), *(one.names[len(one.some) :] for one in each)))
    )
    names = {one: f"p{number}" for number, one in enumerate(definitions, 1)}
    named = tuple(tuple(letter.renamed(names) for letter in word) for word in words)
    several = semantics is Semantics.PROJECTED or any(len(word) > 1 for word in words)
    relevance = _relevance(prop, several=several) if semantics.projects else ()
    return Chains((*((name, one) for one, name in names.items()), *relevance), named, semantics, unit)


def _either(letters: Sequence[WordLetter]) -> WordLetter:
    """Return a letter for all of some that differ in the choice of propositions."""
    return letters[0]._replace(some=tuple(dict.fromkeys(chain.from_iterable(one.some for one in letters))))


def _unit(prop: Property) -> str:
    """Return the unit in which the durations of absent events are whole numbers; empty without durations."""
    clauses = [one for one in prop.absences if one.duration is not None]
    durations = [one.duration or 0 for one in clauses]
    late = prop.tree.time is not None and prop.tree.time.late
    unit = next(one for one in ("s", "ms", "us", "ns") if not any(each % UNITS[one] for each in durations))
    for clause, duration in zip(clauses, durations, strict=True):
        nodes = [clause.source.node]
        if not 0 < duration < _LONGEST * UNITS[unit]:
            raise NotExpressible(
                unwritten(f"a duration of an absent event is 1 to {_LONGEST - 1:,} {unit}"), nodes=nodes
            )
        if clause.side is Side.AFTER and late:  # what comes between the duration and the lateness breaks nothing
            raise NotExpressible(unwritten("`for D after` is written without `late`, or with `late 0 s`"), nodes=nodes)
    return unit if clauses else ""


def _breaking(clause: WithoutEvent) -> str:
    return _definition(clause.pattern, [] if clause.guard is None else [clause.guard])


def _add(letters: list[WordLetter], clause: WithoutEvent, places: Sequence[int]) -> None:
    """Add a clause with a duration to the letters at the places of its part."""
    assert clause.duration is not None
    one = (_breaking(clause), clause.duration)
    for place in places:
        letters[place] = letters[place]._replace(timed=True)
    if clause.side is Side.BEFORE:
        first = letters[places[0]]
        letters[places[0]] = first._replace(before=tuple(dict.fromkeys((*first.before, one))))
        return
    last = letters[-1]
    if places[-1] < len(letters) - 1:
        why = "`without … for D after` is written of a part that ends the match"
        raise NotExpressible(unwritten(why), nodes=[clause.source.node])
    letters[-1] = last._replace(after=tuple(dict.fromkeys((*last.after, one))))
    if len({duration for _, duration in letters[-1].after}) > 1:
        why = "several clauses `for D after` of different durations"
        raise NotExpressible(unwritten(why), nodes=[clause.source.node])


def _require_apart(scenario: Scenario, events: Iterable[Event]) -> None:
    """Raise `NotExpressible` if one of the events can be one that breaks a clause with a duration."""
    patterns = [event.pattern for event in events]
    for clause, _ in scenario.absences:
        if clause.duration is not None and any(overlaps(one, clause.pattern) for one in patterns):
            why = "an absent event within a duration that an event of the match can be"
            raise NotExpressible(unwritten(why), nodes=[clause.source.node])


def _relevance(prop: Property, *, several: bool) -> Iterator[tuple[str, str]]:
    """Yield the definitions of the relevant events, if a match may have `several`, and the ignored ones."""
    for name, some in ((_RELEVANT, prop.alphabet if several else ()), (_IGNORED, prop.ignored)):
        for one in dict.fromkeys(_definition(each.pattern, [each.when] if each.when else []) for each in some):
            yield name, one


def _definition(pattern: Pattern, guards: Sequence[Guard]) -> str:
    text = pattern_text(pattern) + "".join(f" when {guard_text(guard)}" for guard in dict.fromkeys(guards))
    return _STRING.sub(lambda found: found[0].replace("*/", "*\\u002f"), text)


class WindowedFormula:
    """The formula of a property with windows under `scattered`, in dense time.

    A part holds at its last event. No event may match two parts that are not in order, so the
    others were earlier. Raises `NotExpressible` and `TooLarge`.
    """

    def __init__(self, prop: Property, limit: int) -> None:
        most, windows = most_events(prop.parts), [part for part in prop.parts if isinstance(part, Within)]
        if single := [window.source.node for window in windows if most[window] < 2]:
            raise self._unwritten("a window over one event only requires that it has a time", single)
        self.unit = next(one for one in ("s", "ms", "us", "ns") if not any(w.duration % UNITS[one] for w in windows))
        if any(window.duration >= _LONGEST * UNITS[self.unit] for window in windows):
            raise self._unwritten(f"a bound is less than {_LONGEST:,} {self.unit}", (w.source.node for w in windows))
        self._names: dict[str, str] = {}
        nest = Nesting(prop, self._refuse, limit=limit, unit="events in all parts").nest()
        self.text = f"once({self._part(nest, '')})"
        self.definitions = tuple((name, one) for one, name in self._names.items())

    @staticmethod
    def _unwritten(why: str, nodes: Iterable[str]) -> NotExpressible:
        return NotExpressible(unwritten(why), nodes=dict.fromkeys(nodes))

    def _refuse(self, why: str, nodes: Iterable[str]) -> NoReturn:
        what = "a window over parts with common events" if why == WINDOW else "events with common variables or guards"
        raise self._unwritten(f"{what} beside windows", nodes)

    def _part(self, nest: Nest, before: str, within: int | None = None) -> str:
        """Return the formula of a part after another, with all its events within a duration of the last."""
        own = [one for one in (nest.within, within) if one is not None]
        within = min(own, default=None)
        if within is not None and nest.op in (PartKind.ALL, PartKind.SEQUENCE):
            *others, last = nest.parts if nest.op is PartKind.SEQUENCE else (*nest.parts, NOTHING)
            flat = others[0].parts if len(others) == 1 and others[0].op is PartKind.ALL else others
            if (nest.op is PartKind.SEQUENCE and len(others) > 1) or not all(map(self._is_single, (*flat, last))):
                raise self._unwritten("a window over events in order, which are not two", nest.nodes())
            self._require_apart([*flat, last])
            if nest.op is PartKind.SEQUENCE:
                return " and ".join([self._part(last, ""), *(self._recent(one, before, within) for one in flat)])
        match nest.op:
            case PartKind.EVENT:
                assert nest.event is not None
                definition = _definition(nest.event.pattern, nest.guards)
                letter = REELAY.atom.format(self._names.setdefault(definition, f"p{len(self._names) + 1}"))
                known = [] if within is None else [f"once{self._bounds(within)}({letter})"]
                return " and ".join([letter, *known, *([REELAY.earlier.format(before)] if before else [])])
            case PartKind.SEQUENCE:
                for one in nest.parts:
                    before = self._part(one, before)
                return before
            case PartKind.ONE:
                return self._either(self._part(one, before, within) for one in nest.parts)
            case PartKind.AT_LEAST:
                return self._part(nest.ways(), before, within)
            case PartKind.ALL:
                self._require_apart(nest.parts)
                return self._either(
                    " and ".join(
                        [
                            self._bracketed(self._part(last, before)),
                            *(self._recent(one, before, within) for one in nest.parts if one is not last),
                        ]
                    )
                    for last in nest.parts
                )
            case _:
                raise AssertionError(nest.op)

    def _recent(self, nest: Nest, before: str, within: int | None) -> str:
        return f"once{'' if within is None else self._bounds(within)}({self._part(nest, before)})"

    def _bounds(self, within: int) -> str:
        if not within:
            raise NotExpressible(unwritten("a window of 0 s: Reelay reads an upper bound of 0 as no bound"))
        return f"[0:{within // UNITS[self.unit]}]"

    @staticmethod
    def _bracketed(part: str) -> str:
        return f"({part})"

    @staticmethod
    def _either(parts: Iterable[str]) -> str:
        found = list(parts)
        return found[0] if len(found) == 1 else f"({' or '.join(f'({one})' for one in found)})"

    @staticmethod
    def _is_single(nest: Nest) -> bool:
        return (
            nest.op is PartKind.EVENT
            or (nest.op is PartKind.ONE and all(one.op is PartKind.EVENT for one in nest.parts))
            or nest == NOTHING
        )

    def _require_apart(self, parts: Sequence[Nest]) -> None:
        """Raise `NotExpressible` if one event can match two of the parts."""
        for one, other in combinations(parts, 2):
            for event, another in product(one.events(), other.events()):
                if overlaps(event.pattern, another.pattern):
                    nodes = (event.source.node, another.source.node)
                    raise self._unwritten("windows beside events that one event can match", nodes)
