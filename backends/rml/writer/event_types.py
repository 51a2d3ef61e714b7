r"""The event types of an RML text, declared as they are needed.

Each event type of the tree is declared once; what an occurrence looks for is that type itself or one derived from it. A derived
type that binds folds comparisons of numbers into its `with`; any other condition becomes a type of its own that binds nothing and is
asked beside it (`/\`), because the negation of a type never binds.
"""

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, replace
from itertools import product

from backends.rml.writer.conditions import ALWAYS, Compare, Condition, Every, Same, Some, Unless, numeric, variables
from backends.rml.writer.names import Names, identifier, in_arithmetic, in_patterns, quoted, spellings
from backends.rml.writer.observations import Argument, Call, Place, Register, place_name
from rvaft.model.guards import Guard, Operation, Operator
from rvaft.model.patterns import Anything, ListPattern, Literal, ObjectPattern, Pattern, Variable
from rvaft.model.tree import RVAFT
from rvaft.model.values import is_number

# The variables of one declaration, and conditions over numbers written with them.


class Scope:
    """The variables of one declaration: registers and places of the call are called after the parameters of its event type."""

    def __init__(self, tree: RVAFT, call: Call, registers: Iterable[str]) -> None:
        self._fresh = Names()
        self.names: dict[str, str] = {}
        parameters = tree.events[call.event].parameters if call.event is not None else ()
        for argument, parameter in zip(call.arguments, parameters, strict=True):
            if isinstance(argument, Register | Place) and key_of(argument) not in self.names:
                self.names[key_of(argument)] = self._fresh.fresh(identifier(parameter, otherwise="p"))
        for register in registers:
            if register not in self.names:
                self.names[register] = self._fresh.fresh(register)

    def fresh(self, wanted: str) -> str:
        """A variable of this declaration alone."""
        return self._fresh.fresh(wanted)

    def condition(self, condition: Condition) -> str:
        """A condition over numbers as a data expression; every operation in parentheses."""
        match condition:
            case Compare(operator, left, right):
                return f"{self._number(left)} {operator.value} {self._number(right)}"
            case Every(parts):
                return " && ".join(f"({self.condition(part)})" for part in parts) if parts else "0 == 0"
            case Some(parts):
                return " || ".join(f"({self.condition(part)})" for part in parts) if parts else "0 == 1"
            case _:
                raise AssertionError(condition)

    def _number(self, guard: Guard) -> str:
        match guard:
            case Literal(constant):
                assert is_number(constant)
                return in_arithmetic(constant)  # type: ignore[arg-type]
            case Variable(name):
                return self.names[name]
            case Operation(Operator.NEGATE, (operand,)):
                return f"(-{self._number(operand)})"
            case Operation(operator, (left, right)):
                return f"({self._number(left)} {operator.value} {self._number(right)})"
            case _:
                raise AssertionError(guard)


def key_of(argument: Register | Place) -> str:
    """The name that a register or place goes by in conditions."""
    return argument.name if isinstance(argument, Register) else place_name(argument)


@dataclass(frozen=True, slots=True)
class _Base:
    """A declared event type of the tree; `hidden` are the literals that no pattern can hold, its last arguments."""

    name: str
    hidden: tuple[Literal, ...]


class Types:
    """Event types under construction; `lines` are the declarations in order."""

    def __init__(self, tree: RVAFT) -> None:
        self.tree = tree
        self.lines: list[str] = []
        self.names = Names()
        self._bases: dict[tuple[str | None, str], _Base] = {}
        self._declared: dict[tuple[object, ...], str] = {}

    # -- what expressions use ---------------------------------------------------------------------------------------

    def observed(self, call: Call, conditions: Sequence[tuple[Condition, str]], node: str) -> list[str]:
        """The types, applied, that together match the events of a call that fulfil the conditions; the first one binds.

        `node` and the names beside the conditions, of the nodes they come from, are what the types are called after.
        """
        folded = [condition for condition, _ in conditions if numeric(condition)]
        names = dict.fromkeys(name for condition, name in conditions if numeric(condition) and name != node)
        binding = self._binding(call, folded, "_".join([node, *names]))
        others = [(c, name if name != node else f"{node}_when") for c, name in conditions if not numeric(c)]
        return [binding, *(self._asked(call, condition, name) for condition, name in others)]

    def checked(self, call: Call, condition: Condition, hint: str) -> list[str]:
        """Types that bind nothing, as parents of another: any of them matches the events of a call that fulfil the condition."""
        if condition == ALWAYS:
            scope = Scope(self.tree, call, ())
            parents, extra = self._parents(call, scope, {})
            return [self._declare((), parents, extra, hint)] if extra else parents
        if numeric(condition) or isinstance(condition, Same):
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

    def _binding(self, call: Call, folded: list[Condition], hint: str) -> str:
        base = self._base(call)
        if not folded and not base.hidden and all(isinstance(a, Register) for a in call.arguments):
            return _applied(base.name, [a.name for a in call.arguments if isinstance(a, Register)])
        extra = [n for c in folded for n in variables(c) if "#" not in n and n not in call.registers]
        registers = tuple(dict.fromkeys((*call.registers, *extra)))
        scope = Scope(self.tree, call, extra)
        used = dict.fromkeys((*registers, *(name for c in folded for name in variables(c))), 2)
        parents, more = self._parents(call, scope, used)
        conditions = [*more, *(scope.condition(condition) for condition in folded)]
        name = self._declare([scope.names[r] for r in registers], parents, conditions, hint)
        return _applied(name, registers)

    def _asked(self, call: Call, condition: Condition, hint: str) -> str:
        """A type that matches where the condition holds of an event that matches the call; it binds nothing."""
        match condition:
            case Same(left, right):
                return self._equal(call, left, right, hint, negated=False)
            case Unless(Same(left, right)):
                return self._equal(call, left, right, hint, negated=True)
            case Unless(inner):
                return self._derived(call, inner, [self._asked(call, inner, hint)], hint, negated=True)
            case Some(parts) if not numeric(condition):
                return self._derived(call, condition, [self._asked(call, part, hint) for part in parts], hint)
            case Every(parts) if not numeric(condition):
                refusals = [self._refused(call, part, hint) for part in parts]
                return self._derived(call, condition, refusals, hint, negated=True)
            case _:
                registers = _outside(call, condition)
                scope = Scope(self.tree, call, registers)
                parents, more = self._parents(call, scope, dict.fromkeys(variables(condition), 2))
                conditions = [*more, scope.condition(condition)]
                return _applied(
                    self._declare([scope.names[r] for r in registers], parents, conditions, hint), registers
                )

    def _refused(self, call: Call, condition: Condition, hint: str) -> str:
        """A type that matches where the condition fails of an event that matches the call."""
        match condition:
            case Unless(inner):
                return self._asked(call, inner, hint)
            case Same(left, right):
                return self._equal(call, left, right, hint, negated=True)
            case _:
                parents = [self._asked(call, condition, hint)]
                return self._derived(call, condition, parents, f"not_{hint}", negated=True)

    def _derived(
        self, call: Call, condition: Condition, parents: list[str], hint: str, *, negated: bool = False
    ) -> str:
        registers = _outside(call, condition)
        return _applied(self._declare(registers, parents, (), hint, negated=negated), registers)

    def _equal(self, call: Call, left: Variable, right: Variable | Literal, hint: str, *, negated: bool) -> str:
        here = {argument.name if isinstance(argument, Register) else place_name(argument)
                for argument in call.arguments if isinstance(argument, Register | Place)}  # fmt: skip
        if left.name not in here and isinstance(right, Variable) and right.name in here:
            left, right = right, left
        registers = _outside(call, Same(left, right))
        if left.name not in here:
            return self._equal_elsewhere(left, right, registers, hint, negated=negated)
        by: Argument = right if isinstance(right, Literal) else _argument(call, right)
        same = replace(call, arguments=tuple(by if _is(a, left) else a for a in call.arguments))
        scope = Scope(self.tree, same, registers)
        parents, more = self._parents(same, scope, dict.fromkeys(registers, 2))
        parameters = [scope.names[r] for r in registers]
        return _applied(self._declare(parameters, parents, more, hint, negated=negated), registers)

    def _equal_elsewhere(
        self, left: Variable, right: Variable | Literal, registers: Sequence[str], hint: str, *, negated: bool
    ) -> str:
        """Two values that earlier events have given."""
        same = self._once(("same",), "same", lambda name: f"{name}(value, value) matches {{}};")
        parents = []
        if isinstance(right, Variable):
            parents = [_applied(same, [left.name, right.name])]
        else:
            texts = spellings(right.value) or (in_arithmetic(right.value),)  # type: ignore[arg-type]
            parents = [_applied(same, [left.name, text]) for text in texts]
        return _applied(self._declare(registers, parents, (), hint, negated=negated), registers)

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
        guard = f" with {_conjunction(conditions)}" if conditions else ""
        sign = " not matches " if negated else " matches "
        body = f"{sign}{' | '.join(parents)}{guard};"
        return self._once(key, hint, lambda name: f"{_applied(name, parameters)}{body}")

    def _once(self, key: tuple[object, ...], hint: str, line: Callable[[str], str]) -> str:
        if key not in self._declared:
            name = self.names.fresh(hint)
            self._declared[key] = name
            self.lines.append(line(name))
        return self._declared[key]

    # -- the types of the tree --------------------------------------------------------------------------------------

    def _parents(self, call: Call, scope: "Scope", used: dict[str, int]) -> tuple[list[str], list[str]]:
        """The base type applied to the arguments, once for each spelling of a literal, and comparisons for very large integers.

        A variable that is not `used` elsewhere and stands but once is written `_`.
        """
        base = self._base(call)
        counts = dict(used)
        for argument in call.arguments:
            if isinstance(argument, Register | Place):
                key = key_of(argument)
                counts[key] = counts.get(key, 0) + 1
        options: list[tuple[str, ...]] = []
        conditions: list[str] = []
        for argument in (*call.arguments, *base.hidden):
            match argument:
                case Literal(constant):
                    texts = spellings(constant)
                    if texts is None:
                        assert isinstance(constant, (int, float))
                        variable = scope.fresh("number")
                        conditions.append(f"{variable} == {in_arithmetic(constant)}")
                        texts = (variable,)
                    options.append(texts)
                case Register() | Place():
                    options.append((scope.names[key_of(argument)] if counts[key_of(argument)] > 1 else "_",))
                case Anything():
                    options.append(("_",))
        return [_applied(base.name, chosen) for chosen in product(*options)], conditions

    def _base(self, call: Call) -> _Base:
        key = (call.event, call.default)
        if key not in self._bases:
            self._bases[key] = self._declare_base(call)
        return self._bases[key]

    def _declare_base(self, call: Call) -> _Base:
        if call.event is None:
            name = self.names.fresh(call.default)
            self.lines.append(f"{name} matches {{ 'event': {quoted(call.default)} }};")
            return _Base(name, ())
        event = self.tree.events[call.event]
        local = Names()
        parameters = {parameter: local.fresh(parameter, otherwise="p") for parameter in event.parameters}
        hidden: list[Literal] = []
        names = list(parameters.values())

        def text(pattern: Pattern) -> str:
            match pattern:
                case Literal(constant) if in_patterns(constant):
                    texts = spellings(constant) or ()
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
        name = self.names.fresh(call.event)
        self.lines.append(f"{_applied(name, names)} matches {body};")
        return _Base(name, tuple(hidden))


def _conjunction(conditions: Sequence[str]) -> str:
    return conditions[0] if len(conditions) == 1 else " && ".join(f"({condition})" for condition in conditions)


def _applied(name: str, arguments: Sequence[str]) -> str:
    return f"{name}({', '.join(arguments)})" if arguments else name


def _outside(call: Call, condition: Condition) -> list[str]:
    """The registers of a condition that the call does not mention."""
    return [name for name in variables(condition) if "#" not in name and name not in call.registers]


def _is(argument: Argument, variable: Variable) -> bool:
    return isinstance(argument, Register | Place) and key_of(argument) == variable.name


def _argument(call: Call, variable: Variable) -> Argument:
    return next((argument for argument in call.arguments if _is(argument, variable)), Register(variable.name))
