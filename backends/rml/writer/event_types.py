r"""The event types of an RML text, declared as they are needed.

Each event type of the tree is declared once; what an occurrence looks for is that type itself or one derived from it. A derived
type that binds folds comparisons of numbers into its `with`; any other condition becomes a type of its own that binds nothing and is
asked beside it (`/\`), because the negation of a type never binds.
"""

from collections import Counter
from collections.abc import Callable, Collection, Iterable, Sequence
from dataclasses import dataclass, replace
from itertools import product
from typing import assert_never

from backends.rml.writer.conditions import ALWAYS, is_equality, is_numeric
from backends.rml.writer.names import RmlNames, identifier, in_arithmetic, in_patterns, quoted, spellings
from backends.rml.writer.observations import Call, is_register
from rvaft.model.guards import Guard, Operation, Operator, variables
from rvaft.model.patterns import Anything, ListPattern, Literal, ObjectPattern, Pattern, Variable
from rvaft.model.tree import RVAFT


class _Scope:
    """The variables of one declaration: registers and places of the call are called after the parameters of its event type."""

    def __init__(self, tree: RVAFT, call: Call, registers: Iterable[str]) -> None:
        self.local = RmlNames()
        self.names: dict[str, str] = {}
        parameters = tree.events[call.event].parameters if call.event is not None else ()
        for argument, parameter in zip(call.arguments, parameters, strict=True):
            if isinstance(argument, Variable) and argument.name not in self.names:
                self.names[argument.name] = self.local.fresh(identifier(parameter, otherwise="p"))
        for register in registers:
            if register not in self.names:
                self.names[register] = self.local.fresh(register)

    def data(self, guard: Guard) -> str:
        """A condition over numbers as a data expression; every operation in parentheses but the outermost."""
        match guard:
            case Literal(constant):
                return in_arithmetic(constant)  # type: ignore[arg-type]
            case Variable(name):
                return self.names[name]
            case Operation(Operator.AND | Operator.OR as operator, ()):
                return "0 == 0" if operator is Operator.AND else "0 == 1"
            case Operation(Operator.AND | Operator.OR as operator, operands):
                sign = " && " if operator is Operator.AND else " || "
                return sign.join(f"({self.data(operand)})" for operand in operands)
            case Operation(operator, operands):
                texts = [f"({self.data(o)})" if isinstance(o, Operation) else self.data(o) for o in operands]
                return f"-{texts[0]}" if operator is Operator.NEGATE else f" {operator.value} ".join(texts)


@dataclass(frozen=True, slots=True)
class _BaseType:
    """A declared event type of the tree; `hidden` are the literals that no pattern can hold, its last arguments."""

    name: str
    hidden: tuple[Literal, ...] = ()


class RmlTypes:
    """Event types under construction; `lines` are the declarations in order."""

    def __init__(self, tree: RVAFT) -> None:
        self.tree = tree
        self.lines: list[str] = []
        self._names = RmlNames()
        self._bases: dict[tuple[str | None, str], _BaseType] = {}
        self._declared: dict[tuple[object, ...], str] = {}

    # -- what expressions use ---------------------------------------------------------------------------------------

    def observed(self, call: Call, conditions: Sequence[tuple[Guard, str]], node: str) -> list[str]:
        """The types, applied, that together match the events of a call that fulfil the conditions; the first one binds.

        `node` and the names beside the conditions, of the nodes they come from, are what the types are called after.
        """
        folded = [condition for condition, _ in conditions if is_numeric(condition)]
        names = dict.fromkeys(name for condition, name in conditions if is_numeric(condition) and name != node)
        binding = self._binding(call, folded, "_".join([node, *names]))
        others = [(c, name if name != node else f"{node}_when") for c, name in conditions if not is_numeric(c)]
        return [binding, *(self._asked(call, condition, name) for condition, name in others)]

    def checked(self, call: Call, condition: Guard, hint: str) -> list[str]:
        """Types that bind nothing, as parents of another: any of them matches the events of a call that fulfil the condition."""
        if condition == ALWAYS:
            parents, extra = self._parents(call, _Scope(self.tree, call, ()), ())
            return [self._declare((), parents, extra, hint)] if extra else parents
        if is_numeric(condition) or is_equality(condition):
            return [self._asked(call, condition, hint)]
        other = self.neither(self.checked(call, ALWAYS, hint), f"not_{hint}")
        return [self.neither([other, self._refused(call, condition, hint)], hint)]

    def union(self, parents: Iterable[str], hint: str) -> str:
        """A type that matches what any of the parents match."""
        return self._declare((), list(parents), (), hint)

    def neither(self, parents: Iterable[str], hint: str) -> str:
        """A type that matches what none of the parents match."""
        return self._declare((), list(parents), (), hint, negated=True)

    # -- derived types ----------------------------------------------------------------------------------------------

    def _binding(self, call: Call, folded: list[Guard], hint: str) -> str:
        base = self._base(call)
        if not folded and not base.hidden and all(map(is_register, call.arguments)):
            return _applied(base.name, [a.name for a in call.arguments if isinstance(a, Variable)])
        whole = Operation(Operator.AND, tuple(folded))
        extra = _outside(call, whole)
        registers = tuple(dict.fromkeys((*call.registers, *extra)))
        scope = _Scope(self.tree, call, extra)
        parents, more = self._parents(call, scope, {*registers, *variables(whole)})
        conditions = [*more, *map(scope.data, folded)]
        return _applied(self._declare([scope.names[r] for r in registers], parents, conditions, hint), registers)

    def _asked(self, call: Call, condition: Guard, hint: str) -> str:
        """A type that matches where the condition holds of an event that matches the call; it binds nothing."""
        registers = _outside(call, condition)
        match condition:
            case Operation(Operator.NOT, (inner,)) if is_equality(inner):
                return self._equal(call, inner, hint, negated=True)
            case _ if is_equality(condition):
                return self._equal(call, condition, hint)
            case Operation(Operator.NOT, (inner,)):
                name = self._declare(registers, [self._asked(call, inner, hint)], (), hint, negated=True)
            case Operation(Operator.OR, parts) if not is_numeric(condition):
                name = self._declare(registers, [self._asked(call, part, hint) for part in parts], (), hint)
            case Operation(Operator.AND, parts) if not is_numeric(condition):
                refusals = [self._refused(call, part, hint) for part in parts]
                name = self._declare(registers, refusals, (), hint, negated=True)
            case _:
                scope = _Scope(self.tree, call, registers)
                parents, more = self._parents(call, scope, variables(condition))
                conditions = [*more, scope.data(condition)]
                name = self._declare([scope.names[r] for r in registers], parents, conditions, hint)
        return _applied(name, registers)

    def _refused(self, call: Call, condition: Guard, hint: str) -> str:
        """A type that matches where the condition fails of an event that matches the call."""
        match condition:
            case Operation(Operator.NOT, (inner,)):
                return self._asked(call, inner, hint)
            case _ if is_equality(condition):
                return self._equal(call, condition, hint, negated=True)
            case _:
                registers = _outside(call, condition)
                parents = [self._asked(call, condition, hint)]
                return _applied(self._declare(registers, parents, (), f"not_{hint}", negated=True), registers)

    def _equal(self, call: Call, equality: Guard, hint: str, *, negated: bool = False) -> str:
        assert isinstance(equality, Operation)
        left, right = equality.operands
        registers = _outside(call, equality)
        if left not in call.arguments and isinstance(right, Variable) and right in call.arguments:
            left, right = right, left
        assert isinstance(left, Variable)
        assert isinstance(right, Variable | Literal)
        if left not in call.arguments:  # two values that earlier events have given
            same = self._once(("same",), "same", lambda name: f"{name}(value, value) matches {{}};")
            texts: Sequence[str] = [right.name] if isinstance(right, Variable) else _spelled(right)
            parents, more = [_applied(same, [left.name, text]) for text in texts], list[str]()
            parameters = registers
        else:
            changed = replace(
                call, arguments=tuple(right if argument == left else argument for argument in call.arguments)
            )
            scope = _Scope(self.tree, changed, registers)
            parents, more = self._parents(changed, scope, registers)
            parameters = [scope.names[register] for register in registers]
        return _applied(self._declare(parameters, parents, more, hint, negated=negated), registers)

    def _declare(
        self,
        parameters: Sequence[str],
        parents: Sequence[str],
        conditions: Sequence[str],
        hint: str,
        *,
        negated: bool = False,
    ) -> str:
        """A derived type; the negation of one with a `with` goes through the positive one, for `not … with` means something else."""
        if negated and conditions:
            parents, conditions = [_applied(self._declare(parameters, parents, conditions, hint), parameters)], ()
        key = (tuple(parameters), tuple(parents), tuple(conditions), negated)
        whole = conditions[0] if len(conditions) == 1 else " && ".join(f"({condition})" for condition in conditions)
        body = f"{'not ' if negated else ''}matches {' | '.join(parents)}{' with ' if conditions else ''}{whole};"
        return self._once(key, hint, lambda name: f"{_applied(name, parameters)} {body}")

    def _once(self, key: tuple[object, ...], hint: str, line: Callable[[str], str]) -> str:
        if key not in self._declared:
            self._declared[key] = name = self._names.fresh(hint)
            self.lines.append(line(name))
        return self._declared[key]

    # -- the types of the tree --------------------------------------------------------------------------------------

    def _parents(self, call: Call, scope: _Scope, used: Collection[str]) -> tuple[list[str], list[str]]:
        """The base type applied to the arguments, once for each spelling of a literal, and comparisons for very large integers.

        A variable that is not `used` elsewhere and stands but once is written `_`.
        """
        base = self._base(call)
        counts = Counter(argument.name for argument in call.arguments if isinstance(argument, Variable))
        options: list[tuple[str, ...]] = []
        conditions: list[str] = []
        for argument in (*call.arguments, *base.hidden):
            match argument:
                case Literal(constant):
                    texts = spellings(constant)
                    if texts is None:
                        texts = (scope.local.fresh("number"),)
                        conditions.append(f"{texts[0]} == {in_arithmetic(constant)}")  # type: ignore[arg-type]
                    options.append(texts)
                case Variable(name):
                    options.append((scope.names[name] if counts[name] > 1 or name in used else "_",))
                case Anything():
                    options.append(("_",))
                case _:
                    assert_never(argument)
        return [_applied(base.name, chosen) for chosen in product(*options)], conditions

    def _base(self, call: Call) -> _BaseType:
        key = (call.event, call.default)
        if key not in self._bases:
            self._bases[key] = self._declare_base(call)
        return self._bases[key]

    def _declare_base(self, call: Call) -> _BaseType:
        if call.event is None:
            name = self._names.fresh(call.default)
            self.lines.append(f"{name} matches {{ 'event': {quoted(call.default)} }};")
            return _BaseType(name)
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

        body = text(event.pattern)
        name = self._names.fresh(call.event)
        self.lines.append(f"{_applied(name, names)} matches {body};")
        return _BaseType(name, tuple(hidden))


def _spelled(literal: Literal) -> tuple[str, ...]:
    return spellings(literal.value) or (in_arithmetic(literal.value),)  # type: ignore[arg-type]


def _applied(name: str, arguments: Sequence[str]) -> str:
    return f"{name}({', '.join(arguments)})" if arguments else name


def _outside(call: Call, condition: Guard) -> list[str]:
    """The registers of a condition that the call does not mention."""
    return [name for name in variables(condition) if is_register(Variable(name)) and name not in call.registers]
