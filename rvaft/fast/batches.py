"""Batches of events: what a tree reads of a block of lines."""

from collections import Counter
from collections.abc import Callable, Hashable, Iterable, Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from io import BufferedIOBase
from operator import attrgetter, methodcaller
from typing import Any, Final, NamedTuple, Self, TypeAlias

from rvaft.errors import TraceError
from rvaft.fast.blocks import Block, Blocks
from rvaft.fast.doubts import SHORT, doubtful, repeated, utf8
from rvaft.fast.heads import ABSENT, REFUSED, event_decoder, fields_of, head_decoder, quoted
from rvaft.fast.skeletons import Skeletons
from rvaft.reads import Reads, TreeReads
from rvaft.shapes import brief
from rvaft.traces import decode, event_on
from rvaft.values import Json

Values: TypeAlias = tuple[Hashable, ...]
Wants: TypeAlias = Callable[[Values], int]
MEMORY: Final = 10_000
"""How many values of the discriminating fields are remembered; then the memory starts afresh."""
_DOUBT: Final = ("doubt",)
"""In place of the values on a line that `rvaft.traces` has to read."""


@dataclass(frozen=True, slots=True)
class Batch:
    """Events that follow each other: how many, those that may concern the tree, and the others by what tells them apart.

    Of `events` each has its place among all of the batch, from 0; it has the fields that the tree's patterns mention, and perhaps
    more. `others` counts events that fit no pattern. After the events of the batch comes the `error`, if there is one.
    """

    count: int
    events: Sequence[tuple[int, dict[str, Json]]]
    others: Sequence[tuple[Values, int]]
    error: TraceError | None = None


class _Known(NamedTuple):
    """What values of the discriminating fields mean: whether some pattern may fit, and the quoted keys that are not to be repeated."""

    live: bool
    apart: Values
    keys: tuple[bytes, ...]


class _View(NamedTuple):
    """A block decoded: for each line what the decoder made of it, and its values in the discriminating fields, or `_DOUBT`.

    The values of one discriminating field stand as they are, those of several together. With `whole` the heads are events, and with
    `sure` no key is repeated that is read.
    """

    heads: Sequence[Any]
    found: list[Hashable]
    counts: Mapping[Hashable, int]
    whole: bool
    sure: bool


class Batches:
    """Reads logs for one tree."""

    def __init__(self, reads: TreeReads, fields: Sequence[str]) -> None:
        self._reads = reads
        self._discriminators = reads.discriminators
        self._decoder = event_decoder(fields)
        self._head = head_decoder(self._discriminators.fields).decode
        self._known: dict[Hashable, _Known] = {}
        self._skeletons = Skeletons(map(quoted, fields), self._sound)
        self._dense = False
        """Whether most lines of late were of interest: then all are decoded as events at once."""

    @classmethod
    def of(cls, reads: TreeReads, also: Iterable[str] = ()) -> Self | None:
        """A reader of the logs of a tree, or None for a tree that is left to `rvaft.traces`; `also` are fields to keep."""
        fields = fields_of(reads.patterns)
        if not reads.discriminators.fields or fields is None:
            return None
        return cls(reads, tuple(dict.fromkeys((*fields, *also))))

    def read(self, stream: BufferedIOBase, file: str, wants: Wants) -> Iterator[Batch]:
        """All events of a stream in batches; raises `TraceError` after the batch that has it.

        `wants` says how many more events that fit no pattern, with given values in the discriminating fields, are to be among
        the events of a batch all the same; it is asked once for each batch.
        """
        coming = Blocks(stream, file)
        for block in coming:
            view = self._view(block)
            batch = self._batch(block, view, wants, file, coming.line)
            yield batch
            if batch.error is not None:
                raise batch.error
            coming.line += len(view.heads)

    # -- what is on each line ---------------------------------------------------------------------------------------

    def _view(self, block: Block) -> _View:
        if self._dense and utf8(block.text) and block.within(SHORT):
            count = self._skeletons.count(block)
            if count is not None:
                with suppress(*REFUSED):
                    heads = self._decoder.decode_lines(block.text)
                    if len(heads) == count:
                        found = self._found(heads, whole=True)
                        return _View(heads, found, Counter(found), whole=True, sure=True)
        whole = self._dense
        heads, refused = _decoded(self._decoder.decode if whole else self._head, block.lines)
        found = self._found(heads, whole=whole)
        counts = Counter(found)
        doubts = doubtful(block)
        doubts.update(refused, self._told_twice(block, found, {} if doubts else counts))
        for place in doubts:
            found[place] = _DOUBT
        return _View(heads, found, Counter(found) if doubts else counts, whole, sure=False)

    def _found(self, heads: Sequence[Any], *, whole: bool) -> list[Hashable]:
        """The values in the discriminating fields, `ABSENT` for those of no head."""
        columns: list[list[Hashable]] = []
        for number, field in enumerate(self._discriminators.fields):
            value: Callable[[Any], Hashable] = methodcaller("get", field, ABSENT) if whole else attrgetter(f"f{number}")
            try:
                columns.append(list(map(value, heads)))
            except AttributeError:
                columns.append([ABSENT if head is None else value(head) for head in heads])
        return columns[0] if len(columns) == 1 else list(zip(*columns, strict=True))

    def _told_twice(self, block: Block, found: Sequence[Any], counts: Mapping[Hashable, int]) -> Iterator[int]:
        """The places of lines that may repeat a discriminating field.

        With `counts`, those of `found`, no line writes a field otherwise than it is: then to count them in the block will do.
        """
        fields = self._discriminators.fields
        for number, field in enumerate(fields):
            key = quoted(field)
            absent = counts.get(ABSENT, 0) if len(fields) == 1 else sum(values[number] is ABSENT for values in found)
            if not counts or block.text.count(key) != len(found) - absent:
                yield from repeated(block.lines, key)

    def _sound(self, line: bytes) -> bool:
        """Whether a line is one object."""
        try:
            decode(line, reads=Reads())
        except ValueError:
            return False
        return True

    # -- events -----------------------------------------------------------------------------------------------------

    def _batch(self, block: Block, view: _View, wants: Wants, file: str, first: int) -> Batch:
        heads, found, counts, whole, sure = view
        known = {values: self._what(values) for values in counts if values is not _DOUBT}
        left = {values: wants(what.apart) for values, what in known.items() if not what.live}
        others = {values: counts[values] for values, wanted in left.items() if not wanted}
        places = (
            [place for place, values in enumerate(found) if values not in others] if len(others) < len(counts) else []
        )
        keys = {} if sure else {values: what.keys for values, what in known.items() if what.live}
        self._dense = 2 * len(places) > len(found)
        if sure and not left:
            return Batch(len(found), list(enumerate(heads)), ())
        events: list[tuple[int, dict[str, Json]]] = []
        blank = 0
        for place in places:
            values = found[place]
            if values in left:
                if not left[values]:
                    others[values] = others.get(values, 0) + 1
                    continue
                left[values] -= 1
            event: dict[str, Json] | None = None
            if sure:
                event = heads[place]
            elif values is not _DOUBT and not _repeats(block.lines[place], keys.get(values, ())):
                event = heads[place] if whole else _one(self._decoder.decode, block.lines[place])
            if event is None:
                try:
                    event = event_on(block.lines[place], file, first + place, self._reads)
                except TraceError as error:
                    before = view._replace(heads=heads[:place], found=found[:place], counts=Counter(found[:place]))
                    return replace(self._batch(block, before, wants, file, first), error=error)
            if event is None:
                blank += 1
            else:
                events.append((place - blank, event))
        return Batch(len(found) - blank, events, [(known[values].apart, count) for values, count in others.items()])

    def _what(self, values: Hashable) -> _Known:
        known = self._known.get(values)
        if known is None:
            fields = self._discriminators.fields
            every = values if len(fields) > 1 else (values,)
            assert isinstance(every, tuple)
            asked = self._discriminators.values(dict(zip(fields, every, strict=True)))
            live = bool(self._discriminators.candidates(asked))
            keys = tuple(quoted(field) for field in self._reads.where(asked).fields if field not in fields)
            known = _Known(live, self._discriminators.apart(every), keys)
            if len(self._known) >= MEMORY:
                self._known.clear()
            if brief(every):
                self._known[values] = known
        return known


def _repeats(line: bytes, keys: tuple[bytes, ...]) -> bool:
    """Whether one of these quoted keys stands in a line more than once."""
    for key in keys:  # noqa: SIM110 (asked of every event)
        if line.count(key) > 1:
            return True
    return False


def _decoded(decode: Callable[[bytes], Any], lines: Sequence[bytes]) -> tuple[list[Any], list[int]]:
    """What a decoder makes of each line, and the places of those that it refuses; there stands None."""
    try:
        return list(map(decode, lines)), []
    except REFUSED:
        heads = [_one(decode, line) for line in lines]
        return heads, [place for place, head in enumerate(heads) if head is None]


def _one(decode: Callable[[bytes], Any], line: bytes) -> Any:
    try:
        return decode(line)
    except REFUSED:
        return None
