"""Counterexamples: shrunk disagreements, saved in folders that can be replayed.

`FOLDER/NAME` holds `tree.rvaft`, `trace.jsonl`, `case.json` (semantics, part of the tree, verdicts)
and the specifications. Saving is atomic: a case is written beside its folder, read back, and
renamed.
"""

import json
import os
import re
import shutil
from collections import Counter
from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, field, replace
from hashlib import blake2b
from itertools import count
from pathlib import Path
from secrets import token_hex
from typing import Annotated, Any, Final, TypeAlias

import msgspec

from cross_check.campaign import Task
from cross_check.comparison import Roster
from cross_check.participants import (
    REFERENCE,
    Absent,
    Enlisted,
    Handwritten,
    detections,
    reports_detections_only,
    verdicts_of,
)
from cross_check.results import DETECTIONS_ONLY, Difference, Job, Result, Status
from cross_check.shrink import shrink
from rvaft.backend import all_backends
from rvaft.errors import RvaftError
from rvaft.language.printer import dumps
from rvaft.model.nodes import Kind
from rvaft.model.tree import RVAFT
from rvaft.model.values import Json, is_finite
from rvaft.model.verdict import Semantics, Verdict
from rvaft.readers.json_lines import read
from rvaft.rules.validity import load as load_tree
from rvaft.support.files import opened_within
from rvaft.support.terminal import visible

StrPath: TypeAlias = str | os.PathLike[str]
Verdicts: TypeAlias = tuple[Verdict, ...]

TREE: Final = "tree.rvaft"
TRACE: Final = "trace.jsonl"
CASE: Final = "case.json"
_WHAT: Final = f"a case is a folder with {TREE}, {TRACE} and {CASE}"
_LONGEST_NAME: Final = 60
_LONGEST_MESSAGE: Final = 200
_LONGEST_FILE: Final = 64 << 20


class CaseError(RvaftError, ValueError):
    """A case cannot be read, written or created; `file` is its place."""

    def __init__(self, message: str, *, file: str) -> None:
        self.message = message
        self.file = file
        super().__init__(f"{file}: {message}")


class SpecificationFile(msgspec.Struct, forbid_unknown_fields=True):
    """The file of a specification in the folder of the case, with a portable name."""

    language: str
    file: Annotated[str, msgspec.Meta(pattern=r"^[a-z0-9_-][a-z0-9._-]*\Z")]


class CaseRecord(msgspec.Struct, forbid_unknown_fields=True):
    """The content of `case.json`; only `semantics` and `verdicts` are required."""

    semantics: Semantics
    verdicts: dict[str, Verdicts]
    branch: Annotated[int, msgspec.Meta(ge=1)] | None = None
    kind: Kind | None = None
    specifications: dict[str, SpecificationFile] = {}


@dataclass(frozen=True, slots=True)
class Case:
    """A tree (or a branch or kind of it) and a trace under one semantics.

    `verdicts` holds for each participant the verdict after every event, `specifications` language
    and text of participants that have one. Raises `CaseError` for a wrong number of verdicts and
    for a restricted tree, instead of which a case has `branch` or `kind`.
    """

    name: str
    tree: RVAFT
    trace: tuple[Json, ...] = field(hash=False)
    semantics: Semantics
    branch: int | None = None
    kind: Kind | None = None
    verdicts: Mapping[str, Verdicts] = field(default_factory=dict, hash=False)
    specifications: Mapping[str, tuple[str, str]] = field(default_factory=dict, hash=False)

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
    """Return a short name that depends only on the content: `and-projected-3f2a`."""
    parts = [dumps(tree), json.dumps(list(trace), sort_keys=True), str(semantics), str(branch), str(kind)]
    digest = blake2b("\n".join(parts).encode(), digest_size=2).hexdigest()
    return f"{tree.nodes[tree.root].gate or 'leaf'}-{semantics}-{digest}"


# Writing.


def save(case: Case, folder: StrPath) -> Path:
    """Write a case into its own folder, and return the folder.

    An existing folder with the same case is returned unchanged; another case with the name gets a
    number. Raises `CaseError` if that fails or the case does not read back equal.
    """
    home, stem = Path(folder), _slug(case.name)
    temporary = home / f".{stem}.{token_hex(4)}"
    try:
        files = _files(case)
    except (TypeError, ValueError, RecursionError) as error:
        raise CaseError(f"the case cannot be written: {_reason(error)}", file=case.name) from error
    try:
        temporary.mkdir(parents=True)
        for name, data in files.items():
            (temporary / name).write_bytes(data)
        _check_reads_back(case, temporary)
        return _settled(temporary, home / stem, files)
    except RvaftError:
        raise
    except (OSError, ValueError) as error:
        raise CaseError(f"the case cannot be written: {_reason(error)}", file=str(home)) from error
    finally:
        shutil.rmtree(temporary, ignore_errors=True)


def _files(case: Case) -> dict[str, bytes]:
    texts = {TREE: dumps(case.tree), CASE: ""}
    texts[TRACE] = "".join(json.dumps(event, ensure_ascii=False) + "\n" for event in case.trace)
    specifications: dict[str, Json] = {}
    for participant, (language, text) in case.specifications.items():
        stem, suffix = _slug(participant), _slug(language)
        numbered = (f"{stem}{'' if number == 1 else f'-{number}'}.{suffix}" for number in count(1))
        file = next(name for name in numbered if name not in texts)
        texts[file] = text
        specifications[participant] = {"language": language, "file": file}
    names = ("semantics", "branch", "kind", "verdicts")
    record = {**{name: getattr(case, name) for name in names}, "specifications": specifications}
    texts[CASE] = json.dumps(record, ensure_ascii=False, indent=2) + "\n"
    return {name: text.encode() for name, text in texts.items()}


def _slug(text: str) -> str:
    plain = re.sub(r"[^a-z0-9_]+", "-", text.lower()).strip("-")
    return plain[:_LONGEST_NAME].strip("-") or "case"


def _check_reads_back(case: Case, temporary: Path) -> None:
    try:
        again = replace(load(temporary), name=case.name)
        same = again == case or (not all(map(is_finite, case.trace)) and _files(again) == _files(case))
    except RvaftError as error:
        reason = str(error).splitlines()[0].removeprefix(f"{temporary}{os.sep}")
        raise CaseError(f"the case cannot be read back: {reason}", file=case.name) from error
    if not same:
        raise CaseError("the case does not read back as it is: is its trace made of JSON values?", file=case.name)


def _settled(temporary: Path, wanted: Path, files: Mapping[str, bytes]) -> Path:
    """Rename the folder to an unused name; concurrent writers see complete cases only."""
    for number in count(1):
        place = wanted if number == 1 else wanted.with_name(f"{wanted.name}-{number}")
        if not os.path.lexists(place):
            try:
                return temporary.rename(place)
            except OSError:
                if not os.path.lexists(place):
                    raise
        with suppress(OSError):
            if all((place / name).read_bytes() == data for name, data in files.items()):
                return place
    raise AssertionError("there is always a further number")


# Reading.


def load(path: StrPath) -> Case:
    """Return the case in a folder, named after the folder; its files are regular ones in there.

    Raises `CaseError` for other folders, and the errors of its tree and trace.
    """
    folder = Path(path)
    if not folder.is_dir():
        raise CaseError(f"there is no folder of this name; {_WHAT}", file=str(path))
    file = folder / CASE
    try:
        record = _record(_text(file), str(file))
        file = folder / TREE
        _text(file)  # the tree file is required
        tree = load_tree(file, confine_imports=True)
        file = folder / TRACE
        with opened_within(folder, file) as stream:
            trace = tuple(read(stream, name=str(file)))
        texts = {name: (one.language, _text(file := folder / one.file)) for name, one in record.specifications.items()}
    except OSError as error:
        raise CaseError(f"cannot be read: {_reason(error)}", file=str(file)) from error
    name = Path(os.path.abspath(folder)).name  # noqa: PTH100 (a link keeps its name)
    try:
        return Case(name, tree, trace, record.semantics, record.branch, record.kind, record.verdicts, texts)
    except CaseError as error:
        raise CaseError(error.message, file=str(folder / CASE)) from None


def _text(file: Path) -> str:
    with opened_within(file.parent, file) as stream:
        data = stream.read(_LONGEST_FILE + 1)
    if len(data) > _LONGEST_FILE:
        raise CaseError(f"longer than {_LONGEST_FILE >> 20} MiB", file=str(file))
    try:
        return data.decode("utf-8-sig" if file.name == CASE else "utf-8")
    except UnicodeDecodeError as error:
        raise CaseError(f"not UTF-8 (byte {error.start + 1})", file=str(file)) from None


def _record(text: str, file: str) -> CaseRecord:
    def unrepeated(pairs: list[tuple[str, Any]]) -> dict[str, Any]:
        for key, number in Counter(key for key, _ in pairs).items():
            if number > 1:
                raise ValueError(f"the key {json.dumps(key)} is repeated")
        return dict(pairs)

    try:
        return msgspec.convert(json.loads(text, object_pairs_hook=unrepeated), CaseRecord)
    except json.JSONDecodeError as error:
        raise CaseError(f"not JSON: {error.msg} (line {error.lineno}, column {error.colno})", file=file) from None
    except RecursionError:
        raise CaseError("not a case: nested too deeply", file=file) from None
    except ValueError as error:
        known = {"semantics": Semantics, "kind": Kind}.get(str(error).rpartition(".")[2].strip("`"), Verdict)
        more = f"; known: {', '.join(known)}" if "enum" in str(error) else ""
        raise CaseError(f"not a case: {visible(str(error))[:_LONGEST_MESSAGE]}{more}", file=file) from None


def _reason(error: Exception) -> str:
    return getattr(error, "strerror", None) or str(error).splitlines()[0]


def case_folders(folder: StrPath) -> tuple[Path, ...]:
    """Return this folder if it is a case, else its visible subfolders by name.

    Raises `CaseError` if there are none.
    """
    home = Path(folder)
    if any(os.path.lexists(home / name) for name in (CASE, TREE, TRACE)):
        return (home,)
    try:
        inner = sorted(path for path in home.iterdir() if path.is_dir() and not path.name.startswith("."))
    except (OSError, ValueError) as error:
        raise CaseError(f"cannot be read: {_reason(error)}", file=str(home)) from error
    if not inner:
        raise CaseError(f"there is no case here; {_WHAT}", file=str(folder))
    return tuple(inner)


# Shrinking.


def shrunk(task: Task, result: Result) -> Case:
    """Return the smallest case found in which the participant and its baseline still disagree.

    With handwritten specifications only the trace is reduced, because they do not follow the tree.
    """
    assert result.difference is not None
    job, roster = task.job, task.roster
    names = result.difference.baseline, result.participant

    def made(tree: RVAFT) -> dict[str, Enlisted]:
        return {name: enlist() for name, enlist in roster.candidates(tree, job) if name in names}

    def disagrees(tree: RVAFT, trace: Sequence[Json]) -> bool:
        if roster.against and tree is not task.tree:
            return False
        enlisted = made(tree)
        found = _verdicts(enlisted, trace)
        only = any(map(reports_detections_only, enlisted.values()))
        return len(found) == len(names) and len({detections(one) if only else one for one in found.values()}) > 1

    tree, trace = shrink(task.tree, list(result.difference.trace), disagrees)
    enlisted = made(tree)
    texts = {text.path: (text.language, text.text) for text in roster.against if text.path in names}
    for name, one in enlisted.items():
        if not isinstance(one, Absent) and one.specification is not None:
            texts[name] = one.specification.language, one.specification.text
    name = case_name(tree, trace, job.semantics, branch=job.branch, kind=job.kind)
    verdicts = _verdicts(enlisted, trace)
    return Case(name, tree, tuple(trace), job.semantics, job.branch, job.kind, verdicts, texts)


def _verdicts(enlisted: Mapping[str, Enlisted], trace: Sequence[Json]) -> dict[str, Verdicts]:
    results = ((name, verdicts_of(one, trace)) for name, one in enlisted.items())
    return {name: verdicts for name, verdicts in results if isinstance(verdicts, tuple)}


# Replaying.


@dataclass(frozen=True, slots=True)
class Replay:
    """The verdicts of a participant now, and `before`, when the case was saved, if known."""

    result: Result
    before: Verdicts | None
    now: Verdicts | None


def replay(case: Case, roster: Roster) -> Iterator[Replay]:
    """Yield the verdicts of participants of the roster and of the case on its trace."""
    known = all_backends()
    named = tuple(name for name in case.verdicts if name in known)
    others = {name: text for name, text in case.specifications.items() if name not in known}
    against = tuple(Handwritten(name, *text, roster.patience, roster.run_c) for name, text in others.items())
    if roster.backends is None and (named or against):
        roster = replace(roster, backends=named)
    roster = replace(roster, against=(*roster.against, *against))
    job = Job(case.name, case.semantics, case.branch, case.kind)
    baseline: Verdicts | None = None
    for name, enlist in roster.candidates(case.tree, job):
        enlisted = enlist()
        found, only = verdicts_of(enlisted, case.trace), reports_detections_only(enlisted)
        before = case.verdicts.get(name)
        if isinstance(found, RvaftError):
            yield Replay(Result(job, name, Status.of(found), why=str(found)), before, None)
            continue
        wanted = found if baseline is None else detections(baseline) if only else baseline
        status = Status.BASELINE if baseline is None else Status.TESTED if found == wanted else Status.DIFFERS
        baseline = found if baseline is None else baseline
        difference = Difference(case.trace, REFERENCE, baseline, found) if status is Status.DIFFERS else None
        length = len(found)
        why = DETECTIONS_ONLY if only else ""
        ran = Result(job, name, status, verdicts=length, traces=1, longest=length, why=why, detections_only=only)
        result = replace(ran, difference=difference)
        yield Replay(result, before, found)
