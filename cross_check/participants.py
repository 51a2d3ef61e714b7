"""Who takes part in a comparison: the reference, the engine, and the text of each backend run by its own reader."""

from collections.abc import Callable, Iterable
from dataclasses import dataclass
from typing import Final

from rvaft.backend import Specification, all_backends, backend
from rvaft.engine import engine
from rvaft.errors import NotExpressible, RvaftError, TooLarge, ToolMissing
from rvaft.model import Kind
from rvaft.monitors import Monitor
from rvaft.restrict import restrict
from rvaft.semantics import Reference
from rvaft.tree import RVAFT
from rvaft.verdict import Semantics

REFERENCE: Final = "reference"
ENGINE: Final = "engine"


@dataclass(frozen=True, slots=True)
class Participant:
    """Somebody who gives verdicts; `start` makes a fresh monitor."""

    name: str
    start: Callable[[], Monitor]
    specification: Specification | None = None


@dataclass(frozen=True, slots=True)
class Absent:
    """Somebody who cannot take part, and why; never counted as agreement."""

    name: str
    error: RvaftError

    @property
    def status(self) -> str:
        """In two words what the matter is."""
        match self.error:
            case NotExpressible():
                return "not expressible"
            case TooLarge():
                return "too large"
            case ToolMissing():
                return "tool missing"
            case _:
                return "could not run"


def faithful_backends() -> tuple[str, ...]:
    """The backends whose texts should mean the tree."""
    return tuple(name for name in all_backends() if backend(name).faithful)


def enlist(
    tree: RVAFT,
    semantics: Semantics,
    *,
    backends: Iterable[str] | None = None,
    branch: int | None = None,
    kind: Kind | None = None,
) -> list[Participant | Absent]:
    """The reference, the engine and the backends (all faithful ones unless named), for a tree or a part of it."""
    part = restrict(tree, branch=branch, kind=kind)
    found: list[Participant | Absent] = [
        Participant(REFERENCE, lambda: Reference(tree, semantics, branch=branch, kind=kind)),
        Participant(ENGINE, lambda: engine(part, semantics)),
    ]
    for name in faithful_backends() if backends is None else backends:
        try:
            specification = backend(name).translate(part, semantics)
            specification.monitor()
        except RvaftError as error:
            found.append(Absent(name, error))
        else:
            found.append(Participant(name, specification.monitor, specification))
    return found
