"""From a tree to Sigma: a rule for each event, and one correlation of the rules.

A correlation asks for rules and not for events: one event that fits two rules serves both. So no two events of a tree may fit the same one.
Sigma has no types: what a number, a boolean and a text have in common it does not tell apart, so constants that could be taken for others are refused.
"""

import re
from collections.abc import Iterator, Mapping
from itertools import combinations
from typing import Any, Final, NoReturn

from rvaft.analysis.normal_form import NormalForm, Op, Part, normal_form
from rvaft.errors import NotExpressible, TooLarge, TreeError, installed
from rvaft.model.expressions import time_text
from rvaft.model.patterns import Anything, Literal, ObjectPattern, Pattern, Variable
from rvaft.model.tree import RVAFT
from rvaft.model.values import NUMBER, Json, equal
from rvaft.model.verdict import Semantics

FOREVER: Final = "36500d"
"""The timespan where a tree has no window: a hundred years, while the events that have no times stand 1 s apart."""
_SECOND: Final = 1_000_000_000
_ODD: Final = re.compile(r"[\0-\2\ud800-\udfff]")
_COLUMN: Final = re.compile(r"rowid|oid|_rowid_|rvaft_.*", re.IGNORECASE)
"""What columns of a table are called that are no fields."""


class SigmaRules:
    """One translation of a tree; `plain` is the same without counted leaves, `pand` and windows. `limit` counts rules."""

    def __init__(self, tree: RVAFT, plain: RVAFT, semantics: Semantics, limit: int) -> None:
        self._tree, self._whole, self._semantics, self._limit = plain, tree, semantics, limit
        self._form: NormalForm = normal_form(plain)
        self._names: dict[str, str] = {}
        self._variables: dict[str, dict[str, str]] = {}
        """Of each rule the fields of its variables."""

    def text(self) -> tuple[str, int]:
        """The documents, and how many symbols they have."""
        yaml = installed("yaml", "PyYAML", "pip install '.[sigma]' in a checkout of rvaft")
        if not self._form.feasible:
            message = f"no scenario of {self._tree.root} is feasible"
            raise TreeError(message, rule="no-scenario", nodes=[self._tree.root])
        if guards := [node for number, _ in self._form.guards for node in [self._form.parts[number].node]]:
            self._refuse("Sigma compares without types: to it a text is more than any number", *guards)
        correlation, rules = self._correlation()
        documents = [*rules, {"title": self._title(), "correlation": correlation}]
        if self._time is not None:
            documents[-1]["rvaft"] = self._time
        text = "---\n".join(
            yaml.safe_dump(one, sort_keys=False, allow_unicode=False, width=10_000) for one in documents
        )
        return text, len(re.findall(r"\w+|\S", text))

    def _title(self) -> str:
        return _ODD.sub("?", self._tree.root)[:256].strip() or "tree"

    def _refuse(self, reason: str, *nodes: str) -> NoReturn:
        named = dict.fromkeys(self._tree.origins.get(name, name) for name in nodes)
        raise NotExpressible(reason, backend="sigma", semantics=self._semantics, nodes=named)

    # -- the correlation

    def _correlation(self) -> tuple[dict[str, Any], list[dict[str, Any]]]:
        form, parts = self._form, self._form.parts
        place = {name: at for at, name in enumerate(self._tree.order)}
        events = [number for number in form.kept() if parts[number].op is Op.EVENT]
        events.sort(key=lambda number: place[parts[number].node])
        if len(events) > self._limit:
            raise TooLarge("rules of the correlation", limit=self._limit)
        ordered = any(parts[number].op is Op.SEQUENCE for number in form.kept())
        steps = self._steps() if ordered else [[number] for number in events]
        for one, other in combinations(steps, 2):
            for first in one:
                for second in other:
                    nodes = parts[first].node, parts[second].node
                    if not disjoint(*(self._pattern(node) for node in nodes)):
                        self._refuse(
                            "one event can fit two rules, and a correlation does not tell that it is one", *nodes
                        )
        named = {number: self._name(parts[step[0]].node) for step in steps for number in step}
        rules = [self._rule(named[step[0]], [parts[number].node for number in step]) for step in steps]
        names = list(dict.fromkeys(named.values()))
        found: dict[str, Any] = {"type": "temporal_ordered" if ordered else "temporal", "rules": names}
        found |= self._grouped(names, [len(step) for step in steps])
        found["timespan"] = self._timespan()
        root = parts[form.root]
        if not ordered and len(names) > 1 and (root.op is not Op.ALL or self._nested(root)):
            simple = root.op in (Op.ONE, Op.AT_LEAST) and not self._nested(root)
            found["condition"] = {"gte": root.need} if simple else self._condition(form.root, named)
        return found, rules

    def _nested(self, root: Part) -> bool:
        return any(self._form.parts[one].op is not Op.EVENT for one in root.parts)

    def _steps(self) -> list[list[int]]:
        """The events in sequence, each step one of several."""
        parts, found = self._form.parts, list[list[int]]()
        todo = [self._form.root]
        while todo:
            part = parts[number := todo.pop()]
            match part.op:
                case Op.SEQUENCE | Op.ALL if part.op is Op.SEQUENCE or len(part.parts) < 2:
                    todo += part.parts[::-1]
                case Op.EVENT:
                    found.append([number])
                case Op.ONE if all(parts[one].op is Op.EVENT for one in part.parts):
                    found.append([*part.parts])
                case _:
                    self._refuse("a correlation puts single events in order, and no parts that have several", part.node)
        if len({number for step in found for number in step}) < sum(map(len, found)):
            self._refuse("an event is in two steps of a sequence")
        return found

    def _condition(self, number: int, named: Mapping[int, str]) -> str:
        """What has to be there, over the names of rules."""
        part = self._form.parts[number]
        if part.op is Op.EVENT:
            return named[number]
        below = [self._condition(one, named) for one in part.parts]
        if not below:
            self._refuse("an alternative asks for no event", part.node)
        if part.op is Op.AT_LEAST:
            below = [f"({' and '.join(way)})" if way[1:] else way[0] for way in self._ways(below, part.need)]
        joined = (" and " if part.op is Op.ALL else " or ").join(below)
        if len(joined) > 200 * self._limit:
            raise TooLarge("rules of the correlation", limit=self._limit)
        return f"({joined})" if below[1:] else joined

    def _ways(self, below: list[str], need: int) -> Iterator[tuple[str, ...]]:
        for count, way in enumerate(combinations(below, need)):
            if count > self._limit:
                raise TooLarge("rules of the correlation", limit=self._limit)
            yield way

    def _timespan(self) -> str:
        asked = {n.name: n.within for n in self._whole.top_down() if n.within is not None}
        self._time = time_text(self._whole.time) if asked and self._whole.time is not None else None
        if not asked:
            return FOREVER
        within = asked.pop(self._whole.root, None)
        if asked or within is None:
            self._refuse("a correlation has one timespan, and so one window, around all", *asked)
        if within < _SECOND or within % _SECOND or within > 36_500 * 86_400 * _SECOND:
            self._refuse("a timespan is of whole seconds, one or more", self._whole.root)
        return f"{within // _SECOND}s"

    def _grouped(self, names: list[str], alternatives: list[int]) -> dict[str, Any]:
        """Variables that all events have."""
        shared = {name for fields in self._variables.values() for name in fields}
        shared = {name for name in shared if sum(name in one for one in self._variables.values()) > 1}
        for name in sorted(shared):
            lacking = [rule for rule in names if name not in self._variables.get(rule, {})]
            if lacking or max(alternatives) > 1:
                self._refuse(f"a correlation groups by what all of its events have, and not all have {name}")
        by = {name: {rule: self._variables[rule][name] for rule in names} for name in sorted(shared)}
        same = {name: next(iter(fields.values())) for name, fields in by.items() if len(set(fields.values())) == 1}
        others = [fields for name, fields in by.items() if name not in same]
        aliases = {f"rvaft_{number}": fields for number, fields in enumerate(others)}
        found: dict[str, Any] = {"aliases": aliases} if aliases else {}
        return found | ({"group-by": [*dict.fromkeys(same.values()), *aliases]} if by else {})

    # -- a rule

    def _name(self, node: str) -> str:
        """A name of letters and digits that no other rule has."""
        word = re.sub(r"[^a-z0-9_]", "_", node.lower()) or "_"
        word = f"e_{word}" if word in ("and", "or", "not", "of") or not word[0].isalpha() else word
        while word in self._names.values():
            word += "_"
        return self._names.setdefault(node, word)

    def _pattern(self, node: str) -> Pattern:
        pattern = self._tree.pattern(node)
        assert pattern is not None, "only nodes with events are observed"
        return pattern

    def _rule(self, name: str, nodes: list[str]) -> dict[str, Any]:
        """A rule that an event of one of the nodes fits."""
        detection: dict[str, Any] = {}
        for number, node in enumerate(nodes):
            detection["selection" if len(nodes) == 1 else f"selection{number}"] = self._selection(name, node)
        condition = "selection" if len(nodes) == 1 else "1 of selection*"
        logsource = {"category": "rvaft"}
        return {"title": name, "name": name, "logsource": logsource, "detection": {**detection, "condition": condition}}

    def _selection(self, rule: str, node: str) -> dict[str, Any]:
        found: dict[str, Any] = {}
        bound: dict[str, str] = {}
        todo: list[tuple[tuple[str, ...], Pattern]] = [((), self._pattern(node))]
        while todo:
            way, part = todo.pop(0)
            if way and (not re.fullmatch(r"[^.|\0-\x1f\ud800-\udfff]+", way[-1]) or _COLUMN.fullmatch(way[0])):
                self._refuse("the name of a field has a meaning of its own in Sigma or in a table", node)
            field = ".".join(way)
            match part:
                case ObjectPattern(inner) if inner:
                    todo[:0] = [((*way, step), below) for step, below in inner]
                case Literal(str() as value):
                    if (
                        NUMBER.fullmatch(value.strip())
                        or value.strip() in ("true", "false", "null")
                        or not value.strip()
                        or value[0] in "[{"
                        or _ODD.search(value)
                    ):
                        self._refuse("Sigma has no types: it takes the text for another value", node)
                    found[f"{field}|cased"] = re.sub(r"([\\*?])", r"\\\1", value)
                case Literal(value) if _plain_number(value):
                    found[field] = value
                case Literal():
                    self._refuse("Sigma has no types, and no null: it takes the constant for another value", node)
                case Variable(name) if name in bound:
                    self._refuse("no rule compares two fields of an event by value", node)
                case Variable() | Anything():
                    found[f"{field}|exists"] = True
                    bound |= {part.name: field} if isinstance(part, Variable) else {}
                case _:
                    self._refuse("no rule asks for the length of a list, or whether a value is an object", node)
        if len({name.partition("|")[0].lower() for name in found}) < len(found):
            self._refuse("two fields of an event differ in case alone, which no table tells apart", node)
        own = self._variables.setdefault(rule, {})
        own |= {name: field for name, field in bound.items() if not name.startswith("_")}
        return found


def _plain_number(value: Json) -> bool:
    return (
        isinstance(value, int | float) and not isinstance(value, bool) and abs(value) < 2**53 and "e" not in repr(value)
    )


def disjoint(one: Pattern, other: Pattern) -> bool:
    """Whether some field must be another constant in an event that matches one pattern than in one that matches the other."""
    match one, other:
        case ObjectPattern(fields), ObjectPattern(others):
            known = dict(others)
            return any(name in known and disjoint(inner, known[name]) for name, inner in fields)
        case Literal(value), Literal(another):
            return not equal(value, another)
        case _:
            return False
