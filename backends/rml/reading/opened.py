"""Variables that an event passed without binding them; their names begin with "?"."""

from collections.abc import Iterator, Mapping

from backends.rml.reading.matching import UNBOUND
from backends.rml.reading.syntax import Name
from backends.rml.reading.terms import Term, Terms
from rvaft.values import Json


def is_open(name: str) -> bool:
    """Whether a variable is one of these."""
    return name.startswith("?")


def opened(bound: Mapping[str, Json]) -> Mapping[str, Json]:
    """Those of some bindings that give an open variable its value."""
    return {name: value for name, value in bound.items() if is_open(name) and value is not UNBOUND} if bound else bound


def canonical(terms: Terms, term: Term) -> Term:
    """The term with its open variables numbered by where they first occur, so that equal states are equal terms."""
    if not any(map(is_open, term.free)):
        return term
    order = list(dict.fromkeys(_open_names(term)))
    return terms.substituted(term, {name: Name(f"?{index}") for index, name in enumerate(order)})


def _open_names(term: Term) -> Iterator[str]:
    seen: set[Term] = set()
    todo = [term]
    while todo:
        at = todo.pop()
        if at not in seen and any(map(is_open, at.free)):
            seen.add(at)
            yield from _own_names(at)
            todo.extend(reversed(at.parts))


def _own_names(term: Term) -> list[str]:
    match term.operator:
        case "occurs" | "filter":
            names = [p.name for p in term.data.parameters if isinstance(p, Name)]
        case "if" | "call":
            names = [value.name for _, value in term.data[-1] if isinstance(value, Name)]
        case _:
            names = []
    return [name for name in names if is_open(name)]
