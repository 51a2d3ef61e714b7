"""Events read against all patterns of a tree at once: which occurrences an event can serve, and whether it is relevant.

Equal patterns with equal guards are one *letter*, tried once per event. What the shape of an event decides is worked out once for
each shape (`rvaft.shapes`), so an event that concerns nothing costs one look-up, however large the tree.
"""

from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from typing import Final, NamedTuple

from rvaft.engine.plan import Plan
from rvaft.letters import Letter, Reader, reader
from rvaft.shapes import Decided, Shapes
from rvaft.tree import RVAFT
from rvaft.values import Json


class Hit(NamedTuple):
    """A letter that an event is, the nodes whose runtime event that is, and the values it gives to their variables."""

    letter: int
    nodes: tuple[int, ...]
    values: Mapping[str, Json]


@dataclass(frozen=True, slots=True)
class Reading:
    """What one event means to a tree."""

    relevant: bool
    hits: tuple[Hit, ...]


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
        return _Sketch(
            tuple(one for one in readers if one.number < count), tuple(one for one in readers if one.number >= count)
        )

    def serving(self, event: Json, wanted: Callable[[int], bool]) -> Iterator[tuple[int, Mapping[str, Json]]]:
        """The letters that an event fits, of those wanted, and the values it gives to their variables."""
        for one in self._shapes.of(event).letters:
            if wanted(one.number):
                values = one.read(event)
                if values is not None:
                    yield one.number, values

    def read(self, event: Json, *, relevance: bool = True) -> Reading:
        """What an event means; without `relevance` it is not asked whether the event is relevant."""
        sketch = self._shapes.of(event)
        if not sketch.letters:
            return NOTHING
        relevant = False
        hits: list[Hit] = []
        for one in sketch.letters:
            values = one.read(event)
            if values is not None:
                number = one.number
                relevant = relevant or (relevance and self._relevant[number])
                if self.serves[number]:
                    hits.append(Hit(number, self.serves[number], values))
        return Reading(relevant and not sketch.ignores(event), tuple(hits))


class _Sketch(NamedTuple):
    """What events of one shape may be: the letters, and among those that are ignored."""

    letters: tuple[Reader, ...]
    ignored: tuple[Reader, ...]

    def ignores(self, event: Json) -> bool:
        """Whether an event is declared never to be relevant."""
        return any(one.admits(event) for one in self.ignored)
