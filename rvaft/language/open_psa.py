"""Fault trees of the Open-PSA Model Exchange Format (MEF 2.0d), read into a draft.

A basic event is a leaf, its constant probability `prob` and the rate of an exponential law `lambda`. An inner formula
becomes a gate. House events are constants, which are folded into the gates that have them. What needs events that stay
out (`not`, `xor`, …), and event trees, common-cause groups, alignments and substitutions are refused.
"""

import math
from collections.abc import Callable, Iterable, Iterator
from typing import Final, NamedTuple, TypeAlias

from rvaft.errors import LanguageError
from rvaft.language.builder import Page
from rvaft.language.draft import DraftNode, GateUse, Located, Reading
from rvaft.language.markup import Element
from rvaft.model.nodes import Gate, Place
from rvaft.support.wording import did_you_mean, listing

ROOT: Final = "opsa-mef"
"""The root element of a model."""
_CONTAINERS: Final = ("define-fault-tree", "define-component", "model-data")
_EVENTS: Final = {"define-gate": "gate", "define-basic-event": "basic-event", "define-house-event": "house-event"}
_DEFINED: Final = {**_EVENTS, "define-parameter": "parameter"}
_ANNOTATIONS: Final = ("label", "attributes")
_GATES: Final = {"and": Gate.AND, "or": Gate.OR, "atleast": Gate.VOT}
_STAYS_OUT: Final = "a tree asks for events that happen, and not that an event stays out"
_REFUSED: Final = {
    **dict.fromkeys(("not", "xor", "nand", "nor", "iff", "imply", "cardinality"), _STAYS_OUT),
    "define-CCF-group": "common-cause groups change probabilities, and a monitor has no event for them; leave it out",
    "include": 'other files are not included; import them in a tree of rvaft, as in import "model.xml";',
    **dict.fromkeys(
        ("define-event-tree", "define-initiating-event", "define-rule", "define-sequence", "define-functional-event"),
        "event trees are not read; leave them out",
    ),
    "define-alignment": "alignments change house events by phase; leave it out",
    "define-substitution": "substitutions change the results of an analysis; leave it out",
    "define-extern-library": "external libraries are not loaded; leave it out",
}
"""Elements that are refused, with the reason."""
_UNKNOWN: Final = "it is no part of a fault tree in Open-PSA that rvaft reads; leave it out"
_SUMS: Final[dict[str, Callable[[Iterable[float]], float]]] = {"add": math.fsum, "mul": math.prod}
_TIME: Final = "system-mission-time"


class _Definition(NamedTuple):
    """A defined event or parameter, the path of its container, and whether only the path reaches it."""

    element: Element
    path: str
    is_private: bool

    @property
    def name(self) -> str:
        return self.element.attributes["name"].strip()

    @property
    def full(self) -> str:
        return f"{self.path}.{self.name}"


_Input: TypeAlias = str | bool
"""An input of a gate: the name of a node, or a constant."""


class _Shape(NamedTuple):
    gate: Gate
    inputs: list[tuple[_Input, Place]]
    need: int
    place: Place


def read_model(root: Element, page: Page) -> None:
    """Add the fault tree of a model to a page; raises `LanguageError`.

    >>> from rvaft.language.parser import parse
    >>> g = '<define-gate name="g"><or><basic-event name="a"/><basic-event name="b"/></or></define-gate>'
    >>> draft = parse(f'<opsa-mef><define-fault-tree name="t">{g}</define-fault-tree></opsa-mef>')
    >>> draft.root, [child.value for child in draft.nodes["g"].children()]
    ('g', ['a', 'b'])
    """
    _Model(root, page).read()


class _Model:
    """The definitions of a model: public ones by name, and all by path."""

    def __init__(self, root: Element, page: Page) -> None:
        self.page = page
        self.root = root
        self.events: dict[str, _Definition] = {}
        self.parameters: dict[str, _Definition] = {}
        self.paths: dict[tuple[bool, str], _Definition] = {}
        self.all: list[_Definition] = []
        self.names: dict[int, str] = {}
        """The name of the node of each event, by the identity of its element."""
        self.taken: set[str] = set()
        self.shapes: dict[str, _Shape] = {}
        self.houses: dict[str, bool] = {}
        self.defines_basic_events = False
        """Whether basic events are defined here; otherwise a file of its own has them."""

    def read(self) -> None:
        self._collect()
        self._choose_names()
        self.defines_basic_events = any(one.element.name == "define-basic-event" for one in self.all)
        gates = [one for one in self.all if one.element.name == "define-gate"]
        for one in self.all:
            if one.element.name == "define-house-event":
                self.houses[self.names[id(one.element)]] = self._house(one)
        for one in gates:
            self._read_gate(one)
        tops = self._tops()
        if len(tops) == 1:
            self.page.toplevels.append(Located(tops[0], self.shapes[tops[0]].place))
        before = {child for shape in self.shapes.values() for child, _ in shape.inputs}
        left = self._fold(tops)
        gone = before.difference(child for name in left for child, _ in self.shapes[name].inputs)
        for one in self.all:
            name = self.names.get(id(one.element), "")
            if one.element.name == "define-basic-event" and name not in gone:
                node = self._node(name, one.element)
                node.attributes += [Located(pair, one.element.place) for pair in self._law(one)]
            elif one.element.name == "define-gate" and name in left:
                self._node(name, one.element)
        for name in left:
            gate, inputs, need, place = self.shapes[name]
            node = self.page.draft.nodes.setdefault(name, DraftNode(name))
            node.statements = node.statements or [place]
            children = tuple([Located(child, where) for child, where in inputs if isinstance(child, str)])
            node.gates.append(Located(GateUse(gate, children, need if gate is Gate.VOT else None), place))
        if gates:
            self._say(gates[0].element.place, "this Open-PSA model is read as `scattered`: failures persist", tops)

    def _say(self, place: Place, sentence: str, names: Iterable[str]) -> None:
        self.page.draft.readings.append(Reading(place, sentence, tuple(names)))

    # Definitions

    def _collect(self) -> None:
        todo = [(child, "", False) for child in reversed(self.root.children)]
        while todo:
            element, path, private = todo.pop()
            if element.name in _ANNOTATIONS:
                continue
            role = element.attributes.get("role", "")
            if role not in ("", "public", "private"):
                raise element.error(f"the role of {element.name} is public or private, not {role!r}")
            private = role == "private" or (private and role != "public")
            if element.name in _CONTAINERS:
                if element.name != "model-data":
                    name = element.attribute("name")
                    path = f"{path}.{name}" if path else name
                todo += [(child, path, private) for child in reversed(element.children)]
            elif element.name in _DEFINED:
                element.attribute("name")
                self._define(_Definition(element, path, private))
            else:
                raise self._refusal(element)

    def _define(self, one: _Definition) -> None:
        is_parameter = one.element.name == "define-parameter"
        table = self.parameters if is_parameter else self.events
        known = self.paths.get((is_parameter, one.full)) or (None if one.is_private else table.get(one.name))
        if known:
            raise one.element.error(f"{one.name} is defined twice, also at {known.element.place}; rename one of them")
        self.paths[is_parameter, one.full] = one
        if not one.is_private:
            table[one.name] = one
        self.all.append(one)

    def _choose_names(self) -> None:
        """Name nodes as events are; a private one by its path, if another event has its name."""
        events = [one for one in self.all if one.element.name in _EVENTS]
        count: dict[str, int] = {}
        for one in events:
            count[one.name] = count.get(one.name, 0) + 1
        for one in events:
            name = one.full if one.is_private and count[one.name] > 1 else one.name
            self.names[id(one.element)] = name
            self.taken.add(name)

    def _find(self, element: Element, path: str) -> _Definition | None:
        """Return what a reference in a container means: what this container defines, else what is public."""
        name, is_parameter = element.attribute("name"), element.name == "parameter"
        local = self.paths.get((is_parameter, f"{path}.{name}"))
        if local is None:
            table = self.parameters if is_parameter else self.events
            local = self.paths.get((is_parameter, name)) if "." in name else table.get(name)
        if local is not None:
            kind = _DEFINED[local.element.name]
            if element.name not in (kind, "event"):
                raise element.error(f"{name} is a {kind}, defined at {local.element.place}, and no {element.name}")
        return local

    def _refusal(self, element: Element) -> LanguageError:
        why = _REFUSED.get(element.name, _UNKNOWN)
        return element.error(f"<{element.name}> cannot be read: {why}")

    # Gates

    def _read_gate(self, one: _Definition) -> None:
        gate = self.names[id(one.element)]
        todo = [(gate, self._formula(one.element))]
        number = 0
        while todo:
            name, formula = todo.pop()
            if formula.name in _GATES:
                inputs = formula.children
                if not inputs:
                    raise formula.error(f"<{formula.name}> of {gate} has no input; add at least one")
            elif formula.name in ("constant", *_EVENTS.values(), "event"):
                inputs = [formula]
            else:
                raise self._refusal(formula)
            below: list[tuple[_Input, Place]] = []
            for inner in inputs:
                found: _Input
                if inner.name in _GATES:
                    number, found = self._fresh(gate, number)
                    todo.append((found, inner))
                else:
                    found = self._input(inner, one.path)
                below.append((found, inner.place))
            need = self._need(formula, len(inputs))
            self.shapes[name] = _Shape(_GATES.get(formula.name, Gate.OR), below, need, formula.place)

    def _formula(self, element: Element) -> Element:
        formulas = [child for child in element.children if child.name not in _ANNOTATIONS]
        if len(formulas) != 1:
            raise element.error(f"the gate {element.attributes['name']} has {len(formulas)} formulas; it needs one")
        return formulas[0]

    def _need(self, formula: Element, inputs: int) -> int:
        if formula.name != "atleast":
            return inputs if formula.name == "and" else 1
        text = formula.attribute("min")
        if not (text.isascii() and text.isdigit() and len(text) < 10 and 1 <= int(text) <= inputs):
            raise formula.error(f"the min of <atleast> is an integer from 1 to {inputs}, the number of its inputs")
        return int(text)

    def _fresh(self, gate: str, number: int) -> tuple[int, str]:
        """Return a name for an inner formula, with its number."""
        while True:
            number += 1
            name = f"{gate}-{number}"
            if name not in self.taken:
                self.taken.add(name)
                return number, name

    def _input(self, element: Element, path: str) -> _Input:
        if element.name == "constant":
            return self._constant(element)
        if element.name not in ("gate", "basic-event", "house-event", "event"):
            raise self._refusal(element)
        found = self._find(element, path)
        if found is not None:
            name = self.names[id(found.element)]
            return self.houses.get(name, name)
        name = element.attribute("name")
        is_basic = element.name == "basic-event" or (element.name == "event" and not self.defines_basic_events)
        if not is_basic or "." in name:
            known = [one.name for one in self.all if one.element.name in _EVENTS]
            raise element.error(f"the {element.name} {name} is not defined{did_you_mean(name, known)}")
        self.taken.add(name)  # its definition may be in a file of its own
        return name

    def _house(self, one: _Definition) -> bool:
        constant = one.element.first("constant")
        if constant is None:
            raise one.element.error(f'{one.name} has no value; add <constant value="true"/>')
        return self._constant(constant)

    def _constant(self, element: Element) -> bool:
        value = element.attribute("value")
        if value not in ("true", "false"):
            raise element.error(f"a constant is true or false, not {value!r}")
        return value == "true"

    def _tops(self) -> list[str]:
        below = {child for shape in self.shapes.values() for child, _ in shape.inputs}
        return [name for name in self.shapes if name not in below]

    def _fold(self, tops: list[str]) -> dict[str, None]:
        """Remove constants from gates, and return the gates that remain."""
        parents: dict[str, list[str]] = {}
        for name, shape in self.shapes.items():
            for child, _ in shape.inputs:
                if isinstance(child, str):
                    parents.setdefault(child, []).append(name)
        todo = [
            name for name, shape in self.shapes.items() if any(isinstance(child, bool) for child, _ in shape.inputs)
        ]
        constant: dict[str, bool] = {}
        folded = dict.fromkeys(todo)
        while todo:
            name = todo.pop()
            if name in constant:
                continue
            shape = self.shapes[name]
            values = [(constant.get(child, child) if isinstance(child, str) else child) for child, _ in shape.inputs]
            inputs = [one for one, value in zip(shape.inputs, values, strict=True) if isinstance(value, str)]
            need = shape.need - sum(value is True for value in values)
            if need <= 0 or need > len(inputs):
                constant[name] = need <= 0
                todo += parents.get(name, [])
                folded |= dict.fromkeys(parents.get(name, []))
            else:
                self.shapes[name] = shape._replace(inputs=inputs, need=need)
        for name in tops:
            if name in constant:
                how = "always fails" if constant[name] else "never fails"
                message = f"the house events decide that {name} {how}: no event matters; change them"
                raise LanguageError(message, **self.shapes[name].place._asdict())
        for name in [one for one in folded if one not in constant][:1]:
            kept = [one for one in folded if one not in constant]
            self._say(self.shapes[name].place, f"constants are folded into {listing(kept)}", kept)
        left: dict[str, None] = {}
        reached = [*reversed(tops)] if folded else []
        while reached:
            name = reached.pop()
            if name in self.shapes and name not in left and name not in constant:
                left[name] = None
                reached += [child for child, _ in reversed(self.shapes[name].inputs) if isinstance(child, str)]
        return left if folded else dict.fromkeys(self.shapes)

    # Nodes and their annotations

    def _node(self, name: str, element: Element) -> DraftNode:
        node = self.page.draft.nodes.setdefault(name, DraftNode(name))
        node.statements.append(element.place)
        label = element.first("label")
        if label is not None and label.text:
            node.labels.append(Located(label.text, label.place))
        for group in element.named("attributes"):
            for one in group.named("attribute"):
                pair = one.attribute("name"), one.attributes.get("value", "")
                node.attributes.append(Located(pair, one.place))
        return node

    def _law(self, one: _Definition) -> Iterator[tuple[str, str]]:
        """Yield the probability or rate of a basic event, if it is constant."""
        laws = [child for child in one.element.children if child.name not in _ANNOTATIONS]
        name = self.names[id(one.element)]
        if len(laws) > 1:
            raise laws[1].error(f"{name} has {len(laws)} laws; keep one")
        for law in laws:
            is_rate = law.name == "exponential" and len(law.children) in (1, 2)
            value = self._value(law.children[0] if is_rate else law, one.path)
            if value is None:
                what = "rate" if is_rate else "probability"
                self._say(law.place, f"the {what} of {name} is left out: <{law.name}> has no constant value", [name])
                continue
            if is_rate and len(law.children) > 1 and law.children[1].name != _TIME:
                self._say(law.place, f"the mission time of {name} is left out; its rate is kept", [name])
            yield ("lambda" if is_rate else "prob"), value

    def _value(self, law: Element, path: str) -> str | None:
        """Return the text of a constant number, of which sums, products and so on are computed."""
        done: dict[int, str | None] = {}
        todo = [(law, path)]
        open_: set[int] = set()
        while todo:
            element, where = todo[-1]
            key = id(element)
            below = [] if key in done else self._operands(element, where)
            waiting = [pair for pair in below if id(pair[0]) not in done]
            if waiting and key not in open_:
                open_.add(key)
                if circle := next((pair for pair in waiting if id(pair[0]) in open_), None):
                    raise circle[0].error("the parameters form a cycle: this value depends on itself")
                todo += waiting
                continue
            todo.pop()
            if key not in done:
                done[key] = self._computed(element, [done.get(id(inner)) for inner, _ in below])
        return done[id(law)]

    def _operands(self, element: Element, path: str) -> list[tuple[Element, str]]:
        if element.name == "parameter":
            found = self._find(element, path)
            if found is None:
                raise element.error(f"the parameter {element.attributes['name']} is not defined")
            values = [child for child in found.element.children if child.name not in _ANNOTATIONS]
            if len(values) != 1:
                raise found.element.error(f"the parameter {found.name} has {len(values)} values; it needs one")
            return [(values[0], found.path)]
        is_mean = element.name == "normal-deviate" or (
            element.name == "lognormal-deviate" and len(element.children) == 3
        )
        if is_mean:
            return [(child, path) for child in element.children[:1]]
        if element.name in (*_SUMS, "sub", "div", "neg"):
            return [(child, path) for child in element.children]
        return []

    def _computed(self, element: Element, below: list[str | None]) -> str | None:
        if element.name in ("float", "int"):
            text = element.attribute("value")
            if not _is_number(text):
                raise element.error(f"{text!r} is no number")
            return text
        if not below or None in below:
            return None
        if len(below) == 1 and element.name not in ("neg", "sub"):
            return below[0]
        numbers = [float(text) for text in below if text is not None]
        first, *rest = numbers
        try:
            match element.name:
                case "add" | "mul":
                    result = _SUMS[element.name](numbers)
                case "sub":
                    result = first - math.fsum(rest)
                case "div":
                    result = first / math.prod(rest)
                case _:
                    result = -first
        except (ZeroDivisionError, OverflowError):
            raise element.error(f"<{element.name}> has no value: division by zero or overflow") from None
        return repr(result)


def _is_number(text: str) -> bool:
    try:
        return math.isfinite(float(text)) and "_" not in text
    except ValueError:
        return False
