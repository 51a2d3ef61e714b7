"""A monitor for patterns: stix2-matcher matches events as observed data."""

import json
import re
from collections.abc import Sequence
from functools import lru_cache
from itertools import chain, islice
from types import SimpleNamespace
from typing import Any, Final

from backends.stix.observations import StixHeader
from rvaft.errors import LanguageError, RvaftError, TooLarge, ToolFailed, error_at, installed
from rvaft.model.values import Json
from rvaft.monitors import DetectionMonitor

_WHERE: Final = re.compile(r"(\d+):(\d+): (.*)", re.DOTALL)
_MATCHES: Final = 500
"""Number of matches examined before the trace is shortened."""


class StixMonitor(DetectionMonitor):
    """A monitor for a pattern; raises `LanguageError`, `ToolMissing`, and `TooLarge` for deep
    patterns.
    """

    def __init__(self, text: str) -> None:
        program = _StixProgram(text)
        super().__init__(
            lambda traces: [program.known(json.dumps(trace)) for trace in traces], program.header.left_open
        )


@lru_cache(maxsize=32)
class _StixProgram:
    def __init__(self, text: str) -> None:
        self.header = StixHeader.of(text)
        self.known = lru_cache(5_000)(self.first)
        self._matcher, exceptions = (installed(name, "stix2-matcher", "pip install '.[stix]'") for name in _MODULES)
        self._steps: list[Any] = []
        skip = lambda _: None  # noqa: E731 -- unused callbacks
        try:
            pattern = self._matcher.Pattern(text, "2.1")
            pattern.walk(SimpleNamespace(enterEveryRule=skip, visitTerminal=skip, exitEveryRule=self._steps.append))
            self._matches([])
        except exceptions.ParseException as error:
            found = _WHERE.match(str(error))
            line, column, message = (int(found[1]), int(found[2]), found[3]) if found else (1, 0, str(error))
            start = sum(map(len, text.splitlines(keepends=True)[: line - 1])) + column
            reason = f"not a STIX pattern: {' '.join(message.split())}"
            raise error_at(reason, text, min(start, len(text)), "<stix>") from None
        except RecursionError:
            raise TooLarge("nested expressions for the parser of stix2-matcher", limit=250) from None
        except Exception as error:  # noqa: BLE001 -- the matcher raises many types of errors on literals
            raise LanguageError(f"not a STIX pattern: {' '.join(str(error).split())}", file="<stix>") from None

    def _matches(self, observed: Sequence[Sequence[Json]]) -> list[int]:
        """Return for some matches (all, if few) the number of observations up to the last one."""
        bundle = {"type": "bundle", "id": "bundle--0", "objects": [*chain.from_iterable(observed)]}
        listener = self._matcher.MatchListener([bundle], stix_version="2.1")
        for step in self._steps:
            step.exitRule(listener)
        some = islice(listener.matched(), _MATCHES)
        return [1 + max(one for one in match if one is not None) for match in some]

    def first(self, written: str) -> int | None:
        """Return the number of the first event at which the pattern matches, or None."""
        observed, found = self.header.observations(json.loads(written)), None
        try:
            while observed and (ends := self._matches(observed)):
                found = min(ends)
                observed = observed[: found - 1 if len(ends) == _MATCHES else 0]
        except RvaftError:
            raise
        except Exception as error:  # noqa: BLE001 -- the matcher raises many types of errors on values
            raise ToolFailed("stix2-matcher", reason=" ".join(str(error).split())) from None
        return found


_MODULES: Final = ("stix2matcher.matcher", "stix2patterns.exceptions")
