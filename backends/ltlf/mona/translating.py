"""A formula of the core as a program for MONA, by the package `ltlf2dfa`."""

from collections.abc import Mapping
from typing import Any, Final

from backends.ltlf.formulas import Formulas, Op, Row
from rvaft.errors import TooLarge, ToolFailed, ToolMissing

OPERATORS: Final = 2_000
"""The most operators, shared subformulas written out wherever they occur: ltlf2dfa knows no sharing, and works by recursion."""


def program(formulas: Formulas, root: int, symbols: Mapping[str, str]) -> str:
    """The program; `symbols` names each atom in a way that ltlf2dfa takes. Raises `ToolMissing`, `ToolFailed`, `TooLarge`."""
    text = _text(formulas, root, symbols)
    try:
        from ltlf2dfa.base import MonaProgram  # noqa: PLC0415 -- not there on every machine
        from ltlf2dfa.parser.ltlf import LTLfParser  # noqa: PLC0415 -- not there on every machine
    except ImportError as error:
        raise ToolMissing("ltlf2dfa", remedy="run `pip install 'rvaft[mona]'`") from error
    try:
        made: Any = MonaProgram(LTLfParser()(text)).mona_program()
    except RecursionError:
        raise TooLarge("the formula is nested too deep for ltlf2dfa", limit=OPERATORS) from None
    except Exception as error:
        raise ToolFailed("ltlf2dfa", reason=f"{type(error).__name__}: {error}".splitlines()[0]) from error
    return str(made)


def _text(formulas: Formulas, root: int, symbols: Mapping[str, str]) -> str:
    """The formula in the syntax of ltlf2dfa, where `X` is the strong next; every operand in parentheses."""
    sizes: dict[int, int] = {}
    texts: dict[int, str] = {}
    for number in formulas.reachable(root):
        row = formulas.rows[number]
        sizes[number] = 1 + sum(sizes[operand] for operand in row.operands)
        if sizes[number] > OPERATORS:
            raise TooLarge("the formula, written out for ltlf2dfa, has more operators", limit=OPERATORS)
        texts[number] = _written(row, [texts[operand] for operand in row.operands], symbols)
    return texts[root]


def _written(row: Row, operands: list[str], symbols: Mapping[str, str]) -> str:
    match row.op, operands:
        case Op.TRUE, _:
            return "true"
        case Op.FALSE, _:
            return "false"
        case Op.ATOM, _:
            return symbols[row.name]
        case Op.NOT, [a]:
            return f"!({a})"
        case Op.NEXT, [a]:
            return f"X({a})"
        case Op.EVENTUALLY, [a]:
            return f"F({a})"
        case Op.UNTIL, [a, b]:
            return f"(({a}) U ({b}))"
        case Op.AND, _:
            return f"({' & '.join(operands)})"
        case Op.OR, _:
            return f"({' | '.join(operands)})"
        case _:
            raise AssertionError(row)
