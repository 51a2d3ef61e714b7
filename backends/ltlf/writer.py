"""Formulas as text in Spot's LTLf syntax; what is used more than once is written once, as a definition."""

import re
from collections import Counter
from collections.abc import Mapping
from typing import Final

from backends.ltlf.formulas import Formulas, Op

# Names that are legal in Spot's LTLf, one for each thing: an injective renaming.

RESERVED: Final = frozenset({"true", "false", "xor", "rvaft", "atom", "relevant", "ignored"})
_ILLEGAL: Final = re.compile(r"[^a-z0-9_]+")


class Names:
    """Gives out names `[a-z_][a-z0-9_]*`, never one twice."""

    def __init__(self) -> None:
        self._taken: set[str] = set(RESERVED)

    def fresh(self, wanted: str) -> str:
        """The wanted name itself where it is legal and free, else one like it."""
        name = _ILLEGAL.sub("_", wanted.lower()) or "_"
        if name[0].isdigit():
            name = f"_{name}"
        candidate, number = name, 1
        while candidate in self._taken:
            number += 1
            candidate = f"{name}_{number}"
        self._taken.add(candidate)
        return candidate


_TOKEN: Final = re.compile(r"X\[!\]|[A-Za-z0-9_]+|[^\s]")
_LEAVES: Final = frozenset({Op.TRUE, Op.FALSE, Op.ATOM})
_ASSOCIATIVE: Final = frozenset({Op.AND, Op.OR})
_PREFIX: Final = frozenset({Op.NOT, Op.NEXT, Op.EVENTUALLY})


def write(formulas: Formulas, root: int, names: Names) -> tuple[dict[str, str], str]:
    """The definitions of shared subformulas, each after those it uses, and the formula itself."""
    reachable = formulas.reachable(root)
    uses = Counter(operand for formula in reachable for operand in formulas.rows[formula].operands)
    defined: dict[int, str] = {}
    definitions: dict[str, str] = {}
    for formula in reachable:
        if uses[formula] > 1 and not _short(formulas, formula):
            text = _text(formulas, formula, defined)
            defined[formula] = names.fresh(f"s{len(defined) + 1}")
            definitions[defined[formula]] = text
    return definitions, _text(formulas, root, defined)


def symbols(definitions: Mapping[str, str], formula: str) -> int:
    """How many tokens the formula and the definitions have."""
    texts = [formula, *(f"{name} = {text}" for name, text in definitions.items())]
    return sum(len(_TOKEN.findall(text)) for text in texts)


def _short(formulas: Formulas, formula: int) -> bool:
    row = formulas.rows[formula]
    return row.op in _LEAVES or (row.op is Op.NOT and formulas.rows[row.operands[0]].op is Op.ATOM)


def _text(formulas: Formulas, root: int, defined: Mapping[int, str]) -> str:
    out: list[str] = []
    todo: list[int | str] = [root]
    while todo:
        item = todo.pop()
        if isinstance(item, str):
            out.append(item)
            continue
        if item in defined:
            out.append(defined[item])
            continue
        row = formulas.rows[item]
        inner = [_bracketed(formulas, operand, row.op, defined) for operand in row.operands]
        if row.op in _LEAVES:
            out.append(row.name or row.op.value)
        elif row.op in _PREFIX:
            sign = row.op.value
            spaced = sign if row.op is Op.NOT or len(inner[0]) == 3 else f"{sign} "
            todo.extend(reversed([spaced, *inner[0]]))
        else:
            pieces: list[int | str] = [piece for operand in inner for piece in (f" {row.op.value} ", *operand)]
            todo.extend(reversed(pieces[1:]))
    return "".join(out)


def _bracketed(formulas: Formulas, operand: int, outer: Op, defined: Mapping[int, str]) -> list[int | str]:
    op = formulas.rows[operand].op
    plain = operand in defined or op in _LEAVES or op in _PREFIX or (op is outer and op in _ASSOCIATIVE)
    return [operand] if plain else ["(", operand, ")"]
