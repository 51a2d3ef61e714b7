"""Properties to past MTL: a disjunction of event orders, each a chain of earlier events."""

import re
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import chain
from typing import Final

from backends.orders import Orders, merged
from rvaft.core.property import Event, Property
from rvaft.core.scenarios import Scenario
from rvaft.errors import NotExpressible, unwritten
from rvaft.model import patterns
from rvaft.model.expressions import guard_text, pattern_text
from rvaft.model.guards import Guard

_STRING: Final = re.compile(r'"(?:[^"\\]|\\.)*"')
_TOKEN: Final = re.compile(r"\w+|[^\s\w]")
_DEEPEST: Final = 200
_NEVER: Final = "never"


@dataclass(frozen=True, slots=True)
class Chains:
    """The event orders of a property as words; a letter is a choice of propositions."""

    propositions: dict[str, str]
    """The definition of each proposition, as `PATTERN when GUARD`."""
    words: tuple[tuple[tuple[str, ...], ...], ...]

    def reelay(self) -> str:
        """Return the formula for Reelay: the last event now or earlier, the others strictly before
        it.
        """
        return self._formula("once({})", "{{{}: true}}", " or ", "{} and pre(once({}))")

    def c2po(self, horizon: int) -> str:
        """Return the formula for C2PO: as for Reelay, but with the last event now, and within
        `horizon`.
        """
        return self._formula("{}", "{}", " || ", f"{{}} && (true S[1,{horizon}] ({{}}))")

    def _formula(self, whole: str, atom: str, either: str, then: str) -> str:
        formulas: list[str] = []
        for word in self.words:
            before = ""
            for letter in word:
                some = [atom.format(name) for name in letter]
                now = some[0] if len(some) == 1 else f"({either.join(some)})"
                before = then.format(now, before) if before else now
            formulas.append(whole.format(before))
        return either.join(formulas)


def symbols(formula: str) -> int:
    """Return the number of tokens of a formula."""
    return len(_TOKEN.findall(formula))


def translation(prop: Property, limit: int) -> Chains:
    """Return the event orders of a property; if there are none, a proposition that never holds."""
    orders = Orders(prop, limit=limit)

    def question(event: Event, guards: Sequence[Guard]) -> str:
        text = pattern_text(event.pattern) + "".join(f" when {guard_text(guard)}" for guard in dict.fromkeys(guards))
        return _STRING.sub(lambda found: found[0].replace("*/", "*\\u002f"), text)

    def letters(scenario: Scenario) -> dict[Event, tuple[str, ...]] | None:
        bound = {event: {*patterns.rigid_variables(event.pattern)} for event in scenario.events}
        several = "a proposition is about one event, and a guard compares several"
        guards = orders.assigned_guards(
            scenario, bound, lambda node, _: NotExpressible(unwritten(several), nodes=[node])
        )
        if guards is None:
            return None
        leaves = {event: orders.groups.get(event, ((event, guards[event]),)) for event in scenario.events}
        return {event: tuple(dict.fromkeys(question(*leaf) for leaf in some)) for event, some in leaves.items()}

    some = ((one, found) for one in orders.scenarios() if (found := letters(one)) is not None)
    words = merged(
        chain.from_iterable(orders.words(one, found) for one, found in some),
        lambda several: tuple(dict.fromkeys(chain.from_iterable(several))),
    )
    if any(len(word) > _DEEPEST for word in words):
        raise NotExpressible(unwritten(f"Reelay aborts on formulas deeper than {_DEEPEST} events"))
    if not words:
        return Chains({_NEVER: "{ } when false"}, (((_NEVER,),),))
    names = {
        one: f"p{number}"
        for number, one in enumerate(dict.fromkeys(chain.from_iterable(chain.from_iterable(words))), 1)
    }
    named = tuple(tuple(tuple(names[one] for one in letter) for letter in word) for word in words)
    return Chains({name: one for one, name in names.items()}, named)
