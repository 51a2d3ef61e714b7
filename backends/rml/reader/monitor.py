"""A monitor that runs an RML text by the published transition rules: one step of a term by one event, with left preference.

A rule yields the parts whose ways it needs (with whether the first will do) and returns the ways of the whole, best first; so
terms may be nested arbitrarily deep. Only a conjunction ever looks at a second way, to find bindings that its sides share.
Everything else commits: to the first way of its parts, except that the last alternative passes all of its ways on.

A variable that an event passes without binding it (`not` types, `|` in patterns) is open from then on: no block binds it any
more, and the next type that has it as an argument gives it its value, everywhere at once.
"""

from collections.abc import Generator, Hashable
from functools import lru_cache
from typing import Final, TypeAlias

from backends.rml.reader.event_types import UNBOUND, EventTypes, truth
from backends.rml.reader.static_checks import checked
from backends.rml.reader.syntax import Name, RmlProgram
from backends.rml.reader.terms import RmlTerm, TermTable, is_open, mark, opened
from rvaft.errors import TooLarge
from rvaft.model.values import Json, equal
from rvaft.model.verdict import Verdict
from rvaft.monitors import Monitor
from rvaft.support.trampoline import Call, run

DEPTH_LIMIT: Final = 50_000
"""How many terms may wait for each other while equations are unfolded."""
_REMEMBERED: Final = 1024
Bindings: TypeAlias = dict[str, Json]
Way: TypeAlias = tuple[RmlTerm, Bindings]
"""The term afterwards and what the step binds."""
Wish: TypeAlias = tuple[RmlTerm, bool]
"""A term, and whether its first way will do."""
Rule: TypeAlias = Generator[Wish, list[Way], list[Way]]
_NOTHING: Final[Bindings] = {}


@lru_cache(maxsize=256)
def rules(text: str) -> "Transitions":
    """The rules of a text; raises as `read` does."""
    return Transitions(checked(text))


def read(text: str) -> Monitor:
    """A fresh monitor of the specification; raises `LanguageError`, and `TooLarge` where event types nest too deep.

    Monitors of one text share its terms, so that their states can be compared. A step raises `TooLarge` where equations
    unfold into each other without end, which the static check cannot always see.

    >>> [str(verdict) for verdict in read("a matches {e: 'a'}; Main = a a all;").run([{"e": "a"}, {"e": "a"}])]
    ['unknown', 'true']
    """
    return RmlMonitor(rules(text))


class RmlMonitor(Monitor):
    """⊤ from the first prefix whose state may halt, ⊥ when no rule applies any more, else ?; ? before any event."""

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
        if not self._rules.may_halt(self._term):  # it may only before the first event: what was ⊤ there stays ⊤
            self._term = self._rules.step(self._term, event)
        if self._term is None:
            return Verdict.FALSE
        if self._rules.may_halt(self._term):
            self._term = None
            return Verdict.TRUE
        return Verdict.UNKNOWN


class Transitions:
    """The rules for one program; the steps that were taken last are remembered."""

    def __init__(self, program: RmlProgram) -> None:
        self.terms = TermTable(program)
        self.types = EventTypes(program)
        self.start: Final = self.terms.body("Main")
        self._taken: dict[tuple[RmlTerm, Hashable], RmlTerm | None] = {}

    def step(self, term: RmlTerm, event: Json) -> RmlTerm | None:
        """The term after the event, or None where no rule applies; raises `TooLarge` where unfolding finds no end."""
        asked = term, mark(event)
        try:
            return self._taken[asked]
        except KeyError:
            pass
        after = None
        for term_after, bound in _RmlStep(self, event).ways(term)[:1]:
            after = self.terms.canonical(self.terms.substituted(term_after, opened(bound)))
        if len(self._taken) >= _REMEMBERED:
            self._taken.clear()
        self._taken[asked] = after
        return after

    def may_halt(self, term: RmlTerm) -> bool:
        """Whether a trace may end here; each term remembers its answer. Raises `TooLarge` where unfolding finds no end."""
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
        """What a condition or the name of an equation stands for."""
        if term.operator == "call":
            return self.terms.unfolded(term)
        holds = truth(term.data[0], dict(term.data[1]))
        return self.terms.nothing if holds is None else term.parts[not holds]


def _check_depth(depth: int) -> None:
    if depth >= DEPTH_LIMIT:
        raise TooLarge("terms inside each other while unfolding equations", limit=DEPTH_LIMIT)


class _RmlStep:
    """One event."""

    def __init__(self, transitions: Transitions, event: Json) -> None:
        self.terms = transitions.terms
        self.transitions = transitions
        self.event = event
        self.opened = 0

    def ways(self, root: RmlTerm) -> list[Way]:
        """At most one way to take the event."""
        answer = self._at_once(root, first=True)
        known: dict[Wish, list[Way]] = {}
        stack = [((root, True), self._rule(root, first=True), 0)] if answer is None else []
        while stack:
            asked, rule, opened_before = stack[-1]
            try:
                wish = next(rule) if answer is None else rule.send(answer)
            except StopIteration as stop:
                stack.pop()
                answer = stop.value
                if opened_before == self.opened:  # the same block in two places opens two variables
                    known[asked] = stop.value
                continue
            answer = known.get(wish)
            if answer is None:
                answer = self._at_once(wish[0], first=wish[1])
            if answer is None:
                _check_depth(len(stack))
                stack.append((wish, self._rule(wish[0], first=wish[1]), self.opened))
        return answer or []

    def _at_once(self, term: RmlTerm, *, first: bool) -> list[Way] | None:
        """The ways of a term without parts, else None."""
        match term.operator:
            case "event":
                found: list[Bindings] = []
                for bound in self.transitions.types.matches(term.data, self.event):
                    if not any(all(_agree(bound[name], other[name]) for name in bound) for other in found):
                        found.append(bound)
                    if first:
                        break
                return [(self.terms.empty, bound) for bound in found]
            case "all":
                return [(term, _NOTHING)]
            case "empty" | "nothing":
                return []
            case _:
                return None

    def _rule(self, term: RmlTerm, *, first: bool) -> Rule:
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
            case "call" | "if":
                return self._same(self.transitions.chosen(term), first=first)
            case "star" | "plus" | "optional" | "closure" | "times":
                return self._repeated(term, first=first)
            case operator:
                raise AssertionError(operator)

    def _same(self, term: RmlTerm, *, first: bool) -> Rule:
        return (yield term, first)

    def _union(self, term: RmlTerm, *, first: bool) -> Rule:
        for part in term.parts[:-1]:
            ways = yield part, True
            if ways:
                return ways
        return (yield term.parts[-1], first)

    def _shuffle(self, term: RmlTerm, *, first: bool) -> Rule:
        for index, part in enumerate(term.parts):
            ways = yield part, first or index < len(term.parts) - 1
            if ways:
                before, behind = term.parts[:index], term.parts[index + 1 :]
                return [(self.terms.joined("shuffle", (*before, after, *behind)), bound) for after, bound in ways]
        return []

    def _sequence(self, term: RmlTerm, *, first: bool) -> Rule:
        head, rest = term.parts
        ways = yield head, True
        if ways:
            return [(self.terms.then(after, rest), bound) for after, bound in ways]
        return (yield rest, first) if self.transitions.may_halt(head) else []

    def _both(self, term: RmlTerm, *, first: bool) -> Rule:
        """Depth first through the ways of the parts; `chosen` holds one term for each part but the last looked at."""
        parts, chosen, bound, found = term.parts, list[RmlTerm](), [_NOTHING], list[Way]()
        left = [iter((yield parts[0], False))]
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
            following = self.terms.substituted(parts[len(left)], opened(merged))
            chosen.append(way[0])
            bound.append(merged)
            left.append(iter((yield following, False)))
        return found

    def _block(self, term: RmlTerm) -> Rule:
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

    def _filter(self, term: RmlTerm, *, first: bool) -> Rule:
        inside, outside = term.parts
        matched = next(self.transitions.types.matches(term.data, self.event), None)
        if matched is None:
            ways = yield outside, first
            return [(self._filtered(term, inside, after), bound) for after, bound in ways]
        matched = {name: v for name, v in matched.items() if v is not UNBOUND or not is_open(name)}
        ways = yield self.terms.substituted(inside, opened(matched)), first and not matched
        found = [
            (self._filtered(term, after, outside), merged)
            for after, bound in ways
            if (merged := _merged(matched, bound)) is not None
        ]
        return found[:1] if first else found

    def _filtered(self, term: RmlTerm, inside: RmlTerm, outside: RmlTerm) -> RmlTerm:
        over = inside is self.terms.all and outside is self.terms.all
        return inside if over else self.terms.make("filter", (inside, outside), term.data)

    def _repeated(self, term: RmlTerm, *, first: bool) -> Rule:
        body, number, terms = term.parts[0], term.data, self.terms
        if term.operator == "times" and number < 1:
            return []
        ways = yield body, first
        match term.operator:
            case "optional":
                return ways
            case "closure":
                return [(a if a is terms.all else terms.make("closure", (a,)), bound) for a, bound in ways]
            case "times":
                rest = terms.make("times", (body,), number - 1) if number > 1 else terms.empty
            case _:
                rest = terms.make("star", (body,))
        return [(terms.then(after, rest), bound) for after, bound in ways]


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
