"""The backend of HOA automata."""

from collections.abc import Callable, Mapping
from functools import partial
from typing import Any, ClassVar

from backends.absences import refuse_timeless, without_vacuous
from backends.automaton.determinise import HOPELESS, Automaton, determinised, minimised, refined
from backends.automaton.hoa_reader import HoaMonitor, formal, program
from backends.automaton.hoa_writer import title_of, write
from backends.automaton.letters import FeasibleLetters, Relevance
from backends.automaton.partial_matches import PartialMatches
from backends.automaton.structure import Structure, structure
from rvaft.backend import Backend, Observed, SpecificationText
from rvaft.capabilities import EVERY_OPERATOR, GATES, JSON_VALUES, Capability, Feature, Ties, Value
from rvaft.core.passes import Pass
from rvaft.core.property import Condition, Part, Property, Within, WithoutEvent
from rvaft.core.residual import ResidualSpace
from rvaft.core.time_order import GUARDED_EVENTS
from rvaft.errors import NotExpressible, TooLarge, unwritten
from rvaft.model.guards import Operator
from rvaft.model.patterns import Pattern
from rvaft.model.tree import RVAFT
from rvaft.model.verdict import Semantics
from rvaft.monitors import Monitor
from rvaft.support.budget import Work


class AutomatonBackend(Backend):
    """Deterministic automata, complete over the feasible letters and minimal over them.

    A letter is feasible if an event can make it true. Infeasible letters change no verdict; mostly
    they have no edge, which HOA reads as rejection. The labels of one state are disjoint.

    The limit of `translate` counts states; each state allows ten edges and a thousand construction
    steps. Only reading needs Spot.

    >>> from rvaft import loads
    >>> specification = AutomatonBackend().translate(loads("toplevel r; r sand a b;"), Semantics.STRICT)
    >>> specification.metrics.states, specification.text.splitlines()[0]
    (5, 'HOA: v1')
    """

    name: ClassVar[str] = "automaton"
    language: ClassVar[str] = "hoa"
    suffix: ClassVar[str] = ".hoa"
    remark: ClassVar[str] = "/* {} */\n"
    remark_line: ClassVar[int] = 1
    semantics: ClassVar[frozenset[Semantics]] = frozenset(Semantics)
    says: ClassVar[frozenset[type[Part]]] = GATES | {Condition, WithoutEvent}
    passes: ClassVar[tuple[Pass, ...]] = GUARDED_EVENTS
    operators: ClassVar[frozenset[Operator]] = EVERY_OPERATOR
    features: ClassVar[frozenset[Feature]] = frozenset({Feature.TIME_POINTS, Feature.OWN_VALUES})
    values: ClassVar[frozenset[Value]] = JSON_VALUES | {Value.SOME_ITEM, Value.SOME_VARIABLE}
    ties: ClassVar[Ties] = Ties.ANY
    extensions: ClassVar[Mapping[Capability, str]] = {
        **dict.fromkeys((Ties.ALL_EVENTS, Ties.ANY), "slices"),
        **dict.fromkeys((Feature.TIME_POINTS, Within), "time variables"),
    }
    default_limit: ClassVar[int] = 100_000

    def write(self, prop: Property, semantics: Semantics, limit: int) -> SpecificationText:
        """Return the automaton in HOA."""
        work, prop = Work(limit), _sayable(prop, semantics)
        automaton, parts, letters = _built(prop, semantics, work)
        relevance, name = _relevance(prop, semantics), title_of(prop, semantics)
        text, metrics = write(automaton, parts, letters, name=name, time=prop.time, relevance=relevance, work=work)
        return SpecificationText(text, metrics, partial(AutomatonBackend.read, self))

    def diagram(self, tree: RVAFT, semantics: Semantics, *, limit: int | None = None) -> str:
        """Return the minimal automaton as DOT; raises `TooLarge` beyond `limit` states
        (`READABLE`).
        """
        from backends.automaton.diagram import BEFORE, READABLE, diagram  # noqa: PLC0415 -- a drawing, imported on use

        semantics, most = Semantics(semantics), READABLE if limit is None else limit
        prop = _sayable(self.prepared(tree, semantics), semantics)
        if prop.absences and semantics.projects:
            why = "an edge of a diagram is of relevant events, and an absent event may be none"
            raise NotExpressible(unwritten(why), nodes=[clause.source.node for clause in prop.absences])
        try:
            automaton, parts, letters = _built(prop, semantics, Work(BEFORE * most))
        except TooLarge as error:
            raise TooLarge(f"{error.what}, too many to draw", limit=most) from error
        return diagram(automaton, parts, letters, prop=prop, semantics=semantics, limit=most)

    def read(self, text: str, *, atoms: Mapping[str, Pattern] | None = None) -> Monitor:
        """Return a monitor for any HOA text.

        With a proposition `alive`, the text encodes finite words by any acceptance condition;
        without it, the text is an automaton over finite words.
        """
        return HoaMonitor(program(text, atoms))

    def read_confined(
        self, text: str, *, confine: Callable[[], object], atoms: Mapping[str, Pattern] | None = None
    ) -> Monitor:
        """Return a monitor as `read` does, which follows all slices whatever checksum the text has."""
        confine()
        return HoaMonitor(program(text, atoms, believed=False))

    def formal(self, text: str) -> dict[str, Any]:
        """Return the abstract syntax of an automaton."""
        return formal(text)

    def observed(self, text: str, *, atoms: Mapping[str, Pattern] | None = None) -> tuple[Observed, ...] | None:
        """Return the patterns of the propositions, or None if the text has times."""
        known = program(text, atoms)
        return tuple(dict.fromkeys(known.questions())) if known.time is None else None


def _sayable(prop: Property, semantics: Semantics) -> Property:
    """Return the property without clauses that every match holds; raises `NotExpressible` for others."""
    prop = without_vacuous(prop, semantics)
    refuse_timeless(prop, semantics, {Semantics.SCATTERED})
    for clause in prop.absences:
        nodes = [clause.source.node]
        if clause.guard is not None:
            raise NotExpressible(unwritten("absent events are written without guards"), nodes=nodes)
    return prop


def _relevance(prop: Property, semantics: Semantics) -> Relevance | None:
    if not semantics.projects:
        return None
    alphabet = dict.fromkeys((entry.pattern, entry.when) for entry in prop.alphabet)
    ignored = dict.fromkeys((one.pattern, one.when) for one in prop.ignored)
    return Relevance(tuple(alphabet), tuple(ignored))


def _built(prop: Property, semantics: Semantics, work: Work) -> tuple[Automaton, Structure, FeasibleLetters]:
    parts = structure(prop)
    scattered = semantics is Semantics.SCATTERED
    letters = FeasibleLetters(parts.patterns, _relevance(prop, semantics))
    automaton = Automaton(HOPELESS)
    if parts.form.feasible and prop.absences:
        matches = PartialMatches(prop, parts.atoms, parts.guard_bits, work)
        automaton = determinised(matches, letters, work, semantics)
    elif parts.form.feasible:  # constant guards may leave no scenario
        residuals = ResidualSpace(parts.form, parts.atom_of, parts.guard_bits, at_least=not scattered, work=work)
        automaton = determinised(residuals, letters, work, semantics)
    if semantics is Semantics.CONSECUTIVE or prop.absences:
        return refined(automaton, letters, work), parts, letters
    return minimised(automaton, letters, work, looping=scattered), parts, letters
