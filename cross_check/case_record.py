"""`case.json`: the semantics, the part of the tree, the verdicts and where the specifications are, written and strictly read."""

import json
import re
from collections.abc import Mapping
from collections.abc import Set as AbstractSet
from dataclasses import dataclass
from enum import StrEnum
from typing import Any, Final, TypeVar

from rvaft.errors import RvaftError
from rvaft.model import Kind
from rvaft.printable import visible
from rvaft.verdict import Semantics, Verdict

Choice = TypeVar("Choice", bound=StrEnum)

FILE_NAME: Final = re.compile(r"[a-z0-9_-][a-z0-9._-]*")
"""Names of files that are the same name on every system, and that stay in their folder."""


class CaseError(RvaftError, ValueError):
    """A case cannot be read, written or made; `file` says where."""

    def __init__(self, message: str, *, file: str) -> None:
        self.message = message
        self.file = file
        super().__init__(f"{file}: {message}")


@dataclass(frozen=True, slots=True)
class Record:
    """What `case.json` says. `specifications` gives the language and the file of each participant's text."""

    semantics: Semantics
    branch: int | None
    kind: Kind | None
    verdicts: Mapping[str, tuple[Verdict, ...]]
    specifications: Mapping[str, tuple[str, str]]

    @property
    def text(self) -> str:
        """The record as JSON."""
        specifications = {
            name: {"language": language, "file": file} for name, (language, file) in self.specifications.items()
        }
        value = {
            "semantics": self.semantics,
            "branch": self.branch,
            "kind": self.kind,
            "verdicts": self.verdicts,
            "specifications": specifications,
        }
        return json.dumps(value, ensure_ascii=False, indent=2) + "\n"

    @classmethod
    def read(cls, data: bytes, file: str) -> "Record":
        """The record that a file holds; `branch`, `kind` and `specifications` may be left out. Raises `CaseError`."""
        value = _Value(_decoded(data, file), "the case", file)
        fields = value.object(
            {"semantics", "branch", "kind", "verdicts", "specifications"}, needed={"semantics", "verdicts"}
        )
        branch, kind = fields.get("branch"), fields.get("kind")
        written = fields.get("specifications")
        return cls(
            fields["semantics"].one_of(Semantics),
            None if branch is None or branch.value is None else branch.number(),
            None if kind is None or kind.value is None else kind.one_of(Kind),
            {
                name: tuple(verdict.one_of(Verdict) for verdict in verdicts.items())
                for name, verdicts in fields["verdicts"].object().items()
            },
            {} if written is None else {name: _specification(text) for name, text in written.object().items()},
        )


def _specification(text: "_Value") -> tuple[str, str]:
    fields = text.object({"language", "file"}, needed={"language", "file"})
    return fields["language"].text(), fields["file"].file_name()


def _decoded(data: bytes, file: str) -> Any:
    def constant(name: str) -> Any:
        raise ValueError(f"{name} is no JSON number")

    def without_repetition(pairs: list[tuple[str, Any]]) -> dict[str, Any]:
        found: dict[str, Any] = {}
        for key, value in pairs:
            if key in found:
                raise ValueError(f"the key {_shown(key)} is repeated")
            found[key] = value
        return found

    try:
        text = data.decode("utf-8-sig")
        return json.loads(text, object_pairs_hook=without_repetition, parse_constant=constant)
    except UnicodeDecodeError as error:
        raise CaseError(f"not UTF-8 (byte {error.start + 1})", file=file) from None
    except json.JSONDecodeError as error:
        raise CaseError(f"not JSON: {error.msg} (line {error.lineno}, column {error.colno})", file=file) from None
    except RecursionError:
        raise CaseError("not a case: nested too deeply", file=file) from None
    except ValueError as error:
        raise CaseError(f"not a case: {error}", file=file) from None


def _shown(value: object) -> str:
    text = json.dumps(value)
    return visible(text if len(text) <= 40 else f"{text[:37]}...")


@dataclass(frozen=True, slots=True)
class _Value:
    """A JSON value, what it is, and the file that it is from; every question about it raises `CaseError` for a wrong type."""

    value: Any
    what: str
    file: str

    def wrong(self, wanted: str) -> CaseError:
        return CaseError(f"{self.what} should be {wanted}, not {_shown(self.value)}", file=self.file)

    def part(self, value: Any, what: str) -> "_Value":
        return _Value(value, what, self.file)

    def object(
        self, known: AbstractSet[str] | None = None, *, needed: AbstractSet[str] = frozenset()
    ) -> dict[str, "_Value"]:
        if not isinstance(self.value, dict):
            raise self.wrong("an object")
        for key in sorted(self.value.keys() - known) if known is not None else ():
            raise CaseError(
                f"{self.what} has the unknown key {_shown(key)}; known: {', '.join(sorted(known or ()))}",
                file=self.file,
            )
        for key in sorted(needed - self.value.keys()):
            raise CaseError(f"{self.what} lacks the key {_shown(key)}", file=self.file)
        return {key: self.part(value, _shown(key)) for key, value in self.value.items()}

    def items(self) -> list["_Value"]:
        if not isinstance(self.value, list):
            raise self.wrong("a list")
        return [self.part(value, f"item {number} of {self.what}") for number, value in enumerate(self.value, 1)]

    def text(self) -> str:
        if not isinstance(self.value, str):
            raise self.wrong("a string")
        return self.value

    def file_name(self) -> str:
        if not FILE_NAME.fullmatch(self.text()):
            raise self.wrong("the name of a file in the folder of the case")
        return self.text()

    def number(self) -> int:
        if not isinstance(self.value, int) or isinstance(self.value, bool) or self.value < 1:
            raise self.wrong("a whole number from 1, or null")
        return self.value

    def one_of(self, choices: type[Choice]) -> Choice:
        known = {choice.value: choice for choice in choices}
        if not isinstance(self.value, str) or self.value not in known:
            raise self.wrong(f"one of {', '.join(known)}")
        return known[self.value]
