"""The backend: tree to HOA text, HOA text to monitor."""

from collections.abc import Mapping
from functools import partial
from typing import ClassVar

from backends.automaton.determinise import HOPELESS, Automaton, determinised, minimised, refined
from backends.automaton.diagram import BEFORE, READABLE, diagram
from backends.automaton.hoa_reader import HoaMonitor, program
from backends.automaton.hoa_writer import title_of, write
from backends.automaton.letters import FeasibleLetters, Relevance
from backends.automaton.structure import Structure, structure
from rvaft.backend import Backend, Observed, SpecificationText
from rvaft.capabilities import EVERY_OPERATOR, GATES, JSON_VALUES, Feature, Ties, Value
from rvaft.core.passes import Pass, bind_times, expand_times, order_ends, windows_to_guards
from rvaft.core.property import Condition, Part, Property
from rvaft.core.residual import ResidualSpace
from rvaft.errors import TooLarge
from rvaft.model.guards import Operator
from rvaft.model.patterns import Pattern
from rvaft.model.tree import RVAFT
from rvaft.model.verdict import Semantics
from rvaft.monitors import Monitor
from rvaft.support.budget import Work


class AutomatonBackend(Backend):
    """Deterministic automata that are complete over the letters which an event can make true, and minimal over them.

    A letter that no event makes true leads where the shortest labels let it, mostly nowhere, which
    HOA reads as rejection; labels of one state are disjoint all the same, and no state owes its
    verdict to such a letter. The limit of `translate` is a number of states; for each, ten edges
    and a thousand steps of the construction are allowed. Reading needs Spot, translating does not.

    >>> from rvaft import loads
    >>> specification = AutomatonBackend().translate(loads("toplevel r; r sand a b;"), Semantics.STRICT)
    >>> specification.metrics.states, specification.text.splitlines()[0]
    (5, 'HOA: v1')
    """

    name: ClassVar[str] = "automaton"
    language: ClassVar[str] = "hoa"
    suffix: ClassVar[str] = ".hoa"
    semantics: ClassVar[frozenset[Semantics]] = frozenset(Semantics)
    says: ClassVar[frozenset[type[Part]]] = GATES | {Condition}
    passes: ClassVar[tuple[Pass, ...]] = (expand_times, order_ends, windows_to_guards, bind_times)
    operators: ClassVar[frozenset[Operator]] = EVERY_OPERATOR
    features: ClassVar[frozenset[Feature]] = frozenset({Feature.TIME_POINTS})
    values: ClassVar[frozenset[Value]] = JSON_VALUES
    ties: ClassVar[Ties] = Ties.ANY
    default_limit: ClassVar[int] = 100_000

    def write(self, prop: Property, semantics: Semantics, limit: int) -> SpecificationText:
        """The automaton in HOA; raises `TooLarge` beyond `limit` states."""
        work = Work(limit)
        automaton, parts, letters = _built(prop, semantics, work)
        relevance, name = _relevance(prop, semantics), title_of(prop, semantics)
        text, metrics = write(automaton, parts, letters, name=name, time=prop.time, relevance=relevance, work=work)
        return SpecificationText(text, metrics, partial(AutomatonBackend.read, self))

    def diagram(self, tree: RVAFT, semantics: Semantics, *, limit: int | None = None) -> str:
        """The minimal automaton as a graph in the DOT language; raises `TooLarge` beyond so many
        states, by default `READABLE`.
        """
        semantics, most = Semantics(semantics), READABLE if limit is None else limit
        prop = self.prepared(tree, semantics)
        try:
            automaton, parts, letters = _built(prop, semantics, Work(BEFORE * most))
        except TooLarge as error:
            raise TooLarge(f"{error.what}, too many to draw", limit=most) from error
        return diagram(automaton, parts, letters, prop=prop, semantics=semantics, limit=most)

    def read(self, text: str, *, atoms: Mapping[str, Pattern] | None = None) -> Monitor:
        """A monitor that runs any HOA text.

        With a proposition `alive` the text is read as an encoding of finite words, whatever its
        acceptance; without, as a finite automaton that accepts in its accepting states. Raises
        `LanguageError`, `ToolMissing` without Spot, `TooLarge`.
        """
        return HoaMonitor(program(text, atoms))

    def observed(self, text: str, *, atoms: Mapping[str, Pattern] | None = None) -> tuple[Observed, ...] | None:
        """What the propositions of a HOA text ask of events, None where times are among it; raises as `read` does."""
        known = program(text, atoms)
        return tuple(dict.fromkeys(known.questions())) if known.time is None else None


def _relevance(prop: Property, semantics: Semantics) -> Relevance | None:
    if not semantics.projects:
        return None
    alphabet = dict.fromkeys((entry.pattern, entry.when) for entry in prop.alphabet)
    ignored = dict.fromkeys((one.pattern, one.when) for one in prop.ignored)
    return Relevance(tuple(alphabet), tuple(ignored))


def _built(prop: Property, semantics: Semantics, work: Work) -> tuple[Automaton, Structure, FeasibleLetters]:
    """The minimal automaton of a property, and what its letters mean."""
    parts = structure(prop)
    scattered = semantics is Semantics.SCATTERED
    letters = FeasibleLetters(parts.patterns, _relevance(prop, semantics))
    automaton = Automaton(HOPELESS)
    if parts.form.feasible:  # constant guards may leave no scenario
        residuals = ResidualSpace(parts.form, parts.atom_of, parts.guard_bits, at_least=not scattered, work=work)
        automaton = determinised(residuals, letters, work, semantics)
    if semantics is Semantics.CONSECUTIVE:
        return refined(automaton, letters, work), parts, letters
    return minimised(automaton, letters, work, looping=scattered), parts, letters
