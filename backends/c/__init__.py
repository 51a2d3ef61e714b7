"""The `c` backend: a tree as one self-contained file of C99, for native and embedded monitors.

A tree whose matches need no joins is followed node by node, and has no partial matches; the `limit` counts the
starts of matches that an instance keeps. For other trees it counts downward-closed sets of events of all scenarios.
Only reading needs a C compiler.
"""

from collections.abc import Callable, Mapping, Sequence
from contextlib import AbstractContextManager
from copy import copy
from dataclasses import replace
from pathlib import Path
from typing import ClassVar, Self

from backends.c.cache import cached_program
from backends.c.common_text import EventTests, KeyField, Use
from backends.c.events import OPERATORS
from backends.c.library import CAPACITY, CMonitor, require_compiler
from backends.c.log import NativeLog
from backends.c.observed_tests import observed
from backends.c.translation import translation
from rvaft.backend import Backend, Metrics, Observed, SpecificationText
from rvaft.capabilities import GATES, JSON_VALUES, Capability, Feature, Ties, Value
from rvaft.core.property import Condition, EndInOrder, Part, Property, Times, Within, WithoutEvent
from rvaft.errors import OptionError, Reason, unwritten
from rvaft.model.guards import Guard, Operator
from rvaft.model.patterns import Pattern
from rvaft.model.verdict import Semantics

__all__ = ["CBackend"]


class CBackend(Backend):
    """C99 without allocation: tables of nodes or of stages, and one runtime for all trees.

    >>> from rvaft import loads
    >>> specification = CBackend().translate(loads("theft sand break_in alarm;"), Semantics.SCATTERED)
    >>> specification.metrics.states, "static const node nodes[]" in specification.text
    (3, True)
    """

    name: ClassVar[str] = "c"
    language: ClassVar[str] = "c"
    suffix: ClassVar[str] = ".c"
    executes: ClassVar[bool] = True
    remark: ClassVar[str] = "/* {} */\n"
    semantics: ClassVar[frozenset[Semantics]] = frozenset(Semantics)
    says: ClassVar[frozenset[type[Part]]] = GATES | {Condition, EndInOrder, Times, Within, WithoutEvent}
    operators: ClassVar[frozenset[Operator]] = OPERATORS
    features: ClassVar[frozenset[Feature]] = frozenset({Feature.TIME_POINTS, Feature.LATE, Feature.OWN_VALUES})
    values: ClassVar[frozenset[Value]] = JSON_VALUES
    ties: ClassVar[Ties] = Ties.ANY
    reasons: ClassVar[Mapping[Capability, Reason]] = {
        Operator.LOWER: unwritten("`lower` needs the tables of Unicode, which the runtime does not have"),
        Value.SOME_ITEM: unwritten("the runtime reads list items at fixed places, and not any item"),
    }
    default_limit: ClassVar[int] = 5_000

    _use: Use = Use()

    def keyed(self, key: Sequence[KeyField]) -> Self:
        """Return a backend whose texts monitor each value of a key as a log of its own."""
        return self._used(replace(self._use, key=tuple(key)))

    def repeating(self, by: str) -> Self:
        """Return a backend whose texts repeat each value of a variable for itself (definition, 4.9).

        A tree with `repeat by` does so of itself. Writing raises `OptionError` where not every event binds it.
        """
        return self._used(replace(self._use, by=by))

    def counted(self, letters: Sequence[tuple[Pattern, Guard | None]], apart: Sequence[str], clock: str) -> Self:
        """Return a backend whose texts also count the events of a log, as `EventTests` says."""
        return self._used(replace(self._use, counted=EventTests(tuple(letters), tuple(apart), clock)))

    def _used(self, use: Use) -> Self:
        twin = copy(self)
        vars(twin)["_use"] = use
        return twin

    def write(self, prop: Property, semantics: Semantics, limit: int) -> SpecificationText:
        """Return the file; raises `NotExpressible` and `TooLarge`."""
        written = translation(prop, semantics, limit, self._use_of(prop, semantics))
        sizes = Metrics(written.stages + written.moves, states=written.stages, edges=written.moves)
        return SpecificationText(written.text, sizes)

    def _use_of(self, prop: Property, semantics: Semantics) -> Use:
        """Return the use with the repetition that the tree states; a text that cannot repeat so does not repeat."""
        stated = prop.tree.repeat_by
        if self._use.by is not None or stated is None:
            return self._use
        try:
            prop.require_shared(stated, semantics)
        except OptionError:
            return replace(self._use, repeats=False)
        return replace(self._use, by=stated)

    def observed(
        self,
        text: str,
        *,
        atoms: Mapping[str, Pattern] | None = None,  # noqa: ARG002
    ) -> tuple[Observed, ...] | None:
        """Return the tests of events that an unchanged text lists; None if it depends on times."""
        return observed(text)

    def program(self, text: str, warn: Callable[[str], object]) -> AbstractContextManager[Path]:
        """Yield a compiled program for JSON Lines, from a cache; its detections have the places of events.

        Raises `ToolMissing`, `ToolFailed` and `OSError`.
        """
        return cached_program(text, CAPACITY, warn)

    def native_log(
        self, text: str, *, keys: int, repeat: bool, forgets: bool, warn: Callable[[str], object]
    ) -> NativeLog:
        """Return a monitor of one log, compiled from a text, with room for some values of its key.

        With `forgets`, values of which no event can matter any more make room for others. Raises
        `ToolMissing`, `ToolFailed` and `OSError`.
        """
        return NativeLog(text, keys=keys, repeat=repeat, forgets=forgets, warn=warn)

    def require(self) -> None:
        """Raise `ToolMissing` if there is no C compiler."""
        require_compiler()

    def read(self, text: str, *, atoms: Mapping[str, Pattern] | None = None) -> CMonitor:  # noqa: ARG002
        """Return a monitor that runs the compiled text; raises `LanguageError` and `ToolMissing`."""
        return CMonitor(text)

    def read_confined(
        self,
        text: str,
        *,
        confine: Callable[[], object],
        atoms: Mapping[str, Pattern] | None = None,  # noqa: ARG002
    ) -> CMonitor:
        """Return a monitor that runs the compiled text; `confine` is called between compiling and running it."""
        return CMonitor(text, confine)
