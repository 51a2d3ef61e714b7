"""Monitors of texts that strangers wrote, read and run in a child process with limits."""

import json
import pickle
from base64 import b64decode, b64encode
from collections.abc import Hashable, Iterable, Iterator, Mapping, Sequence
from functools import partial
from io import BytesIO
from typing import Any, Final

import msgspec

from rvaft.backend import Backend, Match, Observed
from rvaft.errors import (
    LanguageError,
    NoVerdict,
    OptionError,
    RvaftError,
    TooLarge,
    ToolFailed,
    ToolMissing,
    TraceError,
)
from rvaft.model.guards import Duration, Operation, Operator, TimePoint
from rvaft.model.patterns import Anything, ListPattern, Literal, ObjectPattern, Pattern, SomeItem, Variable
from rvaft.model.values import Json
from rvaft.model.verdict import Verdict
from rvaft.monitors import DetectionMonitor, FirstDetections, LeftOpen, Monitor
from rvaft.support.confinement import Child, Limits, can_confine, confine

Traces = Sequence[Sequence[Json]]


def require_permission(language: Backend, *, file: str, run_c: bool) -> None:
    """Raise `OptionError` unless texts of this language may be run."""
    if language.executes and not run_c:
        raise OptionError(f"{file}: a text in C is a program; --run-c compiles and runs it, confined")
    if language.executes and not can_confine():
        raise ToolMissing("seccomp with Landlock, which confine programs,", remedy="use Linux 5.13 or newer on x86-64")


class ConfinedText:
    """A text in a child process, and its monitors; `name` names it in errors.

    A request raises the errors of the reader, `ToolFailed` if the child ends, and `ToolTimeout`.
    """

    def __init__(
        self, name: str, language: Backend, text: str, limits: Limits, *, atoms: Mapping[str, Pattern] | None = None
    ) -> None:
        self._child = Child(name, lambda: _Server(language, text, atoms), limits, prepared=language.executes)
        self._freed: list[tuple[int, int]] = []
        # A program can depend on anything, whatever its text says of it.
        found = None if language.executes else self._ask("observed", str | None)
        self.observed: tuple[Observed, ...] | None = None if found is None else _unpickled(b64decode(found))
        self.fields: list[tuple[str, ...]] = [] if language.executes else self._ask("fields", list[tuple[str, ...]])
        about = self._ask("about", dict[str, bool])
        self._detects, self._leaves_open = about.get("detections", False), about.get("left_open", False)

    @property
    def first_detections(self) -> FirstDetections | None:
        """The first detections of whole traces, if the language reports detections only."""
        return self._first_detections if self._detects else None

    @property
    def left_open(self) -> LeftOpen | None:
        """Why a trace has no verdict, if there are such traces."""
        return self._left_open if self._leaves_open else None

    def start(self) -> "ConfinedMonitor":
        """Return a new monitor."""
        return ConfinedMonitor(self)

    def matches(self, traces: Traces) -> Sequence[frozenset[Match]] | None:
        """Return all matches in each trace, or None if the language does not report them."""
        found = self._ask("matches", list[list[list[tuple[str, int]]]] | None, traces)
        return None if found is None else [frozenset(map(frozenset, some)) for some in found]

    def advance(self, held: "_Held | None", events: Sequence[Json]) -> tuple["_Held", list[Verdict]]:
        """Return a monitor after further events, and the verdict after each."""
        number, verdicts = self._ask("advance", tuple[int, list[Verdict]], self._number(held), events)
        if len(verdicts) != len(events):
            raise ToolFailed("the reader", reason=f"{len(verdicts)} verdicts for {len(events)} events")
        return _Held(self._child.number, number, self._freed), verdicts

    def state(self, held: "_Held | None") -> int:
        """Return a number that stands for the state of a monitor."""
        found: int = self._ask("state", int, self._number(held))
        return found

    def _first_detections(self, traces: Traces) -> list[int | None]:
        found: list[int | None] = self._ask("first_detections", list[int | None], traces)
        if len(found) != len(traces):
            raise ToolFailed("the reader", reason=f"{len(found)} answers to {len(traces)} traces")
        return found

    def _left_open(self, trace: Sequence[Json]) -> str:
        found: str = self._ask("left_open", str, trace)
        return found

    def _number(self, held: "_Held | None") -> int:
        if held is not None and held.process != self._child.number:
            raise ToolFailed("the reader", reason="its process has ended")
        return 0 if held is None else held.number

    def _ask(self, what: str, kind: Any, *given: Any) -> Any:
        """Return the answer of the child, which is of this type; the child may say anything."""
        freed, self._freed[:] = [*self._freed], []
        numbers = [number for process, number in freed if process == self._child.number]
        reply = self._child.ask(pickle.dumps((numbers, what, given)))
        try:
            found = msgspec.convert(json.loads(reply), _Reply)
            if not found.error:
                return msgspec.convert(found.value, kind)
        except (ValueError, msgspec.MsgspecError, RecursionError):
            raise ToolFailed("the reader", reason="its process sent no proper answer") from None
        raise _error(found)


class _Reply(msgspec.Struct, forbid_unknown_fields=True):
    """The answer of a child: a value, or the class of an error of rvaft with its attributes."""

    value: Any = None
    error: str = ""
    kind: str = ""
    fields: dict[str, str | int | None] = {}


class _Held:
    """A monitor in a child process."""

    def __init__(self, process: int, number: int, freed: list[tuple[int, int]]) -> None:
        self.process, self.number, self._freed = process, number, freed

    def __del__(self) -> None:
        self._freed.append((self.process, self.number))


class ConfinedMonitor(Monitor):
    """A monitor of a text in a child process; what the child holds for it never changes."""

    def __init__(self, text: ConfinedText) -> None:
        super().__init__()
        self._text = text
        self._held: _Held | None = None
        self.left_open = text.left_open

    def run(self, events: Iterable[Json]) -> Iterator[Verdict]:
        """Yield the verdict after each event."""
        if self._verdict.final or not isinstance(events, list | tuple):
            return super().run(events)
        self._held, verdicts = self._text.advance(self._held, events)
        self._read += len(events)
        self._verdict = verdicts[-1] if verdicts else self._verdict
        return iter(verdicts)

    def _advance(self, event: Json) -> Verdict:
        self._held, (verdict,) = self._text.advance(self._held, [event])
        return verdict

    @property
    def state(self) -> Hashable:
        """The number of the state."""
        return self._text.state(self._held)


class _Server:
    """Answers the requests of `ConfinedText` in the child."""

    def __init__(self, language: Backend, text: str, atoms: Mapping[str, Pattern] | None) -> None:
        self._language, self._text, self._atoms = language, text, atoms
        self._monitors: dict[int, Monitor] = {}
        self._made = 0
        self._states: dict[Hashable, int] = {}

    def __call__(self, request: bytes) -> bytes:
        freed, what, given = pickle.loads(request)  # noqa: S301 (the parent's own)
        for number in freed:
            self._monitors.pop(number, None)
        try:
            answer = {"value": self._answer(what, *given)}
        except Exception as error:  # noqa: BLE001 (whatever a text causes ends in one line)
            answer = _described(error)
        return json.dumps(answer).encode()

    def _answer(self, what: str, *given: Any) -> Any:
        match what:
            case "observed":
                found = self._language.observed(self._text, atoms=self._atoms)
                return None if found is None else b64encode(pickle.dumps(found)).decode()
            case "fields":
                return self._language.fields(self._text)
            case "about":
                one = self._monitor(0)
                return {"detections": isinstance(one, DetectionMonitor), "left_open": one.left_open is not None}
            case "advance":
                number, events = given
                twin = self._monitor(number).fork()
                verdicts = [*twin.run(events)]
                self._made += 1
                self._monitors[self._made] = twin
                return [self._made, verdicts]
            case "state":
                state = self._monitor(*given).state
                return self._states.setdefault(state, len(self._states))
            case "first_detections":
                one = self._monitor(0)
                assert isinstance(one, DetectionMonitor)
                return [*one.first_detections(*given)]
            case "left_open":
                left_open = self._monitor(0).left_open
                assert left_open is not None
                return left_open(*given)
            case "matches":
                every = self._language.matches(self._text, *given)
                return None if every is None else [[[*one] for one in some] for some in every]
        raise AssertionError(what)

    def _monitor(self, number: int) -> Monitor:
        if not self._monitors:
            rights = partial(confine, threads=False) if self._language.executes else _confined_already
            self._monitors[0] = self._language.read_confined(self._text, confine=rights, atoms=self._atoms)
        return self._monitors[number]


def _confined_already() -> None:
    """Do nothing: a child that starts no program is confined before it answers."""


_PATTERNS: Final = (Observed, Literal, Variable, Anything, ObjectPattern, ListPattern, SomeItem)
_GUARDS: Final = (Operation, Operator, TimePoint, Duration)
_ADMITTED: Final = {(one.__module__, one.__qualname__): one for one in (*_PATTERNS, *_GUARDS)}


class _ModelUnpickler(pickle.Unpickler):
    """Admits the classes of patterns and guards."""

    def find_class(self, module: str, name: str) -> type:
        found = _ADMITTED.get((module, name))
        if found is None:
            raise pickle.UnpicklingError(f"{module}.{name} is no part of a pattern")
        return found


def _unpickled(data: bytes) -> tuple[Observed, ...]:
    try:
        found = _ModelUnpickler(BytesIO(data)).load()
    except Exception as error:
        raise ToolFailed("the reader", reason=f"its patterns cannot be read: {error}") from error
    return tuple(one for one in found if isinstance(one, Observed))


# Errors as JSON.


_ATTRIBUTES: Final[Mapping[type[RvaftError], Mapping[str, Any]]] = {
    LanguageError: {"message": str, "file": str, "line": int, "column": int, "source": str},
    NoVerdict: {"reason": str},
    OptionError: {},
    ToolFailed: {"tool": str, "reason": str},
    ToolMissing: {"tool": str, "remedy": str},
    TooLarge: {"what": str, "limit": int},
    TraceError: {"message": str, "file": str, "line": int | None},
}
"""The errors that a child may report, with the types of their attributes."""


def _described(error: Exception) -> dict[str, Any]:
    for kind, names in _ATTRIBUTES.items():
        if type(error) is kind:
            fields = {name: getattr(error, name) for name in names}
            return {"error": str(error.args[0]) or kind.__name__, "kind": kind.__name__, "fields": fields}
    if isinstance(error, MemoryError):
        return {"error": "it needs more memory than it has"}
    return {"error": " ".join(f"{type(error).__name__}: {error}".split())}


def _error(found: _Reply) -> RvaftError:
    """Return the error that a child reports."""
    for kind, names in _ATTRIBUTES.items():
        fields = {name: found.fields.get(name) for name in names}
        if kind.__name__ == found.kind and all(isinstance(fields[name], of) for name, of in names.items()):
            made = kind.__new__(kind, found.error)
            vars(made).update(fields)
            return made
    return ToolFailed("the reader", reason=found.error)
