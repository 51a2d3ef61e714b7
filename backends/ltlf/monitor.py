"""Running a formula on events: slices, one for each partial assignment of the variables that matching can reach.

At an event a slice may stay as it is (atoms with an unbound variable are false), or take up the values that make one more atom
true; then the letter is all atoms true under its assignment. ⊤ if in some slice the formula holds here and on every
continuation; ⊥ if there is none where it can still hold. A slice in which it cannot is dropped.
"""

from collections.abc import Hashable, Iterator, Mapping
from functools import lru_cache
from typing import Final, NamedTuple

from backends.ltlf.formulas import Formulas, Op
from backends.ltlf.progression import Atom, Residuals, atoms_of, candidates_of
from backends.ltlf.reader import Header, Observation, parse, split
from backends.ltlf.satisfiability import Liveness
from rvaft.backend import Observed
from rvaft.errors import LanguageError, TooLarge
from rvaft.model.guards import Guard, Operation, Operator
from rvaft.model.guards import variables as guard_variables
from rvaft.model.patterns import (
    Binding,
    Literal,
    ObjectPattern,
    Pattern,
    Variable,
    rigid_variables,
    substitute,
    variables,
)
from rvaft.model.values import Json, key
from rvaft.model.verdict import Verdict
from rvaft.monitors import Monitor

# A text made ready to run; monitors of one text share it, so that their states can be compared.


class Program:
    """The formula of a text, its atoms, and everything that was found out about its residuals so far."""

    def __init__(self, text: str, given: Mapping[str, Pattern]) -> None:
        header, rest = split(text)
        formulas = Formulas()
        root = root_of(header, rest, formulas)
        names = [row.name for row in formulas.rows if row.op is Op.ATOM]
        self.atoms: dict[str, Atom] = atoms_of(header, names, given)
        self.candidates = candidates_of(self.atoms)
        self.residuals = Residuals(formulas, {name: atom.mentions for name, atom in self.atoms.items()})
        self.liveness = Liveness(formulas, self.residuals.diagrams)
        self.initial = self.residuals.of(root)


def root_of(header: Header, rest: str, formulas: Formulas) -> int:
    """The formula behind a header, among `formulas`; raises `LanguageError` and `ToolMissing`."""
    known: dict[str, int] = {}

    def atom(name: str) -> int:
        if name in header.definitions and name not in known:
            unknown = next(one for one in header.definitions if one not in known)  # the one that is being read
            line, column = header.places[unknown]
            raise LanguageError(f"{name} is used before it is defined", file="<ltlf>", line=line, column=column)
        return known[name] if name in known else formulas.atom(name)

    for name in header.definitions:
        line, column = header.places[name]
        known[name] = parse(header.definitions[name], formulas, atom, line=line, column=column)
    skipped = len(rest) - len(rest.lstrip())
    before = rest[:skipped]
    line = 1 + before.count("\n")
    column = len(before) - before.rfind("\n")
    if not rest.strip():
        message = "there is no formula after the comment" if skipped else "there is no formula"
        raise LanguageError(message, file="<ltlf>", line=line, column=column)
    return parse(rest[skipped:].rstrip(), formulas, atom, line=line, column=column)


@lru_cache(maxsize=32)
def _cached(text: str, given: tuple[tuple[str, Pattern], ...]) -> Program:
    return Program(text, dict(given))


def program(text: str, given: Mapping[str, Pattern]) -> Program:
    """The program of a text; the same one again while it is remembered. Raises `LanguageError` and `ToolMissing`."""
    return _cached(text, tuple(sorted(given.items(), key=lambda item: item[0])))


# What a formula asks of events: the patterns and guards of its atoms, and what its header says of relevance.


def observed(text: str, given: Mapping[str, Pattern]) -> tuple[Observed, ...]:
    """The questions; `given` has the patterns of atoms that the text does not define. Raises `LanguageError`, `ToolMissing`."""
    header, rest = split(text)
    formulas = Formulas()
    root_of(header, rest, formulas)
    names = [row.name for row in formulas.rows if row.op is Op.ATOM]
    return tuple(dict.fromkeys(question for name in names for question in _questions(header, name, given)))


def _questions(header: Header, name: str, given: Mapping[str, Pattern]) -> Iterator[Observed]:
    if name in header.relevant or name in header.ignored:
        for one in (*header.relevant.get(name, ()), *header.ignored.get(name, ())):
            if all(set(guard_variables(guard)) <= set(variables(one.pattern)) for guard in one.guards):
                yield _apart(one)
    elif name in header.atoms:
        atom = header.atoms[name]
        # a guard on a variable that the atom cannot share with others never has its value, and counts as true
        guards = [g for g in atom.guards if not any(variable.startswith("_") for variable in guard_variables(g))]
        yield Observed(atom.pattern, _all(guards))
    else:
        yield Observed(given.get(name, ObjectPattern((("event", Literal(name)),))))


def _apart(observation: Observation) -> Observed:
    """With variables of its own: some values will do."""
    taken = variables(observation.pattern)
    by: dict[str, Pattern] = {}
    for name in rigid_variables(observation.pattern):
        own = f"_{name}"
        while own in taken:
            own = f"_{own}"
        by[name] = Variable(own)
    guards = [_renamed(guard, by) for guard in observation.guards]
    return Observed(substitute(observation.pattern, by), _all(guards))


def _renamed(guard: Guard, by: Mapping[str, Pattern]) -> Guard:
    match guard:
        case Variable(name):
            renamed = by.get(name, guard)
            assert isinstance(renamed, Variable)
            return renamed
        case Operation(operator, operands):
            return Operation(operator, tuple(_renamed(operand, by) for operand in operands))
        case _:
            return guard


def _all(guards: list[Guard]) -> Guard | None:
    """One guard that holds when all do."""
    if len(guards) > 1:
        return Operation(Operator.AND, tuple(guards))
    return guards[0] if guards else None


SLICE_LIMIT: Final = 100_000

Assignment = frozenset[tuple[str, Hashable]]
"""A binding as a key."""


class Slice(NamedTuple):
    """A binding and what the formula still demands under it."""

    binding: Binding
    residual: int


class LtlfMonitor(Monitor):
    """A formula of LTLf on a trace; `TooLarge` where values give rise to too many slices."""

    def __init__(self, program: Program) -> None:
        super().__init__()
        self._program = program
        self._slices: dict[tuple[Assignment, int], Slice] = {(frozenset(), program.initial): Slice({}, program.initial)}

    @property
    def state(self) -> Hashable:
        """The program, the slices, the verdict."""
        return self._program, frozenset(self._slices), self._verdict

    def _advance(self, event: Json) -> Verdict:
        slices: dict[tuple[Assignment, int], Slice] = {}
        residuals, liveness = self._program.residuals, self._program.liveness
        candidates = frozenset(self._program.candidates.at(event))
        for binding, residual in self._slices.values():
            for extended in self._extensions(binding, residual, event, candidates):
                asked = residuals.now(residual) & candidates
                letter = frozenset(name for name in asked if self._program.atoms[name].holds(event, extended))
                accepted, rest = residuals.step(residual, letter)
                if accepted and liveness.valid(rest):
                    self._slices = {}
                    return Verdict.TRUE
                if accepted or liveness.satisfiable(rest):
                    names = residuals.variables(rest)
                    kept = {name: value for name, value in extended.items() if name in names}
                    slices[_assignment(kept), rest] = Slice(kept, rest)
                    if len(slices) > SLICE_LIMIT:
                        raise TooLarge("the trace gives rise to more assignments of the variables", limit=SLICE_LIMIT)
        self._slices = slices
        return Verdict.UNKNOWN if slices else Verdict.FALSE

    def _extensions(
        self, binding: Binding, residual: int, event: Json, candidates: frozenset[str]
    ) -> Iterator[Binding]:
        """The binding itself, and with the values that one more atom takes from the event."""
        yield binding
        if self._program.residuals.variables(residual) <= binding.keys():
            return
        seen = {_assignment(binding)}
        for name in sorted(self._program.residuals.now(residual) & candidates):
            atom = self._program.atoms[name]
            if not atom.binds <= binding.keys():
                extended = atom.extended(event, binding)
                if extended is not None and _assignment(extended) not in seen:
                    seen.add(_assignment(extended))
                    yield extended


def _assignment(binding: Binding) -> Assignment:
    return frozenset((name, key(value)) for name, value in binding.items())
