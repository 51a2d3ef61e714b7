"""Cases: a tree and a trace with what everybody said after each event, in a folder that can be read, sent and run again.

`FOLDER/NAME` holds `tree.rvaft`, `trace.jsonl`, `case.json` (semantics, part of the tree, verdicts) and the specifications as they
were. A case is in its folder completely or not at all: it is written beside it, read back, and renamed.
"""

import json
import os
import re
import shutil
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field, replace
from hashlib import blake2b
from pathlib import Path
from secrets import token_hex
from typing import Final, TypeAlias

from cross_check.case_record import CaseError, Record
from rvaft.errors import RvaftError
from rvaft.language import dumps
from rvaft.language import load as load_tree
from rvaft.model import Kind
from rvaft.traces import read
from rvaft.tree import RVAFT
from rvaft.values import Json
from rvaft.verdict import Semantics, Verdict

__all__ = ["Case", "CaseError", "Text", "case_folders", "case_name", "load", "load_all", "save"]

TREE: Final = "tree.rvaft"
TRACE: Final = "trace.jsonl"
CASE: Final = "case.json"

_LONGEST_NAME: Final = 60

StrPath: TypeAlias = str | os.PathLike[str]


@dataclass(frozen=True, slots=True)
class Text:
    """A specification as a participant had it, in the language of its backend."""

    language: str
    text: str


@dataclass(frozen=True, slots=True)
class Case:
    """A tree, or a part of it, and a trace, under one semantics.

    `verdicts` gives for each participant by name its verdict after every event of the trace, `specifications` the texts of those
    that have one, for people to read. Raises `CaseError` for a participant with more or fewer verdicts than events, and for a
    restricted tree: a case has the whole tree, and says which part.
    """

    name: str
    tree: RVAFT
    trace: tuple[Json, ...] = field(hash=False)
    semantics: Semantics
    branch: int | None = None
    kind: Kind | None = None
    verdicts: Mapping[str, tuple[Verdict, ...]] = field(default_factory=dict, hash=False)
    specifications: Mapping[str, Text] = field(default_factory=dict, hash=False)

    def __post_init__(self) -> None:
        if self.tree.restricted:
            raise CaseError("a case has a whole tree; give it with `branch` or `kind`", file=self.name)
        for name, verdicts in self.verdicts.items():
            if len(verdicts) != len(self.trace):
                message = f"{name} has {len(verdicts)} verdicts for a trace of length {len(self.trace)}"
                raise CaseError(message, file=self.name)


def case_name(
    tree: RVAFT, trace: Iterable[Json], semantics: Semantics, *, branch: int | None = None, kind: Kind | None = None
) -> str:
    """A short name that stays the same for the same tree, trace and question: `and-projected-3f2a`."""
    parts = [dumps(tree), json.dumps(list(trace), sort_keys=True), str(semantics), str(branch), str(kind)]
    digest = blake2b("\n".join(parts).encode(), digest_size=2).hexdigest()
    return f"{tree.nodes[tree.root].gate or 'leaf'}-{semantics}-{digest}"


# -- writing ----------------------------------------------------------------------------------------------------


def save(case: Case, folder: StrPath) -> Path:
    """Write a case into a folder of its own, named after it, and return that.

    A folder that holds this very case already is returned as it is; where another case has the name, a number follows it. Raises
    `CaseError` where the folder cannot be written, or the case would not read back as it is.
    """
    home = Path(folder)
    files = _files(case)
    temporary = home / f".{_slug(case.name)}.{token_hex(4)}"
    try:
        temporary.mkdir(parents=True)
        for name, data in files.items():
            (temporary / name).write_bytes(data)
        _check_reads_back(case, temporary)
        return _settled(temporary, home, _slug(case.name), files)
    except OSError as error:
        raise CaseError(f"the case cannot be written: {error.strerror or error}", file=str(home)) from error
    except ValueError as error:
        if isinstance(error, RvaftError):
            raise
        raise CaseError(
            f"the case cannot be written: {error}", file=str(home)
        ) from error  # a path that no system can have
    finally:
        shutil.rmtree(temporary, ignore_errors=True)


def _files(case: Case) -> dict[str, bytes]:
    """The files of a case by name."""
    texts: dict[str, str] = {}
    specifications: dict[str, tuple[str, str]] = {}
    for participant, specification in case.specifications.items():
        file = _unused(_slug(participant), f".{_slug(specification.language)}", {TREE, TRACE, CASE, *texts})
        texts[file] = specification.text
        specifications[participant] = specification.language, file
    record = Record(case.semantics, case.branch, case.kind, case.verdicts, specifications)
    try:
        lines = [json.dumps(event, ensure_ascii=False) + "\n" for event in case.trace]
        every = {TREE: dumps(case.tree), TRACE: "".join(lines), CASE: record.text, **texts}
        return {name: text.encode() for name, text in every.items()}
    except (TypeError, ValueError, RecursionError) as error:
        reason = str(error).splitlines()[0]
        raise CaseError(f"the case cannot be written: {reason}", file=case.name) from error


def _slug(text: str) -> str:
    """A text as a part of a file name that is good on every system."""
    plain = re.sub(r"[^a-z0-9_]+", "-", text.lower()).strip("-")
    return plain[:_LONGEST_NAME].strip("-") or "case"


def _unused(stem: str, suffix: str, used: set[str]) -> str:
    number = 1
    while (name := f"{stem}{'' if number == 1 else f'-{number}'}{suffix}") in used:
        number += 1
    return name


def _check_reads_back(case: Case, temporary: Path) -> None:
    try:
        same = replace(load(temporary), name=case.name) == case
    except RvaftError as error:
        reason = str(error).splitlines()[0].removeprefix(f"{temporary}{os.sep}")
        raise CaseError(f"the case cannot be read back: {reason}", file=case.name) from error
    if not same:
        raise CaseError("the case does not read back as it is: is its trace made of JSON values?", file=case.name)


def _settled(temporary: Path, home: Path, stem: str, files: Mapping[str, bytes]) -> Path:
    """Give the folder its name, one that no other case has; whoever comes second to a name sees the first complete."""
    number = 1
    while True:
        place = home / (stem if number == 1 else f"{stem}-{number}")
        if not os.path.lexists(place):
            try:
                return temporary.rename(place)
            except OSError:
                if not os.path.lexists(place):
                    raise
        if _holds(place, files):
            return place
        number += 1


def _holds(place: Path, files: Mapping[str, bytes]) -> bool:
    try:
        return all((place / name).read_bytes() == data for name, data in files.items())
    except OSError:
        return False


# -- reading ----------------------------------------------------------------------------------------------------


def load(path: StrPath) -> Case:
    """The case in a folder; its name is that of the folder.

    Raises `CaseError` for what is no case, `LanguageError` and `TreeError` for its tree, and `TraceError` for its trace.
    """
    folder = Path(path)
    if not folder.is_dir():
        raise CaseError(
            f"there is no folder of this name; a case is a folder with {TREE}, {TRACE} and {CASE}", file=str(path)
        )
    record = Record.read(_bytes(folder / CASE), str(folder / CASE))
    _bytes(folder / TREE)  # it has to be here; what it imports may be elsewhere
    try:
        tree = load_tree(folder / TREE)
    except OSError as error:
        raise _unreadable(folder / TREE, error) from error
    try:
        trace = tuple(read(folder / TRACE))
    except OSError as error:
        raise _unreadable(folder / TRACE, error) from error
    texts = {name: Text(language, _text(folder / file)) for name, (language, file) in record.specifications.items()}
    name = Path(os.path.abspath(folder)).name  # noqa: PTH100 (a link keeps its name)
    try:
        return Case(name, tree, trace, record.semantics, record.branch, record.kind, record.verdicts, texts)
    except CaseError as error:
        raise CaseError(error.message, file=str(folder / CASE)) from None


def case_folders(folder: StrPath) -> tuple[Path, ...]:
    """The folders of cases: this one if it holds a case itself, else all in it but hidden ones, by name.

    Raises `CaseError` where there is none.
    """
    home = Path(folder)
    if any(os.path.lexists(home / name) for name in (CASE, TREE, TRACE)):
        return (home,)
    try:
        inner = sorted(path for path in home.iterdir() if path.is_dir() and not path.name.startswith("."))
    except (OSError, ValueError) as error:
        raise _unreadable(home, error) from error
    if not inner:
        raise CaseError(f"there is no case here; a case is a folder with {TREE}, {TRACE} and {CASE}", file=str(folder))
    return tuple(inner)


def load_all(folder: StrPath) -> tuple[Case, ...]:
    """The case in a folder, or all cases in the folders in it; raises as `load` does for the first that is none."""
    return tuple(load(path) for path in case_folders(folder))


def _bytes(file: Path) -> bytes:
    try:
        return file.read_bytes()
    except OSError as error:
        raise _unreadable(file, error) from error


def _text(file: Path) -> str:
    try:
        return _bytes(file).decode()
    except UnicodeDecodeError as error:
        raise CaseError(f"not UTF-8 (byte {error.start + 1})", file=str(file)) from None


def _unreadable(file: Path, error: OSError | ValueError) -> CaseError:
    reason = error.strerror if isinstance(error, OSError) and error.strerror else str(error)
    return CaseError(f"cannot be read: {reason}", file=str(file))
