"""A monitor for RML texts by the published transition rules, with left preference.

A *way* is the next term with the bindings of the step. A rule requests the ways of its parts and
returns the ways of the whole, best first; with `first`, one suffices. Only a conjunction uses
second ways, to find common bindings. Other operators commit to the first way of a part; the last
alternative passes all its ways on.

An event may match without binding a variable (`not` types, `|` in patterns). The variable is then
*open*: no block binds it, and the next event type with it as an argument binds all its occurrences.
"""

from collections.abc import Hashable
from dataclasses import replace
from functools import lru_cache
from typing import Any, Final, TypeAlias

from backends.rml.reader.event_types import UNBOUND, EventTypes, alternatives_of, value
from backends.rml.reader.parser import parse
from backends.rml.reader.syntax import (
    Constant,
    Declaration,
    Expression,
    Name,
    RmlProgram,
    TypeUse,
    Wildcard,
    fold,
    signature,
)
from backends.rml.reader.terms import RmlTerm, TermTable, is_open, mark
from rvaft.errors import NotExpressible, TooLarge, unwritten
from rvaft.export.event_conditions import EventConditions
from rvaft.model.values import Json, equal
from rvaft.model.verdict import Verdict
from rvaft.monitors import Monitor
from rvaft.support.budget import Call, run

DEPTH_LIMIT: Final = 50_000
"""Maximum nesting of terms while equations are unfolded."""
_REMEMBERED: Final = 1024
Bindings: TypeAlias = dict[str, Json]
Way: TypeAlias = tuple[RmlTerm, Bindings]
_NOTHING: Final[Bindings] = {}


@lru_cache(maxsize=256)
def rules(text: str) -> "Transitions":
    """Return the rules of a text; raises as `read` does."""
    return Transitions(parse(text))


def read(text: str) -> Monitor:
    """Return a new monitor; raises `LanguageError`, and `TooLarge` for too deeply nested event
    types.

    Monitors of one text share terms, so that states are comparable. A step raises `TooLarge` if
    equations unfold without end; the static check does not find all such cases.

    >>> [str(verdict) for verdict in read("a matches {e: 'a'}; Main = a a;").run([{"e": "a"}, {"e": "a"}])]
    ['unknown', 'true']
    """
    return RmlMonitor(rules(text))


class RmlMonitor(Monitor):
    """⊤ from the first prefix whose term may halt, ⊥ if no rule applies, else ?; ? before any
    event.
    """

    def __init__(self, rules: "Transitions") -> None:
        super().__init__()
        self._rules = rules
        self._term: RmlTerm | None = rules.start

    @property
    def state(self) -> Hashable:
        """The verdict and the term."""
        return self.verdict, self._term

    def _advance(self, event: Json) -> Verdict:
        assert self._term is not None
        if not self._rules.may_halt(self._term):  # a term that may halt before any event stays ⊤
            self._term = self._rules.step(self._term, event)
        if self._term is None:
            return Verdict.FALSE
        if self._rules.may_halt(self._term):
            self._term = None
            return Verdict.TRUE
        return Verdict.UNKNOWN


def formal(text: str) -> dict[str, Any]:
    """Return the variables of the outermost block, and the equations, `Main` first.

    Raises `NotExpressible`, `LanguageError`, `TooLarge`.
    """
    program, events = parse(text), EventConditions()
    reachable = list(program.reachable())
    place = {equation.name: number for number, equation in enumerate(reachable)}
    shared, main = _outermost(reachable[0].body)

    def test(use: TypeUse) -> Json:
        alternatives: list[Json] = ["or"]
        for one in program.declared.get(signature(use), ()):
            derived = _derived(one, use)
            if one.negated or (derived and not one.parameters and one.guard is None):
                if derived is None or one.guard is not None:
                    raise NotExpressible(unwritten("an event type negates a pattern or a guard"))
                either: Json = ["or", *map(test, derived)]
                alternatives.append(["not", either] if one.negated else either)
            else:
                alternatives += [events.of(found, use.variables) for found in alternatives_of(program, one, use)]
        return alternatives

    def term(part: Expression, below: list[Json]) -> Json:
        match part:
            case Expression("all" | "empty" | "cat" | "and" | "or" | "shuffle" | "star" | "optional" as operator):
                return [operator, *below]
            case Expression("event" | "filter" as operator, data=use) if use.variables <= set(
                shared if operator == "event" else ()
            ):
                return [operator, test(use), *below]
            case Expression("call", data=(name, (), ())) if not shared or name != "Main":
                return ["call", place[name]]
            case _:
                raise NotExpressible(
                    unwritten("the text has an operator or a use of variables that is not in the formal syntax")
                )

    if any(equation.parameters for equation in reachable):
        raise NotExpressible(unwritten("an equation of the text has parameters"))
    bodies = [main, *(equation.body for equation in reachable[1:])]
    equations: list[Json] = [fold(body, term, lambda part: part.parts) for body in bodies]
    return events.text("rml", {"variables": [*shared], "equations": equations})


def _outermost(body: Expression) -> tuple[list[str], Expression]:
    """Return the variables of a block around the whole text, or under its filter, and the text without it."""
    if body.operator == "filter" and body.parts[1].operator == "all":
        names, inside = _outermost(body.parts[0])
        return names, replace(body, parts=(inside, body.parts[1])) if body.parts[0].operator == "block" else body
    names = []
    while body.operator == "block":
        names.append(body.data)
        body = body.parts[0]
    return names, body


def _derived(one: Declaration, use: TypeUse) -> list[TypeUse] | None:
    """Return the event types that a declaration names, with the arguments of a use; None if it has
    patterns, or passes on anything but its arguments.
    """
    given = dict(zip(one.parameters, use.parameters, strict=True))
    derived = []
    for each in one.alternatives:
        if not isinstance(each, TypeUse) or not each.variables <= given.keys() or len(given) < len(one.parameters):
            return None
        parameters = tuple(given[p.name] if isinstance(p, Name) else p for p in each.parameters)
        if not all(isinstance(p, Name | Constant | Wildcard) for p in parameters):
            return None
        derived.append(replace(each, parameters=parameters))
    return derived


class Transitions:
    """The rules of one program, with a cache of recent steps."""

    def __init__(self, program: RmlProgram) -> None:
        self.terms = TermTable(program)
        self.types = EventTypes(program)
        self.start: Final = self.terms.body("Main")
        self._taken: dict[tuple[RmlTerm, Hashable], RmlTerm | None] = {}
        self._matched: dict[tuple[RmlTerm, Hashable, bool], list[Bindings]] = {}

    def step(self, term: RmlTerm, event: Json) -> RmlTerm | None:
        """Return the term after the event, or None if no rule applies; raises `TooLarge`."""
        key = term, mark(event)
        try:
            return self._taken[key]
        except KeyError:
            pass
        after = None
        for term_after, bound in run(_RmlStep(self, event, key[1]).ways(term, True))[:1]:
            after = self.terms.canonical(self.terms.opened(term_after, bound))
        if len(self._taken) >= _REMEMBERED:
            self._taken.clear()
        self._taken[key] = after
        return after

    def matches(self, term: RmlTerm, event: Json, known: Hashable, *, first: bool) -> list[Bindings]:
        """Return the bindings of each match of an event with a term's event type.

        `known` identifies the event; `first` restricts the result to one match.
        """
        key = term, known, first
        if key not in self._matched:
            found: list[Bindings] = []
            for bound in self.types.matches(term.data, event):
                if not any(all(_agree(bound[name], other[name]) for name in bound) for other in found):
                    found.append(bound)
                if first:
                    break
            if len(self._matched) >= _REMEMBERED:
                self._matched.clear()
            self._matched[key] = found
        return self._matched[key]

    def may_halt(self, term: RmlTerm) -> bool:
        """Return whether a trace may end here (cached); raises `TooLarge` for endless unfolding."""
        return run(self._halting(term, 0)) if term.halts is None else term.halts

    def _halting(self, term: RmlTerm, depth: int) -> Call[bool]:
        if term.halts is None:
            _check_depth(depth)
            match term.operator:
                case "all" | "empty" | "star" | "optional" | "closure":
                    term.halts = True
                case "event" | "nothing":
                    term.halts = False
                case "times" if term.data == 0:
                    term.halts = True
                case operator:
                    parts = (self.chosen(term),) if operator in ("if", "call") else term.parts
                    decides = operator == "or"
                    halts = not decides
                    for part in parts:
                        if (yield self._halting(part, depth + 1)) is decides:
                            halts = decides
                            break
                    term.halts = halts
        return term.halts

    def chosen(self, term: RmlTerm) -> RmlTerm:
        """Return the chosen branch of a condition, or the body of a called equation."""
        if term.operator == "call":
            return self.terms.unfolded(term)
        condition, environment = term.data
        holds = value(condition, dict(environment))
        return term.parts[not holds] if isinstance(holds, bool) else self.terms.nothing


def _check_depth(depth: int) -> None:
    if depth >= DEPTH_LIMIT:
        raise TooLarge("terms inside each other while unfolding equations", limit=DEPTH_LIMIT)


class _RmlStep:
    def __init__(self, transitions: Transitions, event: Json, known: Hashable) -> None:
        self.terms = transitions.terms
        self.transitions = transitions
        self.event = event
        self._event_known = known
        self._opened = 0
        self._depth = 0
        self._known: dict[tuple[RmlTerm, bool], list[Way]] = {}

    def ways(self, term: RmlTerm, first: bool) -> Call[list[Way]]:
        """Return the ways of a term to take the event, best first; with `first`, one suffices."""
        found = self._known.get((term, first))
        if found is None:
            _check_depth(self._depth)
            self._depth, opened_before = self._depth + 1, self._opened
            found = yield from self._rule(term, first)
            self._depth -= 1
            if opened_before == self._opened:  # the same block in two places opens two variables
                self._known[term, first] = found
        return found

    def _rule(self, term: RmlTerm, first: bool) -> Call[list[Way]]:
        terms, parts = self.terms, term.parts
        match term.operator:
            case "all":
                return [(term, _NOTHING)]
            case "empty" | "nothing":
                return []
            case "event":
                found = self.transitions.matches(term, self.event, self._event_known, first=first)
                return [(terms.empty, bound) for bound in found]
            case "or":
                for part in parts[:-1]:
                    ways = yield self.ways(part, True)
                    if ways:
                        return ways  # type: ignore[no-any-return]
                return (yield self.ways(parts[-1], first))  # type: ignore[no-any-return]
            case "shuffle":
                for i, part in enumerate(parts):
                    ways = yield self.ways(part, first or i < len(parts) - 1)
                    if ways:
                        return [(terms.joined("shuffle", (*parts[:i], a, *parts[i + 1 :])), bound) for a, bound in ways]
                return []
            case "cat":
                head, rest = parts
                ways = yield self.ways(head, True)
                if ways:
                    return [(terms.then(after, rest), bound) for after, bound in ways]
                return (yield self.ways(rest, first)) if self.transitions.may_halt(head) else []
            case "and":
                return (yield from self._both(term, first))
            case "block":
                return (yield from self._block(term))
            case "filter":
                return (yield from self._filter(term, first))
            case "call" | "if":
                return (yield self.ways(self.transitions.chosen(term), first))  # type: ignore[no-any-return]
            case "times" if term.data < 1:
                return []
            case "star" | "plus" | "optional" | "closure" | "times" as operator:
                ways = yield self.ways(parts[0], first)
                if operator == "optional":
                    return ways  # type: ignore[no-any-return]
                if operator == "closure":
                    return [(a if a is terms.all else terms.make("closure", (a,)), bound) for a, bound in ways]
                rest = terms.make("star", parts)
                if operator == "times":
                    rest = terms.make("times", parts, term.data - 1) if term.data > 1 else terms.empty
                return [(terms.then(after, rest), bound) for after, bound in ways]
            case operator:
                raise AssertionError(operator)

    def _both(self, term: RmlTerm, first: bool) -> Call[list[Way]]:
        """Combine the ways of all parts depth-first; `chosen` holds the terms of earlier parts."""
        parts, chosen, bound, found = term.parts, list[RmlTerm](), [_NOTHING], list[Way]()
        left = [iter((yield self.ways(parts[0], False)))]
        while left:
            way = next(left[-1], None)
            if way is None:
                left.pop()
                bound.pop()
                del chosen[-1:]
                continue
            merged = _merged(bound[-1], way[1])
            if merged is None:
                continue
            if len(left) == len(parts):
                found.append((self.terms.joined("and", (*chosen, way[0])), merged))
                if first:
                    break
                continue
            following = self.terms.opened(parts[len(left)], merged)
            chosen.append(way[0])
            bound.append(merged)
            left.append(iter((yield self.ways(following, False))))
        return found

    def _block(self, term: RmlTerm) -> Call[list[Way]]:
        variable = term.data
        ways = yield self.ways(term.parts[0], True)
        if not ways:
            return []
        after, bound = ways[0]
        if variable not in bound:
            return [(self.terms.block(variable, after), bound)]
        value = bound[variable]
        if value is UNBOUND:
            self._opened += 1
            value = Name(f"?new{self._opened}")
        others = {name: v for name, v in bound.items() if name != variable}
        return [(self.terms.substituted(after, {variable: value}), others)]

    def _filter(self, term: RmlTerm, first: bool) -> Call[list[Way]]:
        def filtered(inside: RmlTerm, outside: RmlTerm) -> RmlTerm:
            over = inside is self.terms.all and outside is self.terms.all
            return inside if over else self.terms.make("filter", (inside, outside), term.data)

        inside, outside = term.parts
        matched = next(self.transitions.types.matches(term.data, self.event), None)
        if matched is None:
            ways = yield self.ways(outside, first)
            return [(filtered(inside, after), bound) for after, bound in ways]
        matched = {name: v for name, v in matched.items() if v is not UNBOUND or not is_open(name)}
        ways = yield self.ways(self.terms.opened(inside, matched), first and not matched)
        both = [(filtered(after, outside), _merged(matched, bound)) for after, bound in ways]
        found = [(after, merged) for after, merged in both if merged is not None]
        return found[:1] if first else found


def _agree(left: Json, right: Json) -> bool:
    return left is right or equal(left, right)


def _merged(left: Bindings, right: Bindings) -> Bindings | None:
    """Return the union of bindings, or None on a conflict; an unbound variable of one side
    conflicts.
    """
    if not left or not right:
        return left or right
    for name in left.keys() & right.keys():
        if is_open(name):
            continue
        if left[name] is UNBOUND or right[name] is UNBOUND or not equal(left[name], right[name]):
            return None
    return {**left, **right}
