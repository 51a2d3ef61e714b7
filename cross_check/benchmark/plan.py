"""What is compared: trees × semantics × languages."""

import hashlib
import math
from collections import Counter
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from random import Random
from time import process_time
from typing import Final, NamedTuple

from cross_check.generate.traces import fitting, interesting_values
from rvaft.backend import all_backends, backend
from rvaft.engine import Engine, engine
from rvaft.errors import OptionError, RvaftError, ToolFailed
from rvaft.language.printer import dumps
from rvaft.model.nodes import Gate, Node
from rvaft.model.patterns import Anything, Literal, substitute
from rvaft.model.tree import RVAFT
from rvaft.model.values import Json
from rvaft.model.verdict import Semantics, Verdict

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


# The events that every language runs: random traces that are led towards a detection, the same for the same seed.
#
# A random trace alone would soon be hopeless in most trees, and then no monitor has anything to do. So each event is one that the engine waits
# for, with values under which hope remains if some are found; one in ten fits nothing, where that does no harm. One trace in four is led on
# purpose, somewhere on its way, to where no hope is left, if the tree has such a place: a text has to say that, too.

EVENTS: Final = 240
"""Events of all walks together; the last walk ends with them."""
LONGEST: Final = 60
"""Events after which a walk ends without a verdict."""
_NOISE: Final = 0.1
_DOOMED: Final = 4
"""One walk in so many is led to where no hope is left."""
_TRIES: Final = 16
"""How many events to try for one that leaves hope, or none."""
_FOREIGN: Final = "none of the tree's"
SCALARS: Final = (str, int, float, bool, type(None))


@dataclass(frozen=True, slots=True)
class Walk:
    """A trace, and the verdict after each of its events."""

    events: tuple[Json, ...]
    verdicts: tuple[Verdict, ...]


def walks(
    tree: RVAFT, semantics: Semantics, seed: int, *, events: int = EVENTS, seconds: float = math.inf
) -> tuple[Walk, ...]:
    """So many events in traces that each end with a final verdict or when they are long; fewer where the engine gives up or takes longer."""
    random = Random(f"{seed} {semantics}")  # noqa: S311 (no secret)
    values = [value for value in interesting_values(tree) if isinstance(value, SCALARS)]
    start = engine(tree, semantics)
    found: list[Walk] = []
    left, until = events, process_time() + seconds
    while left > 0 and process_time() < until:
        doomed = semantics is not Semantics.SCATTERED and len(found) % _DOOMED == _DOOMED - 1  # there hope never ends
        doom = random.randrange(len(found[-1].events)) if doomed else LONGEST
        walk = _walk(random, start.fork(), values, _Way(min(left, LONGEST), doom, until))
        if not walk.events:
            break
        found.append(walk)
        left -= len(walk.events)
    return tuple(found)


class _Way(NamedTuple):
    """How a walk goes: the most events, after how many of them whatever ends all hope is what happens, and until when."""

    longest: int
    doom: int
    until: float


def _walk(random: Random, monitor: Engine, values: Sequence[Json], way: _Way) -> Walk:
    taken: list[Json] = []
    verdicts: list[Verdict] = []
    noisy = monitor.semantics is not Semantics.STRICT
    try:
        while len(taken) < way.longest and not monitor.verdict.final and process_time() < way.until:
            event = _hopeless(random, monitor, values) if len(taken) >= way.doom else None
            if event is None:
                noise = noisy and random.random() < _NOISE
                event = {_FOREIGN: len(taken)} if noise else _hopeful(random, monitor, values)
            verdicts.append(monitor.step(event))
            taken.append(event)
    except RvaftError:
        pass  # more partial matches than the engine follows; what there is will do
    return Walk(tuple(taken), tuple(verdicts))


def _hopeless(random: Random, monitor: Engine, values: Sequence[Json]) -> Json | None:
    """An event that leaves no hope, if one is found: most often one of the tree's own."""
    tree = monitor.tree
    nodes = random.sample(tree.occurrences, min(len(tree.occurrences), _TRIES))
    tried: list[Json] = [fitting(random, tree.pattern(node) or Anything(), values) for node in nodes]
    tried.insert(random.randrange(len(tried) + 1), {_FOREIGN: 0})
    return next((event for event in tried if monitor.fork().step(event) is Verdict.FALSE), None)


def _hopeful(random: Random, monitor: Engine, values: Sequence[Json]) -> Json:
    """An event that is waited for, and, if one is found, leaves hope."""
    event: Json = {}
    for node, variables in _candidates(random, monitor):
        bound = {name: Literal(value) for name, value in variables.items() if isinstance(value, SCALARS)}
        event = fitting(random, substitute(monitor.tree.pattern(node) or Anything(), bound), values)
        if monitor.fork().step(event) is not Verdict.FALSE:
            break
    return event


def _candidates(random: Random, monitor: Engine) -> Iterator[tuple[str, Mapping[str, Json]]]:
    """Nodes whose events to try, with values that are bound; what is waited for is only asked where trying is no cheaper."""
    tree = monitor.tree
    if monitor.semantics is not Semantics.SCATTERED and not tree.variables:  # where a wrong guess shows at once
        yield from ((node, {}) for node in random.sample(tree.occurrences, min(len(tree.occurrences), _TRIES)))
    awaited = [(one.node, record.variables) for record in monitor.pending(limit=1) for one in record.awaited]
    yield from (random.choice(awaited) for _ in range(_TRIES if awaited else 0))
