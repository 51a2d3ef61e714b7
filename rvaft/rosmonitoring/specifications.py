"""The monitors as RML and in the Prolog form that ROSMonitoring's RML oracle loads."""

from collections.abc import Collection, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Final

from rvaft.api import translate
from rvaft.errors import NotExpressible, TooLarge
from rvaft.rosmonitoring.planning import Planned
from rvaft.verdict import Semantics

SUFFIXES: Final = {"rml": ".rml", "rml-prolog": ".pl"}
"""The backends, and how their files end."""


_BEGINNINGS: Final = {"rml": b"// The attack-fault tree ", "rml-prolog": b":- module(spec, "}
"""How these texts begin, whatever the tree."""


@dataclass(frozen=True, slots=True)
class LeftOut:
    """Why a monitor has no file for the RML oracle."""

    monitor: str
    reason: str

    @property
    def files(self) -> tuple[str, ...]:
        """The files that there are not."""
        return tuple(f"{self.monitor}{suffix}" for suffix in SUFFIXES.values())

    def __str__(self) -> str:
        return f"{' and '.join(self.files)} left out: {self.reason}"


def leftover(folder: Path, ids: Collection[str]) -> Iterator[str]:
    """The files in a folder that are specifications of monitors with these ids, by their names and by how they begin."""
    for name, suffix in SUFFIXES.items():
        for path in sorted(folder.glob(f"*{suffix}")):
            if path.stem in ids and path.is_file() and not path.is_symlink():
                with path.open("rb") as stream:
                    if stream.read(len(_BEGINNINGS[name])) == _BEGINNINGS[name]:
                        yield path.name


def specifications(monitor: Planned, semantics: Semantics) -> Iterator[tuple[str, str] | LeftOut]:
    """The files of a monitor, each with its text, or why RML does not have it."""
    try:
        texts = {suffix: translate(monitor.tree, name, semantics=semantics).text for name, suffix in SUFFIXES.items()}
    except (NotExpressible, TooLarge) as error:
        yield LeftOut(monitor.id, str(error))
        return
    for suffix, text in texts.items():
        yield f"{monitor.id}{suffix}", text if text.endswith("\n") else f"{text}\n"
