"""What is compared, trees × semantics × languages, and the events that every language runs."""

import hashlib
import math
from collections import Counter
from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass
from functools import cached_property
from random import Random
from time import process_time
from typing import Final

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
        """Some digits of a hash of the tree's canonical text, by which the tree is known again."""
        return hashlib.sha256(dumps(self.tree).encode(errors="surrogateescape")).hexdigest()[:12]


@dataclass(frozen=True, slots=True)
class Cell:
    """One thing to measure: a tree under a semantics in a language."""

    subject: Subject
    semantics: Semantics
    language: str


def gate_subject(gate: Gate, children: int, threshold: int | None = None) -> Subject:
    """A gate over so many leaves with default events, which are pairwise disjoint: no event can be of two of them.

    >>> gate_subject(Gate.AND, 3).name
    'and 3'
    """
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
    """All backends but those whose texts are another backend's texts in another form; the unfaithful ones come last."""
    faithful: dict[str, bool] = {}
    for name in all_backends():
        faithful[name] = False  # a backend that cannot be loaded is in nobody's way, and its rows say why it cannot run
        with suppress(ToolFailed):
            if (found := backend(name)).form_of is None:
                faithful[name] = found.faithful
            else:
                del faithful[name]
    return tuple(sorted(faithful, key=lambda name: (not faithful[name], name)))


def cells_of(subjects: Iterable[Subject], semantics: Iterable[Semantics], languages: Iterable[str]) -> tuple[Cell, ...]:
    """Every tree under every semantics in every language, in this order.

    Raises `OptionError` for a comparison of nothing, and for two trees that reports would call the same.
    """
    subjects, semantics, languages = tuple(subjects), tuple(semantics), tuple(languages)
    for name, count in Counter(subject.name for subject in subjects).items():
        if count > 1:
            raise OptionError(
                f"{count} trees are called {name}: rename a file, or write its path in another way, as ./{name}"
            )
    cells = tuple(
        Cell(subject, choice, language) for subject in subjects for choice in semantics for language in languages
    )
    if not cells:
        raise OptionError("nothing to compare: name at least one tree or gate, one semantics and one language")
    return cells


# -- the events ---------------------------------------------------------------------------------------------------------
# A random trace alone would soon be hopeless in most trees, and then no monitor has anything to do. So each event is one that the
# engine waits for, with values under which hope remains if some are found; one in ten fits nothing, where that does no harm. One
# walk in four is led on purpose, somewhere on its way, to where no hope is left, if the tree has such a place: a text has to say
# that, too.

EVENTS: Final = 240
"""Events of all walks together; the last walk ends with them."""
LONGEST: Final = 60
"""Events after which a walk ends without a verdict."""
_NOISE: Final = 0.1
_DOOMED: Final = 4
_TRIES: Final = 16
"""How many events to try for one that leaves hope, or none."""
_FOREIGN: Final = "none of the tree's"
_SCALARS: Final = (str, int, float, bool, type(None))


@dataclass(frozen=True, slots=True)
class Walk:
    """A trace that is led through the tree, and the verdict after each of its events."""

    events: tuple[Json, ...]
    verdicts: tuple[Verdict, ...]


def walks(
    tree: RVAFT, semantics: Semantics, seed: int, *, events: int = EVENTS, seconds: float = math.inf
) -> tuple[Walk, ...]:
    """So many events in traces that each end with a final verdict or when they are long; fewer where the engine gives up or takes longer."""
    guide = _Guide(tree, semantics, Random(f"{seed} {semantics}"), process_time() + seconds)  # noqa: S311 (no secret)
    found: list[Walk] = []
    while events > 0 and process_time() < guide.until:
        doomed = semantics is not Semantics.SCATTERED and len(found) % _DOOMED == _DOOMED - 1  # there hope never ends
        doom = guide.random.randrange(len(found[-1].events)) if doomed else LONGEST
        walk = guide.walk(min(events, LONGEST), doom)
        if not walk.events:
            break
        found.append(walk)
        events -= len(walk.events)
    return tuple(found)


class _Guide:
    """Leads walks through a tree with the help of the engine, until a moment of the processor's time."""

    def __init__(self, tree: RVAFT, semantics: Semantics, random: Random, until: float) -> None:
        self.random = random
        self.until = until
        self._tree = tree
        self._start = engine(tree, semantics)
        self._values = [value for value in interesting_values(tree) if isinstance(value, _SCALARS)]

    def walk(self, longest: int, doom: int) -> Walk:
        """A walk of at most so many events; after `doom` of them whatever ends all hope is what happens."""
        monitor, taken, verdicts = self._start.fork(), list[Json](), list[Verdict]()
        noisy = monitor.semantics is not Semantics.STRICT
        with suppress(RvaftError):  # more partial matches than the engine follows; what there is will do
            while len(taken) < longest and not monitor.verdict.final and process_time() < self.until:
                event = self._hopeless(monitor) if len(taken) >= doom else None
                if event is None:
                    noise = noisy and self.random.random() < _NOISE
                    event = {_FOREIGN: len(taken)} if noise else self._hopeful(monitor)
                verdicts.append(monitor.step(event))
                taken.append(event)
        return Walk(tuple(taken), tuple(verdicts))

    def _fitting(self, node: str, variables: Mapping[str, Json]) -> Json:
        bound = {name: Literal(value) for name, value in variables.items() if isinstance(value, _SCALARS)}
        return fitting(self.random, substitute(self._tree.pattern(node) or Anything(), bound), self._values)

    def _some_nodes(self) -> list[str]:
        return self.random.sample(self._tree.occurrences, min(len(self._tree.occurrences), _TRIES))

    def _hopeless(self, monitor: Engine) -> Json | None:
        """An event that leaves no hope, if one is found: most often one of the tree's own."""
        tried = [self._fitting(node, {}) for node in self._some_nodes()]
        tried.insert(self.random.randrange(len(tried) + 1), {_FOREIGN: 0})
        return next((event for event in tried if monitor.fork().step(event) is Verdict.FALSE), None)

    def _hopeful(self, monitor: Engine) -> Json:
        """An event that is waited for, and, if one is found, leaves hope."""
        event: Json = {}
        for node, variables in self._candidates(monitor):
            event = self._fitting(node, variables)
            if monitor.fork().step(event) is not Verdict.FALSE:
                break
        return event

    def _candidates(self, monitor: Engine) -> Iterator[tuple[str, Mapping[str, Json]]]:
        """Nodes whose events to try, with values that are bound; what is waited for is only asked where trying is no cheaper."""
        if monitor.semantics is not Semantics.SCATTERED and not self._tree.variables:  # a wrong guess shows at once
            yield from ((node, {}) for node in self._some_nodes())
        awaited: Sequence[tuple[str, Mapping[str, Json]]] = [
            (one.node, record.variables) for record in monitor.pending(limit=1) for one in record.awaited
        ]
        yield from (self.random.choice(awaited) for _ in range(_TRIES if awaited else 0))
