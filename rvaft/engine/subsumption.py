"""Which partial matches another one makes superfluous.

**Taken or passed over.** Under `scattered` a configuration may pass over every event. Passing over is of no use where the occurrence
belongs to all that the configuration can still become and taking it costs nothing: no variable is bound by it, no choice made. Then
whatever the configuration could do later, it can do with the event taken, within the same branch (so that the explanation still
finds the lowest).

**Different values.** Take two partial matches that have come equally far (the same taken, decided with the same outcome, and broken)
and whose bindings agree but for some variables that no occurrence to come mentions: these are of consequence through the guards still
open alone. An open guard is *for greater values* of such a variable if, whatever the values of the others, it holds for y where it holds
for x < y; and likewise for smaller values. If all open guards that mention the variable are for greater values of it, a completion of the
match with x is one of the match with y > x: the same events for the same occurrences, the same scenario, of the same branches. With
several such variables replace one after the other. So the match with the lesser value may be dropped as long as the other, or one that
can do all that it can, is kept.

What makes a guard one for greater (smaller) values, as `rvaft.model.guards` evaluates it:

- Rounding is monotone: of two values of one type, x <= y, and a constant c, x + c <= y + c holds for the computed results too, for whole
  numbers exactly and for IEEE doubles after rounding (a whole number is first rounded to a double where c is one). The
  same goes for x + e where e is whatever the rest of the guard gives, the same for both. Not so between values of two types: 2**53 and
  2.0**53 are equal, but 2.0**53 + 11 is greater than 2**53 + 11. So only values of one type are compared.
- Comparisons of numbers are exact, whatever their types. On texts they are those of code points; arithmetic on texts is undefined.
- What is undefined does not hold, nor does its negation. So it must not depend on x whether a comparison is defined. Types decide it, and
  being finite, and the conversion of a whole number to a double. Therefore values and constants beyond `MOST` are left out: added to a
  finite double such values leave a finite double, since they are less than half of the last place of the largest. After the
  one operand that is not a constant only whole constants are allowed, for a sum of whole numbers may be too large for a double.
- So a comparison stays defined, or undefined, as the value changes: it is *steady*. Then its negation is for the other direction, and steady.
- `and` holds where all its operands do: it is monotone if they are. But what it does not look at may be undefined, so that `and` may
  turn from false to undefined where its first operand turns from false to true. So neither is it steady, nor is `or`, unless only
  the last operand mentions the variable and is. `or` looks at an operand where those before are false, which for them must not turn
  into undefined: it is monotone if its operands are, and those before the last are steady.

Anything else is left alone: equality, products, a variable on both sides. What is not said to be comparable counts as equal only
if nothing can tell the values apart (`fingerprint`).
"""

from collections.abc import Mapping
from typing import Final, assert_never

from rvaft.analysis.normal_form import Op
from rvaft.engine.compiled_tree import CompiledTree
from rvaft.engine.configuration import MORE, POSSIBLE, SURE, TOUCHED, Configuration
from rvaft.engine.partial_matches import Matching
from rvaft.model.guards import Guard, Operation, Operator, variables
from rvaft.model.patterns import Literal, Variable
from rvaft.model.values import Json, is_number


def commits(matching: Matching, before: Configuration, after: Configuration, node: int) -> bool:
    """Whether the configuration after a node's event can do all that the one before it can."""
    compiled, flags = matching.compiled, matching.progress.flags
    if after.binding != before.binding or after.closed != before.closed:
        return False
    if any(name not in before.binding for name in compiled.exported[node]):
        return False
    if compiled.core and (matching.shared.free or not matching.shared.settled(before, node)):
        return False

    def ends(node: int, flags: int) -> bool:  # nothing more comes of it in the same branch
        return flags & SURE > 0 and not (flags & MORE and compiled.picks >> node & 1)

    def keeps(gate: int, child: int) -> bool:  # nothing is lost by what happened below the child
        siblings = compiled.children[gate]
        match compiled.ops[gate]:
            case Op.ALL:
                return True
            case Op.SEQUENCE:
                return all(ends(elder, flags(before, elder)) for elder in siblings[: compiled.slot[child]])
            case Op.ONE | Op.AT_LEAST as op:
                able = sum(flags(before, sibling) & POSSIBLE > 0 for sibling in siblings)
                if flags(before, child) & TOUCHED or able <= compiled.need[gate]:
                    return True
                return op is Op.AT_LEAST and flags(after, child) & SURE > 0 and not compiled.picks >> child & 1
            case Op.EVENT | Op.CONDITION:
                raise AssertionError("a body joins children")
            case _ as never:
                assert_never(never)

    follows = node not in compiled.members and compiled.own[node] and not compiled.top_down
    if follows and not ends(node, matching.progress.inner(after, node)):
        return False
    child = node
    while compiled.parent[child] >= 0:
        if not keeps(compiled.parent[child], child):
            return False
        child = compiled.parent[child]
    return True


MOST: Final = 10**100

_MIXED: Final = None
_FIRST_GREATER: Final = (Operator.GT, Operator.GE)
_COMPARISONS: Final = (*_FIRST_GREATER, Operator.LT, Operator.LE)


def directions(compiled: CompiledTree, configuration: Configuration) -> dict[str, int]:
    """The variables that a configuration binds of which a greater (1) or a smaller (-1) value can do more."""
    found = {}
    for name in configuration.binding:
        if not compiled.mentions[name] & ~configuration.taken:
            waiting = (node for node in compiled.guarded_by.get(name, ()) if not configuration.closed >> node & 1)
            guards = [guard for node in waiting if (guard := compiled.guards[node]) is not None]
            signs = {tendency(guard, name) for guard in guards}
            if signs in ({1}, {-1}):
                found[name] = 1 if 1 in signs else -1
    return found


def tendency(guard: Guard, name: str) -> int | None:
    """Whether a guard is for greater (1) or smaller (-1) values of a variable, does not mention it (0), or is neither (None)."""
    if name not in variables(guard):
        return 0
    match guard:
        case Operation(Operator.AND | Operator.OR as operator, operands):
            if operator is Operator.OR and not all(_steady(operand, name) for operand in operands[:-1]):
                return _MIXED
            signs = {tendency(operand, name) for operand in operands} - {0}
            return signs.pop() if len(signs) == 1 else _MIXED
        case Operation(Operator.NOT, (operand,)):
            return _turned(tendency(operand, name)) if _steady(operand, name) else _MIXED
        case Operation(operator, (left, right)) if operator in _COMPARISONS:
            if name in variables(left) and name in variables(right):
                return _MIXED
            slope = _slope(left, name)[0] if name in variables(left) else _turned(_slope(right, name)[0])
            return slope if operator in _FIRST_GREATER else _turned(slope)
        case _:
            return _MIXED


def _steady(guard: Guard, name: str) -> bool:
    """Whether a guard that is monotone in a variable is defined, or undefined, whatever its value."""
    if name not in variables(guard):
        return True
    match guard:
        case Operation(Operator.AND | Operator.OR, (*first, last)):
            return _steady(last, name) and not any(name in variables(operand) for operand in first)
        case Operation(Operator.NOT, (operand,)):
            return _steady(operand, name)
        case _:
            return True


def _turned(sign: int | None) -> int | None:
    return _MIXED if sign is None else -sign


def _slope(term: Guard, name: str) -> tuple[int | None, bool]:
    """The sign of a variable in a sum that mentions it once, and whether the rest of it is constants."""
    match term:
        case Variable():
            return 1, True
        case Operation(Operator.NEGATE, (inner,)):
            slope, alone = _slope(inner, name)
            return _turned(slope), alone
        case Operation(Operator.ADD | Operator.SUB as operator, (left, right)):
            if name in variables(left) and name in variables(right):
                return _MIXED, False
            inner, other = (left, right) if name in variables(left) else (right, left)
            slope, alone = _slope(inner, name)
            if operator is Operator.SUB and inner is right:
                slope = _turned(slope)
            if isinstance(other, Literal) and _moderate(other.value):
                return (slope, alone) if alone or type(other.value) is int else (_MIXED, False)
            return (slope, False) if alone else (_MIXED, False)
        case _:
            return _MIXED, False


def _moderate(value: Json) -> bool:
    return is_number(value) and -MOST <= value <= MOST


def scale(value: Json) -> type | None:
    """What two values have in common that can be compared; None for a value that cannot be."""
    if type(value) is str or (type(value) in (int, float) and _moderate(value)):
        return type(value)
    return None


def at_least(left: Mapping[str, Json], right: Mapping[str, Json], directions: Mapping[str, int]) -> bool:
    """Whether one binding can do all that the other can; where there are directions, they are on one scale."""
    return all(left[n] >= right[n] if sign > 0 else left[n] <= right[n] for n, sign in directions.items())
