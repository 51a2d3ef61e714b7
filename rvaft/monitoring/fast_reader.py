"""Logs read many lines at a time: what a tree reads of them is decoded by msgspec, and what msgspec does not check is looked for in the bytes."""

import re
from collections import Counter
from collections.abc import Callable, Hashable, Iterable, Iterator, Sequence
from contextlib import suppress
from functools import cached_property
from io import DEFAULT_BUFFER_SIZE, BufferedIOBase
from operator import attrgetter, methodcaller
from pathlib import Path
from typing import Any, Final, NamedTuple, Self, TypedDict

import msgspec

from rvaft.analysis.pattern_index import Reads, TreeReads, brief
from rvaft.errors import TraceError
from rvaft.model.patterns import ObjectPattern
from rvaft.model.values import Json, Scalar
from rvaft.monitoring.reader import BOM, MAX_DEPTH, MAX_DIGITS, MAX_LINE, decode, event_on, failures_of, unreadable
from rvaft.monitoring.stream import Batch
from rvaft.support.files import SUFFIXES

SIZE: Final = 3 << 15
"""Bytes that are read at once: small enough for the caches of the machine."""
SHORT: Final = 2 * MAX_DEPTH
"""A line no longer than this has neither too many levels nor too many digits."""
MEMORY: Final = 10_000
"""How many values of the discriminating fields, and how many skeletons of lines, are remembered; then the memory starts afresh."""

_DIGITS: Final = re.compile(rb"[0-9]{%d}" % (MAX_DIGITS + 1))
_ASCII: Final = tuple(bytes([digit]) for digit in b"234567")
"""The third digit of the numbers of ASCII's letters and signs."""
_REFUSED: Final = (msgspec.DecodeError, UnicodeDecodeError, RecursionError)
"""What a decoder raises for a line that is not for it, malformed or not."""
_DOUBT: Final = ("doubt",)
"""In place of the values on a line that `rvaft.monitoring.reader` has to read."""


class LogBlock:
    """Whole lines, as one piece of bytes; `first` is the number of the first."""

    def __init__(self, text: bytes, first: int = 1) -> None:
        self.text = text
        self.first = first

    @cached_property
    def lines(self) -> list[bytes]:
        """The lines without their ends."""
        lines = self.text.split(b"\n")
        if not lines[-1]:
            lines.pop()
        return lines

    def is_within(self, length: int) -> bool:
        """Whether certainly no line is longer than that."""
        text, half = self.text, length // 2
        return all(text.find(b"\n", start, start + half) >= 0 for start in range(0, len(text) - half, half))


def blocks(stream: BufferedIOBase, file: str) -> Iterator[LogBlock]:
    """The lines of a stream in turn; one longer than `MAX_LINE` is the last.

    Raises `TraceError` where the file cannot be read, after the lines that end before.
    """
    failures = failures_of(file)
    # Damaged data is lost from the call on that meets it, so there no more is asked for at once than when it is read by lines.
    at_once = min(SIZE, DEFAULT_BUFFER_SIZE) if Path(file).suffix.lower() in SUFFIXES else SIZE
    held, line, mark = b"", 1, BOM
    failure: Exception | None = None
    more = True
    while more:
        pieces, size, ended = [held], len(held), False
        while more and (size < SIZE or (not ended and size <= len(BOM) + MAX_LINE)):
            try:
                data = stream.read1(at_once)
            except failures as error:
                failure, data = error, b""
            more = bool(data)
            pieces.append(data)
            size += len(data)
            ended = ended or b"\n" in data
        more = more and ended
        text = b"".join(pieces)
        end = len(text) if not more and failure is None else text.rfind(b"\n") + 1
        given = text[:end].removeprefix(mark)
        if given:
            yield LogBlock(given, line)
        held, mark = text[end:], b""
        line += given.count(b"\n")
    if failure is not None:
        raise unreadable(failure, file, line) from failure


# -- what the decoder does not see --------------------------------------------------------------------------------------
#
# It checks all of JSON's grammar but passes over strings and numbers that nobody reads: what is no UTF-8, what is nested too deeply, numbers
# that are too long, keys that are written with escapes, or repeated.


def doubtful(block: LogBlock) -> set[int]:
    """The places of lines with something about them that the decoder does not see."""
    found: set[int] = set()
    if not _is_utf8(block.text):
        found.update(place for place, line in enumerate(block.lines) if not _is_utf8(line))
    if _has_escapes(block.text):
        found.update(place for place, line in enumerate(block.lines) if _has_escapes(line))
    if max(map(len, block.lines)) > SHORT:
        found.update(place for place, line in enumerate(block.lines) if len(line) > SHORT and _is_endless(line))
    return found


def _is_utf8(text: bytes) -> bool:
    if not text.isascii():
        try:
            text.decode()
        except UnicodeDecodeError:
            return False
    return True


def _has_escapes(text: bytes) -> bool:
    """Whether some ASCII letter or sign is written by its number, as those of a key could be."""
    place = text.find(b"\\")
    while place >= 0:
        if text.startswith(b"u00", place + 1) and text[place + 4 : place + 5] in _ASCII:
            return True
        place = text.find(b"\\", place + 2)
    return False


def _is_endless(line: bytes) -> bool:
    return (
        line.count(b"{") + line.count(b"[") > MAX_DEPTH
        or len(line) > MAX_LINE
        or (len(line) > MAX_DIGITS and bool(_DIGITS.search(line)))
    )


class Skeletons:
    """The skeletons of lines that are one object each and repeat none of these quoted keys.

    The *skeleton* of a line is what remains without the characters that numbers are written with. Two lines of the same skeleton have the same
    strings, but for these characters, and the same brackets: such a character never stands behind the backslash of an escape, so what is
    inside a string in one line is so in the other. Hence, where one line is an object in which no key is repeated, and the others are
    JSON, they are objects in which no key is repeated. And where every line of a block holds an object, and the block holds as many
    values as it has lines, every line holds one value.
    """

    _OF_NUMBERS: Final = b"0123456789.+-eE"
    FEW: Final = 16
    """One line in so many may have a skeleton that is new: such lines take long."""
    REST: Final = 64
    """After a block with more new ones, so many are not looked at."""

    def __init__(self, keys: Iterable[bytes]) -> None:
        self._keys = tuple(key.translate(None, self._OF_NUMBERS) for key in keys)
        self._known: set[bytes] = set()
        self._resting = 0

    def count(self, block: LogBlock) -> int | None:
        """The number of lines of a block whose lines all have known skeletons, or None where some have not."""
        if self._resting:
            self._resting -= 1
            return None
        lines = LogBlock(block.text.translate(None, self._OF_NUMBERS)).lines
        new = set(lines) - self._known
        if len(new) * self.FEW > len(lines) + self.FEW:
            self._resting = self.REST
            return None
        if new and len(self._known) + len(new) > MEMORY:
            self._known.clear()
            new = set(lines)
        for skeleton in new:
            if b"\\u" in skeleton or any(skeleton.count(key) > 1 for key in self._keys):
                return None
            try:
                decode(block.lines[lines.index(skeleton)], reads=Reads())
            except ValueError:
                return None
            self._known.add(skeleton)
        return len(lines)


# -- the reader ---------------------------------------------------------------------------------------------------------


class DiscriminatorMeaning(NamedTuple):
    """What values of the discriminating fields mean: whether events with them are looked at, and the quoted keys not to be repeated."""

    live: bool
    keys: tuple[bytes, ...]


class FastReader:
    """Reads logs for one tree; `possible` says whether events with given values in the discriminating fields are of interest.

    Of events it decodes only these fields. The values of one discriminating field stand as they are, those of several as a tuple.
    """

    def __init__(self, reads: TreeReads, fields: Sequence[str], possible: Callable[[Iterable[Hashable]], bool]) -> None:
        self._reads = reads
        self._discriminators = reads.discriminators
        self._possible = possible
        event: Any = TypedDict("event", dict.fromkeys(fields, Scalar), total=False)  # type: ignore[misc] # the names come with the tree
        self._event = msgspec.json.Decoder(event)
        names = {f"f{number}": field for number, field in enumerate(self._discriminators.fields)}
        # Not to be looked at by the garbage collector: heads live for one block, and hold nothing that could refer to them.
        head = msgspec.defstruct(
            "Head",
            [(name, Scalar | msgspec.UnsetType, msgspec.UNSET) for name in names],
            rename=names.__getitem__,
            gc=False,
            module=__name__,
        )
        self._head = msgspec.json.Decoder(head)
        self._known: dict[Hashable, DiscriminatorMeaning] = {}
        self._skeletons = Skeletons(map(_quoted, fields))
        self._dense = False
        """Whether most lines of late were of interest: then all are decoded as events at once."""

    @classmethod
    def of(
        cls, reads: TreeReads, also: Iterable[str] = (), possible: Callable[[Iterable[Hashable]], bool] | None = None
    ) -> Self | None:
        """A reader of the logs of a tree, or None for a tree that is left to `rvaft.monitoring.reader`; `also` are fields to keep.

        Such a tree tells no events apart by strings, wants more than fields, or fields whose names a line could write in more ways
        than one, escapes of ASCII by their number aside.
        """
        if not reads.discriminators.fields or not all(isinstance(one, ObjectPattern) for one in reads.patterns):
            return None
        named = [name for one in reads.patterns if isinstance(one, ObjectPattern) for name, _ in one.fields]
        fields = tuple(dict.fromkeys((*named, *also)))
        if not all(name.isascii() and name.isprintable() and not set(name) & set('"\\/') for name in fields):
            return None
        asked = reads.discriminators

        def fits(values: Iterable[Hashable]) -> bool:
            return bool(asked.candidates(asked.values(dict(zip(asked.fields, values, strict=True)))))

        return cls(reads, fields, possible or fits)

    def read(self, stream: BufferedIOBase, file: str) -> Iterator[Batch]:
        """All events of a stream in batches; raises `TraceError` after the batch that has it."""
        for block in blocks(stream, file):
            batch = self._batch(block, file)
            yield batch
            if batch.error is not None:
                raise batch.error

    def _batch(self, block: LogBlock, file: str) -> Batch:
        whole = self._dense
        heads = self._sound(block) if whole and _is_utf8(block.text) and block.is_within(SHORT) else None
        sound = heads is not None
        if heads is None:
            heads, found, counts = self._checked(block, whole=whole)
        else:
            found = self._values(heads, whole=True)
            counts = Counter(found)
        known = {values: self._meaning(values) for values in counts if values is not _DOUBT}
        dead = {values for values, meaning in known.items() if not meaning.live}
        places = [place for place, values in enumerate(found) if values not in dead] if dead else range(len(found))
        self._dense = 2 * len(places) > len(found)
        if sound:
            return Batch(len(found), [(place, heads[place]) for place in places] if dead else list(enumerate(heads)))
        events: list[tuple[int, dict[str, Json]]] = []
        blank = 0
        for place in places:
            line, values = block.lines[place], found[place]
            event: dict[str, Json] | None = None
            if values is not _DOUBT and not _repeats(line, known[values].keys):
                event = heads[place] if whole else _decoded(self._event, line)
            if event is None:
                try:
                    event = event_on(line, file, block.first + place, self._reads)
                except TraceError as error:
                    return Batch(place - blank, events, error)
            if event is None:
                blank += 1
            else:
                events.append((place - blank, event))
        return Batch(len(found) - blank, events)

    def _sound(self, block: LogBlock) -> list[Any] | None:
        """The events of a block in which nothing can be wrong that the decoder does not see, or None."""
        count = self._skeletons.count(block)
        if count is not None:
            with suppress(*_REFUSED):
                heads: list[Any] = self._event.decode_lines(block.text)
                if len(heads) == count:
                    return heads
        return None

    def _checked(self, block: LogBlock, *, whole: bool) -> tuple[list[Any], list[Hashable], Counter[Hashable]]:
        """For each line what the decoder makes of it and its values in the discriminating fields, `_DOUBT` where it cannot be trusted."""
        decoder = self._event if whole else self._head
        try:
            heads = list(map(decoder.decode, block.lines))
            doubts = doubtful(block)
        except _REFUSED:
            heads = [_decoded(decoder, line) for line in block.lines]
            doubts = doubtful(block) | {place for place, head in enumerate(heads) if head is None}
        found = self._values(heads, whole=whole)
        counts = Counter(found)
        fields = self._discriminators.fields
        for number, field in enumerate(fields):
            # Where no line writes a field otherwise than it is, to count them in the block will do.
            key, absent = _quoted(field), msgspec.UNSET
            lacking = counts.get(absent, 0) if len(fields) == 1 else sum(one[number] is absent for one in found)  # type: ignore[index]
            if doubts or block.text.count(key) != len(found) - lacking:
                doubts.update(place for place, line in enumerate(block.lines) if line.count(key) > 1)
        for place in doubts:
            found[place] = _DOUBT
        return heads, found, Counter(found) if doubts else counts

    def _values(self, heads: Sequence[Any], *, whole: bool) -> list[Hashable]:
        columns: list[list[Hashable]] = []
        for number, field in enumerate(self._discriminators.fields):
            value: Callable[[Any], Hashable]
            value = methodcaller("get", field, msgspec.UNSET) if whole else attrgetter(f"f{number}")
            try:
                columns.append(list(map(value, heads)))
            except AttributeError:
                columns.append([msgspec.UNSET if head is None else value(head) for head in heads])
        return columns[0] if len(columns) == 1 else list(zip(*columns, strict=True))

    def _meaning(self, values: Hashable) -> DiscriminatorMeaning:
        known = self._known.get(values)
        if known is None:
            fields = self._discriminators.fields
            every: Any = values if len(fields) > 1 else (values,)
            asked = self._discriminators.values(dict(zip(fields, every, strict=True)))
            keys = tuple(_quoted(field) for field in self._reads.where(asked).fields if field not in fields)
            known = DiscriminatorMeaning(self._possible(every), keys)
            if len(self._known) >= MEMORY:
                self._known.clear()
            if brief(every):
                self._known[values] = known
        return known


def _quoted(field: str) -> bytes:
    """A field as it stands in a line."""
    return f'"{field}"'.encode()


def _repeats(line: bytes, keys: tuple[bytes, ...]) -> bool:
    """Whether one of these quoted keys stands in a line more than once."""
    for key in keys:  # noqa: SIM110 (asked of every event)
        if line.count(key) > 1:
            return True
    return False


def _decoded(decoder: "msgspec.json.Decoder[Any]", line: bytes) -> Any:
    try:
        return decoder.decode(line)
    except _REFUSED:
        return None
