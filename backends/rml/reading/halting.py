"""Whether a trace may end in a term."""

from collections.abc import Generator
from typing import Final, TypeAlias

from backends.rml.reading.data import truth
from backends.rml.reading.terms import Term, Terms
from rvaft.errors import TooLarge

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
