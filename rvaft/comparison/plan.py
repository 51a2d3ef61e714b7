"""What is compared: trees × semantics × languages."""

import hashlib
from collections import Counter
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from functools import cached_property
from typing import Final

from rvaft.backend import all_backends, backend
from rvaft.errors import OptionError, ToolFailed
from rvaft.language import dumps
from rvaft.model import Gate, Node
from rvaft.tree import RVAFT
from rvaft.verdict import Semantics

MAX_ARITY: Final = 12
"""The most children of a gate, unless more are asked for."""
TIMEOUT: Final = 60.0
"""Seconds of the processor for one cell, unless others are asked for."""
MEMORY: Final = 4096
"""Megabytes of memory (2**20 bytes each) for one cell, unless others are asked for."""


@dataclass(frozen=True)
class Subject:
    """A tree with the name that reports call it by; `gate` and `threshold` are those of a gate over leaves, None for any other tree."""

    name: str
    tree: RVAFT
    gate: Gate | None = None
    threshold: int | None = None

    @property
    def children(self) -> int | None:
        """How many leaves the gate is over."""
        return None if self.gate is None else len(self.tree.nodes[self.tree.root].children)

    @cached_property
    def digest(self) -> str:
        """By what the tree is known again: some digits of a hash of its canonical text."""
        return hashlib.sha256(dumps(self.tree).encode(errors="surrogateescape")).hexdigest()[:12]


@dataclass(frozen=True, slots=True)
class Settings:
    """What a measurement depends on beside its cell.

    `limit` is that of translations, in the unit of the language (None: the backend's own); `timeout` is in seconds of the processor, for
    everything that is done in one cell, and `memory` in megabytes for each process of it; `seed` is that of the events that are run.
    """

    limit: int | None = None
    timeout: float = TIMEOUT
    seed: int = 0
    memory: int = MEMORY


@dataclass(frozen=True, slots=True)
class Cell:
    """One thing to measure."""

    subject: Subject
    semantics: Semantics
    language: str


def gate_subject(gate: Gate, children: int, threshold: int | None = None) -> Subject:
    """A gate over so many leaves with default events, which are pairwise disjoint: no event can be of two of them."""
    leaves = [Node(f"e{number}") for number in range(1, children + 1)]
    root = Node("top", gate, tuple(leaf.name for leaf in leaves), threshold)
    size = f"{children}" if threshold is None else f"{threshold}/{children}"
    return Subject(f"{gate} {size}", RVAFT("top", [root, *leaves]), gate, threshold)


def gate_subjects(gates: Iterable[Gate] = Gate, max_arity: int = MAX_ARITY) -> Iterator[Subject]:
    """Each gate with 1 to `max_arity` children; VOT with every threshold."""
    for gate in gates:
        for children in range(1, max_arity + 1):
            for threshold in range(1, children + 1) if gate is Gate.VOT else (None,):
                yield gate_subject(gate, children, threshold)


def default_languages() -> tuple[str, ...]:
    """All backends but those whose texts are the texts of another one in another form; the unfaithful ones come last."""
    found = {name: _faithful(name) for name in all_backends() if _own_texts(name)}
    return tuple(sorted(found, key=lambda name: (not found[name], name)))


def _own_texts(name: str) -> bool:
    try:
        return backend(name).form_of is None
    except ToolFailed:
        return True  # it is in the way of nobody, and its rows say why it cannot run


def _faithful(name: str) -> bool:
    try:
        return backend(name).faithful
    except ToolFailed:
        return False


def cells_of(subjects: Iterable[Subject], semantics: Iterable[Semantics], languages: Iterable[str]) -> tuple[Cell, ...]:
    """Every tree under every semantics in every language, in this order.

    Raises `OptionError` for a comparison of nothing, and for two trees that reports would call the same.
    """
    subjects, spoken = tuple(subjects), tuple(languages)
    for name, count in Counter(subject.name for subject in subjects).items():
        if count > 1:
            raise OptionError(
                f"{count} trees are called {name}: rename a file, or write its path in another way, as ./{name}"
            )
    choices = [(choice, language) for choice in semantics for language in spoken]
    cells = tuple(Cell(subject, *choice) for subject in subjects for choice in choices)
    if not cells:
        raise OptionError("nothing to compare: name at least one tree or gate, one semantics and one language")
    return cells
