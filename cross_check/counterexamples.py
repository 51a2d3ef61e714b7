"""Cases: a tree and a trace with what everybody said after each event, in a folder that can be read, sent and run again.

`FOLDER/NAME` holds `tree.rvaft`, `trace.jsonl`, `case.json` (semantics, part of the tree, verdicts) and the specifications as they
were. A case is in its folder completely or not at all: it is written beside it, read back, and renamed.
"""

import json
import os
import re
import shutil
from collections.abc import Iterable, Iterator, Mapping, Sequence
from collections.abc import Set as AbstractSet
from dataclasses import dataclass, field, replace
from enum import StrEnum
from hashlib import blake2b
from pathlib import Path
from secrets import token_hex
from typing import Any, Final, TypeAlias, TypeVar

from cross_check.campaign import Task
from cross_check.comparison import Roster
from cross_check.participants import REFERENCE, Absent, Handwritten, verdicts_of
from cross_check.results import Difference, Job, Result, Status
from cross_check.shrink import shrink
from rvaft.api import load as load_tree
from rvaft.backend import all_backends
from rvaft.errors import RvaftError
from rvaft.language.printer import dumps
from rvaft.model.nodes import Kind
from rvaft.model.tree import RVAFT
from rvaft.model.values import Json
from rvaft.model.verdict import Semantics, Verdict
from rvaft.monitoring.reader import read
from rvaft.support.terminal import visible

# `case.json`: the semantics, the part of the tree, the verdicts and where the specifications are, written and strictly read.

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


# A disagreement made small and kept: tree and trace are reduced together as long as the two still differ.


def shrunk(task: Task, result: Result) -> Case:
    """The smallest case found in which this participant and the one it was compared with still differ.

    A text that was given beside the tree does not follow when the tree changes; then only the trace is reduced.
    """
    assert result.difference is not None
    names = result.difference.baseline, result.participant
    fixed = bool(task.roster.against)

    def disagrees(tree: RVAFT, trace: Sequence[Json]) -> bool:
        if fixed and not _same(tree, task.tree):
            return False
        found = verdicts(task.roster, tree, task.job, trace, names)
        return len(found) == len(names) and len(set(found.values())) > 1

    tree, trace = shrink(task.tree, list(result.difference.trace), disagrees)
    job = task.job
    made = [(name, enlist()) for name, enlist in task.roster.candidates(tree, job) if name in names]
    texts = {text.path: Text(text.language, text.text) for text in task.roster.against if text.path in names}
    for name, one in made:
        if not isinstance(one, Absent) and one.specification is not None:
            texts[name] = Text(one.specification.language, one.specification.text)
    return Case(
        case_name(tree, trace, job.semantics, branch=job.branch, kind=job.kind),
        tree,
        tuple(trace),
        job.semantics,
        job.branch,
        job.kind,
        {name: said for name, one in made if isinstance(said := verdicts_of(one, trace), tuple)},
        texts,
    )


def _same(one: RVAFT, other: RVAFT) -> bool:
    """Whether two trees are equal in all that has a meaning."""
    parts = [(t.root, dict(t.nodes), dict(t.events), t.ignores, t.causality) for t in (one, other)]
    return parts[0] == parts[1]


def verdicts(
    roster: Roster, tree: RVAFT, job: Job, trace: Sequence[Json], names: Sequence[str]
) -> dict[str, tuple[Verdict, ...]]:
    """What each of these participants says after every prefix; those that cannot take part are left out."""
    found: dict[str, tuple[Verdict, ...]] = {}
    for name, enlist in roster.candidates(tree, job):
        if name in names:
            said = verdicts_of(enlist(), trace)
            if isinstance(said, tuple):
                found[name] = said
    return found


def keep(task: Task, result: Result, folder: Path) -> Path:
    """Save the shrunk case of a disagreement below a folder; raises `OSError`."""
    return save(shrunk(task, result), folder)


# Saved cases run again.


@dataclass(frozen=True, slots=True)
class Replay:
    """What one participant of a case says now; `before` is what it said when the case was saved, if it did."""

    result: Result
    before: tuple[Verdict, ...] | None
    now: tuple[Verdict, ...] | None


def asked(case: Case, roster: Roster) -> Roster:
    """The roster, with those that took part when the case was saved: backends, and texts that are kept with it."""
    named = tuple(name for name in case.verdicts if name in all_backends())
    kept = (Handwritten(name, text.language, text.text) for name, text in case.specifications.items())
    against = tuple(text for text in kept if text.path not in all_backends())
    if roster.backends is None and (named or against):
        roster = replace(roster, backends=named)
    return replace(roster, against=(*roster.against, *against))


def replay(case: Case, roster: Roster) -> Iterator[Replay]:
    """What the participants say on the trace of a case: those of the roster, and those that the case has verdicts of."""
    job = Job(case.name, case.semantics, case.branch, case.kind)
    baseline: tuple[Verdict, ...] | None = None
    for name, enlist in asked(case, roster).candidates(case.tree, job):
        found = verdicts_of(enlist(), case.trace)
        if isinstance(found, RvaftError):
            status = Status(Absent(name, found).status)
            yield Replay(Result(job, name, status, why=str(found)), case.verdicts.get(name), None)
            continue
        status = Status.BASELINE if baseline is None else Status.TESTED if found == baseline else Status.DIFFERS
        baseline = found if baseline is None else baseline
        difference = Difference(case.trace, REFERENCE, baseline, found) if status is Status.DIFFERS else None
        length = len(found)
        result = Result(job, name, status, verdicts=length, traces=1, longest=length, difference=difference)
        yield Replay(result, case.verdicts.get(name), found)
