"""Forms of trees for tests of risk, and references that share nothing with the analyses."""

from collections.abc import Iterator, Mapping
from itertools import combinations, product

from hypothesis import strategies as st

from rvaft.language.parser import parse_as_written
from rvaft.risk.model import Op, RiskTree, of_draft


def form(text: str, *, galileo: bool = False) -> RiskTree:
    """Return the form of a text."""
    return of_draft(parse_as_written(text, "t.dft" if galileo else "t.rvaft"))


@st.composite
def static_texts(draw: st.DrawFn, leaves: int = 6) -> str:
    """Draw a static tree with shared nodes, and a probability for each leaf."""
    names = [f"e{number}" for number in range(draw(st.integers(2, leaves)))]
    lines = [f"{name} prob={draw(st.integers(0, 20)) / 20};" for name in names]
    known = list(names)
    for number in range(draw(st.integers(1, 4))):
        children = draw(st.lists(st.sampled_from(known), min_size=1, max_size=4, unique=True))
        word = draw(st.sampled_from(["or", "and", f"{draw(st.integers(1, len(children)))}of{len(children)}"]))
        known.append(f"g{number}")
        lines.append(f"g{number} {word} {' '.join(children)};")
    return f"toplevel {known[-1]}; {' '.join(lines)}"


def holds(tree: RiskTree, happened: Mapping[str, bool]) -> bool:
    """Return whether the root of a static tree happens, if these leaves do."""
    values = dict(happened)
    for name in tree.order():
        if name in tree.gates:
            gate = tree.gates[name]
            many = sum(values[child] for child in gate.children)
            need = {Op.OR: 1, Op.AND: len(gate.children), Op.AT_LEAST: gate.need}[gate.op]
            values[name] = many >= need
    return values[tree.root]


def used(tree: RiskTree) -> list[str]:
    """Return the leaves below the root."""
    return [name for name in tree.order() if name in tree.leaves]


def probability(tree: RiskTree) -> float:
    """Return the probability of a static tree by enumeration."""
    names, total = used(tree), 0.0
    for values in product((False, True), repeat=len(names)):
        weight = 1.0
        for name, value in zip(names, values, strict=True):
            chance = tree.leaves[name].numbers.chance or 0.0
            weight *= chance if value else 1 - chance
        if weight and holds(tree, dict(zip(names, values, strict=True))):
            total += weight
    return total


def minimal_sets(tree: RiskTree) -> set[frozenset[str]]:
    """Return the minimal cut sets of a static tree by enumeration, of leaves that can happen."""
    names = [name for name in used(tree) if tree.leaves[name].numbers.chance != 0]
    never = dict.fromkeys(used(tree), False)
    found: list[frozenset[str]] = []
    for some in _subsets(names):
        if not any(one <= some for one in found) and holds(tree, never | dict.fromkeys(some, True)):
            found.append(some)
    return set(found)


def _subsets(names: list[str]) -> Iterator[frozenset[str]]:
    for size in range(len(names) + 1):
        yield from map(frozenset, combinations(names, size))
