"""What a drawing of a tree says about one match, or one branch: which nodes and edges it is made of, and where its events are."""

import json
from collections.abc import Collection, Iterator, Mapping
from dataclasses import dataclass
from typing import Final

from rvaft.branches import branch
from rvaft.model import Kind
from rvaft.monitors import Explanation
from rvaft.tree import RVAFT
from rvaft.values import Json

LONGEST: Final = 120
"""Characters of a value; what is longer is cut, and a sign says so."""
_SHOWN_FIELDS: Final = ("time", "topic")
"""What is shown of an event beside its number, where it has them."""


@dataclass(frozen=True, slots=True)
class Marks:
    """A match on a tree: the scenario's nodes with the children they keep, what stands at a node, and what below the tree.

    `meaning` is what it means to be marked. Texts are not escaped for any format.
    """

    kept: Mapping[str, frozenset[str]]
    notes: Mapping[str, tuple[str, ...]]
    below: tuple[str, ...]
    meaning: str = "detected"

    def edge(self, parent: str, child: str) -> bool:
        """Whether the scenario keeps this child of this node."""
        return child in self.kept.get(parent, ())


def marks(tree: RVAFT, explanation: Explanation, events: Mapping[int, Json]) -> Marks:
    """The marks of a match; of an event that is not among `events` only the number is known."""
    scenario = {name: frozenset(children) for name, children in explanation.scenario.items()}
    kept = {**dict.fromkeys(explanation.matched, frozenset[str]()), **scenario}
    notes = {name: _note(number, events.get(number)) for name, number in explanation.matched.items()}
    return Marks(kept, notes, tuple(_below(tree, explanation)))


def branch_marks(tree: RVAFT, number: int) -> Marks:
    """The marks of the branch of that number; raises `TreeError` where there is none."""
    found = branch(tree, number)
    kept = {name: frozenset(found.children(name)) for name in found.nodes}
    return Marks(kept, {}, (_title(number, found.kinds),), f"branch {number}")


def _note(number: int, event: Json) -> tuple[str, ...]:
    shown = [field for field in _SHOWN_FIELDS if field in event] if isinstance(event, Mapping) else []
    return f"event {number}", *(f"{field} {_bare(event[field])}" for field in shown)


def _below(tree: RVAFT, explanation: Explanation) -> Iterator[str]:
    """The branch with its kinds, then the variables in the order of the tree."""
    if title := _title(explanation.branch, explanation.kinds):
        yield title
    order = {name: place for place, name in enumerate(tree.variables)}
    for name in sorted(explanation.variables, key=lambda name: order.get(name, len(order))):
        yield f"{name} = {_written(explanation.variables[name])}"


def _title(number: int | None, kinds: Collection[Kind]) -> str:
    words = ("" if number is None else f"branch {number}", ", ".join(sorted(kind.value for kind in kinds)))
    return ": ".join(word for word in words if word)


def _bare(value: Json) -> str:
    """A value as text, a string without its quotes."""
    return _cut(value) if isinstance(value, str) else _written(value)


def _written(value: Json) -> str:
    try:
        return _cut(json.dumps(value, ensure_ascii=False, default=repr))
    except ValueError:  # an integer of more digits than Python writes
        return "…"


def _cut(text: str) -> str:
    return text if len(text) <= LONGEST else f"{text[:LONGEST]}…"
