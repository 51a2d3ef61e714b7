"""The labels of the edges of one state, short and pairwise disjoint.

A letter needs to say `not` only of the atoms by which letters with another target differ. Atoms that never hold together and yet
tell targets apart exclude each other in an alias of the header, so that an edge names just the atoms that hold.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from backends.automaton.letters import Letters, bits
from backends.automaton.subsets import Row


@dataclass(frozen=True, slots=True)
class Cube:
    """Atoms and guards that hold and that do not."""

    atoms: int
    no_atoms: int
    guards: int = 0
    no_guards: int = 0

    def covers(self, other: "Cube") -> bool:
        """Whether every letter of the other is one of this."""
        return not (
            self.atoms & ~other.atoms
            or self.no_atoms & ~other.no_atoms
            or self.guards & ~other.guards
            or self.no_guards & ~other.no_guards
        )


def cubes(row: Row) -> dict[int, list[Cube]]:
    """For each target what leads there."""
    seen_elsewhere = _elsewhere(row)
    found: dict[int, list[Cube]] = {}
    for (atoms, holding), target in row.targets.items():
        other_atoms, other_guards = seen_elsewhere[target]
        matter = row.guards[atoms]
        cube = Cube(atoms, other_atoms & ~atoms, holding, other_guards & matter & ~holding)
        found.setdefault(target, []).append(cube)
    return {target: _needed(those) for target, those in found.items()}


def _elsewhere(row: Row) -> dict[int, tuple[int, int]]:
    """For each target the atoms and guards of letters that lead to another one."""
    own: dict[int, tuple[int, int]] = {}
    first: dict[int, tuple[int, int]] = {}
    for (atoms, holding), target in row.targets.items():
        before = own.get(target, (0, 0))
        own[target] = (before[0] | atoms, before[1] | holding)
    targets = list(own)
    for order in (targets, targets[::-1]):
        atoms = guards = 0
        for target in order:
            kept = first.get(target, (0, 0))
            first[target] = (kept[0] | atoms, kept[1] | guards)
            atoms |= own[target][0]
            guards |= own[target][1]
    return first


def _needed(those: list[Cube]) -> list[Cube]:
    """Without cubes that another one covers; a cube has at least the atoms and guards of one that covers it."""
    if len(those) == 1:
        return those
    kept: list[Cube] = []
    for one in sorted(dict.fromkeys(those), key=lambda cube: cube.atoms.bit_count() + cube.guards.bit_count()):
        if not any(other.covers(one) for other in kept):
            kept.append(one)
    return kept


def rivals(states: Sequence[Mapping[int, list[Cube]]], letters: Letters) -> dict[int, int]:
    """For each atom those that never hold with it and that some letter with it excludes."""
    found: dict[int, int] = {}
    for state in states:
        for those in state.values():
            for cube in those:
                for atom in bits(cube.atoms):
                    found[atom] = found.get(atom, 0) | cube.no_atoms & ~letters.together(atom, cube.no_atoms)
    return {atom: excluded for atom, excluded in found.items() if excluded}


@dataclass(frozen=True, slots=True)
class Writer:
    """Writes cubes over the numbers of propositions; `always` holds on every edge it writes."""

    always: tuple[int, ...]
    atoms: Mapping[int, int]
    guards: Mapping[int, int]
    rivals: Mapping[int, int]

    def aliases(self) -> list[str]:
        """The definitions that labels refer to."""
        return [
            f"Alias: @{self.atoms[atom]} " + "&".join(self._alias(atom, excluded))
            for atom, excluded in sorted(self.rivals.items())
        ]

    def _alias(self, atom: int, excluded: int) -> list[str]:
        return [*map(str, self.always), str(self.atoms[atom]), *(f"!{self.atoms[other]}" for other in bits(excluded))]

    def label(self, cube: Cube) -> str:
        """One cube."""
        aliased = [atom for atom in bits(cube.atoms) if atom in self.rivals]
        said = 0
        for atom in aliased:
            said |= self.rivals[atom]
        words = [] if aliased else [str(number) for number in self.always]
        words += [f"@{self.atoms[atom]}" if atom in self.rivals else str(self.atoms[atom]) for atom in bits(cube.atoms)]
        words += [f"!{self.atoms[atom]}" for atom in bits(cube.no_atoms & ~said)]
        words += [str(self.guards[guard]) for guard in bits(cube.guards)]
        words += [f"!{self.guards[guard]}" for guard in bits(cube.no_guards)]
        return "&".join(words)
