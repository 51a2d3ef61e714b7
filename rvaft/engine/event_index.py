"""Events read against all patterns of a tree at once: which occurrences an event can serve, and whether it is relevant.

Equal patterns with equal guards are one *letter*, tried once per event. What the shape of an event decides is worked out once for
each shape (`rvaft.shapes`), so an event that concerns nothing costs one look-up, however large the tree.
"""

from collections import Counter
from collections.abc import Callable, Hashable, Iterator, Mapping, Sequence
from itertools import combinations
from typing import Final, NamedTuple

from rvaft.analysis.pattern_index import Decided, Letter, Reader, Shapes, Values, reader
from rvaft.engine.compiled_tree import Plan
from rvaft.model.guards import Predicate
from rvaft.model.patterns import ListPattern, Literal, ObjectPattern, Pattern
from rvaft.model.tree import RVAFT
from rvaft.model.values import Json, key

# Can one event fit two patterns? A quick no, or a careful yes.


def compatible(left: Pattern, right: Pattern) -> bool:
    """False only where no event fits both; what variables demand is not looked at."""
    agenda = [(left, right)]
    while agenda:
        match agenda.pop():
            case Literal() as a, Literal() as b:
                if a != b:
                    return False
            case ObjectPattern(fields), ObjectPattern(others):
                given = dict(others)
                agenda.extend((inner, given[name]) for name, inner in fields if name in given)
            case ListPattern(items), ListPattern(others):
                if len(items) != len(others):
                    return False
                agenda.extend(zip(items, others, strict=True))
            case (
                Literal() | ObjectPattern() | ListPattern() as a,
                Literal() | ObjectPattern() | ListPattern() as b,
            ) if type(a) is not type(b):
                return False
            case _:
                pass
    return True


def overlapping(patterns: Sequence[Pattern]) -> Iterator[tuple[int, int]]:
    """The pairs of patterns that one event may fit.

    The patterns are split by the literals of one field after another, so that many patterns with different names cost
    little; those without a literal there go with each group.
    """
    literals = [_literals(pattern) for pattern in patterns]
    seen: set[tuple[int, int]] = set()
    agenda: list[tuple[list[int], frozenset[str]]] = [(list(range(len(patterns))), frozenset())]
    while agenda:
        group, used = agenda.pop()
        counts = Counter(field for number in group for field in literals[number] if field not in used)
        best = counts.most_common(1)
        if len(group) <= 8 or not best or best[0][1] < 2:
            for pair in combinations(group, 2):
                if pair not in seen and compatible(patterns[pair[0]], patterns[pair[1]]):
                    seen.add(pair)
                    yield pair
            continue
        field = best[0][0]
        rest = [number for number in group if field not in literals[number]]
        tables: dict[Hashable, list[int]] = {}
        for number in group:
            if field in literals[number]:
                tables.setdefault(literals[number][field], []).append(number)
        agenda.extend((sorted([*numbers, *rest]), used | {field}) for numbers in tables.values())


def _literals(pattern: Pattern) -> dict[str, Hashable]:
    if not isinstance(pattern, ObjectPattern):
        return {}
    return {field: key(inner.value) for field, inner in pattern.fields if isinstance(inner, Literal)}


class Hit(NamedTuple):
    """A letter that an event is, the nodes whose runtime event that is, and the values it gives to their variables."""

    letter: int
    nodes: tuple[int, ...]
    values: Mapping[str, Json]


class Reading(NamedTuple):
    """What one event means to a tree."""

    relevant: bool
    hits: Sequence[Hit]


_new: Final = tuple.__new__  # half the time of the classes' own; they add nothing
NOTHING: Final = Reading(relevant=False, hits=())
"""What an event means that fits no pattern."""


class Letters:
    """All letters of a tree: those of its occurrences, those of its alphabet, and those it ignores."""

    def __init__(self, tree: RVAFT, plan: Plan) -> None:
        serves: dict[Letter, list[int]] = {}
        for node, name in enumerate(plan.names):
            pattern = tree.pattern(name)
            if pattern is not None:
                serves.setdefault(Letter(pattern, plan.filters[node]), []).append(node)
        alphabet = dict.fromkeys(Letter(entry.pattern, entry.when) for entry in tree.alphabet)
        self.letters = tuple(dict.fromkeys([*serves, *alphabet]))
        self.serves = tuple(tuple(serves.get(letter, ())) for letter in self.letters)
        """For each letter the nodes whose runtime event it is."""
        self._relevant = tuple(letter in alphabet for letter in self.letters)
        ignored = [Letter(tree.instantiate(ignore.on), ignore.when) for ignore in tree.ignores]
        all_letters = [*self.letters, *ignored]
        self._readers = tuple(reader(number, letter) for number, letter in enumerate(all_letters))
        self.sketch = Shapes((letter.pattern for letter in all_letters), self._sketch).of
        """What the shape of an event says: for who reads many events of few shapes."""

    def _sketch(self, decided: Decided) -> "Sketch":
        readers = [self._readers[number] for number in sorted((*decided.fits, *decided.open))]
        count = len(self.letters)
        letters = tuple(
            Known(one.number, self.serves[one.number], self._relevant[one.number], one, one.holds, one.values)
            for one in readers
            if one.number < count
        )
        ignored = tuple(one for one in readers if one.number >= count)
        return Sketch(letters, tuple(known for known in letters if known.nodes), ignored)

    def serving(
        self, event: Json, wanted: Callable[[int], bool], sketch: "Sketch | None" = None
    ) -> Iterator[tuple[int, Mapping[str, Json]]]:
        """The letters that an event fits, of those wanted, and the values it gives to their variables."""
        for known in (sketch or self.sketch(event)).letters:
            if wanted(known.number):
                values = known.reader.read(event)
                if values is not None:
                    yield known.number, values

    def read(self, event: Json, sketch: "Sketch | None" = None, *, relevance: bool = True) -> Reading:
        """What an event means; without `relevance` it is not asked whether the event is relevant."""
        if sketch is None:
            sketch = self.sketch(event)
        if not sketch.letters:
            return NOTHING
        relevant = False
        hits: list[Hit] = []
        for number, nodes, matters, one, holds, values_of in sketch.letters if relevance else sketch.serving:
            if not one.plain:
                values = one.read(event)
                if values is None:
                    continue
            elif holds is not None and not holds(event):
                continue
            else:  # as `read` does; here for very many events
                values = values_of(event)
            relevant = relevant or matters
            if nodes:
                hits.append(_new(Hit, (number, nodes, values)))
        return _new(Reading, (relevance and relevant and not sketch.ignores(event), hits))


class Known(NamedTuple):
    """A letter with the nodes that it serves, whether it is relevant, and how it is read: as a whole, and in parts."""

    number: int
    nodes: tuple[int, ...]
    relevant: bool
    reader: Reader
    holds: Predicate | None
    values: Values


class Sketch(NamedTuple):
    """What events of one shape may be: the letters, those of them that serve a node, and those that are ignored."""

    letters: tuple[Known, ...]
    serving: tuple[Known, ...]
    ignored: tuple[Reader, ...]

    def ignores(self, event: Json) -> bool:
        """Whether an event is declared never to be relevant."""
        return any(one.admits(event) for one in self.ignored)
