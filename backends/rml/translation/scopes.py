"""The variables of one declaration, and conditions over numbers written with them."""

from collections.abc import Iterable

from backends.rml.translation.conditions import Compare, Condition, Every, Some
from backends.rml.translation.literals import in_arithmetic
from backends.rml.translation.names import Names, identifier
from backends.rml.translation.observations import Call, Place, Register, place_name
from rvaft.guards import Guard, Operation, Operator
from rvaft.patterns import Literal, Variable
from rvaft.tree import RVAFT
from rvaft.values import is_number


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
