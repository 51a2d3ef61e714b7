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


@st.composite
def galileo_texts(draw: st.DrawFn, leaves: int = 5, *, dependencies: bool = True) -> str:
    """Draw a dynamic tree in Galileo's format, a statement on each line; not all of them can be analysed."""
    names = [f"e{number}" for number in range(draw(st.integers(2, leaves)))]
    known, lines = list(names), list[str]()
    for gate in range(draw(st.integers(1, 4))):
        last = [known[-1]] if gate else []
        chosen = draw(st.lists(st.sampled_from(known), min_size=1, max_size=3, unique=True))
        children = draw(st.permutations(list(dict.fromkeys([*chosen, *last]))))
        vote = f"{draw(st.integers(1, len(children)))}of{len(children)}"
        word = draw(st.sampled_from(["or", "and", vote, "pand", "por", "wsp", "wsp", "csp"]))
        if len(children) == 1 and word in ("wsp", "csp", "pand", "por"):
            word = "or"
        known.append(f"g{gate}")
        lines.append(" ".join(f'"{name}"' if name != word else word for name in [known[-1], word, *children]))
    words = st.lists(st.sampled_from(["fdep", "pdep=0.3", "seq", "mutex"]), max_size=2 if dependencies else 0)
    for place, word in enumerate(draw(words)):
        some = draw(st.lists(st.sampled_from(names), min_size=2, max_size=3, unique=True))
        if word in ("fdep", "pdep=0.3"):
            trigger = draw(st.sampled_from([name for name in known if name not in some] or [""]))
            some = [trigger, *some[:2]] if trigger else some
        lines.append(" ".join([f'"d{place}"', word, *(f'"{name}"' for name in some)]))
    for name in names:
        dormancy = draw(st.sampled_from(["", " dorm=0", " dorm=0.3", " dorm=1"]))
        value = draw(st.sampled_from([f"lambda={draw(st.integers(1, 9)) / 10}"] * 6 + ["prob=0.4", "lambda=0"]))
        lines.append(f'"{name}" {value}{dormancy if "lambda" in value else ""}')
    return "".join(f"{line};\n" for line in [f'toplevel "{known[-1]}"', *lines])


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
