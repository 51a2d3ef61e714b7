"""A compiled monitor of one log, which reads its lines in blocks."""

import ctypes
import os
import secrets
from collections.abc import Callable, Iterator, Sequence
from contextlib import suppress
from functools import lru_cache
from io import RawIOBase
from mmap import mmap
from operator import itemgetter
from typing import Final, TypeAlias

from backends.c.cache import cached_library
from rvaft.errors import RvaftError, TooLarge, ToolFailed, TraceError

CAPACITY: Final = 1 << 20
"""The number of partial matches of all keys; memory that is not used is not touched."""
_PIECE: Final = 1 << 18
"""Bytes that are read at a time, which stay in the cache."""
_SLACK: Final = bytes(16)
"""The reader may read a few bytes behind a line."""
_TRUE: Final = 1
_FULL: Final = -1
_UNSUPPORTED: Final = -2
_REMEDY: Final = "omit --native"
_FIRST: Final = 21
"""The number of places of a group."""


EventPlace: TypeAlias = tuple[int, int, int]
"""An event of a log: its number, its line, and the offset of the line in bytes."""


class _EventPlace(ctypes.Structure):
    _fields_ = [("number", ctypes.c_uint64), ("line", ctypes.c_uint64), ("offset", ctypes.c_uint64)]


class _Head(ctypes.Structure):
    """The first fields of `rvaft_log`."""

    _fields_ = [
        ("verdict", ctypes.c_int32),
        ("taken", ctypes.c_uint32),
        ("number", ctypes.c_uint64),
        ("line", ctypes.c_uint64),
        ("offset", ctypes.c_uint64),
        ("reason", ctypes.c_char_p),
    ]


@lru_cache(maxsize=16)
def _functions(text: str, capacity: int, keys: int, warn: Callable[[str], object]) -> ctypes.CDLL:
    try:
        with cached_library(text, capacity, keys, warn) as file:
            found = ctypes.CDLL(os.fspath(file))
    except OSError as error:
        raise ToolFailed("the native monitor", reason=str(error)) from None
    found.rvaft_log_size.restype = found.rvaft_log_read.restype = ctypes.c_size_t
    found.rvaft_log_begin.argtypes = [ctypes.c_void_p, ctypes.c_uint64, ctypes.c_int]
    found.rvaft_log_begin.restype = None
    found.rvaft_log_read.argtypes = [ctypes.c_void_p, ctypes.c_void_p, ctypes.c_size_t]
    if hasattr(found, "rvaft_log_keys_full"):  # a text with a key
        found.rvaft_log_keep_keys.argtypes = [ctypes.c_void_p]
        found.rvaft_log_keep_keys.restype = None
        found.rvaft_log_keys_full.argtypes = [ctypes.c_void_p, ctypes.c_void_p]
    if hasattr(found, "rvaft_log_declined"):  # a text that counts events
        found.rvaft_log_declined.restype = ctypes.c_char_p
        found.rvaft_log_group.restype = found.rvaft_log_key.restype = ctypes.c_uint64
        for name in ("declined", "groups", "keys"):
            getattr(found, f"rvaft_log_{name}").argtypes = [ctypes.c_void_p]
        for name in ("group", "key"):
            getattr(found, f"rvaft_log_{name}").argtypes = [ctypes.c_void_p, ctypes.c_uint32, ctypes.c_void_p]
    return found


class NativeLog:
    """Monitors one log that comes in pieces.

    `failure` is why there is no verdict from event `failed` on; a `TraceError` names the line only.
    """

    def __init__(
        self,
        text: str,
        *,
        keys: int,
        repeat: bool,
        forgets: bool = True,
        warn: Callable[[str], object] = lambda _: None,
    ) -> None:
        self._functions = _functions(text, CAPACITY, keys, warn)
        self._keys, self._keyed = keys, hasattr(self._functions, "rvaft_log_keys_full")
        self._state = mmap(-1, self._functions.rvaft_log_size())  # zeros; what is not used takes no memory
        self._head = _Head.from_buffer(self._state)
        self._address = ctypes.addressof(self._head)
        self._functions.rvaft_log_begin(self._address, secrets.randbits(64), int(repeat))
        if self._keyed and not forgets:
            self._functions.rvaft_log_keep_keys(self._address)
        self._rest = b""
        self.failed = 0
        self.failure: RvaftError | None = None

    def read(self, data: bytes, *, ended: bool = False) -> Iterator[Sequence[EventPlace]]:
        """Read a piece of the log, and yield the events of each detection, the last one first detected.

        A line that a piece does not end is read with the next one, or where the log has `ended`.
        """
        if not ended:
            at = data.rfind(b"\n") + 1
            data, self._rest = self._rest + data[:at] if at else b"", data[at:] if at else self._rest + data
        else:
            data, self._rest = self._rest + data, b""
        size, data = len(data), data + _SLACK
        yield from self._lines(ctypes.cast(ctypes.c_char_p(data), ctypes.c_void_p).value or 0, size)

    def read_file(self, stream: RawIOBase) -> Iterator[Sequence[EventPlace]]:
        """Read a whole log, in one buffer, and yield the events of each detection as `read` does."""
        buffer, rest = bytearray(_PIECE + len(_SLACK)), 0
        while self.failure is None:
            room = len(buffer) - len(_SLACK)
            with memoryview(buffer) as view, view[rest:room] as free:
                got = stream.readinto(free) or 0
            end = rest + got
            if not got:
                buffer[end : end + len(_SLACK)] = _SLACK
            at = buffer.rfind(b"\n", 0, end) + 1 if got else end
            if at:
                address = ctypes.addressof(ctypes.c_char.from_buffer(buffer))
                yield from self._lines(address, at)
                rest = end - at
                buffer[:rest] = buffer[at:end]
            elif end == room:  # a line that is longer than the buffer
                buffer, rest = buffer + bytes(len(buffer)), end
            else:
                rest = end
            if not got:
                return

    def _lines(self, start: int, size: int) -> Iterator[Sequence[EventPlace]]:
        """Read whole lines at an address."""
        done, head = 0, self._head
        while done < size and self.failure is None:
            done += self._functions.rvaft_log_read(self._address, start + done, size - done)
            if head.verdict < 0:
                self.failed, self.failure = head.number, self._why()
            elif head.taken:
                places = (_EventPlace * head.taken).from_buffer(self._state, ctypes.sizeof(_Head))
                yield [(one.number, one.line, one.offset) for one in places]

    @property
    def declined(self) -> str | None:
        """Why the counts are not those of the log, if they are not."""
        found: bytes | None = self._functions.rvaft_log_declined(self._address)
        return None if found is None else found.decode()

    def group_counts(self) -> Iterator[tuple[int, Sequence[EventPlace]]]:
        """Yield the number of events of each group, and the places of the first ones."""
        places = (_EventPlace * _FIRST)()
        for number in range(self._functions.rvaft_log_groups(self._address)):
            total = self._functions.rvaft_log_group(self._address, number, places)
            yield total, [(one.number, one.line, one.offset) for one in places[: min(total, _FIRST)]]

    def key_counts(self) -> Iterator[tuple[int, EventPlace]]:
        """Yield the number of events of each key, in order of first occurrence, then of those without a key.

        The number comes with the place of the first event. Keys that were forgotten are left out.
        """
        place, found = _EventPlace(), list[tuple[int, EventPlace]]()
        keys = self._functions.rvaft_log_keys(self._address)
        for number in range(keys + 1):
            total = self._functions.rvaft_log_key(self._address, number, ctypes.byref(place))
            if total or number == keys:
                found.append((total, (place.number, place.line, place.offset)))
        last = found.pop()
        yield from sorted(found, key=itemgetter(1))
        yield last

    @property
    def forgotten_keys(self) -> tuple[int, int, int]:
        """How many keys were forgotten, how many began too early after that, and the first event of these, or 0."""
        return self._key_state()[1]

    def _key_state(self) -> tuple[bool, tuple[int, int, int]]:
        numbers = (ctypes.c_uint64 * 3)()
        full = self._keyed and bool(self._functions.rvaft_log_keys_full(self._address, numbers))
        return full, (numbers[0], numbers[1], numbers[2])

    @property
    def total(self) -> int:
        """The number of events."""
        return int(self._head.number)

    def close(self) -> None:
        """Release the memory of the monitor, which reads nothing more."""
        del self._head
        with suppress(BufferError):  # a piece that is not read to its end refers to it
            self._state.close()

    def _why(self) -> RvaftError:
        reason = (self._head.reason or b"").decode()
        match self._head.verdict:
            case code if code == _FULL and reason:
                return TraceError(f"too much of {reason} for the native monitor: {_REMEDY}", line=self._head.line)
            case code if code == _FULL and self._key_state()[0]:
                remedy = "raise it with --max-keys N, or name another field"
                return TooLarge("different values of the key", limit=self._keys, remedy=remedy)
            case code if code == _FULL:
                return TooLarge("partial matches or texts of the native monitor", limit=CAPACITY, remedy=_REMEDY)
            case code if code == _UNSUPPORTED:
                return TooLarge("bits of a number or a time in the native monitor", limit=64, remedy=_REMEDY)
            case _:
                return TraceError(f"the native monitor cannot read it: {reason}", line=self._head.line)
