r"""The event types of an RML text, declared on demand, and guards as conditions that RML can check.

Each event type of the tree is declared once. An occurrence uses that type or a type derived from
it. A derived type that binds has numeric comparisons in its `with`. Other conditions become
separate types that bind nothing and are joined by `/\`, because a negated type never binds.

A guard is three-valued; a condition states when a guard is true. A condition consists of `and` and
`or` over numeric comparisons, which fail on other values; over *equalities* of a variable with a
literal or variable; and of `not` before either kind of `==`.
"""

from collections import Counter
from collections.abc import Callable, Collection, Iterable, Sequence
from dataclasses import dataclass, replace
from itertools import product
from typing import Final, TypeGuard, assert_never

from backends.rml.writer.terms import RmlNames, applied, in_arithmetic, in_patterns, quoted, spellings
from rvaft.capabilities import CALCULATING
from rvaft.core.conditions import (
    ComparisonTest,
    ConditionTest,
    EqualityTest,
    SortTest,
    TruthConditions,
    TruthTest,
    spelled,
)
from rvaft.model.guards import FUNCTIONS, JUNCTIONS, Guard, Operation, Operator, TermSort, conjuncts, variables
from rvaft.model.nodes import Argument, On
from rvaft.model.patterns import Anything, ListPattern, Literal, ObjectPattern, Pattern, SomeItem, Variable
from rvaft.model.tree import RVAFT
from rvaft.model.values import is_number

ALWAYS: Final = Operation(Operator.AND, ())
NEVER: Final = Operation(Operator.OR, ())


NUMERIC: Final = CALCULATING
"""Operators that RML calculates; its `min` and `max` take two numbers."""
TEXTS: Final = FUNCTIONS - NUMERIC


class Inexpressible(Exception):
    """A guard that no RML event type can check; the message is the reason."""


def _without(operator: Operator) -> Inexpressible:
    return Inexpressible(f"RML cannot search strings, and has no {operator}")


def _is_equality(condition: Guard) -> TypeGuard[Operation]:
    return isinstance(condition, Operation) and (
        condition.operator is Operator.EQ and isinstance(condition.operands[0], Variable)
    )


def _is_numeric(condition: Guard) -> bool:
    match condition:
        case Operation(operator, parts) if operator in JUNCTIONS:
            return all(map(_is_numeric, parts))
        case Operation(operator):
            return operator is not Operator.NOT and not _is_equality(condition)
        case _:
            return False


def when_true(guard: Guard) -> Guard:
    """Return the condition under which a guard holds; raises `Inexpressible`."""
    return spelled(TruthConditions().of(guard), _tested, lambda every, parts: _every(parts) if every else _some(parts))


def _tested(test: ConditionTest) -> Guard:
    match test:
        case TruthTest(Operation(operator)):
            raise _without(operator)
        case TruthTest(term, wanted):
            return Operation(Operator.EQ, (term, Literal(wanted)))
        case EqualityTest(left, right, wanted) if left == right:
            return ALWAYS if wanted else NEVER
        case EqualityTest(left, right, wanted):
            equal = Operation(Operator.EQ, (left, right) if isinstance(left, Variable) else (right, left))
            return equal if wanted else Operation(Operator.NOT, (equal,))
        case ComparisonTest(TermSort.TEXT, left, _, right):
            for side in (left, right):
                if isinstance(side, Operation):
                    raise _without(side.operator)
            if isinstance(left, Literal) or isinstance(right, Literal):
                raise Inexpressible("RML cannot order strings")
            return NEVER
        case ComparisonTest(_, left, sign, right):
            sides = (left, right) if isinstance(left, Operation) or sign not in _EQUALITIES else (right, left)
            compared = Operation(_EQUALITIES.get(sign) or Operator(sign), sides)
            return compared if all(map(_is_calculable, sides)) else NEVER
        case SortTest(term, TermSort.NUMBER, wanted):
            number = term if isinstance(term, Operation) else Operation(Operator.NEGATE, (term,))
            known = Operation(Operator.EQ, (number, number))  # arithmetic is defined for numbers only
            return NEVER if not _is_calculable(term) else known if wanted else Operation(Operator.NOT, (known,))
        case SortTest(term):
            raise _without(term.operator if isinstance(term, Operation) else Operator.LT)
        case _:
            assert_never(test)


_EQUALITIES: Final = {"=": Operator.EQ, "<>": Operator.NE}


def _is_calculable(guard: Guard) -> bool:
    match guard:
        case Literal(constant):
            return is_number(constant)
        case Variable():
            return True
        case Operation(operator) if operator in TEXTS:
            raise _without(operator)
        case Operation(operator, operands):
            return operator in NUMERIC and all(map(_is_calculable, operands))


def _every(parts: Iterable[Guard]) -> Guard:
    flat = [inner for part in parts for inner in conjuncts(part)]
    if NEVER in flat:
        return NEVER
    return flat[0] if len(flat) == 1 else Operation(Operator.AND, tuple(dict.fromkeys(flat)))


def _some(parts: Iterable[Guard]) -> Guard:
    flat: list[Guard] = []
    for part in parts:
        flat.extend(part.operands if isinstance(part, Operation) and part.operator is Operator.OR else (part,))
    if ALWAYS in flat:
        return ALWAYS
    return flat[0] if len(flat) == 1 else Operation(Operator.OR, tuple(dict.fromkeys(flat)))


def _data(guard: Guard, names: dict[str, str]) -> str:
    match guard:
        case Literal(constant):
            return in_arithmetic(constant)  # type: ignore[arg-type]
        case Variable(name):
            return names[name]
        case Operation(Operator.AND | Operator.OR as operator, ()):
            return "0 == 0" if operator is Operator.AND else "0 == 1"
        case Operation(Operator.AND | Operator.OR as operator, operands):
            sign = " && " if operator is Operator.AND else " || "
            return sign.join(f"({_data(operand, names)})" for operand in operands)
        case Operation(Operator.ABS, (operand,)):
            return f"abs({_data(operand, names)})"
        case Operation(Operator.MIN | Operator.MAX as operator, (first, *others)):
            rest = Operation(operator, tuple(others)) if len(others) > 1 else others[0]
            return f"{operator}({_data(first, names)}, {_data(rest, names)})"
        case Operation(operator, operands):
            texts = [f"({_data(o, names)})" if isinstance(o, Operation) else _data(o, names) for o in operands]
            return f"-{texts[0]}" if operator is Operator.NEGATE else f" {operator.value} ".join(texts)


# Event types.


def is_register(argument: Argument) -> TypeGuard[Variable]:
    """Return whether an argument is a variable of the RML text."""
    return isinstance(argument, Variable) and "#" not in argument.name


@dataclass(frozen=True, slots=True)
class Call:
    """An event type with arguments; if `event` is None, the default event of node `default`."""

    event: str | None
    arguments: tuple[Argument, ...] = ()
    default: str = ""

    @property
    def registers(self) -> tuple[str, ...]:
        """The distinct registers among the arguments."""
        return tuple(dict.fromkeys(a.name for a in self.arguments if is_register(a)))

    def pattern(self, tree: RVAFT) -> Pattern:
        """Return the pattern of the events, with registers and places as variables."""
        if self.event is None:
            return ObjectPattern((("event", Literal(self.default)),))
        return tree.instantiate(On(self.event, self.arguments))


class RmlTypes:
    """Event types under construction; `lines` are the declarations in order."""

    def __init__(self, tree: RVAFT) -> None:
        self.tree = tree
        self.lines: list[str] = []
        self._names = RmlNames()
        self._bases: dict[tuple[str | None, str], tuple[str, list[Literal]]] = {}
        """The declared event types, with the literals that patterns cannot hold as their last
        arguments.
        """
        self._declared: dict[tuple[object, ...], str] = {}

    def observed(self, call: Call, conditions: Sequence[tuple[Guard, str]], node: str) -> list[str]:
        """Return the applied types that together match a call under conditions; the first one
        binds.
        """
        folded = [condition for condition, _ in conditions if _is_numeric(condition)]
        names = dict.fromkeys(name for condition, name in conditions if _is_numeric(condition) and name != node)
        binding = self._binding(call, folded, "_".join([node, *names]))
        others = [(c, name if name != node else f"{node}_when") for c, name in conditions if not _is_numeric(c)]
        return [binding, *(self._satisfying(call, condition, name) for condition, name in others)]

    def checked(self, call: Call, condition: Guard, hint: str) -> list[str]:
        """Return types that match events of a call that satisfy the condition, and bind nothing."""
        if condition == ALWAYS:
            parents, extra = self._parents(call, *self._scope(call, ()), ())
            return [self._declare((), parents, extra, hint)] if extra else parents
        if _is_numeric(condition) or _is_equality(condition):
            return [self._satisfying(call, condition, hint)]
        other = self.neither(self.checked(call, ALWAYS, hint), f"not_{hint}")
        return [self.neither([other, self._violating(call, condition, hint, f"not_{hint}")], hint)]

    def union(self, parents: Iterable[str], hint: str) -> str:
        """Return a type that matches what any parent matches."""
        return self._declare((), list(parents), (), hint)

    def neither(self, parents: Iterable[str], hint: str) -> str:
        """Return a type that matches what no parent matches."""
        return self._declare((), list(parents), (), hint, negated=True)

    # Derived types.

    def _scope(self, call: Call, registers: Iterable[str]) -> tuple[dict[str, str], RmlNames]:
        local, names = RmlNames(), dict[str, str]()
        parameters = self.tree.events[call.event].parameters if call.event is not None else ()
        for argument, parameter in zip(call.arguments, parameters, strict=True):
            if isinstance(argument, Variable) and argument.name not in names:
                names[argument.name] = local.fresh(parameter, otherwise="p")
        for register in registers:
            if register not in names:
                names[register] = local.fresh(register)
        return names, local

    def _binding(self, call: Call, folded: list[Guard], hint: str) -> str:
        name, hidden = self._base(call)
        if not folded and not hidden and all(map(is_register, call.arguments)):
            return applied(name, [a.name for a in call.arguments if isinstance(a, Variable)])
        return self._derived(call, Operation(Operator.AND, tuple(folded)), folded, hint, call.registers)

    def _derived(
        self, call: Call, condition: Guard, conditions: Iterable[Guard], hint: str, binding: Sequence[str] = ()
    ) -> str:
        """Return a type with numeric conditions in its `with`; it binds the registers `binding`."""
        outside = _outside(call, condition)
        registers = tuple(dict.fromkeys((*binding, *outside)))
        names, local = self._scope(call, outside)
        parents, more = self._parents(call, names, local, {*registers, *variables(condition)})
        more += [_data(one, names) for one in conditions]
        return applied(self._declare([names[r] for r in registers], parents, more, hint), registers)

    def _satisfying(self, call: Call, condition: Guard, hint: str) -> str:
        registers = _outside(call, condition)
        match condition:
            case Operation(Operator.NOT, (inner,)):
                return self._violating(call, inner, hint, hint)
            case _ if _is_equality(condition):
                return self._equal(call, condition, hint)
            case Operation(Operator.OR, parts) if not _is_numeric(condition):
                types = [self._satisfying(call, part, hint) for part in parts]
                return applied(self._declare(registers, types, (), hint), registers)
            case Operation(Operator.AND, parts) if not _is_numeric(condition):
                types = [self._violating(call, part, hint, f"not_{hint}") for part in parts]
                return applied(self._declare(registers, types, (), hint, negated=True), registers)
            case _:
                return self._derived(call, condition, [condition], hint)

    def _violating(self, call: Call, condition: Guard, hint: str, negation: str) -> str:
        match condition:
            case Operation(Operator.NOT, (inner,)):
                return self._satisfying(call, inner, hint)
            case _ if _is_equality(condition):
                return self._equal(call, condition, hint, negated=True)
            case _:
                registers, satisfied = _outside(call, condition), self._satisfying(call, condition, hint)
                return applied(self._declare(registers, [satisfied], (), negation, negated=True), registers)

    def _equal(self, call: Call, equality: Operation, hint: str, *, negated: bool = False) -> str:
        left, right = equality.operands
        registers = _outside(call, equality)
        if left not in call.arguments and isinstance(right, Variable) and right in call.arguments:
            left, right = right, left
        assert isinstance(left, Variable)
        assert isinstance(right, Variable | Literal)
        if left not in call.arguments:  # two values of earlier events
            same = self._once(("same",), "same", lambda name: f"{name}(value, value) matches {{}};")
            texts: Sequence[str] = [right.name] if isinstance(right, Variable) else _spelled(right)
            parents, more = [applied(same, [left.name, text]) for text in texts], list[str]()
            parameters = registers
        else:
            changed = replace(call, arguments=tuple(right if a == left else a for a in call.arguments))
            names, local = self._scope(changed, registers)
            parents, more = self._parents(changed, names, local, registers)
            parameters = [names[register] for register in registers]
        return applied(self._declare(parameters, parents, more, hint, negated=negated), registers)

    def _declare(
        self,
        parameters: Sequence[str],
        parents: Sequence[str],
        conditions: Sequence[str],
        hint: str,
        *,
        negated: bool = False,
    ) -> str:
        """Return a derived type.

        A negated type with a `with` is derived from the positive one, because `not … with` negates
        only the parents.
        """
        if negated and conditions:
            parents, conditions = [applied(self._declare(parameters, parents, conditions, hint), parameters)], ()
        key = (tuple(parameters), tuple(parents), tuple(conditions), negated)
        whole = conditions[0] if len(conditions) == 1 else " && ".join(f"({condition})" for condition in conditions)
        body = f"{'not ' if negated else ''}matches {' | '.join(parents)}{' with ' if conditions else ''}{whole};"
        return self._once(key, hint, lambda name: f"{applied(name, parameters)} {body}")

    def _once(self, key: tuple[object, ...], hint: str, line: Callable[[str], str]) -> str:
        if key not in self._declared:
            self._declared[key] = name = self._names.fresh(hint)
            self.lines.append(line(name))
        return self._declared[key]

    # Types of the tree.

    def _parents(
        self, call: Call, names: dict[str, str], local: RmlNames, used: Collection[str]
    ) -> tuple[list[str], list[str]]:
        """Return the base type per spelling of literals, and comparisons of large integers.

        A variable that occurs once and is not `used` is written `_`.
        """
        base, hidden = self._base(call)
        counts = Counter(argument.name for argument in call.arguments if isinstance(argument, Variable))
        options: list[tuple[str, ...]] = []
        conditions: list[str] = []
        for argument in (*call.arguments, *hidden):
            match argument:
                case Literal(constant):
                    texts = spellings(constant)
                    if texts is None:
                        texts = (local.fresh("number"),)
                        conditions.append(f"{texts[0]} == {in_arithmetic(constant)}")  # type: ignore[arg-type]
                    options.append(texts)
                case Variable(name):
                    options.append((names[name] if counts[name] > 1 or name in used else "_",))
                case Anything():
                    options.append(("_",))
                case _:
                    assert_never(argument)
        return [applied(base, chosen) for chosen in product(*options)], conditions

    def _base(self, call: Call) -> tuple[str, list[Literal]]:
        key = (call.event, call.default)
        if key not in self._bases:
            self._bases[key] = self._declare_base(call)
        return self._bases[key]

    def _declare_base(self, call: Call) -> tuple[str, list[Literal]]:
        if call.event is None:
            name = self._names.fresh(call.default)
            self.lines.append(f"{name} matches {{ 'event': {quoted(call.default)} }};")
            return name, []
        event, local = self.tree.events[call.event], RmlNames()
        parameters = {parameter: local.fresh(parameter, otherwise="p") for parameter in event.parameters}
        names, hidden = list(parameters.values()), list[Literal]()

        def text(pattern: Pattern) -> str:
            match pattern:
                case Literal(constant) if in_patterns(constant):
                    texts = _spelled(pattern)
                    return texts[0] if len(texts) == 1 else f"({' | '.join(texts)})"
                case Literal():
                    hidden.append(pattern)
                    names.append(local.fresh("number"))
                    return names[-1]
                case Variable(parameter):
                    return parameters[parameter]
                case Anything():
                    return "_"
                case ObjectPattern(fields):
                    inner = ", ".join(f"{quoted(key)}: {text(part)}" for key, part in fields)
                    return f"{{ {inner} }}" if inner else "{}"
                case ListPattern(items):
                    return f"[{', '.join(text(item) for item in items)}]"
                case SomeItem():
                    raise AssertionError("refused by the capabilities")

        body = text(event.pattern)
        name = self._names.fresh(call.event)
        self.lines.append(f"{applied(name, names)} matches {body};")
        return name, hidden


def _spelled(literal: Literal) -> tuple[str, ...]:
    return spellings(literal.value) or (in_arithmetic(literal.value),)  # type: ignore[arg-type]


def _outside(call: Call, condition: Guard) -> list[str]:
    return [name for name in variables(condition) if is_register(Variable(name)) and name not in call.registers]
