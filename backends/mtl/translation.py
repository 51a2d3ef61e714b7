"""From a tree to a formula: a disjunction of the orders of its events, each a chain of `once`, strictly earlier by `pre`."""

import re
from collections import Counter
from collections.abc import Iterable, Sequence
from itertools import chain
from typing import Final

from backends.orders import Orders, merged
from rvaft.analysis.normal_form import is_constant
from rvaft.analysis.scenarios import Kept
from rvaft.backend import Backend
from rvaft.errors import NotExpressible
from rvaft.model import guards, patterns
from rvaft.model.expressions import guard_text, pattern_text
from rvaft.model.guards import Guard
from rvaft.model.patterns import Anything
from rvaft.model.tree import RVAFT
from rvaft.model.verdict import Semantics

_STRING: Final = re.compile(r'"(?:[^"\\]|\\.)*"')
_TOKEN: Final = re.compile(r"\w+|[^\s\w]")
_DEEPEST: Final = 200


def translation(backend: Backend, tree: RVAFT, semantics: Semantics, limit: int) -> tuple[str, int]:
    """The text of a plain tree, and how many symbols its formula has."""
    orders = Orders(tree, limit=limit)

    def refusal(reason: str, nodes: Iterable[str]) -> NotExpressible:
        return NotExpressible(reason, backend=backend.name, semantics=semantics, nodes=nodes)

    def question(name: str, asked: Sequence[Guard]) -> str:
        pattern = tree.pattern(name) or Anything()
        text = pattern_text(pattern) + "".join(f" when {guard_text(guard)}" for guard in dict.fromkeys(asked))
        return _STRING.sub(lambda found: found[0].replace("*/", "*\\u002f"), text)

    def letters(kept: Kept) -> dict[str, tuple[str, ...]] | None:
        nodes = orders.tree.nodes
        names = [name for name in kept if nodes[name].has_event]
        single = [name for name in names if name not in orders.groups]
        bound = {name: {*patterns.rigid_variables(tree.pattern(name) or Anything())} for name in single}
        holders = Counter(chain.from_iterable(bound.values()))
        if tied := [name for name in single if any(holders[one] > 1 for one in bound[name])]:
            raise refusal("a proposition is about one event, and a variable ties several", tied)
        asked: dict[str, list[Guard]] = {name: [] for name in names}
        for node in (nodes[name] for name in kept):
            for guard in () if is_constant(node) else guards.conjuncts(node.when):
                mentioned = {*guards.variables(guard)}
                if not mentioned and not guards.holds(guard, {}):
                    return None
                where = [
                    name
                    for name in dict.fromkeys((node.name, *single))
                    if mentioned <= bound.get(name, set()) and name in bound
                ]
                if not where:
                    raise refusal("a proposition is about one event, and a guard compares several", [node.name])
                asked[where[0]].append(guard)
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
        raise refusal(f"Reelay itself ends at formulas that are deeper than {_DEEPEST} events", [])
    names = {
        one: f"p{number}"
        for number, one in enumerate(dict.fromkeys(chain.from_iterable(chain.from_iterable(words))), 1)
    }
    formula = " or ".join(_chain(word, names) for word in words) or "once({never: true})"
    header = "".join(f"{name} := {one}\n" for one, name in names.items()) + (
        "" if words else "never := { } when false\n"
    )
    return f"/* rvaft\n{header}*/\n{formula}\n", len(_TOKEN.findall(formula))


def _leaves(orders: Orders, names: Iterable[str]) -> list[str]:
    return [
        leaf for name in names for leaf in (_leaves(orders, orders.groups[name]) if name in orders.groups else [name])
    ]


def _chain(word: Sequence[tuple[str, ...]], names: dict[str, str]) -> str:
    """The last event now or earlier, and strictly before it the others."""
    texts: list[str] = []
    for letter in word:
        some = [f"{{{names[one]}: true}}" for one in letter]
        texts.append(some[0] if len(some) == 1 else f"({' or '.join(some)})")
    opened = " and pre(".join(f"once({text}" for text in reversed(texts))
    return opened + ")" * (2 * len(texts) - 1)
