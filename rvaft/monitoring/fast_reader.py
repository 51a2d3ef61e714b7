"""Batches of events: what a tree reads of a block of lines."""

import re
from collections import Counter
from collections.abc import Callable, Hashable, Iterable, Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from functools import cached_property
from io import DEFAULT_BUFFER_SIZE, BufferedIOBase
from operator import attrgetter, methodcaller
from pathlib import Path
from typing import Any, Final, NamedTuple, Protocol, Self, TypeAlias, TypedDict

import msgspec

from rvaft.analysis.pattern_index import Reads, TreeReads, brief
from rvaft.errors import TraceError
from rvaft.model.patterns import ObjectPattern, Pattern
from rvaft.model.values import Json, Scalar
from rvaft.monitoring.reader import BOM, MAX_DEPTH, MAX_DIGITS, MAX_LINE, decode, event_on, failures_of, unreadable
from rvaft.support.files import SUFFIXES

# A stream of bytes cut into blocks of whole lines.

SIZE: Final = 3 << 15
"""Bytes that are read at once: small enough for the caches of the machine."""


class Block:
    """Whole lines, as one piece of bytes."""

    def __init__(self, text: bytes) -> None:
        self.text = text

    @cached_property
    def lines(self) -> list[bytes]:
        """The lines without their ends."""
        lines = self.text.split(b"\n")
        if not lines[-1]:
            lines.pop()
        return lines

    def within(self, length: int) -> bool:
        """Whether certainly no line is longer than that."""
        text, half = self.text, length // 2
        return all(text.find(b"\n", start, start + half) >= 0 for start in range(0, len(text) - half, half))


class Blocks:
    """The lines of a stream in turn; one longer than `MAX_LINE` is the last."""

    def __init__(self, stream: BufferedIOBase, file: str) -> None:
        self._stream = stream
        self._file = file
        self._failures = failures_of(file)
        # Damaged data is lost from the call on that meets it, so there no more is asked for at once than when it is read by lines.
        self._at_once = min(SIZE, DEFAULT_BUFFER_SIZE) if Path(file).suffix.lower() in SUFFIXES else SIZE
        self.line = 1
        """The number of the first line of the block that comes next; kept by who takes the blocks."""

    def __iter__(self) -> Iterator[Block]:
        """Raises `TraceError` where the file cannot be read, after the lines that end before."""
        held = b""
        begun = False
        while True:
            text, more, failure = self._more(held)
            whole = not more and failure is None
            end = len(text) if whole else text.rfind(b"\n") + 1
            given = text[:end] if begun else text[:end].removeprefix(BOM)
            begun = True
            if given:
                yield Block(given)
            if failure is not None:
                raise unreadable(failure, self._file, self.line) from failure
            if not more:
                return
            held = text[end:]

    def _more(self, held: bytes) -> tuple[bytes, bool, Exception | None]:
        """What is held and what comes after it, up to some line's end; whether there may be more; what it failed with."""
        pieces, size = [held], len(held)
        ended = False
        while size < SIZE or (not ended and size <= len(BOM) + MAX_LINE):
            try:
                data = self._stream.read1(self._at_once)
            except self._failures as error:
                return b"".join(pieces), False, error
            if not data:
                return b"".join(pieces), False, None
            pieces.append(data)
            size += len(data)
            ended = ended or b"\n" in data
        return b"".join(pieces), ended, None


# Lines of a block that the fast decoder cannot be trusted with.
#
# It checks all of JSON's grammar but passes over strings and numbers that nobody reads. So what it does not see is looked for here, in the
# bytes: what is no UTF-8, what is nested too deeply, numbers that are too long, keys that are written with escapes, or repeated.

SHORT: Final = 2 * MAX_DEPTH
"""A line no longer than this has neither too many levels nor too many digits."""
_DIGITS: Final = re.compile(rb"[0-9]{%d}" % (MAX_DIGITS + 1))
_ASCII: Final = tuple(bytes([digit]) for digit in b"234567")
"""The third digit of the numbers of ASCII's letters and signs."""


def doubtful(block: Block) -> set[int]:
    """The places of lines with something about them that the decoder does not see."""
    found: set[int] = set()
    text, lines = block.text, block.lines
    if not utf8(text):
        found.update(place for place, line in enumerate(lines) if not utf8(line))
    if _escapes(text):
        found.update(place for place, line in enumerate(lines) if _escapes(line))
    if max(map(len, lines)) > SHORT:
        found.update(place for place, line in enumerate(lines) if len(line) > SHORT and _endless(line))
    return found


def repeated(lines: Iterable[bytes], key: bytes) -> set[int]:
    """The places of lines in which a quoted key stands more than once, as a key or as anything else."""
    return {place for place, line in enumerate(lines) if line.count(key) > 1}


def utf8(text: bytes) -> bool:
    """Whether that is what the bytes are."""
    if text.isascii():
        return True
    try:
        text.decode()
    except UnicodeDecodeError:
        return False
    return True


def _escapes(text: bytes) -> bool:
    """Whether some ASCII letter or sign is written by its number, as those of a key could be."""
    place = text.find(b"\\")
    while place >= 0:
        if text.startswith(b"u00", place + 1) and text[place + 4 : place + 5] in _ASCII:
            return True
        place = text.find(b"\\", place + 2)
    return False


def _endless(line: bytes) -> bool:
    return (
        line.count(b"{") + line.count(b"[") > MAX_DEPTH
        or len(line) > MAX_LINE
        or (len(line) > MAX_DIGITS and bool(_DIGITS.search(line)))
    )


# What is decoded of a line: the fields that some pattern of a tree mentions, where they hold no objects or lists.

ABSENT: Final = msgspec.UNSET
REFUSED: Final = (msgspec.DecodeError, UnicodeDecodeError, RecursionError)
"""What a decoder raises for a line that is not for it, malformed or not."""


def fields_of(patterns: Iterable[Pattern]) -> tuple[str, ...] | None:
    """The fields of events that patterns mention; None for patterns that the fast decoder is not for.

    Such want more than fields, or fields whose names a line could write in more ways than one, escapes of ASCII by their number aside.
    """
    found: dict[str, None] = {}
    for pattern in patterns:
        if not isinstance(pattern, ObjectPattern):
            return None
        found.update(dict.fromkeys(field for field, _ in pattern.fields))
    simple = all(name.isascii() and name.isprintable() and not set(name) & set('"\\/') for name in found)
    return tuple(found) if simple else None


def quoted(field: str) -> bytes:
    """A field as it stands in a line."""
    return f'"{field}"'.encode()


class Decoder(Protocol):
    """A decoder of msgspec; raises one of `REFUSED`."""

    def decode(self, line: bytes) -> Any:
        """The value on a line."""

    def decode_lines(self, text: bytes) -> list[Any]:
        """The values in a text, whatever lines they are on."""


def event_decoder(fields: Iterable[str]) -> Decoder:
    """Decodes objects to events with these fields alone; refuses those in which one of them is an object or a list."""
    event: Any = TypedDict("event", dict.fromkeys(fields, Scalar), total=False)  # type: ignore[misc] # the names come with the tree
    return msgspec.json.Decoder(event)


def head_decoder(fields: Iterable[str]) -> Decoder:
    """Decodes objects to such with attributes `f0`, `f1`, … for these fields; `ABSENT` stands for one that is not there.

    Refuses objects in which one of them is an object or a list.
    """
    names = {f"f{number}": field for number, field in enumerate(fields)}
    # Not to be looked at by the garbage collector: heads live for one block, and hold nothing that could refer to them.
    head = msgspec.defstruct(
        "Head",
        [(name, Scalar | msgspec.UnsetType, ABSENT) for name in names],
        rename=names.__getitem__,
        gc=False,
        module=__name__,
    )
    return msgspec.json.Decoder(head)


# Lines that differ in their numbers alone, as those of one publisher mostly do.
#
# The *skeleton* of a line is what remains without the characters that numbers are written with. Two lines of the same skeleton have the same
# strings, but for these characters, and the same brackets: such a character never stands behind the backslash of an escape, so what is
# inside a string in one line is so in the other. Hence, where one line is an object in which no key is repeated, and the others are
# JSON, they are objects in which no key is repeated. And where every line of a block holds an object, and the block holds as many
# values as it has lines, every line holds one value.

_OF_NUMBERS: Final = b"0123456789.+-eE"
MEMORY: Final = 4096
"""How many skeletons are remembered; then the memory starts afresh."""
_FEW: Final = 16
"""One line in so many may have a skeleton that is new: such lines take long."""
_REST: Final = 64
"""After a block with more new ones, so many are not looked at."""


class Skeletons:
    """The skeletons of lines that are one object each, and repeat none of these quoted keys.

    `sound` says of a line whether it is one object and does not exceed the limits of a trace.
    """

    def __init__(self, keys: Iterable[bytes], sound: Callable[[bytes], bool]) -> None:
        self._keys = tuple(key.translate(None, _OF_NUMBERS) for key in keys)
        self._sound = sound
        self._known: set[bytes] = set()
        self._resting = 0

    def count(self, block: Block) -> int | None:
        """The number of lines of a block whose lines all have known skeletons, or None where some have not."""
        if self._resting:
            self._resting -= 1
            return None
        lines = block.text.translate(None, _OF_NUMBERS).split(b"\n")
        if not lines[-1]:
            lines.pop()
        new = set(lines) - self._known
        if len(new) * _FEW > len(lines) + _FEW:
            self._resting = _REST
            return None
        if new and not self._learn(lines, block, new):
            return None
        return len(lines)

    def _learn(self, lines: list[bytes], block: Block, new: set[bytes]) -> bool:
        if len(self._known) + len(new) > MEMORY:
            self._known.clear()
            new = set(lines)
        for skeleton in new:
            if b"\\u" in skeleton or any(skeleton.count(key) > 1 for key in self._keys):
                return False
            if not self._sound(block.lines[lines.index(skeleton)]):
                return False
            self._known.add(skeleton)
        return True


Values: TypeAlias = tuple[Hashable, ...]
Wants: TypeAlias = Callable[[Values], int]
BATCHES_MEMORY: Final = 10_000
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
            if len(self._known) >= BATCHES_MEMORY:
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
