"""Events in C: the fields that a tree reads, as a tree of names, and patterns and guards as C."""

from collections.abc import Callable, Mapping
from typing import Final

from rvaft.errors import NotExpressible, unwritten
from rvaft.model.guards import Guard, Operation, Operator, definition
from rvaft.model.patterns import Anything, ListPattern, Literal, ObjectPattern, Pattern, SomeItem, Variable
from rvaft.model.values import Scalar

Step = str | int
_O: Final = Operator
_CALLS: Final[Mapping[Operator, str]] = {
    _O.EQ: "equals({}, {})",
    _O.NE: "denied(equals({}, {}))",
    _O.LT: "less({}, {})",
    _O.LE: "at_most({}, {})",
    _O.GT: "less({1}, {0})",
    _O.GE: "at_most({1}, {0})",
    _O.ADD: "add(error, {}, {})",
    _O.SUB: "subtract(error, {}, {})",
    _O.MUL: "multiply(error, {}, {})",
    _O.DIV: "divide(error, {}, {})",
    _O.NEGATE: "negated(error, {})",
    _O.NOT: "denied({})",
    _O.STARTSWITH: "starts_with({}, {})",
    _O.ENDSWITH: "ends_with({}, {})",
    _O.CONTAINS: "contains({}, {})",
    _O.LIKE: "like({}, {})",
    _O.ABS: "absolute(error, {})",
    _O.NUMBER: "number_of(error, {})",
}
_FOLDS: Final[Mapping[Operator, str]] = {
    _O.AND: "both({}, {})",
    _O.OR: "either({}, {})",
    _O.MIN: "lesser({}, {})",
    _O.MAX: "greater({}, {})",
}
OPERATORS: Final = frozenset({*_CALLS, *_FOLDS, _O.IN})
"""The operators that `expression` writes."""


def string(text: str) -> str:
    r"""Return a string literal of C with the size in bytes, as two arguments.

    >>> print(string("é?"))
    "\303\251\077", 3
    """
    try:
        data = text.encode()
    except UnicodeEncodeError:
        raise NotExpressible(unwritten("a string with an unpaired surrogate never occurs in JSON Lines")) from None
    plain = "".join(chr(c) if 32 <= c < 127 and chr(c) not in '"\\?' else f"\\{c:03o}" for c in data)
    return f'"{plain}", {len(data)}'


def constant(value: Scalar) -> str:
    """Return a JSON value as an expression of C.

    >>> constant(2.0), constant(0.5), constant(None)
    ('integer(INT64_C(2))', 'rvaft_real(0x1.0000000000000p-1)', 'plain(RVAFT_NULL)')
    """
    if isinstance(value, float) and value.is_integer():
        value = int(value)
    match value:
        case None:
            return "plain(RVAFT_NULL)"
        case bool():
            return f"truth({int(value)})"
        case int() if -(1 << 63) < value < 1 << 63:
            return f"integer(INT64_C({value}))"
        case int() if value == -(1 << 63):
            return "integer(INT64_MIN)"
        case int():
            return f"bytes_of(RVAFT_BIG, {string(str(value))})"
        case float():
            return f"rvaft_real({value.hex()})"
        case str():
            return f"bytes_of(RVAFT_TEXT, {string(value)})"


def expression(guard: Guard, term: Callable[[Guard], str | None]) -> str:
    """Return a guard as an expression of C; `term` returns that of a variable or a time."""
    found = term(guard)
    if found is not None:
        return found
    match guard:
        case Literal(value):
            return constant(value)
        case Operation(operator, operands) if operator in _FOLDS:
            return _folded(_FOLDS[operator], [expression(one, term) for one in operands])
        case Operation(operator, operands) if operator in _CALLS:
            return _CALLS[operator].format(*(expression(one, term) for one in operands))
        case _:
            meaning = definition(guard)
            assert meaning is not None, f"no value of {guard}"
            return expression(meaning, term)


def _folded(call: str, terms: list[str]) -> str:
    made = terms[-1]
    for term in reversed(terms[:-1]):
        made = call.format(term, made)
    return made


class NumberedFields:
    """The fields that a tree reads, numbered; each is below another one or the event (-1)."""

    def __init__(self) -> None:
        self.paths: list[tuple[Step, ...]] = []
        self.whole: set[int] = set()
        """The fields that are compared as a whole if they are lists or objects."""
        self.times: set[int] = set()
        """The fields that are read as times only."""
        self._numbers: dict[tuple[Step, ...], int] = {}

    def number(self, path: tuple[Step, ...]) -> int:
        """Return the number of the field at a path."""
        if path not in self._numbers:
            if len(path) > 1:
                self.number(path[:-1])
            self._numbers[path] = len(self.paths)
            self.paths.append(path)
        return self._numbers[path]

    def tests(self, pattern: Pattern) -> tuple[str, dict[str, int]]:
        """Return whether an event matches, as an expression of C, and the field of each variable."""
        found: list[str] = []
        bound: dict[str, int] = {}
        todo: list[tuple[Pattern, tuple[Step, ...]]] = [(pattern, ())]
        while todo:
            part, path = todo.pop()
            field = self.number(path) if path else -1
            match part:
                case Literal(str() as text):
                    found.append(f"is_text(&E({field}), {string(text)})")
                case Literal(value):
                    found.append(f"is_value(&E({field}), {constant(value)})")
                case Variable(name) if name in bound:
                    self.whole.add(field)
                    found.append(f"same(&E({bound[name]}), &E({field}))")
                case Variable(name):
                    self.whole.add(field)
                    bound[name] = field
                    found.append(f"E({field}).tag != RVAFT_ABSENT")
                case Anything():
                    found.append(f"E({field}).tag != RVAFT_ABSENT")
                case ObjectPattern(fields):
                    if not fields and path:
                        found.append(f"E({field}).tag == RVAFT_OBJECT")
                    todo += [(inner, (*path, name)) for name, inner in reversed(fields)]
                case ListPattern(items):
                    self.whole.add(field)  # a repeated key is refused in any item
                    found.append(f"(E({field}).tag == RVAFT_LIST && E({field}).integer == {len(items)})")
                    todo += [(inner, (*path, place)) for place, inner in reversed(list(enumerate(items)))]
                case SomeItem():
                    raise NotExpressible(unwritten("a test of some item of a list needs a loop over the items"))
        literals = [one for one in found if "ABSENT" not in one]
        return " && ".join([*literals, *(one for one in found if "ABSENT" in one)]) or "1", bound

    def rows(self) -> list[str]:
        """Return the rows of the table of fields: name, size, first child, next sibling, keys of children, flags."""
        children: dict[tuple[Step, ...], list[int]] = {}
        for number, path in enumerate(self.paths):
            children.setdefault(path[:-1], []).append(number)
        rows = []
        for number, path in enumerate(self.paths):
            siblings = children[path[:-1]]
            place = siblings.index(number) + 1
            following = siblings[place] if place < len(siblings) else -1
            child = children.get(path, [-1])[0]
            name = string(path[-1]) if isinstance(path[-1], str) else f"NULL, {path[-1]}"
            flags = f"{int(number in self.whole)}, {int(number in self.times)}"
            rows.append(f"{{{name}, {child}, {following}, {self.keys(path)}, {flags}}}")
        return rows

    def keys(self, path: tuple[Step, ...]) -> str:
        """Return the set of the hashes (`KEY_HASH`) of the keys below a field, or of its items."""
        names = (str(one[-1]).encode(errors="replace") for one in self.paths if one[:-1] == path)
        bits = {(5 * len(name) + (name[0] if name else 0)) % 64 for name in names}
        return f"UINT64_C({sum(1 << bit for bit in bits)})"
