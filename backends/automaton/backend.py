"""The backend: tree to HOA text, HOA text to monitor."""

from collections.abc import Mapping
from functools import partial
from time import perf_counter
from typing import ClassVar, NamedTuple

from backends.automaton.configurations import Moves
from backends.automaton.determinise import HOPELESS, Automaton, Subsets
from backends.automaton.diagram import BEFORE, READABLE, diagram
from backends.automaton.hoa_writer import Relevance, Text, title_of, write
from backends.automaton.letters import Alphabet, Letters
from backends.automaton.minimise import minimised
from backends.automaton.structure import Plan, Structure, decided, plan, structure
from rvaft.backend import Backend, Metrics, Observed, Specification
from rvaft.errors import TooLarge
from rvaft.model.patterns import Pattern
from rvaft.model.tree import RVAFT
from rvaft.model.verdict import Semantics
from rvaft.monitors import Monitor


class AutomatonBackend(Backend):
    """Deterministic automata that are complete over the letters which an event can make true, and minimal over them.

    A letter that no event makes true leads where the shortest labels let it, mostly nowhere, which HOA reads as rejection; labels
    of one state are disjoint all the same, and no state owes its verdict to such a letter. The limit of `translate` is a number
    of states; for each, ten edges and a thousand steps of the construction are allowed. Reading needs Spot, translating does not.
    """

    name: ClassVar[str] = "automaton"
    language: ClassVar[str] = "hoa"
    suffix: ClassVar[str] = ".hoa"
    default_limit: ClassVar[int] = 100_000

    def translate(self, tree: RVAFT, semantics: Semantics, *, limit: int | None = None) -> Specification:
        """The tree as an automaton; raises `TooLarge`, never `NotExpressible`."""
        started = perf_counter()
        text = _translated(tree, Semantics(semantics), self.default_limit if limit is None else limit)
        metrics = Metrics(text.symbols, states=text.states, edges=text.edges, seconds=perf_counter() - started)
        return Specification(text.text, self.language, metrics, partial(AutomatonBackend.read, self))

    def diagram(self, tree: RVAFT, semantics: Semantics, *, limit: int | None = None) -> str:
        """The minimal automaton as a graph in the DOT language; raises `TooLarge` beyond so many states, by default `READABLE`."""
        most = READABLE if limit is None else limit
        try:
            built = _built(tree, Semantics(semantics), BEFORE * most)
        except TooLarge as error:
            raise TooLarge(f"{error.what}, too many to draw", limit=most) from error
        return diagram(
            built.automaton, built.parts, built.letters, tree=tree, semantics=Semantics(semantics), limit=most
        )

    def read(self, text: str, *, atoms: Mapping[str, Pattern] | None = None) -> Monitor:
        """A monitor that runs any HOA text.

        With a proposition `alive` the text is read as an encoding of finite words, whatever its acceptance; without, as a finite
        automaton that accepts in its accepting states. Raises `LanguageError`, `ToolMissing` without Spot, `TooLarge`.
        """
        from backends.automaton.monitor import monitor  # noqa: PLC0415 -- only reading needs Spot

        return monitor(text, {} if atoms is None else atoms)

    def observed(self, text: str, *, atoms: Mapping[str, Pattern] | None = None) -> tuple[Observed, ...]:
        """What the propositions of a HOA text ask of events; raises as `read` does."""
        from backends.automaton.monitor import observed  # noqa: PLC0415 -- only reading needs Spot

        return observed(text, {} if atoms is None else atoms)


def _translated(tree: RVAFT, semantics: Semantics, limit: int) -> Text:
    built = _built(tree, semantics, limit)
    return write(built.automaton, built.parts, built.letters, name=title_of(tree, semantics), relevance=built.relevance)


class _Built(NamedTuple):
    """The minimal automaton of a tree, and what its letters mean."""

    automaton: Automaton
    parts: Structure
    letters: Letters
    relevance: Relevance | None


def _built(tree: RVAFT, semantics: Semantics, limit: int) -> _Built:
    parts = structure(tree)
    relevance, alphabet = _relevance(tree) if semantics is Semantics.PROJECTED else (None, None)
    letters = Letters(parts.patterns, alphabet)
    plans = _plans(parts, semantics, limit)
    automaton = Subsets(Moves(plans), letters, semantics, limit).build() if plans else Automaton(HOPELESS)
    automaton = minimised(automaton, letters, looping=semantics is Semantics.SCATTERED)
    return _Built(automaton, parts, letters, relevance)


def _plans(parts: Structure, semantics: Semantics, limit: int) -> tuple[Plan, ...]:
    if parts.root is None:
        return ()
    root, binders, at_least = parts.root, parts.binders(), semantics is not Semantics.SCATTERED
    graphs = decided(parts, root, at_least=at_least, limit=limit)
    return tuple(plan(graph, root, binders, at_least=at_least, limit=limit) for graph in graphs)


def _relevance(tree: RVAFT) -> tuple[Relevance, Alphabet]:
    entries = dict.fromkeys((entry.pattern, entry.when) for entry in tree.alphabet)
    ignored = dict.fromkeys((tree.instantiate(ignore.on), ignore.when) for ignore in tree.ignores)
    alphabet = Alphabet(
        tuple(pattern for pattern, _ in entries), tuple(pattern for pattern, when in ignored if when is None)
    )
    return Relevance(tuple(entries), tuple(ignored)), alphabet
