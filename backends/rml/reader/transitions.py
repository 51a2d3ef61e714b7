"""The published transition rules: one step of a term by one event, with left preference.

A rule yields the parts whose ways it needs (with whether the first will do) and returns the ways of the whole, best first; so
terms may be nested arbitrarily deep. Only a conjunction ever looks at a second way, to find bindings that its sides share.
Everything else commits: to the first way of its parts, except that the last alternative passes all of its ways on.

A variable that an event passes without binding it (`not` types, `|` in patterns) is open from then on: no block binds it any
more, and the next type that has it as an argument gives it its value, everywhere at once. Open variables have names with "?".
"""

from collections.abc import Generator
from dataclasses import dataclass
from typing import Final, TypeAlias

from backends.rml.reader.event_types import UNBOUND, Types, truth
from backends.rml.reader.syntax import Name
from backends.rml.reader.terms import Forms, Term, Terms, canonical, is_open, opened
from rvaft.errors import TooLarge
from rvaft.model.values import Json, equal

# Whether a trace may end in a term.

DEPTH_LIMIT: Final = 50_000
_Rule: TypeAlias = Generator[Term, bool, bool]


def may_halt(terms: Terms, root: Term) -> bool:
    """Whether a trace may end here; each term remembers its answer. Raises `TooLarge` where unfolding finds no end."""
    if root.halts is not None:
        return root.halts
    stack = [(root, _rule(terms, root))]
    answer: bool | None = None
    while stack:
        term, rule = stack[-1]
        try:
            wanted = next(rule) if answer is None else rule.send(answer)
        except StopIteration as stop:
            stack.pop()
            term.halts = answer = stop.value
            continue
        answer = wanted.halts
        if answer is None:
            if len(stack) >= DEPTH_LIMIT:
                raise TooLarge("terms inside each other while unfolding equations", limit=DEPTH_LIMIT)
            stack.append((wanted, _rule(terms, wanted)))
    return bool(answer)


def _rule(terms: Terms, term: Term) -> _Rule:
    """Yields the terms whose answers decide, and returns the answer."""
    match term.operator:
        case "all" | "empty" | "star" | "optional" | "closure":
            return True
        case "or":
            for part in term.parts:
                if (yield part):
                    return True
            return False
        case "times" if term.data == 0:
            return True
        case "shuffle" | "cat" | "and" | "filter" | "block" | "plus" | "times":
            for part in term.parts:
                if not (yield part):
                    return False
            return True
        case "if":
            chosen = truth(term.data[0], dict(term.data[1]))
            return False if chosen is None else (yield term.parts[not chosen])
        case "call":
            return (yield terms.unfolded(term))
        case _:
            return False


Bindings: TypeAlias = dict[str, Json]
Way: TypeAlias = tuple[Term, Bindings]
"""The term afterwards and what the step binds."""
Wish: TypeAlias = tuple[Term, bool]
"""A term, and whether its first way will do."""
Rule: TypeAlias = Generator[Wish, list[Way], list[Way]]

TRANSITIONS_DEPTH_LIMIT: Final = 50_000
_NONE: Final[Bindings] = {}


class Transitions:
    """The rules for one program."""

    def __init__(self, terms: Terms, types: Types) -> None:
        self.terms = terms
        self.types = types

    def step(self, term: Term, event: Json) -> Term | None:
        """The term after the event, or None where no rule applies; raises `TooLarge` where unfolding finds no end."""
        ways = _Step(self.terms, self.types, event).ways(term)
        if not ways:
            return None
        after, bound = ways[0]
        return canonical(self.terms, self.terms.substituted(after, opened(bound)))

    def may_halt(self, term: Term) -> bool:
        """Whether the trace may end here; raises `TooLarge` where unfolding finds no end."""
        return may_halt(self.terms, term)


@dataclass(slots=True)
class _Frame:
    wish: Wish
    rule: Rule
    opened: int


class _Step:
    """One event."""

    def __init__(self, terms: Terms, types: Types, event: Json) -> None:
        self.terms = terms
        self.forms = Forms(terms)
        self.types = types
        self.event = event
        self.opened = 0

    def ways(self, root: Term) -> list[Way]:
        """At most one way to take the event."""
        ways = self._at_once(root, first=True)
        if ways is not None:
            return ways
        known: dict[Wish, list[Way]] = {}
        stack = [_Frame((root, True), self._rule(root, first=True), 0)]
        answer: list[Way] | None = None
        while stack:
            frame = stack[-1]
            try:
                wish = next(frame.rule) if answer is None else frame.rule.send(answer)
            except StopIteration as stop:
                stack.pop()
                answer = stop.value
                if frame.opened == self.opened:  # the same block in two places opens two variables
                    known[frame.wish] = stop.value
                continue
            term, first = wish
            answer = known.get(wish)
            if answer is None:
                answer = self._at_once(term, first=first)
            if answer is None:
                if len(stack) >= TRANSITIONS_DEPTH_LIMIT:
                    raise TooLarge("terms inside each other while unfolding equations", limit=TRANSITIONS_DEPTH_LIMIT)
                stack.append(_Frame(wish, self._rule(term, first=first), self.opened))
        return answer or []

    def _at_once(self, term: Term, *, first: bool) -> list[Way] | None:
        """The ways of a term without parts, else None."""
        match term.operator:
            case "occurs":
                matches = self.types.matches(term.data, self.event)
                found = next(matches, None)
                if found is None:
                    return []
                return [(self.terms.empty, found)] if first else _distinct(self.terms.empty, [found, *matches])
            case "all":
                return [(term, _NONE)]
            case "empty" | "nothing":
                return []
            case _:
                return None

    def _rule(self, term: Term, *, first: bool) -> Rule:
        match term.operator:
            case "or":
                return self._union(term, first=first)
            case "shuffle":
                return self._shuffle(term, first=first)
            case "cat":
                return self._sequence(term, first=first)
            case "and":
                return self._both(term, first=first)
            case "block":
                return self._block(term)
            case "filter":
                return self._filter(term, first=first)
            case "call":
                return self._same(self.terms.unfolded(term), first=first)
            case "if":
                chosen = truth(term.data[0], dict(term.data[1]))
                return self._same(self.terms.nothing if chosen is None else term.parts[not chosen], first=first)
            case _:
                return self._repeated(term, first=first)

    def _same(self, term: Term, *, first: bool) -> Rule:
        return (yield term, first)

    def _union(self, term: Term, *, first: bool) -> Rule:
        for part in term.parts[:-1]:
            ways = yield part, True
            if ways:
                return ways
        return (yield term.parts[-1], first)

    def _shuffle(self, term: Term, *, first: bool) -> Rule:
        for index, part in enumerate(term.parts):
            ways = yield part, first or index < len(term.parts) - 1
            if ways:
                before, behind = term.parts[:index], term.parts[index + 1 :]
                return [(self.forms.shuffle((*before, after, *behind)), bound) for after, bound in ways]
        return []

    def _sequence(self, term: Term, *, first: bool) -> Rule:
        head, rest = term.parts
        ways = yield head, True
        if ways:
            return [(self.forms.then(after, rest), bound) for after, bound in ways]
        return (yield rest, first) if may_halt(self.terms, head) else []

    def _both(self, term: Term, *, first: bool) -> Rule:
        """Depth first through the ways of the parts; `chosen` holds one term for each part but the last looked at."""
        parts, chosen, bound, found = term.parts, list[Term](), [_NONE], list[Way]()
        left = [iter((yield parts[0], False))]
        while left:
            way = next(left[-1], None)
            if way is None:
                left.pop()
                bound.pop()
                if chosen:
                    chosen.pop()
                continue
            merged = _merged(bound[-1], way[1])
            if merged is None:
                continue
            if len(left) == len(parts):
                found.append((self.forms.both((*chosen, way[0])), merged))
                if first:
                    break
                continue
            following = self.terms.substituted(parts[len(left)], opened(merged))
            chosen.append(way[0])
            bound.append(merged)
            left.append(iter((yield following, False)))
        return found

    def _block(self, term: Term) -> Rule:
        variable = term.data
        ways = yield term.parts[0], True
        if not ways:
            return []
        after, bound = ways[0]
        if variable not in bound:
            return [(self.terms.block(variable, after), bound)]
        value = bound[variable]
        if value is UNBOUND:
            self.opened += 1
            value = Name(f"?new{self.opened}")
        others = {name: v for name, v in bound.items() if name != variable}
        return [(self.terms.substituted(after, {variable: value}), others)]

    def _filter(self, term: Term, *, first: bool) -> Rule:
        inside, outside = term.parts
        matched = next(self.types.matches(term.data, self.event), None)
        if matched is None:
            ways = yield outside, first
            return [(self.forms.filtered(term, inside, after), bound) for after, bound in ways]
        matched = {name: v for name, v in matched.items() if v is not UNBOUND or not is_open(name)}
        ways = yield self.terms.substituted(inside, opened(matched)), first and not matched
        found = [
            (self.forms.filtered(term, after, outside), merged)
            for after, bound in ways
            if (merged := _merged(matched, bound)) is not None
        ]
        return found[:1] if first else found

    def _repeated(self, term: Term, *, first: bool) -> Rule:
        body, number = term.parts[0], term.data
        if term.operator == "times" and number < 1:
            return []
        ways = yield body, first
        match term.operator:
            case "optional":
                return ways
            case "closure":
                return [(self.forms.closure(after), bound) for after, bound in ways]
            case "times":
                rest = self.terms.repeated("times", body, number - 1) if number > 1 else self.terms.empty
            case _:
                rest = self.terms.repeated("star", body)
        return [(self.forms.then(after, rest), bound) for after, bound in ways]


def _distinct(term: Term, matches: list[Bindings]) -> list[Way]:
    kept: list[Bindings] = []
    for bound in matches:
        if not any(all(_agree(bound[name], other[name]) for name in bound) for other in kept):
            kept.append(bound)
    return [(term, bound) for bound in kept]


def _agree(left: Json, right: Json) -> bool:
    return left is right or equal(left, right)


def _merged(left: Bindings, right: Bindings) -> Bindings | None:
    """Both bindings, or None where they differ; a variable that one side left unbound agrees with nothing."""
    if not left or not right:
        return left or right
    for name in left.keys() & right.keys():
        if is_open(name):
            continue
        if left[name] is UNBOUND or right[name] is UNBOUND or not equal(left[name], right[name]):
            return None
    return {**left, **right}
