"""From a tree to a formula: a disjunction of the orders of its events, each a chain of what is strictly earlier."""

import re
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from itertools import chain
from typing import Final

from backends.orders import Orders, merged
from rvaft.analysis.scenarios import Kept
from rvaft.errors import NotExpressible
from rvaft.model import guards, patterns
from rvaft.model.expressions import guard_text, pattern_text
from rvaft.model.guards import Guard
from rvaft.model.patterns import Anything
from rvaft.model.tree import RVAFT

_STRING: Final = re.compile(r'"(?:[^"\\]|\\.)*"')
_TOKEN: Final = re.compile(r"\w+|[^\s\w]")
_DEEPEST: Final = 200
_NEVER: Final = "never"


@dataclass(frozen=True, slots=True)
class Chains:
    """The orders of a tree's events, each a word of propositions, of which several in a letter are a choice."""

    propositions: dict[str, str]
    """What each proposition asks of an event, as `PATTERN when GUARD`."""
    words: tuple[tuple[tuple[str, ...], ...], ...]

    def reelay(self) -> str:
        """The formula as Reelay takes it: the last event now or earlier, and strictly before it the others."""
        return self._formula("once({})", "{{{}: true}}", " or ", "{} and pre(once({}))")

    def c2po(self, horizon: int) -> str:
        """The formula as C2PO takes it: the last event now, and strictly before it, by at most `horizon`, the others."""
        return self._formula("{}", "{}", " || ", f"{{}} && (true S[1,{horizon}] ({{}}))")

    def _formula(self, whole: str, atom: str, either: str, then: str) -> str:
        """The words in the shapes of a language: of a chain, a proposition, a choice, and an event with those before it."""
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
    """How many tokens a formula has."""
    return len(_TOKEN.findall(formula))


def translation(tree: RVAFT, limit: int) -> Chains:
    """The orders of the events of a plain tree; where there are none, what no event is."""
    orders = Orders(tree, limit=limit)

    def question(name: str, asked: Sequence[Guard]) -> str:
        pattern = tree.pattern(name) or Anything()
        text = pattern_text(pattern) + "".join(f" when {guard_text(guard)}" for guard in dict.fromkeys(asked))
        return _STRING.sub(lambda found: found[0].replace("*/", "*\\u002f"), text)

    def letters(kept: Kept) -> dict[str, tuple[str, ...]] | None:
        names = [name for name in kept if orders.tree.nodes[name].has_event]
        single = [name for name in names if name not in orders.groups]
        bound = {name: {*patterns.rigid_variables(tree.pattern(name) or Anything())} for name in single}
        several = "a proposition is about one event, and a guard compares several"
        asked = orders.asked(kept, bound, lambda node, _: NotExpressible(several, nodes=[node]))
        if asked is None:
            return None
        found: dict[str, tuple[str, ...]] = {}
        for name in names:
            inside = orders.groups.get(name, ())
            some = [question(one, guards.conjuncts(tree.nodes[one].when)) for one in _leaves(orders, inside)]
            found[name] = tuple(dict.fromkeys(some)) if inside else (question(name, asked[name]),)
        return found

    some = ((kept, found) for kept in orders.scenarios() if (found := letters(kept)) is not None)
    words = merged(
        chain.from_iterable(orders.words(kept, found) for kept, found in some),
        lambda several: tuple(dict.fromkeys(chain.from_iterable(several))),
    )
    if any(len(word) > _DEEPEST for word in words):
        raise NotExpressible(f"Reelay itself ends at formulas that are deeper than {_DEEPEST} events")
    if not words:
        return Chains({_NEVER: "{ } when false"}, (((_NEVER,),),))
    names = {
        one: f"p{number}"
        for number, one in enumerate(dict.fromkeys(chain.from_iterable(chain.from_iterable(words))), 1)
    }
    named = tuple(tuple(tuple(names[one] for one in letter) for letter in word) for word in words)
    return Chains({name: one for one, name in names.items()}, named)


def _leaves(orders: Orders, names: Iterable[str]) -> list[str]:
    return [
        leaf for name in names for leaf in (_leaves(orders, orders.groups[name]) if name in orders.groups else [name])
    ]
