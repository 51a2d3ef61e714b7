"""Properties to past MTL: a disjunction of event orders, each a chain of earlier events."""

import re
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from itertools import chain
from typing import Final, assert_never

from backends.orders import Orders, merged
from rvaft.core.property import Event, Property
from rvaft.core.scenarios import Scenario
from rvaft.errors import NotExpressible, unwritten
from rvaft.model import patterns
from rvaft.model.expressions import guard_text, pattern_text
from rvaft.model.guards import Guard
from rvaft.model.patterns import Pattern
from rvaft.model.verdict import Semantics

_STRING: Final = re.compile(r'"(?:[^"\\]|\\.)*"')
_TOKEN: Final = re.compile(r"\w+|[^\s\w]")
_DEEPEST: Final = 200
_NEVER: Final = "never"
_RELEVANT: Final = "relevant"
_IGNORED: Final = "ignored"


@dataclass(frozen=True, slots=True)
class Dialect:
    """The operators of past MTL in one syntax.

    `before` is one event ago, `earlier` at any event ago, `since` the second formula at an event
    from which on the first holds.
    """

    atom: str
    either: str
    both: str
    negated: str
    once: str
    before: str
    earlier: str
    since: str


REELAY: Final = Dialect(
    "{{{}: true}}", " or ", " and ", "not {}", "once({})", "pre({})", "pre(once({}))", "({} since ({}))"
)


def c2po(horizon: int) -> Dialect:
    """Return the syntax of C2PO, in which all operators have bounds."""
    earlier = f"(true S[1,{horizon}] ({{}}))"
    return Dialect("{}", " || ", " && ", "!{}", "{}", "(true S[1,1] ({}))", earlier, f"({{}} S[0,{horizon}] ({{}}))")


@dataclass(frozen=True, slots=True)
class Chains:
    """The event orders of a property as words; a letter is a choice of propositions."""

    definitions: tuple[tuple[str, str], ...]
    """The definitions of the propositions, as `PATTERN when GUARD`; those of one name are alternatives."""
    words: tuple[tuple[tuple[str, ...], ...], ...]
    semantics: Semantics

    @property
    def propositions(self) -> tuple[str, ...]:
        """The names of the propositions."""
        return tuple(dict.fromkeys(name for name, _ in self.definitions))

    def formula(self, dialect: Dialect) -> str:
        """Return the formula; in `REELAY` it holds from the detection on, in C2PO at the detection."""
        return dialect.either.join(dialect.once.format(self._chain(word, dialect)) for word in self.words)

    def _chain(self, word: Sequence[Sequence[str]], dialect: Dialect) -> str:
        """Return the formula that the last event of a word is now, and the others are before it."""

        def atom(name: str) -> str:
            return dialect.atom.format(name)

        def negated(part: str) -> str:
            return dialect.negated.format(part)

        def last_relevant(part: str) -> str:
            return dialect.before.format(dialect.since.format(negated(counts), part))

        names, found, first = self.propositions, "", ""
        then: Callable[[str], str]
        relevant, ignored = atom(_RELEVANT), negated(atom(_IGNORED)) if _IGNORED in names else ""
        counts = f"({relevant}{dialect.both}{ignored})" if ignored else relevant
        match self.semantics:
            case Semantics.SCATTERED:
                then = dialect.earlier.format
            case Semantics.STRICT:
                any_event = f"({atom(word[0][0])}{dialect.either}{negated(atom(word[0][0]))})"
                first, then = negated(dialect.before.format(any_event)), dialect.before.format
            case Semantics.PROJECTED:
                first, then = negated(dialect.earlier.format(counts)), last_relevant
            case Semantics.CONSECUTIVE:
                then = last_relevant
            case _:
                assert_never(self.semantics)
        for letter in word:
            some = [atom(name) for name in letter]
            now = some[0] if len(some) == 1 else f"({dialect.either.join(some)})"
            before = then(found) if found else first
            found = dialect.both.join(filter(None, (now, ignored, before)))
        return found


def symbols(formula: str) -> int:
    """Return the number of tokens of a formula."""
    return len(_TOKEN.findall(formula))


def translation(prop: Property, semantics: Semantics, limit: int) -> Chains:
    """Return the event orders of a property; if there are none, a proposition that never holds."""
    orders = Orders(prop, limit=limit, minimal=semantics is Semantics.SCATTERED)

    def letters(scenario: Scenario) -> dict[Event, tuple[str, ...]] | None:
        bound = {event: {*patterns.rigid_variables(event.pattern)} for event in scenario.events}
        reason = unwritten("a proposition is about one event, and a guard compares several")
        guards = orders.assigned_guards(scenario, bound, lambda node, _: NotExpressible(reason, nodes=[node]))
        if guards is None:
            return None
        leaves = {event: orders.groups.get(event, ((event, guards[event]),)) for event in scenario.events}
        return {
            event: tuple(dict.fromkeys(_definition(one.pattern, its) for one, its in some))
            for event, some in leaves.items()
        }

    some = ((one, found) for one in orders.scenarios() if (found := letters(one)) is not None)
    words = merged(
        chain.from_iterable(orders.words(one, found) for one, found in some),
        lambda several: tuple(dict.fromkeys(chain.from_iterable(several))),
    )
    if any(len(word) > _DEEPEST for word in words):
        raise NotExpressible(unwritten(f"Reelay aborts on formulas deeper than {_DEEPEST} events"))
    if not words:
        return Chains(((_NEVER, "{ } when false"),), (((_NEVER,),),), Semantics.SCATTERED)
    names = {
        one: f"p{number}"
        for number, one in enumerate(dict.fromkeys(chain.from_iterable(chain.from_iterable(words))), 1)
    }
    named = tuple(tuple(tuple(names[one] for one in letter) for letter in word) for word in words)
    several = semantics is Semantics.PROJECTED or any(len(word) > 1 for word in words)
    relevance = _relevance(prop, several=several) if semantics.projects else ()
    return Chains((*((name, one) for one, name in names.items()), *relevance), named, semantics)


def _relevance(prop: Property, *, several: bool) -> Iterator[tuple[str, str]]:
    """Yield the definitions of the relevant events, if a match may have `several`, and the ignored ones."""
    for name, some in ((_RELEVANT, prop.alphabet if several else ()), (_IGNORED, prop.ignored)):
        for one in dict.fromkeys(_definition(each.pattern, [each.when] if each.when else []) for each in some):
            yield name, one


def _definition(pattern: Pattern, guards: Sequence[Guard]) -> str:
    text = pattern_text(pattern) + "".join(f" when {guard_text(guard)}" for guard in dict.fromkeys(guards))
    return _STRING.sub(lambda found: found[0].replace("*/", "*\\u002f"), text)
