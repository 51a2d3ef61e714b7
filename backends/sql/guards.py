"""Guards as SQL conditions, with NULL for undefined.

Guards evaluate `and` and `or` from the left, so they become CASE. Before arithmetic, a double with
an integral value becomes an integer. Calculated parts of a comparison are named and evaluated once.
"""

import re
from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Final

from backends.sql.dialects import Dialect
from rvaft.errors import NotExpressible, unwritten
from rvaft.model.guards import ARITHMETIC, COMPARISONS, UNDEFINED, Guard, Operation, Operator, value, variables
from rvaft.model.patterns import Literal, Variable
from rvaft.model.values import EXACT_INTEGERS

_NULL: Final = "NULL"
_SIGNS: Final = {Operator.EQ: "=", Operator.NE: "<>", Operator.NEGATE: "-"}
FACETS: Final = ("whole", "real", "text", "truth", "null", "key")
_FROM_TERMS: Final = COMPARISONS | {Operator.IN, Operator.STARTSWITH, Operator.ENDSWITH, Operator.CONTAINS}
"""Operators that yield Booleans from other types."""
_SIMPLE: Final = re.compile(r"[\w.]+|\(-[\w.]+\)")
MAX_NAMED: Final = 100
"""Maximum number of named parts in a comparison."""


@dataclass(frozen=True, slots=True)
class SqlTerm:
    """A value as one expression per type, at most one of them not NULL; None for impossible types.

    `total`: defined for all events. `constant`: its constant numeric value. `key`: of a variable,
    equal exactly for equal values. `plain`: of one type, and never NULL.
    """

    whole: str | None = None
    real: str | None = None
    text: str | None = None
    truth: str | None = None
    null: str | None = None
    total: bool = False
    constant: float | None = None
    key: str | None = None
    plain: bool = False

    @classmethod
    def of(cls, facets: Mapping[str, str]) -> "SqlTerm":
        """Return a variable with these columns."""
        whole, real, text, truth, null, key = map(facets.__getitem__, FACETS)
        return cls(whole, real, text, truth, null, total=True, key=key)

    @property
    def fraction(self) -> bool:
        """Whether the term is a constant with a fraction."""
        return self.whole is None and self.constant is not None


class Guards:
    """Guards in a dialect."""

    def __init__(self, dialect: Dialect) -> None:
        self.dialect = dialect
        self._named: list[list[dict[str, str]]] = []

    def literal(self, value: object) -> SqlTerm:
        """Return a constant; raises `NotExpressible` for integers beyond 64 bits."""
        match value:
            case bool():
                return SqlTerm(truth="true" if value else "false", total=True, plain=True)
            case int() | float():
                if isinstance(value, float) and value.is_integer() and abs(value) < 2**63:
                    value = int(value)
                if isinstance(value, int) and abs(value) >= 2**63:
                    reason = f"{value} is an integer of more than 64 bits"
                    raise NotExpressible(unwritten(reason))
                number = self.dialect.number(value)
                known = value if abs(value) < EXACT_INTEGERS else None
                if isinstance(value, int):
                    return SqlTerm(whole=number, total=True, constant=known, plain=True)
                return SqlTerm(real=number, total=True, constant=known, plain=True)
            case str():
                return SqlTerm(text=self.dialect.text(value), total=True, plain=True)
            case _:
                return SqlTerm(null="true", total=True)

    def condition(self, guard: Guard, binding: Mapping[str, SqlTerm]) -> str:
        """Return the SQL condition of a guard."""
        return self.term(guard, binding).truth or _NULL

    def term(self, guard: Guard, binding: Mapping[str, SqlTerm]) -> SqlTerm:
        """Return the value of a guard or of a subexpression."""
        match guard:
            case Literal(constant):
                return self.literal(constant)
            case Variable(name):
                return binding[name]
            case Operation() if not variables(guard):  # some programs evaluate constants early, and stop on errors
                constant = value(guard, {})
                return SqlTerm() if constant is UNDEFINED else self.literal(constant)
            case Operation(Operator.LIKE, (text, Literal(str() as glob))):
                matched = self.term(text, binding).text
                plain = self.term(text, binding).plain
                return SqlTerm(truth=matched and f"({self.dialect.like(matched, glob)})", plain=plain)
            case Operation(operator, operands) if operator in _FROM_TERMS:
                self._named.append([])
                terms = [self.term(operand, binding) for operand in operands]
                truth = self._applied(operator, terms).truth
                depth, named = len(self._named), self._named.pop()
                truth = self.dialect.with_parts(depth, named, truth) if truth and named else truth
                return SqlTerm(truth=truth, plain=truth is not None and all(term.plain for term in terms))
            case Operation(operator, operands):
                return self._applied(operator, [self.term(operand, binding) for operand in operands])

    def _once(self, term: SqlTerm) -> SqlTerm:
        """Return the term with names for long expressions, where a comparison can name them."""
        kinds = {"whole": term.whole, "real": term.real, "text": term.text}
        long = {
            kind: expression
            for kind, expression in kinds.items()
            if expression is not None and not _SIMPLE.fullmatch(expression)
        }
        if not (long and self._named and (term.real or term.text)):
            return term
        named = self._named[-1]
        if len(named) > MAX_NAMED:
            reason = f"a comparison has more than {MAX_NAMED} steps of calculation"
            raise NotExpressible(unwritten(reason))
        if long not in named:
            named.append(long)
        place = len(self._named), named.index(long) + 1
        columns = {kind: self.dialect.part.format(kind, *place) for kind in long}
        return replace(
            term,
            whole=columns.get("whole", term.whole),
            real=columns.get("real", term.real),
            text=columns.get("text", term.text),
        )

    def _applied(self, operator: Operator, terms: list[SqlTerm]) -> SqlTerm:
        dialect, first = self.dialect, terms[0]
        match operator:
            case Operator.AND | Operator.OR:
                both, found = operator is Operator.AND, terms[-1].truth or _NULL
                if all(one.plain and one.truth for one in terms):
                    return SqlTerm(truth=f"({f' {operator.name} '.join(str(one.truth) for one in terms)})", plain=True)
                if terms[-1].truth is None:  # a value of another type is undefined
                    found = "CAST(NULL AS BOOLEAN)"
                for one in reversed(terms[:-1]):
                    ways = (
                        f"WHEN true THEN {found} WHEN false THEN false"
                        if both
                        else f"WHEN true THEN true WHEN false THEN {found}"
                    )
                    found = f"CASE {one.truth} {ways} END" if one.truth else "CAST(NULL AS BOOLEAN)"
                return SqlTerm(truth=found)
            case Operator.NOT:
                return SqlTerm(truth=first.truth and f"(NOT {first.truth})", plain=first.plain)
            case Operator.EQ:
                return SqlTerm(truth=self.equal(first, terms[1]))
            case Operator.NE:
                return SqlTerm(truth=f"(NOT {self.equal(first, terms[1])})")
            case Operator.IN:
                return SqlTerm(truth=f"({' OR '.join(self.equal(first, one) for one in terms[1:])})")
            case Operator.STARTSWITH | Operator.ENDSWITH | Operator.CONTAINS:
                templates = {
                    "startswith": dialect.startswith,
                    "endswith": dialect.endswith,
                    "contains": dialect.contains,
                }
                some = first.text is not None and terms[1].text is not None
                return SqlTerm(
                    truth=f"({templates[operator](first.text or '', terms[1].text or '')})" if some else None
                )
            case Operator.LOWER:
                return SqlTerm(text=first.text and dialect.lower(first.text))
            case Operator.NUMBER:
                first = self._once(first)
                of_text = {kind: first.text and dialect.read_number(first.text, kind) for kind in ("whole", "real")}
                return self._once(SqlTerm(_first(first.whole, of_text["whole"]), _first(first.real, of_text["real"])))
            case Operator.MIN | Operator.MAX:
                return self._extreme(operator, terms)
            case Operator.NEGATE:
                return self._calculated("-", self.literal(0), first, real=f"(-{first.real})")
            case Operator.ABS:
                return self._once(SqlTerm(first.whole and f"abs({first.whole})", first.real and f"abs({first.real})"))
            case _ if operator in ARITHMETIC:
                return self._calculated(operator.value, first, terms[1])
            case _ if operator in COMPARISONS:
                return SqlTerm(truth=self.compared(first, operator.value, terms[1]))
            case _:
                raise NotExpressible(unwritten(f"SQL has no {operator.value}"))

    def compared(self, left: SqlTerm, sign: str, right: SqlTerm, *, texts: bool = True) -> str | None:
        """Return the comparison of two numbers or two strings; NULL for other types."""
        found = self._numbers(left, sign, right)
        if texts and left.text and right.text:
            found.append(self.dialect.ordered(left.text, sign, right.text))
        return None if not found else f"({found[0]})" if len(found) == 1 else f"coalesce({', '.join(found)})"

    def _numbers(self, left: SqlTerm, sign: str, right: SqlTerm) -> list[str]:
        mirrored = {"<": ">", "<=": ">=", ">": "<", ">=": "<="}.get(sign, sign)
        found = [f"{a} {sign} {b}" for a, b in ((left.whole, right.whole), (left.real, right.real)) if a and b]
        for whole, other, word in ((left, right, sign), (right, left, mirrored)):
            if whole.whole and other.real:
                simple = whole.constant is not None or other.constant is not None  # rounding cannot cross such a number
                cast = self._double(SqlTerm(whole.whole, constant=whole.constant))
                found.append(
                    f"{cast} {word} {other.real}" if simple else self.dialect.compare(whole.whole, word, other.real)
                )
        return found

    def equal(self, left: SqlTerm, right: SqlTerm) -> str:
        """Return deep equality of two values; NULL if one is undefined."""
        if left.key and right.key and not (left.plain or right.plain):
            return f"({left.key} = {right.key})"
        parts = self._numbers(left, "=", right)
        parts += [f"{a} = {b}" for a, b in ((left.text, right.text), (left.truth, right.truth)) if a and b]
        if left.null and right.null:
            parts.append(
                f"({left.null} AND {right.null})"
                if "true" not in (left.null, right.null)
                else right.null
                if left.null == "true"
                else left.null
            )
        if left.plain and right.plain:
            return f"({parts[0]})" if parts else "false"
        same = f"coalesce({', '.join(parts)}, false)" if parts else "false"
        known = [self._defined(term) for term in (left, right) if not term.total]
        return f"CASE WHEN {' AND '.join(known)} THEN {same} END" if known else same

    @staticmethod
    def _defined(term: SqlTerm) -> str:
        facets = [one for one in (term.whole, term.real, term.text, term.truth) if one is not None]
        return f"({' OR '.join(f'{one} IS NOT NULL' for one in facets)})" if facets else "false"

    def _calculated(self, sign: str, left: SqlTerm, right: SqlTerm, *, real: str = "") -> SqlTerm:
        dialect = self.dialect
        if sign == "/":
            a, b = (self._double(self._once(one), exact=True) for one in (left, right))
            return self._once(SqlTerm(real=dialect.finite(f"{a} / nullif({b}, 0)") if a and b else None))
        if not (left.fraction or right.fraction):  # beside a fraction, all operands are rounded
            left, right = self._mathematical(left), self._mathematical(right)
        both = left.whole is not None and right.whole is not None
        whole = dialect.checked(f"{left.whole} {sign} {right.whole}") if both else None
        a, b = self._double(left), self._double(right)
        if a is None or b is None or not (left.real or right.real):
            return self._once(SqlTerm(whole))
        if both and not (left.real and right.real):  # the other operand is always an integer
            a, b = left.real or a, right.real or b
        found = real or dialect.finite(f"{a} {sign} {b}")
        if both and left.real and right.real:
            found = f"CASE WHEN {left.whole} IS NULL OR {right.whole} IS NULL THEN {found} END"
        return self._once(SqlTerm(whole, found))

    def _mathematical(self, term: SqlTerm) -> SqlTerm:
        """Return a number for arithmetic: an integral double as an integer, an error beyond 64
        bits.
        """
        if term.real is None:
            return term
        if term.total and term.key is None:  # a literal
            reason = f"{term.real} is an integer of more than 64 bits"
            raise NotExpressible(unwritten(reason))
        term = self._once(term)
        whole = _first(term.whole, self.dialect.integral(term.real))
        return self._once(SqlTerm(whole, self.dialect.fractional(term.real)))

    def _double(self, term: SqlTerm, *, exact: bool = False) -> str | None:
        """Return a number as a double; `exact` raises a runtime error for inexact integers."""
        whole = term.whole
        if whole is not None and exact and term.constant is None:
            if term.total and term.key is None:  # a literal
                reason = f"it divides {whole}, an integer beyond 2**53"
                raise NotExpressible(unwritten(reason))
            too_large = self.dialect.checked(f"{whole} * 1024")  # an error beyond 2^53
            whole = f"CASE WHEN {too_large} IS NOT NULL THEN {whole} END"
        if term.constant is not None:
            return self.dialect.number(float(term.constant))
        return _first(term.real, whole and self.dialect.cast(whole, self.dialect.real))

    def _extreme(self, operator: Operator, terms: list[SqlTerm]) -> SqlTerm:
        if all(term.whole and not (term.real or term.text) for term in terms):
            word = "least" if operator is Operator.MIN else "greatest"
            return SqlTerm(self.dialect.least(word, [term.whole or "" for term in terms]))
        found = SqlTerm(terms[0].whole, terms[0].real)
        for term in terms[1:]:
            sign = "<" if operator is Operator.MIN else ">"
            closer = self.compared(term, sign, found, texts=False)
            ways = [
                f"CASE {closer} WHEN true THEN {a or _NULL} WHEN false THEN {b or _NULL} END"
                if closer and (a or b)
                else None
                for a, b in ((term.whole, found.whole), (term.real, found.real))
            ]
            found = self._once(SqlTerm(ways[0], ways[1]))
        return found


def _first(one: str | None, other: str | None) -> str | None:
    return f"coalesce({one}, {other})" if one and other else one or other
