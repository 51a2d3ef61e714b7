"""Which atoms one event can make true together: the feasible letters.

An atom that the least event of a set satisfies is satisfied by every event of that set. A letter is therefore feasible
exactly when it contains all that its own least event satisfies. Rigid variables are shared between atoms (a
slice gives them one value) and an atom with a variable that the set does not bind is false; the entries of the alphabet and the `ignore`
declarations share nothing with anybody. Guards are taken as independent of all that.
"""

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, field
from itertools import chain
from typing import TypeAlias

from rvaft.model.patterns import (
    Anything,
    ListPattern,
    Literal,
    ObjectPattern,
    Pattern,
    Variable,
    rigid_variables,
    substitute,
    variables,
)

# The least event that satisfies some patterns, by unification.
#
# Every value that nothing determines is one that occurs nowhere else, and every object has a field that occurs nowhere else.
# Patterns demand and never forbid: what the least event matches, every event that satisfies the patterns matches.


class Clash(Exception):
    """No value is what it would have to be. Never leaves this module."""


@dataclass(slots=True, eq=False)
class _Value:
    """An unknown value, and what is known of it."""

    literal: Literal | None = None
    fields: "dict[str, _Value] | None" = None
    items: "list[_Value] | None" = None
    same: "_Value | None" = None

    def find(self) -> "_Value":
        value = self
        while value.same is not None:
            value = value.same
        return value

    @property
    def free(self) -> bool:
        return self.literal is None and self.fields is None and self.items is None


@dataclass(slots=True)
class Least:
    """The least event that satisfies some patterns; raises `Clash` where there is none."""

    root: _Value = field(default_factory=lambda: _Value(fields={}))
    bound: dict[str, _Value] = field(default_factory=dict)

    def demand(self, pattern: Pattern) -> None:
        """Make the event satisfy one more pattern, whose local variables are its own."""
        own = {name: Variable(f"_{len(self.bound)}{name}") for name in variables(pattern) if name.startswith("_")}
        todo = [(substitute(pattern, own), self.root)]
        while todo:
            part, value = todo.pop()
            known = value.find()
            match part:
                case Literal():
                    _unify(known, _Value(literal=part))
                case Variable(name):
                    _unify(self.bound.setdefault(name, known), known)
                case Anything():
                    pass
                case ObjectPattern(fields):
                    fresh = [(name, inner, _Value()) for name, inner in fields]
                    for name, _, inside in fresh:
                        _unify(known, _Value(fields={name: inside}))
                        known = known.find()
                    _unify(known, _Value(fields={}))
                    todo.extend((inner, inside) for _, inner, inside in fresh)
                case ListPattern(items):
                    inside_list = [_Value() for _ in items]
                    _unify(known, _Value(items=inside_list))
                    todo.extend(zip(items, inside_list, strict=True))

    def finite(self) -> bool:
        """Whether no value would have to contain itself."""
        done: set[int] = set()
        path: set[int] = set()
        todo = [(self.root.find(), False)]
        while todo:
            value, left = todo.pop()
            if left:
                path.discard(id(value))
                done.add(id(value))
            elif id(value) in path:
                return False
            elif id(value) not in done:
                path.add(id(value))
                todo.append((value, True))
                inner = [*(value.fields or {}).values(), *(value.items or ())]
                todo.extend((part.find(), False) for part in inner if id(part.find()) not in done)
        return True

    def satisfies(self, pattern: Pattern) -> bool:
        """Whether the least event matches a pattern, rigid variables as bound so far."""
        if not all(name in self.bound for name in rigid_variables(pattern)):
            return False
        bound = {name: value for name, value in self.bound.items() if not name.startswith("_")}
        todo = [(pattern, self.root)]
        while todo:
            part, value = todo.pop()
            known = value.find()
            match part:
                case Literal():
                    if known.literal != part:
                        return False
                case Variable(name):
                    if not _equal(bound.setdefault(name, known), known):
                        return False
                case Anything():
                    pass
                case ObjectPattern(fields):
                    if known.fields is None or not all(name in known.fields for name, _ in fields):
                        return False
                    todo.extend((inner, known.fields[name]) for name, inner in fields)
                case ListPattern(items):
                    if known.items is None or len(known.items) != len(items):
                        return False
                    todo.extend(zip(items, known.items, strict=True))
        return True


def least(patterns: Iterable[Pattern]) -> Least | None:
    """The least event that satisfies all these patterns, or None where no event does."""
    event = Least()
    try:
        for pattern in patterns:
            event.demand(pattern)
    except Clash:
        return None
    return event if event.finite() else None


def _unify(one: _Value, other: _Value) -> None:
    todo = [(one, other)]
    while todo:
        a, b = (value.find() for value in todo.pop())
        if a is b:
            continue
        b.same = a
        if a.free:
            a.literal, a.fields, a.items = b.literal, b.fields, b.items
        elif b.free or (a.literal is not None and a.literal == b.literal):
            continue
        elif a.fields is not None and b.fields is not None:
            for name, inner in b.fields.items():
                if name in a.fields:
                    todo.append((a.fields[name], inner))
                else:
                    a.fields[name] = inner
        elif a.items is not None and b.items is not None and len(a.items) == len(b.items):
            todo.extend(zip(a.items, b.items, strict=True))
        else:
            raise Clash


def _equal(one: _Value, other: _Value) -> bool:
    todo = [(one, other)]
    while todo:
        a, b = (value.find() for value in todo.pop())
        if a is b:
            continue
        if a.literal is not None and a.literal == b.literal:
            continue
        if a.items is None or b.items is None or len(a.items) != len(b.items):
            return False  # two objects differ in the field that occurs nowhere else
        todo.extend(zip(a.items, b.items, strict=True))
    return True


Atoms: TypeAlias = int
"""A set of atoms, one bit each."""


def bits(mask: int) -> Iterator[int]:
    """The indices of the bits that are set, lowest first."""
    while mask:
        low = mask & -mask
        yield low.bit_length() - 1
        mask ^= low


def apart(pattern: Pattern) -> Pattern:
    """The pattern with variables of its own."""
    return substitute(pattern, {name: Variable(f"_{name}") for name in rigid_variables(pattern)})


@dataclass(frozen=True, slots=True)
class Alphabet:
    """What decides relevance: the entries, and the `ignore` declarations that have no guard."""

    entries: tuple[Pattern, ...]
    ignored: tuple[Pattern, ...]


class Letters:
    """The feasible letters over some atoms; with an alphabet, those of relevant events."""

    def __init__(self, patterns: Sequence[Pattern], alphabet: Alphabet | None = None) -> None:
        self._patterns = tuple(patterns)
        entries = () if alphabet is None else tuple(dict.fromkeys(apart(p) for p in alphabet.entries))
        self._decisive = (*self._patterns, *entries)
        self._entries = {entry: index for index, entry in enumerate(entries, len(self._patterns))}
        self._ignored = () if alphabet is None else tuple(apart(p) for p in alphabet.ignored)
        self._all = (1 << len(self._patterns)) - 1
        self._rivals = _rivals(self._decisive)
        self._closures: dict[Atoms, Atoms | None] = {}
        self._relevant: dict[Atoms, tuple[dict[Atoms, None], Iterator[Atoms]]] = {}
        self._together: dict[int, tuple[Atoms, Atoms]] = {}
        self._implying: dict[int, Atoms] = {}
        self._hidden: dict[int, bool] = {}

    def closure(self, atoms: Atoms) -> Atoms | None:
        """All atoms that hold wherever these hold, or None where they never hold together."""
        if atoms not in self._closures:
            event = least(self._patterns[atom] for atom in bits(atoms))
            near = self._all & ~self._excluded(atoms)
            self._closures[atoms] = None if event is None else self._satisfied(event, near)
        return self._closures[atoms]

    def together(self, atom: int, others: Atoms) -> Atoms:
        """Those of the other atoms that can hold at an event where this one does."""
        known, found = self._together.get(atom, (0, 0))
        for other in bits(others & ~known & ~self._rivals[atom]):
            if least([self._patterns[atom], self._patterns[other]]) is not None:
                found |= 1 << other
        self._together[atom] = (known | others, found)
        return found & others

    def implying(self, atom: int) -> Atoms:
        """The atoms, itself included, at whose every event this one holds."""
        if atom not in self._implying:
            candidates = self._all & ~self._rivals[atom]
            implying = (one for one in bits(candidates) if (self.closure(1 << one) or 0) >> atom & 1)
            self._implying[atom] = sum(1 << one for one in implying)
        return self._implying[atom]

    def over(self, some: Atoms) -> Iterator[Atoms]:
        """The feasible letters as far as these atoms see them, the empty one first where it is feasible."""
        nothing = (self.closure(0) or 0) & some
        seen = {nothing}
        todo = [nothing]
        while todo:
            letter = todo.pop()
            if self._can_be_relevant(letter, some):
                yield letter
            near = some
            for atom in bits(letter):
                near &= self.together(atom, near) | letter
            for atom in reversed(list(bits(near & ~letter))):
                closed = self.closure(letter | 1 << atom)
                if closed is not None and closed & some not in seen:
                    seen.add(closed & some)
                    todo.append(closed & some)

    def _can_be_relevant(self, letter: Atoms, some: Atoms) -> bool:
        """Whether some relevant event makes exactly this letter true, as far as `some` atoms see it."""
        if letter not in self._relevant:
            self._relevant[letter] = ({}, self._find_relevant(letter))
        found, more = self._relevant[letter]
        if any(atoms & some == letter for atoms in found):
            return True
        for atoms in more:
            found[atoms] = None
            if atoms & some == letter:
                return True
        return False

    def _find_relevant(self, letter: Atoms) -> Iterator[Atoms]:
        """What the least relevant events at which these atoms hold make true, one for each entry of the alphabet.

        An atom whose every event is ignored keeps its letters: a partial match that waits for it is none the less a partial match.
        """
        if not self._entries or any(self._always_ignored(atom) for atom in bits(letter)):
            yield letter
        own = [self._patterns[atom] for atom in bits(letter)]
        likely = [self._entries[entry] for pattern in own if (entry := apart(pattern)) in self._entries]
        for index in chain(likely, self._entries.values()):
            if self._rivals[index] & letter:
                continue
            event = least([*own, self._decisive[index]])
            if event is not None and not any(event.satisfies(ignored) for ignored in self._ignored):
                yield self._satisfied(event, self._all & ~self._rivals[index])

    def _always_ignored(self, atom: int) -> bool:
        if atom not in self._hidden:
            event = least([self._patterns[atom]])
            self._hidden[atom] = event is not None and any(event.satisfies(ignored) for ignored in self._ignored)
        return self._hidden[atom]

    def _satisfied(self, event: Least, among: Atoms) -> Atoms:
        return sum(1 << atom for atom in bits(among) if event.satisfies(self._patterns[atom]))

    def _excluded(self, atoms: Atoms) -> Atoms:
        excluded = 0
        for atom in bits(atoms):
            excluded |= self._rivals[atom]
        return excluded


def _rivals(patterns: Sequence[Pattern]) -> list[Atoms]:
    """For each pattern those that differ from it in a literal at a common path: a quick test before unification."""
    by_path: dict[tuple[str, ...], dict[Literal, Atoms]] = {}
    own: list[list[tuple[tuple[str, ...], Literal]]] = []
    for index, pattern in enumerate(patterns):
        own.append(list(_literals(pattern)))
        for path, literal in own[-1]:
            values = by_path.setdefault(path, {})
            values[literal] = values.get(literal, 0) | 1 << index
    with_path = {path: _union(values.values()) for path, values in by_path.items()}
    return [_union(with_path[path] & ~by_path[path][literal] for path, literal in found) for found in own]


def _literals(pattern: Pattern) -> Iterator[tuple[tuple[str, ...], Literal]]:
    todo: list[tuple[tuple[str, ...], Pattern]] = [((), pattern)]
    while todo:
        path, part = todo.pop()
        match part:
            case Literal():
                yield path, part
            case ObjectPattern(fields):
                todo.extend(((*path, name), inner) for name, inner in fields)
            case _:
                pass


def _union(masks: Iterable[int]) -> int:
    union = 0
    for mask in masks:
        union |= mask
    return union
