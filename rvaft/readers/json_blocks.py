"""Logs read many lines at a time: what a tree reads of them is decoded by msgspec, and what msgspec
does not check is looked for in the bytes.
"""

import re
from bisect import bisect_left
from collections import Counter
from collections.abc import Callable, Hashable, Iterable, Iterator, Sequence
from contextlib import suppress
from io import DEFAULT_BUFFER_SIZE, BufferedIOBase
from operator import attrgetter, methodcaller
from pathlib import Path
from typing import Any, Final, NamedTuple, TypeAlias, TypedDict

import msgspec

from rvaft.core.classifier import Reads, TreeReads, brief
from rvaft.errors import TraceError
from rvaft.model.event_time import UNITS
from rvaft.model.patterns import ObjectPattern
from rvaft.model.tree import RVAFT
from rvaft.model.values import Json, JsonObject, Scalar, decimal
from rvaft.readers.json_lines import MAX_DEPTH, decode, event_on
from rvaft.readers.log import BOM, MAX_DIGITS, MAX_LINE, failures_of, unreadable
from rvaft.support.files import SUFFIXES

SIZE: Final = 3 << 15
"""Bytes that are read at once: small enough for the caches of the machine."""
MEMORY: Final = 10_000
"""How many values of the discriminating fields, and how many skeletons of lines, are remembered;
then the memory starts afresh.
"""
FEW: Final = 16
"""One line in so many may have a skeleton that is new: such lines take long."""
_REST: Final = 64
"""After a block with more new ones, so many are not looked at."""
_SHORT: Final = 2 * MAX_DEPTH
"""A line no longer than this has neither too many levels nor too many digits."""
_DIGITS: Final = re.compile(rb"[0-9]{%d}" % (MAX_DIGITS + 1))
_OF_NUMBERS: Final = b"0123456789.+-eE"
_STRETCH: Final = 29_000
"""Bytes in which a key is counted at once."""
_REFUSED: Final = (msgspec.DecodeError, UnicodeDecodeError, RecursionError)
"""What a decoder raises for a line that is not for it, malformed or not."""
_Line: TypeAlias = Any
"""What a decoder makes of a line: an object of a class that is made for the fields of one tree."""
_Value: TypeAlias = Scalar | msgspec.UnsetType
"""What an event has in a field, `msgspec.UNSET` where it lacks it."""
_Values: TypeAlias = _Value | tuple[_Value, ...]
"""What an event has in one field, or in several."""
_DOUBT: Final = ("doubt",)
"""In place of the values on a line that `rvaft.readers.json_lines` has to read."""


class EventBlock(NamedTuple):
    """Events that follow each other: how many, and those of them that may concern the tree, each
    with its place among all, from 0.

    Where a reader keeps fields of all events, `passed` are the places of the others, and `kept`
    what these have in the fields, for each a value, or a tuple of several, `msgspec.UNSET` where
    there is none.
    """

    total: int
    events: Sequence[tuple[int, JsonObject]]
    passed: Sequence[int] = ()
    kept: Sequence[Json] = ()


def _blocks(
    stream: BufferedIOBase, file: str, line: int, *, live: bool
) -> Iterator[tuple[int, bytes, list[bytes], int]]:
    """Whole lines of a stream in turn, each block with the number of its first line, and its bytes;
    one longer than `MAX_LINE` is the last.

    A byte order mark counts among the bytes and is not given. What is `live` is given as it comes,
    not only when a block is full. Raises `TraceError` where the file cannot be read, after the
    lines that end before.
    """
    failures = failures_of(file)
    # Damaged data is lost from the call on that meets it, so there no more is asked for at once
    # than when it is read by lines.
    at_once = min(SIZE, DEFAULT_BUFFER_SIZE) if Path(file).suffix.lower() in SUFFIXES else SIZE
    held, mark = b"", BOM if line == 1 else b""
    failure: Exception | None = None
    more = True
    while more:
        pieces, size, ended = [held], len(held), False
        while more and not (live and ended) and (size < SIZE or (not ended and size <= len(BOM) + MAX_LINE)):
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
            lines = given.split(b"\n")
            if not lines[-1]:
                lines.pop()
            yield line, given, lines, end
            line += len(lines)  # only the last block may end within a line
        held, mark = text[end:], b""
    if failure is not None:
        raise unreadable(failure, file, line) from failure


def plain_fields(reads: TreeReads, also: Iterable[str] = ()) -> Sequence[str]:
    """The fields that a `JsonBlockReader` decodes, those to keep `also`; none for a tree whose logs
    are left to `rvaft.readers.json_lines`.

    Such a tree tells no events apart by strings, wants more than fields, or fields whose names a
    line could write in more ways than one, escapes of ASCII by their number aside.
    """
    patterns = [one for one in reads.patterns if isinstance(one, ObjectPattern)]
    fields = tuple(dict.fromkeys((*(name for one in patterns for name, _ in one.fields), *also)))
    plain = all(name.isascii() and name.isprintable() and not set(name) & set('"\\/') for name in fields)
    return fields if plain and reads.discriminators.fields and len(patterns) == len(reads.patterns) else ()


def exact_time(tree: RVAFT) -> str | None:
    """The field in which a tree has its time, where numbers there count with all their digits."""
    time = tree.time
    return time.field[0] if time is not None and time.format.value in UNITS and len(time.field) == 1 else None


class JsonBlockReader:
    """Reads logs for one tree; `possible` says whether events with given values in the
    discriminating fields are of interest.

    Of events it decodes only these `fields`, in that of the `time` numbers as exactly as they are
    written. The values of one discriminating field stand as they are, those of several as a tuple.
    Those that are `kept`, all of them among the `fields`, are told of every event.
    """

    def __init__(
        self,
        reads: TreeReads,
        possible: Callable[[Iterable[Hashable]], bool],
        fields: Sequence[str],
        *,
        time: str | None,
        strict: bool,
        kept: Sequence[str] = (),
    ) -> None:
        self._reads = reads
        self._strict = strict
        self._possible = possible
        self._asked = reads.discriminators.fields
        assert time not in kept, "what is kept is no more exact than a double"
        self._kept = tuple(kept)
        # Python takes 1 and True for equal: what is kept and a boolean is left to the other reader.
        types = {field: Scalar if field not in kept else str | int | float | None for field in (*fields, *self._asked)}
        # A hook of msgspec is asked for what may be anything only.
        read = {field: Any if field == time else types[field] for field in fields}
        event = TypedDict("event", read, total=False)  # type: ignore[misc] # the names come with the tree
        self._event: msgspec.json.Decoder[_Line] = msgspec.json.Decoder(event, float_hook=_decimal)
        self._time = time
        told = tuple(dict.fromkeys((*self._asked, *kept)))
        names = {f"f{number}": field for number, field in enumerate(told)}
        # Not to be looked at by the garbage collector: heads live for one block, and hold nothing
        # that could refer to them.
        head = msgspec.defstruct(
            "Head",
            [(name, types[field] | msgspec.UnsetType, msgspec.UNSET) for name, field in names.items()],
            rename=names.__getitem__,
            gc=False,
            module=__name__,
        )
        self._head = msgspec.json.Decoder(head)
        self._short = short = {field: name for name, field in names.items()}
        self._of_event = _gets(self._asked)
        self._of_head = attrgetter(*map(short.__getitem__, self._asked))
        self._kept_of_event = _gets(self._kept) if kept else None
        self._kept_of_head = attrgetter(*map(short.__getitem__, self._kept)) if kept else None
        self._known: dict[Hashable, tuple[bool, tuple[bytes, ...]]] = {}
        self._keys = tuple(_quoted(field).translate(None, _OF_NUMBERS) for field in fields)
        self._skeletons: set[bytes] = set()
        self._resting = 0
        self._dense = False
        """Whether most lines of late were of interest: then all are decoded as events at once."""

    def read(
        self,
        stream: BufferedIOBase,
        file: str,
        *,
        line: int = 1,
        live: bool = False,
        reached: Callable[[int, int], None] = lambda _size, _lines: None,
    ) -> Iterator[EventBlock]:
        """All events of a stream in batches; raises `TraceError` after the events before it.

        `line` is the number of the first line; a stream that is `live` is read as it comes. With
        each batch `reached` is told of so many bytes and lines more.
        """
        for first, text, lines, size in _blocks(stream, file, line, live=live):
            dense = self._dense
            sound = self._sound(text, lines) if dense else None
            heads, found, told = (
                self._heads(text, lines) if sound is None else (sound, list(map(self._of_event, sound)), None)
            )
            different = set(found)
            known = {values: self._meaning(values) for values in different if values is not _DOUBT}
            dead = {values for values, (live, _) in known.items() if not live}
            places = [place for place, values in enumerate(found) if values not in dead] if dead else range(len(found))
            self._dense = 2 * len(places) > len(found)
            passed: Sequence[int] = ()
            kept: Sequence[_Values] = ()
            get: Callable[[_Line], _Values] | None = self._kept_of_event if dense else self._kept_of_head
            if told is not None and not places:
                passed, kept = range(len(found)), told
            elif get is not None and dead:
                passed = [place for place, values in enumerate(found) if values in dead]
                kept = [get(heads[place]) for place in passed] if told is None else [told[place] for place in passed]
            if sound is not None:
                reached(size, len(lines) - (not text.endswith(b"\n")))
                events = [(place, sound[place]) for place in places] if dead else list(enumerate(sound))
                yield EventBlock(len(found), events, passed, kept)
                continue
            events = []
            blank: list[int] = []
            for place in places:
                written, values = lines[place], found[place]
                event: dict[str, Json] | None = None
                if values is not _DOUBT:
                    for key in known[values][1]:
                        if written.count(key) > 1:
                            break
                    else:
                        event = heads[place] if dense else _decoded(self._event, written)
                        if event is not None and self._is_nested(event):
                            event = None
                if event is None:
                    try:
                        event = event_on(written, file, first + place, self._reads, strict=self._strict)
                    except TraceError:
                        before = bisect_left(passed, place)
                        reached(size - len(text) + sum(map(len, lines[:place])) + place, place)
                        yield EventBlock(place - len(blank), events, _without(blank, passed[:before]), kept[:before])
                        raise
                if event is None:
                    blank.append(place)
                else:
                    events.append((place - len(blank), event))
            reached(size, len(lines) - (not text.endswith(b"\n")))
            yield EventBlock(len(found) - len(blank), events, _without(blank, passed), kept)

    def _sound(self, text: bytes, lines: list[bytes]) -> list[_Line] | None:
        """The events of a block in which nothing can be wrong that the decoder does not see, or None where some may.

        The *skeleton* of a line is what remains without the characters that numbers are written
        with. Two lines of the same skeleton have the same strings, but for these characters, and
        the same brackets: such a character never stands behind the backslash of an escape, so what
        is inside a string in one line is so in the other. Hence, where one line is an object in
        which no key is repeated, and the others are JSON, they are objects in which no key is
        repeated. And where every line of a block holds an object, and the block holds as many
        values as it has lines, every line holds one value.
        """
        self._resting -= 1
        if self._resting > 0 or max(map(len, lines)) > _SHORT or _is_odd(text):
            return None
        skeletons = text.removesuffix(b"\n").translate(None, _OF_NUMBERS).split(b"\n")
        new = set(skeletons) - self._skeletons
        if len(new) * FEW > len(lines) + FEW:
            self._resting = _REST
            return None
        if new and len(self._skeletons) + len(new) > MEMORY:
            self._skeletons.clear()
            new = set(skeletons)
        for skeleton in new:
            if b"\\u" in skeleton or any(skeleton.count(key) > 1 for key in self._keys):
                return None
            try:
                decode(lines[skeletons.index(skeleton)], reads=Reads())
            except ValueError:
                return None
            self._skeletons.add(skeleton)
        with suppress(*_REFUSED):
            heads: list[_Line] = self._event.decode_lines(text)
            if len(heads) == len(lines) and (self._time is None or not any(map(self._is_nested, heads))):
                return heads
        return None

    def _is_nested(self, event: dict[str, Json]) -> bool:
        """Whether there is more than one value where the time is."""
        return self._time is not None and type(event.get(self._time)) in (dict, list)

    def _heads(self, text: bytes, lines: list[bytes]) -> tuple[list[_Line], list[Hashable], Sequence[_Values] | None]:
        """For each line what the decoder makes of it and its values in the discriminating fields,
        `_DOUBT` where it cannot be trusted.

        Third what is kept of each, if that is known for all.
        """
        decoder = self._event if self._dense else self._head
        get: Callable[[_Line], Hashable] = self._of_event if self._dense else self._of_head
        doubts = _doubtful(text, lines)
        try:
            heads = list(map(decoder.decode, lines))
            found: list[Hashable] = list(map(get, heads))
        except _REFUSED:
            heads = [_decoded(decoder, line) for line in lines]
            found = [_DOUBT if head is None else get(head) for head in heads]
            doubts.update(place for place, values in enumerate(found) if values is _DOUBT)
        columns = {} if doubts else {field: list(map(self._lookup(field), heads)) for field in self._kept}
        counts = Counter(found)
        for number, field in enumerate(dict.fromkeys((*self._asked, *self._kept))):
            # Where no line writes a field otherwise than it is, to count them in the block will do.
            key, there = _quoted(field), -1
            if doubts:
                pass
            elif number < len(self._asked):
                asked = ((self._every(values)[number], count) for values, count in counts.items())
                there = sum(count for value, count in asked if value is not msgspec.UNSET)
            else:
                types = set(map(type, columns[field]))
                there = len(heads) - (columns[field].count(msgspec.UNSET) if msgspec.UnsetType in types else 0)
            if doubts or _count(text, key) != there:
                doubts.update(place for place, line in enumerate(lines) if line.count(key) > 1)
        for place in doubts:
            found[place] = _DOUBT
        every = [columns[field] for field in self._kept] if columns else []
        told: Sequence[_Values] | None = every[0] if len(every) == 1 else list(zip(*every, strict=True))
        return heads, found, told if every else None

    def _lookup(self, field: str) -> Callable[[_Line], _Value]:
        """Gives the value in a field of what the present decoder makes of a line."""
        return methodcaller("get", field, msgspec.UNSET) if self._dense else attrgetter(self._short[field])

    def _every(self, values: Hashable) -> tuple[Json, ...]:
        return values if isinstance(values, tuple) else (values,)

    def _meaning(self, values: Hashable) -> tuple[bool, tuple[bytes, ...]]:
        """Whether events with these values are looked at, and the quoted keys that they are not to repeat."""
        known = self._known.get(values)
        if known is None:
            every = self._every(values)
            asked = self._reads.discriminators.values(dict(zip(self._asked, every, strict=True)))
            keys = tuple(_quoted(field) for field in self._reads.where(asked).fields if field not in self._short)
            known = self._possible(every), keys
            if len(self._known) >= MEMORY:
                self._known.clear()
            if brief(every):
                self._known[values] = known
        return known


def _gets(fields: Sequence[str]) -> Callable[[dict[str, Json]], _Values]:
    """Gives what an event has in a field, of several a tuple."""
    gets = [methodcaller("get", field, msgspec.UNSET) for field in fields]
    return gets[0] if len(gets) == 1 else lambda event: tuple([get(event) for get in gets])


def _without(blank: Sequence[int], places: Sequence[int]) -> Sequence[int]:
    """Places among the lines that are not blank."""
    return [place - bisect_left(blank, place) for place in places] if blank else places


def _doubtful(text: bytes, lines: list[bytes]) -> set[int]:
    """The places of lines with something about them that the decoder does not see.

    It checks all of JSON's grammar but passes over strings and numbers that nobody reads: what is
    no UTF-8, what is nested too deeply, numbers that are too long, keys that are written with
    escapes.
    """
    found: set[int] = set()
    if _is_odd(text):
        found.update(place for place, line in enumerate(lines) if _is_odd(line))
    if max(map(len, lines)) > _SHORT:
        for place, line in enumerate(lines):
            deep = len(line) > _SHORT and line.count(b"{") + line.count(b"[") > MAX_DEPTH
            if deep or len(line) > MAX_LINE or (len(line) > MAX_DIGITS and _DIGITS.search(line)):
                found.add(place)
    return found


def _is_odd(text: bytes) -> bool:
    """Whether it is no UTF-8, or has an ASCII letter that is written by its number, as one of a key could be."""
    place = text.find(b"\\")
    while place >= 0:
        if text.startswith(b"u00", place + 1) and text[place + 4 : place + 5] in (b"2", b"3", b"4", b"5", b"6", b"7"):
            return True
        place = text.find(b"\\", place + 2)
    if not text.isascii():
        try:
            text.decode()
        except UnicodeDecodeError:
            return True
    return False


def _decimal(written: str) -> float:
    number = decimal(written)
    if number - number != 0:
        raise msgspec.DecodeError("beyond a double")
    return number


def _count(text: bytes, key: bytes) -> int:
    """How often a short key occurs: stretch by stretch, since of long texts Python looks at each byte."""
    more = len(key) - 1
    return sum([text.count(key, start, start + _STRETCH + more) for start in range(0, len(text), _STRETCH)])


def _quoted(field: str) -> bytes:
    """A field as it stands in a line."""
    return f'"{field}"'.encode()


def _decoded(decoder: msgspec.json.Decoder[_Line], line: bytes) -> _Line:
    try:
        return decoder.decode(line)
    except _REFUSED:
        return None
