"""Atoms at one event, under an assignment of the variables."""

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from typing import Protocol

from backends.ltlf.candidates import Candidates
from backends.ltlf.header import Header, Observation
from rvaft.guards import Guard, holds
from rvaft.guards import variables as guard_variables
from rvaft.patterns import Anything, Binding, Literal, ObjectPattern, Pattern, match, rigid, rigid_variables
from rvaft.values import Json


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
