"""Rules for single events: a selection of field tests, and guards as further selections.

Sigma compares without types and without case. So constants are `cased`, and guards need declared
types. With the assumptions `case` and `present` a rule has neither `cased` nor `exists`, which few
converters support.
"""

import re
from collections.abc import Iterable
from typing import Any, Final, TypeAlias

from rvaft.core.conditions import (
    NEVER,
    ComparisonTest,
    ConditionJunction,
    ConditionTest,
    EqualityTest,
    SortTest,
    TruthCondition,
    TruthConditions,
    TruthTest,
)
from rvaft.errors import NotExpressible, unwritten
from rvaft.export.rule_metadata import ODD
from rvaft.model.assumptions import Declared
from rvaft.model.guards import OPERATORS, Guard, Operation, Operator, TermSort
from rvaft.model.nodes import ValueType
from rvaft.model.patterns import Anything, Literal, ObjectPattern, Pattern, Variable
from rvaft.model.values import EXACT_INTEGERS, NUMBER, Json

Selection: TypeAlias = dict[str, Any]
"""The tests of fields: a field with modifiers, and its value or values."""
Key: TypeAlias = tuple[str, ...]

_COLUMN: Final = re.compile(r"rowid|oid|_rowid_|rvaft_.*", re.IGNORECASE)
"""Table columns that are not fields."""
_NAME: Final = re.compile(r"[^.|\0-\x1f\ud800-\udfff]+")
_SIGNS: Final = {"<": "lt", "<=": "lte", ">": "gt", ">=": "gte"}
_MODIFIERS: Final = {
    Operator.STARTSWITH: "startswith",
    Operator.ENDSWITH: "endswith",
    Operator.CONTAINS: "contains",
    Operator.LIKE: "",
}
_UNTYPED: Final = "Sigma has no types and no null, and confuses the constant with other values"


class EventRule:
    """The detection of one event; raises `NotExpressible` without nodes."""

    def __init__(self, pattern: Pattern, guards: Iterable[Guard], known: Declared, *, cased: bool) -> None:
        self._known, self._cased = known, "|cased" if cased else ""
        self.fields: dict[str, Key] = {}
        """The field of each variable."""
        self.selection: Selection = {}
        self._valued = ""
        self._pattern(pattern)
        self._further: dict[str, Selection] = {}
        conditions = [TruthConditions.declared(known, self.fields).of(guard) for guard in guards]
        self._condition = self._all(conditions)
        if not self.selection:  # Sigma has no empty selection
            self.selection[f"{self._valued}|exists"] = True
        if len({name.partition("|")[0].lower() for name in self.selection}) < len(
            {name.partition("|")[0] for name in self.selection}
        ):
            raise NotExpressible(unwritten("two field names differ only in case, which SQL tables ignore"))

    def detection(self, prefix: str = "") -> tuple[dict[str, Selection], str]:
        """Return the selections by name, and the condition over them; names get a suffix."""
        name = f"selection{prefix}"
        named = {key: f"{key}{prefix}" for key in self._further}
        condition = re.sub(r"\b(?:filter|test)_\d+\b", lambda found: named[found[0]], self._condition)
        whole = f"{name} and {condition}" if condition else name
        return {name: self.selection, **{named[key]: one for key, one in self._further.items()}}, whole

    # The pattern.

    def _pattern(self, pattern: Pattern) -> None:
        todo: list[tuple[Key, Pattern]] = [((), pattern)]
        while todo:
            way, part = todo.pop(0)
            if way and (not _NAME.fullmatch(way[-1]) or _COLUMN.fullmatch(way[0])):
                dot = f"Sigma reads the dot in the key {way[-1]} as a step to a field inside"
                reserved = "the field name is reserved in Sigma or in SQL tables"
                raise NotExpressible(unwritten(dot if "." in way[-1] else reserved))
            match part:
                case ObjectPattern(inner) if inner:
                    todo[:0] = [((*way, step), below) for step, below in inner]
                case Literal(value):
                    self.selection.update([self._equal(way, value)])
                case Variable(name) if name in self.fields:
                    raise NotExpressible(unwritten("rules are not written for two fields of an event"))
                case Variable() | Anything():
                    if isinstance(part, Variable):
                        self.fields[part.name] = way
                    self._valued = ".".join(way)
                    if way not in self._known.present:
                        self.selection[f"{'.'.join(way)}|exists"] = True
                case _:
                    raise NotExpressible(
                        unwritten("rules are not written for the length of a list, or for whether a value is an object")
                    )

    def _equal(self, way: Key, value: Json) -> tuple[str, Json]:
        """Return the test that a field has a constant value."""
        field, type_ = ".".join(way), self._known.type_of(way)
        match value:
            case bool():
                if type_ is not ValueType.BOOLEAN:
                    raise NotExpressible(unwritten(_UNTYPED))
                return field, value
            case str():
                if ODD.search(value) or (type_ is not ValueType.TEXT and _is_ambiguous(value)):
                    raise NotExpressible(unwritten("Sigma has no types, and confuses the string with another value"))
                return f"{field}{self._cased}", escaped(value)
            case int() | float() if abs(value) < EXACT_INTEGERS and "e" not in repr(value):
                return field, value
            case _:
                raise NotExpressible(unwritten(_UNTYPED))

    # Guards.

    def _all(self, conditions: Iterable[TruthCondition]) -> str:
        """Return the condition for a conjunction; simple tests become part of the selection."""
        found = list[str]()
        for one in conditions:
            if one is NEVER:
                raise NotExpressible(unwritten("a guard never holds, and no rule can express that"))
            parts = one.parts if isinstance(one, ConditionJunction) and one.every else (one,)
            for part in parts:
                if isinstance(part, ConditionJunction):
                    found.append(self._any(part))
                    continue
                field, value, wanted = self._test(part)
                if wanted and field not in self.selection:
                    self.selection[field] = value
                else:
                    found.append(self._named({field: value}, wanted=wanted))
        return " and ".join(filter(None, found))

    def _any(self, junction: ConditionJunction) -> str:
        """Return the condition for a disjunction; several values of one field are a list."""
        values: dict[str, list[Json]] = {}
        others = list[str]()
        for part in junction.parts:
            if isinstance(part, ConditionJunction):
                inner = [self._any(one) if isinstance(one, ConditionJunction) else self._one(one) for one in part.parts]
                others.append(f"({' and '.join(inner)})")
                continue
            field, value, wanted = self._test(part)
            if wanted:
                values.setdefault(field, []).append(value)
            else:
                others.append(self._named({field: value}, wanted=False))
        named = [
            self._named({field: found[0] if len(found) == 1 else found}, wanted=True) for field, found in values.items()
        ]
        if not others and len(values) == 1 and (field := next(iter(values))) not in self.selection:
            del self._further[named[0]]
            self.selection[field] = values[field]
            return ""
        several = [*named, *others]
        return several[0] if len(several) == 1 else f"({' or '.join(several)})"

    def _one(self, test: ConditionTest) -> str:
        field, value, wanted = self._test(test)
        return self._named({field: value}, wanted=wanted)

    def _named(self, selection: Selection, *, wanted: bool) -> str:
        kind = "test" if wanted else "filter"
        name = f"{kind}_{len(self._further) + 1}"
        self._further[name] = selection
        return name if wanted else f"not {name}"

    def _test(self, test: ConditionTest) -> tuple[str, Json, bool]:
        """Return a field with its modifiers, a value, and whether the test must hold."""
        match test:
            case TruthTest(Variable(name), wanted):
                return ".".join(self._typed(name, TermSort.TRUTH)), wanted, True
            case TruthTest(Operation(operator, (Variable(name), Literal(str() as text))), wanted) if (
                operator in _MODIFIERS
            ):
                return *self._matching(operator, self._typed(name, TermSort.TEXT), text), self._sure(name, wanted)
            case EqualityTest(Variable(name), Literal(value), wanted) | EqualityTest(
                Literal(value), Variable(name), wanted
            ):
                way = self._typed(name, TruthConditions().sort(Literal(value)))
                return *self._equal(way, value), self._sure(name, wanted)
            case ComparisonTest(TermSort.NUMBER, Variable(name), sign, Literal(int() | float() as value)):
                way = self._typed(name, TermSort.NUMBER)
                if sign not in _SIGNS:
                    return *self._equal(way, value), self._sure(name, sign == "=")
                field, number = self._equal(way, value)
                return f"{field}|{_SIGNS[sign]}", number, True
            case ComparisonTest(sort, Literal() as left, sign, Variable() as right):
                mirrored = OPERATORS[Operator({"=": "==", "<>": "!="}.get(sign, sign))].mirrored
                assert mirrored is not None, "the sign of a comparison"
                return self._test(ComparisonTest(sort, right, {"==": "=", "!=": "<>"}.get(mirrored, mirrored), left))
            case TruthTest() | EqualityTest() | ComparisonTest() | SortTest():
                raise NotExpressible(
                    unwritten("a rule compares one field with a constant: numbers, or texts by their parts")
                )

    def _typed(self, name: str, sort: TermSort) -> Key:
        """Return the field of a variable whose declared type has a sort."""
        way = self.fields[name]
        if self._known.sort_of(way) is TermSort.UNKNOWN:
            raise NotExpressible(unwritten(f"Sigma compares without types: declare the type of {'.'.join(way)}"))
        if self._known.sort_of(way) is not sort:
            raise NotExpressible(unwritten(f"the guard compares {'.'.join(way)} with a value of another type"))
        return way

    def _sure(self, name: str, wanted: bool) -> bool:
        """Return `wanted`; a negated test needs a value, because Sigma is two-valued."""
        if not wanted and self.fields[name] not in self._known.present:
            raise NotExpressible(unwritten("a negated test needs `assume present;`, because Sigma has no undefined"))
        return wanted

    def _matching(self, operator: Operator, way: Key, text: str) -> tuple[str, str]:
        if ODD.search(text) or not text:
            raise NotExpressible(unwritten("Sigma has no escape for this text"))
        modifier = _MODIFIERS[operator]
        field = f"{'.'.join(way)}{f'|{modifier}' if modifier else ''}{self._cased}"
        return field, text.replace("\\", "\\\\") if operator is Operator.LIKE else escaped(text)


def escaped(text: str) -> str:
    r"""Return a text without wildcards for Sigma.

    >>> print(escaped("C:\\a*"))
    C:\\a\*
    """
    return re.sub(r"([\\*?])", r"\\\1", text)


def _is_ambiguous(text: str) -> bool:
    """Whether a text without type may be a number, a constant, or a nested value."""
    plain = text.strip()
    return not plain or bool(NUMBER.fullmatch(plain)) or plain in ("true", "false", "null") or text[0] in "[{"


def detection_of(rules: Iterable[EventRule]) -> dict[str, Any]:
    """Return the detection of an event, or of a choice of events."""
    every = list(rules)
    parts = [rule.detection("" if len(every) == 1 else f"_{number}") for number, rule in enumerate(every, 1)]
    selections = {name: one for named, _ in parts for name, one in named.items()}
    conditions = [condition for _, condition in parts]
    if len(every) > 1 and len(selections) == len(every):
        return {**selections, "condition": "1 of selection_*"}
    joined = " or ".join(f"({one})" if len(every) > 1 and " " in one else one for one in conditions)
    return {**selections, "condition": joined}
