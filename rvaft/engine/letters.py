"""Events read against all patterns of a tree at once: which occurrences an event can serve, and whether it is relevant.

Equal patterns with equal guards are one *letter*, tried once per event. What the shape of an event decides is worked out once for
each shape (`rvaft.shapes`), so an event that concerns nothing costs one look-up, however large the tree.
"""

from collections.abc import Callable, Iterator, Mapping, Sequence
from typing import Final, NamedTuple

from rvaft.engine.plan import Plan
from rvaft.letters import Letter, Reader, Values, reader
from rvaft.predicates import Predicate
from rvaft.shapes import Decided, Shapes
from rvaft.tree import RVAFT
from rvaft.values import Json


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
        self._shapes = Shapes((letter.pattern for letter in all_letters), self._sketch)

    def _sketch(self, decided: Decided) -> "_Sketch":
        readers = [self._readers[number] for number in sorted((*decided.fits, *decided.open))]
        count = len(self.letters)
        letters = tuple(
            Known(one.number, self.serves[one.number], self._relevant[one.number], one, one.holds, one.values)
            for one in readers
            if one.number < count
        )
        ignored = tuple(one for one in readers if one.number >= count)
        return _Sketch(letters, tuple(known for known in letters if known.nodes), ignored)

    def serving(self, event: Json, wanted: Callable[[int], bool]) -> Iterator[tuple[int, Mapping[str, Json]]]:
        """The letters that an event fits, of those wanted, and the values it gives to their variables."""
        for known in self._shapes.of(event).letters:
            if wanted(known.number):
                values = known.reader.read(event)
                if values is not None:
                    yield known.number, values

    def read(self, event: Json, *, relevance: bool = True) -> Reading:
        """What an event means; without `relevance` it is not asked whether the event is relevant."""
        sketch = self._shapes.of(event)
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


class _Sketch(NamedTuple):
    """What events of one shape may be: the letters, those of them that serve a node, and those that are ignored."""

    letters: tuple[Known, ...]
    serving: tuple[Known, ...]
    ignored: tuple[Reader, ...]

    def ignores(self, event: Json) -> bool:
        """Whether an event is declared never to be relevant."""
        return any(one.admits(event) for one in self.ignored)
