"""Which event patterns can match one event, found without comparing all pairs.

Two patterns *overlap* when some event matches both under one assignment of the rigid variables; local variables are each
pattern's own. That is unification, where an object pattern stands for all objects that have at least its fields.
"""

from collections import Counter
from collections.abc import Hashable, Iterable, Mapping
from typing import TypeAlias, assert_never

import networkx as nx

from rvaft.model.patterns import Anything, ListPattern, Literal, ObjectPattern, Pattern, Variable, walk
from rvaft.model.values import key
from rvaft.support.budget import Budget

Path: TypeAlias = tuple[str, ...]

Shape: TypeAlias = tuple[tuple[str, Hashable], Mapping[str, int]]
"""What a value is (a literal, a list of some length, an object) and the cells of its parts."""


def overlaps(left: Pattern, right: Pattern) -> bool:
    """Whether one event can match both patterns."""
    names = [part.name for pattern in (left, right) for part in walk(pattern) if isinstance(part, Variable)]
    if len(set(names)) == len(names):
        return _compatible(left, right)
    cells = _Cells()
    return cells.unify(cells.of(left, "left"), cells.of(right, "right")) and not cells.endless()


def _compatible(left: Pattern, right: Pattern) -> bool:
    """The same where no variable stands twice, so that each stands for any value."""
    todo = [(left, right)]
    while todo:
        match todo.pop():
            case (Literal() as this, Literal() as that):
                if this != that:
                    return False
            case (ObjectPattern(these), ObjectPattern(those)):
                there = dict(those)
                todo.extend((inner, there[field]) for field, inner in these if field in there)
            case (ListPattern(these), ListPattern(those)):
                if len(these) != len(those):
                    return False
                todo.extend(zip(these, those, strict=True))
            case (Variable() | Anything(), _) | (_, Variable() | Anything()):
                pass
            case _:
                return False
    return True


class _Cells:
    """Terms as cells that are united; of each class of cells one knows what its value looks like."""

    def __init__(self) -> None:
        self._link: list[int] = []
        self._shape: list[Shape | None] = []
        self._named: dict[tuple[str, str], int] = {}

    def of(self, pattern: Pattern, side: str) -> int:
        """The cell of a pattern; local variables belong to its side. Nesting is bounded by the parser."""
        match pattern:
            case Variable(name):
                owner = (name, side if pattern.local else "")
                if owner not in self._named:
                    self._named[owner] = self._new(None)
                return self._named[owner]
            case Anything():
                return self._new(None)
            case Literal(value):
                return self._new((("literal", key(value)), {}))
            case ListPattern(items):
                inside = {str(index): self.of(item, side) for index, item in enumerate(items)}
                return self._new((("list", len(items)), inside))
            case ObjectPattern(fields):
                return self._new((("object", None), {field: self.of(inner, side) for field, inner in fields}))
            case _:
                assert_never(pattern)

    def _new(self, shape: Shape | None) -> int:
        self._link.append(len(self._link))
        self._shape.append(shape)
        return len(self._link) - 1

    def _find(self, cell: int) -> int:
        while self._link[cell] != cell:
            cell = self._link[cell]
        return cell

    def unify(self, left: int, right: int) -> bool:
        """Make two cells equal; False where they cannot be."""
        todo = [(left, right)]
        while todo:
            one, other = (self._find(cell) for cell in todo.pop())
            if one == other:
                continue
            this, that = self._shape[one], self._shape[other]
            self._link[other] = one
            if this is None or that is None:
                self._shape[one] = this or that
                continue
            if this[0] != that[0]:
                return False
            todo.extend((cell, that[1][field]) for field, cell in this[1].items() if field in that[1])
            self._shape[one] = (this[0], {**that[1], **this[1]})
        return True

    def endless(self) -> bool:
        """Whether some value would have to be part of itself, which no JSON value is."""
        graph = nx.DiGraph()
        for cell, shape in enumerate(self._shape):
            if shape is not None and self._link[cell] == cell:
                graph.add_edges_from((cell, self._find(inner)) for inner in shape[1].values())
        return not nx.is_directed_acyclic_graph(graph)


def rivals(patterns: Mapping[Pattern, int], budget: Budget) -> dict[Pattern, int]:
    """For each pattern the union of the masks of all other patterns that overlap it.

    Patterns that a literal tells apart are never compared, and those that differ only in a literal which the other side does not ask for
    are compared once. Raises `Undecided` when the budget is spent.
    """
    index = _Index(patterns, budget)
    todo: list[tuple[list[Pattern], frozenset[Path]]] = [(list(patterns), frozenset())]
    while todo:
        group, used = todo.pop()
        if len(group) < 2:
            continue
        budget.spend(len(group))
        path = index.telling(group, used)
        if path is None:
            for place, one in enumerate(group):
                index.compare([one], group[place + 1 :])
            continue
        wild: list[Pattern] = []
        buckets: dict[Hashable, list[Pattern]] = {}
        for pattern in group:
            fields = index.literals[pattern]
            if path in fields:
                buckets.setdefault(fields[path], []).append(pattern)
            else:
                wild.append(pattern)
        todo.append((wild, used | {path}))
        todo.extend((bucket, used | {path}) for bucket in buckets.values())
        index.cross(wild, [pattern for bucket in buckets.values() for pattern in bucket], path)
    return index.found


class _Index:
    """The literal fields of patterns, and the overlaps found so far."""

    def __init__(self, patterns: Mapping[Pattern, int], budget: Budget) -> None:
        self.masks = patterns
        self.budget = budget
        self.literals = {pattern: _literals(pattern) for pattern in patterns}
        self.found = dict.fromkeys(patterns, 0)

    def telling(self, group: list[Pattern], used: frozenset[Path]) -> Path | None:
        """The path at which most patterns of a group have a literal."""
        counts = Counter(path for pattern in group for path in self.literals[pattern] if path not in used)
        return min(counts, key=lambda path: (-counts[path], path), default=None)

    def compare(self, these: Iterable[Pattern], those: Iterable[Pattern]) -> None:
        """Compare each with each."""
        others = list(those)
        for one in these:
            for other in others:
                self.budget.spend(10)
                if overlaps(one, other):
                    self.found[one] |= self.masks[other]
                    self.found[other] |= self.masks[one]

    def cross(self, wild: list[Pattern], told: list[Pattern], path: Path) -> None:
        """Compare patterns without a literal at a path with patterns that have one."""
        free = [pattern for pattern in wild if _nothing_at(pattern, path)]
        self.compare([pattern for pattern in wild if not _nothing_at(pattern, path)], told)
        if not free:
            return
        alike: dict[Pattern, list[Pattern]] = {}
        for pattern in told:
            alike.setdefault(_replaced(pattern, path), []).append(pattern)
        for reduced, members in alike.items():
            mask = 0
            for pattern in members:
                mask |= self.masks[pattern]
            matching = 0
            for one in free:
                self.budget.spend(10)
                if overlaps(one, reduced):
                    self.found[one] |= mask
                    matching |= self.masks[one]
            for pattern in members:
                self.found[pattern] |= matching


def _literals(pattern: Pattern) -> dict[Path, Hashable]:
    """The literal fields of a pattern by their path through objects."""
    found: dict[Path, Hashable] = {}
    todo: list[tuple[Path, Pattern]] = [((), pattern)]
    while todo:
        path, part = todo.pop()
        if isinstance(part, Literal):
            found[path] = key(part.value)
        elif isinstance(part, ObjectPattern):
            todo.extend(((*path, field), inner) for field, inner in part.fields)
    return found


def _nothing_at(pattern: Pattern, path: Path) -> bool:
    """Whether a pattern asks nothing of the value at a path (and leaves open, as objects do, what surrounds it)."""
    part = pattern
    for field in path:
        if not isinstance(part, ObjectPattern):
            return isinstance(part, Anything)
        inner = dict(part.fields).get(field)
        if inner is None:
            return True
        part = inner
    return isinstance(part, Anything)


def _replaced(pattern: Pattern, path: Path) -> Pattern:
    """The pattern with `_` at a path. Nesting is bounded by the parser."""
    if not path:
        return Anything()
    assert isinstance(pattern, ObjectPattern)
    return ObjectPattern(
        tuple((field, _replaced(inner, path[1:]) if field == path[0] else inner) for field, inner in pattern.fields)
    )
