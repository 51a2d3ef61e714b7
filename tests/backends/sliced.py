"""The verdict of a text of LTLf or HOA with variables, by brute force from section 5 of the definition.

It shares nothing with the readers of these texts. Events are flat, values few and texts small.
"""

import operator
from abc import ABC, abstractmethod
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from itertools import chain, combinations
from typing import Final, TypeAlias

from rvaft.model.verdict import Verdict

Event: TypeAlias = Mapping[str, int]
Assignment: TypeAlias = frozenset[tuple[str, int]]
Letter: TypeAlias = frozenset[str]

COMPARISONS: Final[Mapping[str, Callable[[int, int], bool]]] = {
    "<": operator.lt, "<=": operator.le, "==": operator.eq, "!=": operator.ne,
}  # fmt: skip


@dataclass(frozen=True)
class Atom:
    """An event pattern of fields, with variables or numbers, under guards that compare two of these."""

    name: str
    fields: tuple[tuple[str, str | int], ...]
    guards: tuple[tuple[str, str, str | int], ...] = ()

    @property
    def variables(self) -> frozenset[str]:
        """The variables that the atom binds."""
        return frozenset(value for _, value in self.fields if isinstance(value, str))

    def is_true(self, event: Event, assignment: Assignment) -> bool:
        """Whether an event makes the atom true under an assignment."""
        known = dict(assignment)
        return (
            self.variables <= known.keys()
            and all(name in event and event[name] == known.get(str(v), v) for name, v in self.fields)
            and all(
                COMPARISONS[sign](known[left], known.get(str(right), right))  # type: ignore[arg-type]
                for left, sign, right in self.guards
                if left in known and (isinstance(right, int) or right in known)
            )
        )


def after(atoms: tuple[Atom, ...], event: Event, before: Assignment) -> Iterator[Assignment]:
    """The assignments of slices after an event: the same one, or the variables of one atom that is true."""
    yield before
    for atom in atoms:
        new = {value: event[name] for name, value in atom.fields if isinstance(value, str) and name in event}
        larger = frozenset({**new, **dict(before)}.items())
        if larger != before and atom.is_true(event, larger):
            yield larger


class Text(ABC):
    """A text: its atoms, and whether it accepts a word, for a word whose rest has some outcome."""

    atoms: tuple[Atom, ...]

    @abstractmethod
    def outcomes(self, word: tuple[Letter, ...]) -> set[bool]:
        """Whether the text accepts a word and its extensions by any letters."""

    @staticmethod
    def letters_of(atoms: Iterable[Atom]) -> list[Letter]:
        """All letters."""
        names = [atom.name for atom in atoms]
        subsets = chain.from_iterable(combinations(names, size) for size in range(len(names) + 1))
        return list(map(frozenset, subsets))

    def verdict(self, trace: Sequence[Event]) -> Verdict:
        """The verdict after a trace (section 5 of the definition)."""
        slices: set[tuple[tuple[Letter, ...], Assignment]] = {((), frozenset())}
        for event in trace:
            slices = {
                ((*word, frozenset(one.name for one in self.atoms if one.is_true(event, larger))), larger)
                for word, bound in slices
                for larger in after(self.atoms, event, bound)
            }
        outcomes = [self.outcomes(word) for word in {word for word, _ in slices}]
        if {True} in outcomes:
            return Verdict.TRUE
        return Verdict.FALSE if all(one == {False} for one in outcomes) else Verdict.UNKNOWN


Formula: TypeAlias = tuple[str, tuple["Formula", ...]]
"""An operator or the name of an atom, and operands."""


class LtlfText(Text):
    """A formula of LTLf over atoms."""

    def __init__(self, atoms: tuple[Atom, ...], formula: Formula) -> None:
        self.atoms, self.formula = atoms, formula
        names = set(self._names(formula))
        self.atoms = tuple(atom for atom in atoms if atom.name in names)
        self.parts: list[Formula] = []
        self._collect(formula)
        self.rests = {None, *self._rests()}

    def _names(self, formula: Formula) -> Iterator[str]:
        yield formula[0]
        for operand in formula[1]:
            yield from self._names(operand)

    def _collect(self, formula: Formula) -> None:
        for operand in formula[1]:
            self._collect(operand)
        if formula not in self.parts:
            self.parts.append(formula)

    def _rests(self) -> set[frozenset[Formula]]:
        """The sets of formulas that hold at the first position of some word."""
        found: set[frozenset[Formula]] = set()
        todo: list[frozenset[Formula] | None] = [None]
        while todo:
            rest = todo.pop()
            for letter in self.letters_of(self.atoms):
                now = self.holding(letter, rest)
                if now not in found:
                    found.add(now)
                    todo.append(now)
        return found

    def holding(self, letter: Letter, rest: frozenset[Formula] | None) -> frozenset[Formula]:
        """The parts that hold at a position; `rest` has those of the next one, None at the end."""
        true: set[Formula] = set()
        for part in self.parts:
            name, below = part
            here = [one in true for one in below]
            later = rest is not None and part in rest
            match name:
                case "!":
                    holds = not here[0]
                case "&":
                    holds = all(here)
                case "|":
                    holds = any(here)
                case "X[!]":
                    holds = rest is not None and below[0] in rest
                case "X":
                    holds = rest is None or below[0] in rest
                case "F":
                    holds = here[0] or later
                case "G":
                    holds = here[0] and (rest is None or later)
                case "U":
                    holds = here[1] or (here[0] and later)
                case _:
                    holds = name in letter
            if holds:
                true.add(part)
        return frozenset(true)

    def outcomes(self, word: tuple[Letter, ...]) -> set[bool]:
        """Whether the formula holds on a word and its extensions; on the empty word it does not count."""
        found = set()
        for rest in self.rests:
            now = rest
            for letter in reversed(word):
                now = self.holding(letter, now)
            if now is not None:
                found.add(self.formula in now)
        return found

    def __str__(self) -> str:
        lines = [
            f"atom {atom.name} := {fields(atom)}" + "".join(f" when {g}" for g in guards(atom)) for atom in self.atoms
        ]
        return "\n".join(["/* rvaft", *lines, "*/", written(self.formula)])


def written(formula: Formula) -> str:
    """The formula in Spot's syntax."""
    name, below = formula
    match below:
        case ():
            return name
        case (one,):
            return f"{name}({written(one)})"
        case (one, other):
            return f"(({written(one)}) {name} ({written(other)}))"
    raise AssertionError(formula)


def fields(atom: Atom) -> str:
    """The pattern of an atom."""
    return "{ " + ", ".join(f"{name}: {value}" for name, value in atom.fields) + " }"


def guards(atom: Atom) -> list[str]:
    """The guards of an atom."""
    return [f"{left} {sign} {right}" for left, sign, right in atom.guards]


class HoaText(Text):
    """A deterministic automaton over finite words: for each state the target of each letter, and its mark."""

    def __init__(self, atoms: tuple[Atom, ...], targets: list[dict[Letter, int]], marked: list[bool]) -> None:
        self.atoms, self.targets, self.marked = atoms, targets, marked

    def outcomes(self, word: tuple[Letter, ...]) -> set[bool]:
        """Whether the automaton accepts a word and its extensions."""
        state = 0
        for letter in word:
            state = self.targets[state][letter]
        reached, todo = {state}, [state]
        while todo:
            for target in self.targets[todo.pop()].values():
                if target not in reached:
                    reached.add(target)
                    todo.append(target)
        return {self.marked[one] for one in reached}

    def __str__(self) -> str:
        lines = [f'HOA: v1\ntool: "rvaft" "0123456789abcdef"\nStates: {len(self.targets)}\nStart: 0']  # an edited text
        lines.append(f"AP: {len(self.atoms)} " + " ".join(f'"{atom.name}"' for atom in self.atoms))
        for number, atom in enumerate(self.atoms):
            guard = guards(atom)
            lines.append(f'guard: {number} "{guard[0]}"' if guard else f'event: {number} "{fields(atom)}"')
        lines.append("acc-name: Buchi\nAcceptance: 1 Inf(0)\nproperties: state-acc deterministic\n--BODY--")
        for number, (targets, mark) in enumerate(zip(self.targets, self.marked, strict=True)):
            lines.append(f"State: {number}{' {0}' if mark else ''}")
            for letter, target in targets.items():
                label = "&".join(f"{'' if atom.name in letter else '!'}{n}" for n, atom in enumerate(self.atoms))
                lines.append(f"[{label}] {target}")
        return "\n".join([*lines, "--END--\n"])
