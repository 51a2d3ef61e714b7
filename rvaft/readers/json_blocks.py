"""JSON Lines decoded in blocks: msgspec decodes the fields that the tree reads, and byte searches
find the errors that msgspec ignores.
"""

import re
from bisect import bisect_left
from collections import Counter
from collections.abc import Callable, Hashable, Iterable, Iterator, Sequence
from contextlib import suppress
from functools import cache
from io import DEFAULT_BUFFER_SIZE, BufferedIOBase
from operator import attrgetter, methodcaller
from pathlib import Path
from typing import Any, Final, TypeAlias, TypedDict, cast

import msgspec

from rvaft.core.fields_to_read import Reads, TreeReads
from rvaft.core.pattern_index import brief
from rvaft.errors import TraceError
from rvaft.model.event_time import NUMERIC
from rvaft.model.patterns import ObjectPattern
from rvaft.model.values import LONG, Json, JsonObject, Scalar, finite_decimal
from rvaft.readers.json_lines import MAX_DEPTH, decode, event_on
from rvaft.readers.log import BOM, MAX_DIGITS, MAX_LINE, Batch, BatchTimes, failures_of, unreadable
from rvaft.support.files import SUFFIXES

SIZE: Final = 3 << 15
MEMORY: Final = 10_000
"""Maximum number of cached values, and of line skeletons."""
FEW: Final = 16
"""New skeletons are slow: a block may have one per so many lines."""
_REST: Final = 64
"""Blocks skipped after too many new skeletons."""
_SHORT: Final = 2 * MAX_DEPTH
"""Shorter lines have neither too many levels nor too many digits."""
_DIGITS: Final = re.compile(rb"[0-9]{%d}" % (MAX_DIGITS + 1))
_OF_NUMBERS: Final = b"0123456789.+-eE"
_NUMBERS: Final = bytes(ord("0") if byte in _OF_NUMBERS else ord(" ") for byte in range(256))
_LONG_NUMBER: Final = b"0" * LONG
"""In a text after `_NUMBERS`, what may be a number that a double rounds."""
_NESTED: Final = frozenset({dict, list})
_STRETCH: Final = 29_000
"""Bytes per call when keys are counted."""
_REFUSED: Final = (msgspec.DecodeError, UnicodeDecodeError, RecursionError)
"""Exceptions for a line of an unexpected form."""
_Line: TypeAlias = Any
_Value: TypeAlias = Scalar | msgspec.UnsetType
"""`msgspec.UNSET` if missing."""
_Values: TypeAlias = _Value | tuple[_Value, ...]
_DOUBT: Final = ("doubt",)
"""Marks a line for `rvaft.readers.json_lines`."""


def _blocks(
    stream: BufferedIOBase, file: str, line: int, *, live: bool
) -> Iterator[tuple[int, bytes, list[bytes], int]]:
    """Yield blocks of whole lines: number of the first line, text, lines, and bytes consumed.

    A line longer than `MAX_LINE` ends the input. A `live` stream is passed on as it arrives. Raises
    `TraceError` for a read error, after the lines before it.
    """
    failures = failures_of(file)
    # a failing call loses its data: read compressed files in small pieces
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
            line += len(lines)  # not the number of line ends in the last block
        held, mark = text[end:], b""
    if failure is not None:
        raise unreadable(failure, file, line) from failure


def plain_fields(reads: TreeReads, also: Iterable[str] = ()) -> Sequence[str]:
    """Return the fields that a `JsonBlockReader` decodes, or () if it cannot read logs for the
    tree.

    It needs discriminating strings, patterns that are objects, and field names that JSON spells in
    one way (except for numeric escapes).
    """
    patterns = [one for one in reads.patterns if isinstance(one, ObjectPattern)]
    fields = tuple(dict.fromkeys((*(name for one in patterns for name, _ in one.fields), *also)))
    plain = all(name.isascii() and name.isprintable() and not set(name) & set('"\\/') for name in fields)
    return fields if plain and reads.discriminators.fields and len(patterns) == len(reads.patterns) else ()


def exact_times(reads: TreeReads) -> frozenset[str]:
    """Return the time fields whose times are exact numbers."""
    return frozenset(time.field[0] for time in reads.times if time.format in NUMERIC and len(time.field) == 1)


class JsonBlockReader:
    """Reads logs for some trees; `possible` tests discriminating values for relevance.

    Only `fields` are decoded, or `whole` possible events; numbers in the fields `exact` keep all digits.
    Several discriminating values are a tuple. The `kept` fields are returned for every event, or instead
    the times in the field `timed`.
    """

    def __init__(
        self,
        reads: TreeReads,
        possible: Callable[[Iterable[Hashable]], bool],
        fields: Sequence[str],
        *,
        exact: frozenset[str] = frozenset(),
        strict: bool,
        kept: Sequence[str] = (),
        whole: bool = False,
        timed: str = "",
    ) -> None:
        self._reads = reads
        self._strict = strict
        self._whole = whole
        self._possible = possible
        self._discriminating = reads.discriminators.fields
        assert exact.isdisjoint(kept), "what is kept is no more exact than a double"
        assert not (kept and timed), "values of one or the other are returned"
        self._timed = timed
        kept = [timed] if timed else kept
        self._kept = tuple(kept)
        # Booleans go to the other reader, since 1 equals True in Python
        types = {
            field: Scalar if field not in kept else str | int | float | None
            for field in (*fields, *self._discriminating)
        }
        # msgspec calls a float hook only for values of type Any
        read = {field: Any if field in exact else types[field] for field in fields}
        event = TypedDict("event", read, total=False)  # type: ignore[misc] # the names come with the tree
        self._event: msgspec.json.Decoder[_Line] = msgspec.json.Decoder(event, float_hook=finite_decimal)
        self._rounded_event: msgspec.json.Decoder[_Line] = msgspec.json.Decoder(event)
        time = TypedDict("time", {timed: Any}, total=False)  # type: ignore[misc]
        self._time: msgspec.json.Decoder[_Line] = msgspec.json.Decoder(time, float_hook=finite_decimal)
        self._exact = exact
        head_fields = tuple(dict.fromkeys((*self._discriminating, *kept)))
        names = {f"f{number}": field for number, field in enumerate(head_fields)}
        # without garbage collection: heads live briefly and hold no references
        head = msgspec.defstruct(
            "Head",
            [(name, types[field] | msgspec.UnsetType, msgspec.UNSET) for name, field in names.items()],
            rename=names.__getitem__,
            gc=False,
            module=__name__,
        )
        self._head = msgspec.json.Decoder(head)
        self._short = short = {field: name for name, field in names.items()}
        self._of_event = _gets(self._discriminating)
        self._of_head = attrgetter(*map(short.__getitem__, self._discriminating))
        self._kept_of_event = _gets(self._kept) if kept else None
        self._kept_of_head = attrgetter(*map(short.__getitem__, self._kept)) if kept else None
        self._known: dict[Hashable, tuple[bool, tuple[bytes, ...]]] = {}
        spelled = (re.escape(_name_bytes(field).translate(None, _OF_NUMBERS)) for field in fields)
        self._keys = tuple(re.compile(name + rb"[ \t\r]*:") for name in spelled)
        self._skeletons: set[bytes] = set()
        self._resting = 0
        self._dense = False
        """Whether most lines were relevant; then all are decoded as events."""

    def read(
        self,
        stream: BufferedIOBase,
        file: str,
        *,
        line: int = 1,
        live: bool = False,
        reached: Callable[[int, int], None] = lambda _size, _lines: None,
    ) -> Iterator[Batch]:
        """Yield all events of a stream in blocks; raises `TraceError` after the events before it.

        `line` is the number of the first line; a `live` stream is read as it arrives. `reached` is
        called with the bytes and lines of each block.
        """
        for first, text, lines, size in _blocks(stream, file, line, live=live):
            dense = self._dense
            sound = self._sound(text, lines) if dense else None
            heads, found, kept_values = (
                self._heads(text, lines) if sound is None else (sound, list(map(self._of_event, sound)), None)
            )
            different = dict.fromkeys(found)  # in order, since the first values are listed
            known = {values: self._meaning(values) for values in different if values is not _DOUBT}
            dead = {values for values, (live, _) in known.items() if not live}
            times: BatchTimes | None = None
            if self._timed and sound is None and kept_values is None:
                dead = set()  # a line in doubt may have a time
            places = [place for place, values in enumerate(found) if values not in dead] if dead else range(len(found))
            self._dense = 2 * len(places) > len(found) and not self._whole
            passed, kept = self._passed(heads, found, kept_values, dead, dense=dense)
            if self._timed and dead:
                values_ = kept_values if sound is None else [event.get(self._timed) for event in sound]
                times = self._times(values_ or (), lines, file, first)
            if sound is not None:
                reached(size, len(lines) - (not text.endswith(b"\n")))
                events = [(place, sound[place]) for place in places] if dead else list(enumerate(sound))
                yield Batch(len(found), events, passed, kept, range(first, first + len(found)), times)
                continue
            events = []
            blank: list[int] = []
            for place in places:
                written, values = lines[place], found[place]
                event: dict[str, Json] | None = None
                if values is not _DOUBT and not self._whole:
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
                        passed, kept = _without(blank, passed[:before]), kept[:before]
                        before_it = None if times is None else times._replace(values=times.values[:place])
                        yield Batch(place - len(blank), events, passed, kept, _lines(first, place, blank), before_it)
                        raise
                if event is None:
                    blank.append(place)
                else:
                    events.append((place - len(blank), event))
            reached(size, len(lines) - (not text.endswith(b"\n")))
            every = _lines(first, len(found), blank)
            yield Batch(len(found) - len(blank), events, _without(blank, passed), kept, every, times)

    def _passed(
        self,
        heads: Sequence[_Line],
        found: Sequence[Hashable],
        values: Sequence[_Values] | None,
        dead: set[Hashable],
        *,
        dense: bool,
    ) -> tuple[Sequence[int], Sequence[_Values]]:
        """Return the places of irrelevant events, with their values in the kept fields."""
        get: Callable[[_Line], _Values] | None = self._kept_of_event if dense else self._kept_of_head
        if get is None or self._timed or not dead:
            return (), ()
        if values is not None and dead.issuperset(found):
            return range(len(found)), values
        passed = [place for place, one in enumerate(found) if one in dead]
        return passed, [get(heads[place]) if values is None else values[place] for place in passed]

    def _times(self, values: Sequence[_Values], lines: Sequence[bytes], file: str, first: int) -> BatchTimes:
        """Return the times of a block of lines without doubts."""

        def exact(place: int) -> Json:
            found = _decoded(self._time, lines[place])
            return (event(place) if found is None else found).get(self._timed)

        @cache
        def event(place: int) -> JsonObject:
            found = event_on(lines[place], file, first + place, self._reads, strict=self._strict)
            assert found is not None, "a blank line is in doubt"
            return found

        if msgspec.UNSET in values:
            values = [None if value is msgspec.UNSET else value for value in values]
        return BatchTimes(cast("Sequence[Json]", values), exact, event, {})

    def _sound(self, text: bytes, lines: list[bytes]) -> list[_Line] | None:
        """Return the decoded events of a block, or None if there may be hidden errors.

        The *skeleton* of a line is the line without number characters. Two lines with the same
        skeleton have the same brackets and, up to number characters, the same strings: number
        characters never follow a backslash. If one is an object without repeated keys, so are all
        other JSON lines with the skeleton. If a block holds as many values as lines, and each line
        holds an object, then each line holds one value.
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
            if b"\\u" in skeleton or any(len(key.findall(skeleton)) > 1 for key in self._keys):
                return None
            try:
                decode(lines[skeletons.index(skeleton)], reads=Reads())
            except ValueError:
                return None
            self._skeletons.add(skeleton)
        with suppress(*_REFUSED):
            exact = self._exact and _LONG_NUMBER in text.translate(_NUMBERS)
            heads: list[_Line] = (self._event if exact else self._rounded_event).decode_lines(text)
            types = {type(head.get(field)) for field in self._exact for head in heads}
            if len(heads) == len(lines) and _NESTED.isdisjoint(types):
                return heads
        return None

    def _is_nested(self, event: dict[str, Json]) -> bool:
        return not _NESTED.isdisjoint([type(event.get(field)) for field in self._exact])

    def _heads(self, text: bytes, lines: list[bytes]) -> tuple[list[_Line], list[Hashable], Sequence[_Values] | None]:
        """Return the decoded lines, their discriminating values (or `_DOUBT`), and kept values."""
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
        for number, field in enumerate(dict.fromkeys((*self._discriminating, *self._kept))):
            # without escapes, counting keys in the whole block suffices
            key, there = _name_bytes(field), -1
            if doubts:
                pass
            elif number < len(self._discriminating):
                spelled = ((self._every(values)[number], count) for values, count in counts.items())
                there = sum(count for value, count in spelled if value is not msgspec.UNSET)
            else:
                types = set(map(type, columns[field]))
                there = len(heads) - (columns[field].count(msgspec.UNSET) if msgspec.UnsetType in types else 0)
            if doubts or _count(text, key) != there:
                doubts.update(place for place, line in enumerate(lines) if line.count(key) > 1)
        for place in doubts:
            found[place] = _DOUBT
        every = [columns[field] for field in self._kept] if columns else []
        kept_values: Sequence[_Values] | None = every[0] if len(every) == 1 else list(zip(*every, strict=True))
        return heads, found, kept_values if every else None

    def _lookup(self, field: str) -> Callable[[_Line], _Value]:
        return methodcaller("get", field, msgspec.UNSET) if self._dense else attrgetter(self._short[field])

    def _every(self, values: Hashable) -> tuple[Json, ...]:
        return values if isinstance(values, tuple) else (values,)

    def _meaning(self, values: Hashable) -> tuple[bool, tuple[bytes, ...]]:
        """Return whether such events are relevant, and the keys that must not repeat."""
        known = self._known.get(values)
        if known is None:
            every = self._every(values)
            texts = self._reads.discriminators.values(dict(zip(self._discriminating, every, strict=True)))
            keys = tuple(_name_bytes(field) for field in self._reads.where(texts).fields if field not in self._short)
            known = self._possible(every), keys
            if len(self._known) >= MEMORY:
                self._known.clear()
            if brief(every):
                self._known[values] = known
        return known


def _gets(fields: Sequence[str]) -> Callable[[dict[str, Json]], _Values]:
    gets = [methodcaller("get", field, msgspec.UNSET) for field in fields]
    return gets[0] if len(gets) == 1 else lambda event: tuple([get(event) for get in gets])


def _without(blank: Sequence[int], places: Sequence[int]) -> Sequence[int]:
    """Convert places of lines to places without blank lines."""
    return [place - bisect_left(blank, place) for place in places] if blank else places


def _lines(first: int, count: int, blank: Sequence[int]) -> Sequence[int]:
    every = range(first, first + count)
    return sorted({*every} - {first + place for place in blank}) if blank else every


def _doubtful(text: bytes, lines: list[bytes]) -> set[int]:
    """Return the lines with possible errors that the decoder misses: invalid UTF-8, excessive
    nesting or digits in skipped values, and escaped keys.
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
    """Whether the text is invalid UTF-8 or escapes an ASCII letter."""
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


def _count(text: bytes, key: bytes) -> int:
    """Count a key in pieces, since `count` is slow on long texts."""
    more = len(key) - 1
    return sum([text.count(key, start, start + _STRETCH + more) for start in range(0, len(text), _STRETCH)])


def _name_bytes(field: str) -> bytes:
    return f'"{field}"'.encode()


def _decoded(decoder: msgspec.json.Decoder[_Line], line: bytes) -> _Line:
    try:
        return decoder.decode(line)
    except _REFUSED:
        return None
