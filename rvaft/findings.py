"""What `rvaft check` reports: one finding per line."""

from dataclasses import dataclass, field
from enum import StrEnum

from rvaft.model import Place


class Severity(StrEnum):
    """An error makes the tree unusable; a warning does not."""

    ERROR = "error"
    WARNING = "warning"


@dataclass(frozen=True, slots=True)
class Finding:
    """One finding; `code` is what `rvaft explain` knows, `nodes` the culprits."""

    place: Place
    severity: Severity
    code: str
    message: str
    nodes: tuple[str, ...] = field(default=())

    def __str__(self) -> str:
        return f"{self.place}: {self.severity}: {self.message} [{self.code}]"
