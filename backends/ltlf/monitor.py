"""A monitor for formulas: one slice per reachable partial assignment of the variables.

At an event, a slice stays (atoms with unbound variables are false), or binds the values that make
one more atom true: any atom, or one that the state reads where this suffices. The letter is the set
of true atoms. The verdict is ⊤ if the formula holds in some slice on every continuation. A slice in
which it cannot hold is dropped; the verdict is ⊥ when none is left.
"""

from collections.abc import Callable, Hashable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import lru_cache, partial
from itertools import combinations
from typing import Any, Final, assert_never

from backends.ltlf.formulas import Connective, Formulas
from backends.ltlf.progression import Residuals
from backends.ltlf.reader import Header, Observation, formula_of
from backends.slices import advance, fits, start
from rvaft.backend import Observed
from rvaft.core.letters import Letter, Reader, reader
from rvaft.core.overlaps import overlaps
from rvaft.core.pattern_index import FirstLiterals, PatternIndex, literals_of
from rvaft.export.event_conditions import EventConditions
from rvaft.model import guards, patterns
from rvaft.model.patterns import Binding, Pattern
from rvaft.model.values import Json
from rvaft.model.verdict import Verdict
from rvaft.monitors import Monitor


@dataclass(frozen=True, slots=True, eq=False)
class Atom:
    """The condition of an atom on an event; `pattern` is a necessary condition."""

    pattern: Pattern
    binds: frozenset[str]
    """Variables that must be bound for the atom to be true."""
    mentions: frozenset[str]
    """All variables that affect the atom."""
    extended: Callable[[Json, Binding], Iterable[Binding]]
    """The smallest extensions of a binding that make the atom true at an event."""

    def holds(self, event: Json, binding: Binding, before: Binding) -> bool:
        """Return whether the atom is true at an event; `before` is the binding before the event."""
        return self.binds <= binding.keys() and fits(partial(self.extended, event), binding, before)


def atoms_of(header: Header, names: Iterable[str], given: Mapping[str, Pattern]) -> dict[str, Atom]:
    """Return the named atoms: from the header, from `given`, or as the event of that name."""
    return {
        name: _relevance(header.relevant.get(name, ()), header.ignored.get(name, ()))
        if name in header.relevant or name in header.ignored
        else _event_atom(_observation(header, name, given))
        for name in names
    }


def _observation(header: Header, name: str, given: Mapping[str, Pattern]) -> Observation:
    if name in header.atoms:
        return header.atoms[name]
    return Observation(given.get(name) or patterns.ObjectPattern((("event", patterns.Literal(name)),)))


def _event_atom(observation: Observation) -> Atom:
    pattern = observation.observed
    binds = frozenset(patterns.rigid_variables(pattern))

    conditions = [(guard, frozenset(guards.variables(guard))) for guard in observation.guards]

    def extended(event: Json, binding: Binding) -> Iterator[Binding]:
        for bound in patterns.rigid_ways(patterns.ways(pattern, event, binding)):
            if all(guards.holds(guard, bound) for guard, names in conditions if names <= bound.keys()):
                yield bound

    return Atom(pattern, binds, binds.union(*(names for _, names in conditions)), extended)


def _relevance(relevant: Sequence[Observation], ignored: Sequence[Observation]) -> Atom:

    def fitting(observations: Sequence[Observation]) -> PatternIndex[list[Reader]]:
        readers = [reader(number, Letter(one.pattern, one.when)) for number, one in enumerate(observations)]
        found = [one.pattern for one in observations]
        return PatternIndex(found, lambda at: [readers[number] for number in (*at.fits, *at.open)])

    relevance, ignorance = fitting(relevant), fitting(ignored)

    def extended(event: Json, binding: Binding) -> tuple[Binding, ...]:
        fits = isinstance(event, Mapping) and any(one.admits(event) for one in relevance.of(event))
        return (binding,) if fits and not any(one.admits(event) for one in ignorance.of(event)) else ()

    return Atom(patterns.Anything(), frozenset(), frozenset(), extended)


@lru_cache(maxsize=8)
def _formula(text: str) -> tuple[Header, Formulas, int]:
    formulas = Formulas()
    header, root = formula_of(text, formulas)
    return header, formulas, root


def observed(text: str, given: Mapping[str, Pattern]) -> tuple[Observed, ...] | None:
    """Return the patterns and guards of the atoms and of relevance, or None if the formula has
    times.

    `given` has the patterns of atoms that the text does not define.
    """
    header, formulas, root = _formula(text)
    return tuple(dict.fromkeys(_questions(header, formulas, root, given))) if header.time is None else None


def _questions(header: Header, formulas: Formulas, root: int, given: Mapping[str, Pattern]) -> Iterator[Observed]:
    for name in formulas.atoms(root):
        if name not in header.relevant and name not in header.ignored:
            one = _observation(header, name, given)
            # an anonymous variable is never bound, so a guard on it counts as true
            shared = [g for g in one.guards if not any(variable.startswith("_") for variable in guards.variables(g))]
            yield Observed(one.pattern, Observation(one.pattern, tuple(shared)).when)
        for one in (*header.relevant.get(name, ()), *header.ignored.get(name, ())):
            if set(guards.variables(one.when)) <= set(patterns.variables(one.pattern)):
                yield Observed(one.pattern, one.when).untied()  # any values suffice


def binds_late(formulas: Formulas, root: int, atoms: Mapping[str, Atom]) -> bool:
    """Return whether it suffices that slices bind the atoms that their state reads.

    Then a slice never needs a value earlier: no atom is false because of a variable of another atom,
    and no event must make two atoms true that bind different variables.
    """
    rows, order = formulas.rows, formulas.reachable(root)
    signs = {(root, True)}  # the subformulas, by polarity
    for number, sign in ((number, sign) for number in reversed(order) for sign in (True, False)):
        if (number, sign) in signs:
            signs |= {(operand, sign is not (rows[number].op is Connective.NOT)) for operand in rows[number].operands}
    negative = [rows[number] for number, sign in signs if not sign]
    if any(row.op is Connective.ATOM and not atoms[row.name].mentions <= atoms[row.name].binds for row in negative):
        return False
    binding = [atom for atom in atoms.values() if atom.binds]
    pairs = [
        (one, other)
        for one, other in combinations(binding, 2)
        if not (one.binds <= other.binds or other.binds <= one.binds) and overlaps(one.pattern, other.pattern)
    ]

    def clash(left: frozenset[Atom], right: frozenset[Atom]) -> bool:
        return any((one in left and other in right) or (one in right and other in left) for one, other in pairs)

    # The atoms that are needed now, and later, on some way to accept a prefix.
    needed: dict[tuple[int, bool], tuple[frozenset[Atom], frozenset[Atom]]] = {}
    for number, sign in ((number, sign) for number in order for sign in (True, False) if (number, sign) in signs):
        row, now, later = rows[number], frozenset[Atom](), frozenset[Atom]()
        joint = row.op is (Connective.AND if sign else Connective.OR)
        for this, after in (needed[operand, sign is not (row.op is Connective.NOT)] for operand in row.operands):
            if joint and (clash(now, this) or clash(later, after)):
                return False
            now, later = now | this, later | after
        match row.op:
            case Connective.ATOM:
                now = frozenset([atoms[row.name]] if sign else ())
            case Connective.NEXT | Connective.EVENTUALLY | Connective.UNTIL:
                again = frozenset[Atom]().union(*needed[row.operands[0], sign])  # at several positions of an until
                if pairs and (not sign or (row.op is Connective.UNTIL and clash(again, now | later))):
                    return False
                now, later = frozenset() if row.op is Connective.NEXT else now, now | later
            case Connective.TRUE | Connective.FALSE | Connective.NOT | Connective.AND | Connective.OR:
                pass
            case other:
                assert_never(other)
        needed[number, sign] = now, later
    return True


_AS_JUNCTION: Final = {Connective.TRUE: "AND", Connective.FALSE: "OR"}


def formal(text: str) -> dict[str, Any]:
    """Return the formula as rows, operands first; raises `NotExpressible` and `LanguageError`."""
    header, formulas, root = _formula(text)
    events = EventConditions(header.time)

    def atom(name: str) -> Json:
        if name in header.relevant or name in header.ignored:
            return events.relevance(header.relevant.get(name, ()), header.ignored.get(name, ()))
        one = _observation(header, name, {})
        return events.atom(one.observed, one.guards)

    place: dict[int, int] = {}
    body: list[Json] = []
    for number in formulas.reachable(root):
        place[number], row = len(body), formulas.rows[number]
        operands = [atom(row.name)] if row.op is Connective.ATOM else [place[operand] for operand in row.operands]
        body.append([_AS_JUNCTION.get(row.op, row.op.name).lower(), *operands])
    return events.text("ltlf", body)


@lru_cache(maxsize=32)
class _LtlfProgram:
    """The formula of a text, its atoms and a cache of residuals, for all monitors of the text."""

    def __init__(self, text: str, given: tuple[tuple[str, Pattern], ...]) -> None:
        header, formulas, root = _formula(text)
        self.stamped = header.stamped
        self.atoms = atoms_of(header, formulas.atoms(root), dict(given))
        self.residuals = Residuals(formulas, {name: atom.mentions for name, atom in self.atoms.items()})
        self.initial = self.residuals.of(root)
        self.late = binds_late(formulas, root, self.atoms)
        self.names = list(self.atoms)
        self.index = FirstLiterals(literals_of(atom.pattern) for atom in self.atoms.values())


class LtlfMonitor(Monitor):
    """A monitor for an LTLf formula; raises `TooLarge` beyond the limit of slices."""

    def __init__(self, text: str, given: Mapping[str, Pattern]) -> None:
        super().__init__()
        self._program = _LtlfProgram(text, tuple(sorted(given.items(), key=lambda item: item[0])))
        self._slices = start(self._program.initial)

    @property
    def state(self) -> Hashable:
        """The program, the slices and the verdict."""
        return self._program, frozenset(self._slices), self._verdict

    def _advance(self, event: Json) -> Verdict:
        program, residuals, atoms = self._program, self._program.residuals, self._program.atoms
        event = program.stamped(event)
        residuals.begin()
        candidates = frozenset([program.names[number] for number in program.index.candidates(event)])

        def extensions(residual: int, binding: Binding) -> Iterator[Binding]:
            if not residuals.variables(residual) <= binding.keys():
                atoms_now = residuals.now(residual) & candidates if program.late else candidates
                residuals.ask(len(atoms_now))
                for name in sorted(atoms_now):
                    if not atoms[name].binds <= binding.keys():
                        yield from atoms[name].extended(event, binding)

        def step(residual: int, binding: Binding, before: Binding) -> tuple[Verdict, int]:
            atoms_now = residuals.now(residual) & candidates
            residuals.ask(len(atoms_now))
            letter = frozenset([name for name in atoms_now if atoms[name].holds(event, binding, before)])
            accepted, rest = residuals.step(residual, letter)
            if accepted and residuals.is_valid(rest):
                return Verdict.TRUE, rest
            return Verdict.UNKNOWN if accepted or residuals.is_satisfiable(rest) else Verdict.FALSE, rest

        # Keep all slices: a guard counts as true while a variable is unbound, so more bindings may
        # violate less.
        slices = advance(self._slices, extensions, step, matter=residuals.variables, keep_all=True)
        self._slices = slices or {}
        return Verdict.TRUE if slices is None else Verdict.UNKNOWN if slices else Verdict.FALSE
