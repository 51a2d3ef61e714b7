"""What a formula still demands after some events: progression, kept canonical.

A residual is a Boolean function over variables each of which stands for "the rest is not empty and satisfies g"; the number of the
variable is that of g, so that wholes stand above their parts. One event gives two answers at once: whether the
formula is satisfied if the trace ends here, and the residual for the case that it goes on. After Bacchus and Kabanza, Using temporal logics to express search control knowledge for planning
(Artificial Intelligence, 2000), here with the strong next and the end of the trace.
"""

from collections.abc import Hashable, Iterable, Iterator, Mapping
from dataclasses import dataclass
from typing import Final, Generic, NamedTuple, Protocol, TypeVar

from backends.ltlf.bdd import FALSE, TRUE, Diagrams
from backends.ltlf.formulas import FALSE as NEVER
from backends.ltlf.formulas import TRUE as ALWAYS
from backends.ltlf.formulas import Formulas, Op
from backends.ltlf.reader import Header, Observation
from rvaft.model.guards import Guard, holds
from rvaft.model.guards import variables as guard_variables
from rvaft.model.patterns import Anything, Binding, Literal, ObjectPattern, Pattern, match, rigid, rigid_variables
from rvaft.model.values import Json, key
from rvaft.support.trampoline import Call, run

# Patterns sorted by a literal, so that an event is held only against those that it can fit.

T = TypeVar("T")


class Candidates(Generic[T]):
    """Things with their patterns, found again by events."""

    def __init__(self, items: Iterable[tuple[T, Pattern]]) -> None:
        self._by_field: dict[str, dict[Hashable, list[T]]] = {}
        self._others: list[T] = []
        for item, pattern in items:
            field = _literal_field(pattern)
            if field is None:
                self._others.append(item)
            else:
                name, value = field
                self._by_field.setdefault(name, {}).setdefault(value, []).append(item)

    def at(self, event: Json) -> Iterator[T]:
        """The things whose patterns the event may fit."""
        yield from self._others
        for name, by_value in self._by_field.items():
            if isinstance(event, Mapping) and name in event:
                yield from by_value.get(key(event[name]), ())


def _literal_field(pattern: Pattern) -> tuple[str, Hashable] | None:
    """The first field of a pattern that asks for a literal, and the key of that literal."""
    if isinstance(pattern, ObjectPattern):
        for name, inner in pattern.fields:
            if isinstance(inner, Literal):
                return name, key(inner.value)
    return None


# Atoms at one event, under an assignment of the variables.


class Atom(Protocol):
    """What an atom of a formula observes."""

    @property
    def binds(self) -> frozenset[str]:
        """The variables that must be bound for it to be true."""
        ...

    @property
    def mentions(self) -> frozenset[str]:
        """All variables that make a difference to it."""
        ...

    def holds(self, event: Json, binding: Binding) -> bool:
        """Whether it is true at the event."""
        ...

    def extended(self, event: Json, binding: Binding) -> Binding | None:
        """The smallest extension of the binding under which it is true, or None."""
        ...


@dataclass(frozen=True, slots=True)
class EventAtom:
    """An event pattern under guards; a guard counts as true while one of its variables is unbound."""

    pattern: Pattern
    guards: tuple[tuple[Guard, frozenset[str]], ...]
    binds: frozenset[str]
    mentions: frozenset[str]

    @classmethod
    def of(cls, observation: Observation) -> "EventAtom":
        """The atom of an observation."""
        binds = frozenset(rigid_variables(observation.pattern))
        guards = tuple((guard, frozenset(guard_variables(guard))) for guard in observation.guards)
        return cls(observation.pattern, guards, binds, binds.union(*(names for _, names in guards)))

    def holds(self, event: Json, binding: Binding) -> bool:
        """Whether all its variables are bound, the event fits and no guard fails."""
        return self.binds <= binding.keys() and self.extended(event, binding) is not None

    def extended(self, event: Json, binding: Binding) -> Binding | None:
        """The binding with the variables of the pattern, or None where the event does not fit or a guard fails."""
        found = match(self.pattern, event, binding)
        if found is None:
            return None
        bound = rigid(found)
        failed = any(names <= bound.keys() and not holds(guard, bound) for guard, names in self.guards)
        return None if failed else bound


@dataclass(frozen=True, slots=True)
class RelevanceAtom:
    """True at events that fit one of the observations for some values of the variables, and none of the ignored ones."""

    relevant: Candidates[Observation]
    ignored: Candidates[Observation]
    binds: frozenset[str] = frozenset()
    mentions: frozenset[str] = frozenset()

    @classmethod
    def of(cls, relevant: Iterable[Observation], ignored: Iterable[Observation]) -> "RelevanceAtom":
        """The atom of these observations."""
        return cls(Candidates((o, o.pattern) for o in relevant), Candidates((o, o.pattern) for o in ignored))

    def holds(self, event: Json, binding: Binding) -> bool:  # noqa: ARG002 -- its variables are its own
        """Whether the event is relevant."""
        fits = any(_fits(o, event) for o in self.relevant.at(event))
        return fits and not any(_fits(o, event) for o in self.ignored.at(event))

    def extended(self, event: Json, binding: Binding) -> Binding | None:
        """It binds nothing."""
        return binding if self.holds(event, binding) else None


def _fits(observation: Observation, event: Json) -> bool:
    found = match(observation.pattern, event, {})
    return found is not None and all(
        set(guard_variables(guard)) <= found.keys() and holds(guard, found) for guard in observation.guards
    )


def atoms_of(header: Header, names: Iterable[str], given: Mapping[str, Pattern]) -> dict[str, Atom]:
    """The atoms of these names: as the header has them, else as given, else the event of that name."""
    return {name: _atom(header, name, given) for name in names}


def _atom(header: Header, name: str, given: Mapping[str, Pattern]) -> Atom:
    if name in header.relevant or name in header.ignored:
        return RelevanceAtom.of(header.relevant.get(name, ()), header.ignored.get(name, ()))
    if name in header.atoms:
        return EventAtom.of(header.atoms[name])
    default = ObjectPattern((("event", Literal(name)),))
    return EventAtom.of(Observation(given.get(name, default)))


def candidates_of(atoms: Mapping[str, Atom]) -> Candidates[str]:
    """The atoms by name; those that are no pattern can always be true."""
    return Candidates(
        (name, atom.pattern if isinstance(atom, EventAtom) else Anything()) for name, atom in atoms.items()
    )


NODE_LIMIT: Final = 2_000_000
STEPS_KEPT: Final = 200_000
_JUNCTIONS: Final = frozenset({Op.AND, Op.OR})


class Progress(NamedTuple):
    """After an event: is the formula satisfied if the trace ends here, and what is left if it does not."""

    accepted: bool
    residual: int


_CONSTANTS: Final = {ALWAYS: Progress(accepted=True, residual=TRUE), NEVER: Progress(accepted=False, residual=FALSE)}


class Residuals:
    """The residuals of some formulas; `mentions` gives the variables of each atom."""

    def __init__(self, formulas: Formulas, mentions: Mapping[str, frozenset[str]]) -> None:
        self._formulas = formulas
        self.diagrams = Diagrams(NODE_LIMIT)
        self._lifted: dict[int, int] = {ALWAYS: TRUE, NEVER: FALSE}
        self._now: dict[int, frozenset[str]] = {}
        self._looked_at: dict[int, frozenset[str]] = {}
        self._idles: dict[int, Progress] = {}
        self._steps: dict[tuple[int, frozenset[str]], Progress] = {}
        self._mentioned: dict[int, frozenset[str]] = {}
        self._bare: list[bool] = []
        """Of each formula: is it, apart from `!`, `&` and `|`, about the first position (an atom is in sight)?"""
        self._monotone: list[bool] = []
        """Of each formula: is it of `F`, `&` and `|` only, so that it is true wherever it is true later?"""
        self._variables: list[frozenset[str]] = []
        for row in formulas.rows:
            bare = [self._bare[operand] for operand in row.operands]
            monotone = [self._monotone[operand] for operand in row.operands]
            names = [self._variables[operand] for operand in row.operands]
            self._bare.append(row.op is Op.ATOM or (row.op in (Op.NOT, *_JUNCTIONS) and any(bare)))
            self._monotone.append(row.op is Op.EVENTUALLY or (row.op in _JUNCTIONS and all(monotone)))
            self._variables.append(mentions.get(row.name, frozenset()).union(*names))

    def of(self, formula: int) -> int:
        """The residual that is the formula itself."""
        return run(self._lift(formula))

    def variables(self, residual: int) -> frozenset[str]:
        """The variables that can still make a difference."""
        if residual not in self._mentioned:
            support = self.diagrams.support(residual)
            self._mentioned[residual] = frozenset().union(*(self._variables[formula] for formula in support))
        return self._mentioned[residual]

    def now(self, residual: int) -> frozenset[str]:
        """The atoms that the next event is asked for."""
        if residual not in self._looked_at:
            support = self.diagrams.support(residual)
            self._looked_at[residual] = frozenset().union(*(self._asks(formula) for formula in support))
        return self._looked_at[residual]

    def step(self, residual: int, letter: frozenset[str]) -> Progress:
        """The residual after one event; `letter` are the atoms that are true at it, of those that are asked (`now`)."""
        key = (residual, letter)
        if key not in self._steps:
            if len(self._steps) >= STEPS_KEPT:
                self._steps.clear()
            self._steps[key] = self._stepped(residual, letter)
        return self._steps[key]

    def _stepped(self, residual: int, letter: frozenset[str]) -> Progress:
        known = dict(_CONSTANTS)
        found: dict[int, Progress] = {}
        for formula in self.diagrams.support(residual):
            idle = self._asks(formula).isdisjoint(letter)
            found[formula] = self._idle(formula) if idle else run(self._progress(formula, letter, known))
        accepted = self.diagrams.evaluate(residual, {formula: after.accepted for formula, after in found.items()})
        rest = self.diagrams.compose(residual, {formula: after.residual for formula, after in found.items()})
        return Progress(accepted, rest)

    def _idle(self, formula: int) -> Progress:
        """What is left when none of the atoms that it asks about is true."""
        if formula not in self._idles:
            self._idles[formula] = run(self._progress(formula, frozenset(), dict(_CONSTANTS)))
        return self._idles[formula]

    def _asks(self, formula: int) -> frozenset[str]:
        if formula not in self._now:
            self._now[formula] = run(self._asked(formula))
        return self._now[formula]

    def _lift(self, formula: int) -> Call[int]:
        """Boolean combinations of `F`, `U` and `X[!]` are taken apart; others wait as one variable until the next event."""
        if formula in self._lifted:
            return self._lifted[formula]
        row = self._formulas.rows[formula]
        if row.op is Op.NOT:
            lifted = self.diagrams.negation((yield self._lift(row.operands[0])))
        elif row.op in _JUNCTIONS and not self._bare[formula]:
            parts: list[int] = []
            for operand in row.operands:
                parts += [(yield self._lift(operand))]
            lifted = self._joined(row.op, parts)
        else:
            lifted = self.diagrams.variable(formula)
        self._lifted[formula] = lifted
        return lifted

    def _joined(self, op: Op, parts: list[int]) -> int:
        """The junction of many functions, the lowest first: so each step works near the top."""
        nodes = self.diagrams.nodes
        joined = TRUE if op is Op.AND else FALSE
        for part in sorted(set(parts), key=lambda f: nodes[f][0]):
            joined = (
                self.diagrams.conjunction(part, joined) if op is Op.AND else self.diagrams.disjunction(part, joined)
            )
        return joined

    def _progress(self, formula: int, letter: frozenset[str], known: dict[int, Progress]) -> Call[Progress]:
        if formula in known:
            return known[formula]
        row = self._formulas.rows[formula]
        match row.op:
            case Op.ATOM:
                found = known[ALWAYS if row.name in letter else NEVER]
            case Op.NOT:
                inner = yield self._progress(row.operands[0], letter, known)
                found = Progress(not inner.accepted, self.diagrams.negation(inner.residual))
            case Op.AND | Op.OR:
                found = yield self._junction(formula, letter, known)
            case Op.NEXT:
                found = Progress(accepted=False, residual=(yield self._lift(row.operands[0])))
            case Op.EVENTUALLY:
                inner = yield self._progress(row.operands[0], letter, known)
                again = self.diagrams.variable(formula)
                if inner.residual == FALSE:
                    found = Progress(inner.accepted, again)
                elif self._implied(row.operands[0]):
                    found = inner
                else:
                    found = Progress(inner.accepted, self.diagrams.disjunction(inner.residual, again))
            case Op.UNTIL:
                found = yield self._until(formula, letter, known)
            case _:
                raise AssertionError(row)
        known[formula] = found
        return found

    def _junction(self, formula: int, letter: frozenset[str], known: dict[int, Progress]) -> Call[Progress]:
        row = self._formulas.rows[formula]
        decided = known[NEVER if row.op is Op.AND else ALWAYS]
        parts: list[Progress] = []
        for operand in row.operands:
            part = yield self._progress(operand, letter, known)
            if part == decided:
                return decided
            parts.append(part)
        accepted = [part.accepted for part in parts]
        residual = self._joined(row.op, [part.residual for part in parts])
        return Progress(all(accepted) if row.op is Op.AND else any(accepted), residual)

    def _until(self, formula: int, letter: frozenset[str], known: dict[int, Progress]) -> Call[Progress]:
        left, right = self._formulas.rows[formula].operands
        now: Progress = yield self._progress(right, letter, known)
        if now == known[ALWAYS]:
            return now
        stay = yield self._progress(left, letter, known)
        later = self.diagrams.conjunction(stay.residual, self.diagrams.variable(formula))
        return Progress(now.accepted, self.diagrams.disjunction(now.residual, later))

    def _implied(self, formula: int) -> bool:
        """Whether, once the formula g has begun (its atoms were true), its rest follows from `F g` on the rest of the trace.

        So it is for g = p & X[!] h with a monotone h: if g is true somewhere in the rest, h is true there later, hence at its beginning.
        Keeping `F g` beside h would be right too, but residuals of long sequences would grow with every repetition.
        """
        row = self._formulas.rows[formula]
        operands = row.operands if row.op is Op.AND else (formula,)
        rows = [self._formulas.rows[operand] for operand in operands]
        nexts = [inner.operands[0] for inner in rows if inner.op is Op.NEXT]
        atoms = [inner for inner in rows if inner.op is Op.ATOM]
        return len(nexts) + len(atoms) == len(rows) and len(nexts) <= 1 and all(self._monotone[h] for h in nexts)

    def _asked(self, formula: int) -> Call[frozenset[str]]:
        if formula not in self._now:
            row = self._formulas.rows[formula]
            names = {row.name} if row.op is Op.ATOM else set()
            if row.op is not Op.NEXT:
                for operand in row.operands:
                    names |= yield self._asked(operand)
            self._now[formula] = frozenset(names)
        return self._now[formula]
