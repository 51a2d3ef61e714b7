r"""Event types as the paper writes them: a pattern, and the guards whose last variable the event binds behind `with`.

`with` of RML knows numbers only; a comparison with a string, and one of two variables by `!=`, become event types of
their own that stand beside the event: `(move(newWp) /\ not_move)`.
"""

from collections.abc import Iterable
from dataclasses import dataclass, field
from decimal import Decimal

from backends.rml.words import LARGEST, RESERVED, quoted
from rvaft.errors import NotExpressible
from rvaft.guards import Guard, Operation, Operator
from rvaft.guards import variables as guard_variables
from rvaft.patterns import Anything, ListPattern, Literal, ObjectPattern, Pattern, Variable
from rvaft.values import Scalar

AND = " /\\ "
_WORDS = {Operator.AND: "&&", Operator.OR: "||"}
_FLIPPED = {
    Operator.LT: Operator.GE,
    Operator.GE: Operator.LT,
    Operator.GT: Operator.LE,
    Operator.LE: Operator.GT,
    Operator.EQ: Operator.NE,
    Operator.NE: Operator.EQ,
}


@dataclass
class Declarations:
    """The event types written so far; equal ones are written once."""

    semantics: str
    lines: list[str] = field(default_factory=list)
    _known: dict[str, str] = field(default_factory=dict)
    _variables: dict[str, str] = field(default_factory=dict)
    _taken: set[str] = field(default_factory=set)

    def refuse(self, reason: str, node: str) -> NotExpressible:
        """The error for something that RML cannot say."""
        return NotExpressible(reason, backend="rml-paper", semantics=self.semantics, nodes=[node])

    def variable(self, name: str) -> str:
        """A variable of the tree as RML writes it: lower case."""
        if name not in self._variables:
            self._variables[name] = self._fresh(name[:1].lower() + name[1:])
        return self._variables[name]

    def _fresh(self, wish: str) -> str:
        base = "".join(c if c.isascii() and (c.isalnum() or c == "_") else "_" for c in wish)
        base = base[:1].lower() + base[1:] if base[:1].isalpha() else f"e{base}"
        name, number = base, 1
        while name in self._taken or name in RESERVED:
            number += 1
            name = f"{base}_{number}"
        self._taken.add(name)
        return name

    def declare(self, wish: str, parameters: Iterable[str], matches: str) -> str:
        """An event type with that right-hand side; how it is called in an expression."""
        given = ", ".join(parameters)
        call = f"({given})" if given else ""
        key = f"{call} {matches}"
        if key not in self._known:
            self._known[key] = self._fresh(wish)
            self.lines.append(f"{self._known[key]}{call} {matches};")
        return f"{self._known[key]}{call}"

    # -- patterns ------------------------------------------------------------------------------------------------------

    def pattern(self, pattern: Pattern, node: str) -> str:
        """A pattern; its rigid variables are left as parameters."""
        match pattern:
            case Anything():
                return "_"
            case Variable(name):
                return self.variable(name if not name.startswith("_") else f"local{name}")
            case Literal(value):
                return self._literal(value, node)
            case ObjectPattern(fields):
                return "{" + ", ".join(f"{quoted(name)}: {self.pattern(p, node)}" for name, p in fields) + "}"
            case ListPattern(items):
                return "[" + ", ".join(self.pattern(item, node) for item in items) + "]"

    def _literal(self, value: Scalar, node: str) -> str:
        match value:
            case None:
                return "null"
            case bool():
                return "true" if value else "false"
            case str():
                return quoted(value)
            case _ if value < 0 or abs(value) > LARGEST:
                raise self.refuse(f"RML has no number {value} in a pattern", node)
            case _:
                return format(Decimal(repr(value)), "f")

    # -- guards --------------------------------------------------------------------------------------------------------

    def data(self, guard: Guard, node: str) -> str:
        """A guard over numbers as a data expression, every operation in parentheses."""
        match guard:
            case Variable(name):
                return self.variable(name)
            case Literal(value) if isinstance(value, (int, float)) and not isinstance(value, bool):
                digits = format(Decimal(repr(abs(value))), "f")
                return digits if value >= 0 else f"(-{digits})"
            case Operation(Operator.NEGATE, (operand,)):
                return f"(-{self.data(operand, node)})"
            case Operation(Operator.NOT, (Operation(operator, operands),)) if operator in _FLIPPED:
                return self.data(Operation(_FLIPPED[operator], operands), node)
            case Operation(operator, operands) if operator is not Operator.NOT:
                return f"({f' {_WORDS.get(operator, operator)} '.join(self.data(o, node) for o in operands)})"
            case _:
                raise self.refuse("a guard that is not a comparison of numbers", node)

    def event(self, wish: str, pattern: Pattern, guards: Iterable[Guard], node: str) -> str:
        """One event with the guards that are checked when it comes, as a term."""
        numeric: list[str] = []
        beside: list[str] = []
        for guard in (part for whole in guards for part in _conjuncts(whole)):
            other = self._beside(wish, pattern, guard, node)
            (beside if other else numeric).append(other or self.data(guard, node))
        names = dict.fromkeys((*_names(pattern), *(v for g in guards for v in guard_variables(g) if numeric)))
        parameters = [self.variable(name) for name in names]
        condition = f" with {' && '.join(numeric)}" if numeric else ""
        main = self.declare(wish, parameters, f"matches {self.pattern(pattern, node)}{condition}")
        return f"({AND.join([main, *beside])})" if beside else main

    def _beside(self, wish: str, pattern: Pattern, guard: Guard, node: str) -> str | None:
        """A comparison with a string, or an inequality of two variables, as an event type of its own."""
        filled: Pattern
        match guard:
            case Operation(Operator.EQ | Operator.NE as operator, (Variable(name), Literal(str() as text))):
                negated, filled, parameters = operator is Operator.NE, Literal(text), []
            case Operation(Operator.NE, (Variable(left), Variable(right))):
                name, other = (left, right) if left in _names(pattern) else (right, left)
                negated, filled, parameters = True, Variable(other), [self.variable(other)]
            case _:
                return None
        if name not in _names(pattern):
            raise self.refuse(f"{name} is not bound by the event that checks it", node)
        kept = _only(pattern, name, filled)
        matches = f"{'not ' if negated else ''}matches {self.pattern(kept, node)}"
        return self.declare(f"{'not_' if negated else 'is_'}{wish}", parameters, matches)


def _conjuncts(guard: Guard) -> list[Guard]:
    if isinstance(guard, Operation) and guard.operator is Operator.AND:
        return [part for operand in guard.operands for part in _conjuncts(operand)]
    return [guard]


def _names(pattern: Pattern) -> list[str]:
    match pattern:
        case Variable(name):
            return [] if name.startswith("_") else [name]
        case ObjectPattern(fields):
            return [name for _, inner in fields for name in _names(inner)]
        case ListPattern(items):
            return [name for inner in items for name in _names(inner)]
        case _:
            return []


def _only(pattern: Pattern, name: str, filled: Pattern) -> Pattern:
    """The pattern with one variable replaced and the others open."""
    match pattern:
        case Variable(other):
            return filled if other == name else Anything()
        case ObjectPattern(fields):
            return ObjectPattern(tuple((field_, _only(inner, name, filled)) for field_, inner in fields))
        case ListPattern(items):
            return ListPattern(tuple(_only(inner, name, filled) for inner in items))
        case _:
            return pattern
