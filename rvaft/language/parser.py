"""The parser of trees, patterns and guards; every error in a text is a `LanguageError`."""

import os
import re
from collections.abc import Iterator
from dataclasses import dataclass, field
from functools import cache, lru_cache
from hashlib import sha256
from io import BytesIO
from pathlib import Path
from typing import Any, Final, TypedDict, Unpack

from lark import Lark, Token
from lark import __version__ as lark_version
from lark.exceptions import UnexpectedInput

from rvaft.errors import LanguageError, error_at
from rvaft.language.builder import Build, ImportStatement, Page, Slip, Statement, shown
from rvaft.language.draft import Draft, Located
from rvaft.language.galileo import SUFFIXES as GALILEO
from rvaft.language.galileo import is_galileo, read_dynamic_gates
from rvaft.language.markup import SUFFIX as XML
from rvaft.language.markup import is_document
from rvaft.model.event_time import EventTime, TextFormat
from rvaft.model.guards import Guard
from rvaft.model.patterns import Pattern
from rvaft.support.collector import no_collections
from rvaft.support.files import note_input, opened_within

SUFFIXES: Final = (".rvaft", *GALILEO)
"""The suffixes of trees in this language; errors quote other files only after a statement."""
TREES: Final = (*SUFFIXES, XML)
"""The suffixes of all trees."""
MAX_FILE: Final = 16 * 1024 * 1024
"""The maximum size of a file in bytes; ten thousand nodes need less than 1 MiB."""
_NO_TEXT: Final = re.compile("[\0\ud800-\udfff]")
TABLES: Final = "grammar.tables"
"""The file with the tables, beside the grammar: making them takes longer than reading a tree."""
_STARTS: Final = ["tree", "only_pattern", "only_guard", "moment"]
_REMEMBERED: Final = 1024
"""The number of cached patterns and guards; specifications repeat them."""


class NoTree(LanguageError):
    """A text without a node; `is_part` is whether trees can import its declarations."""

    def __init__(self, draft: Draft) -> None:
        self.is_part = bool(draft.events or draft.ignores or draft.topics)
        super().__init__("the text has no tree: no statement declares a node", file=draft.file)


def tables() -> bytes:
    """Return the tables of the parser, after a line that names the grammar and the version of Lark."""
    stream = BytesIO()
    Lark(_grammar(), parser="lalr", start=_STARTS).save(stream, exclude_options=("transformer",))
    return _title(_grammar()) + stream.getvalue()


def _grammar() -> str:
    return Path(__file__).with_name("grammar.lark").read_text(encoding="utf-8")


def _title(grammar: str) -> bytes:
    return f"{sha256(grammar.encode()).hexdigest()} {lark_version}\n".encode()


@cache
def grammar(*, built: bool) -> Lark:
    """Return the parser, from the stored tables if they are those of the grammar.

    With `built`, it returns statements, patterns and guards, otherwise plain trees.
    """
    text, stored = _grammar(), Path(__file__).with_name(TABLES)
    found = stored.read_bytes() if stored.is_file() else b""
    transformer = Build() if built else None
    if found.startswith(title := _title(text)):
        parser = Lark.__new__(Lark)  # `Lark.load` takes no transformer
        return parser._load(BytesIO(found[len(title) :]), transformer=transformer)  # noqa: SLF001
    return Lark(text, parser="lalr", start=_STARTS, transformer=transformer)


def _parse(text: str, file: str, start: str) -> Any:
    text = text.removeprefix("\ufeff")
    if found := _NO_TEXT.search(text):
        what = (
            "the text has a zero byte: it is binary data" if found[0] == "\0" else "the text has an unpaired surrogate"
        )
        raise error_at(what, text, found.start(), file)
    try:
        return grammar(built=True).parse(text, start=start)
    except Slip as slip:
        raise error_at(slip.message, text, slip.position, file) from None
    except UnexpectedInput as error:
        from rvaft.language.diagnostics import diagnose  # noqa: PLC0415 -- imported on use

        raise diagnose(error, text, file) from None


@lru_cache(maxsize=_REMEMBERED)
def parse_pattern(text: str) -> Pattern:
    """Return the pattern of a text, in which every word is a variable; raises `LanguageError`.

    >>> parse_pattern('{topic: "/command", time: T}').fields[1]
    ('time', Variable(name='T'))
    """
    pattern: Pattern = _parse(text, "<pattern>", "only_pattern")
    return pattern


@lru_cache(maxsize=_REMEMBERED)
def parse_guard(text: str) -> Guard:
    """Return the guard of a text; raises `LanguageError`.

    >>> parse_guard("T2 >= T1 + 10").operator
    <Operator.GE: '>='>
    """
    guard: Guard = _parse(text, "<guard>", "only_guard")
    return guard


def parse_time(text: str, file: str = "<time>") -> EventTime:
    """Return the declaration of a `time` statement without semicolon; raises `LanguageError`.

    >>> parse_time("time header.stamp as ros").field
    ('header', 'stamp')
    """
    time: EventTime = _parse(text, file, "moment")[1]
    if isinstance(time.format, TextFormat) and time.format.needs_year:
        raise error_at(f"the format {time.format} reads no year: write `year 2026` after it", text, 0, file)
    return time


class TreeOptions(TypedDict, total=False):
    """The options of reading a tree."""

    strict_galileo: bool
    confine_imports: bool
    year: int | None


def parse(text: str, file: str = "<text>", **reading: Unpack[TreeOptions]) -> Draft:
    """Return the draft of a text and its imports, whose paths are relative to the folder of `file`.

    With `confine_imports`, only regular files in that folder are read; without it, no error quotes
    files outside of it.

    Raises `LanguageError` for a syntax error, also in an import, and `NoTree` without a node. Other
    errors (a cycle, a duplicate setting, …) stay in the draft. Galileo's dynamic gates are
    translated, or refused with `strict_galileo`.

    >>> sorted(parse("top or a b; a fault;").nodes)
    ['a', 'top']
    """
    draft = _draft(text, file, shown=True, **reading)
    read_dynamic_gates(draft, strict=reading.get("strict_galileo", False))
    return draft


def _draft(text: str, file: str, *, shown: bool, **reading: Unpack[TreeOptions]) -> Draft:
    """Return the draft of a text; errors quote the text if it is to be `shown`."""
    if unknown := reading.keys() - TreeOptions.__optional_keys__:
        raise TypeError(f"unknown option {min(unknown)}")
    draft = Draft(file, year=reading.get("year"))
    main = _Source(file, draft, [], os.path.realpath(file), text, shown)
    _read_all(main, confined=reading.get("confine_imports", False))
    if not draft.nodes:
        raise NoTree(draft)
    draft.carry_out_prunes()
    return draft


def parse_file(path: os.PathLike[str] | str, **reading: Unpack[TreeOptions]) -> Draft:
    """Return the draft of a file and its imports; raises `OSError` and the errors of `parse`.

    With `confine_imports` the file, too, is a regular one in its folder, and no link out of it. Errors
    quote a file of another suffix than those of trees only after its first statement.
    """
    draft = parse_file_as_written(path, **reading)
    read_dynamic_gates(draft, strict=reading.get("strict_galileo", False))
    return draft


def parse_as_written(text: str, file: str = "<text>", **reading: Unpack[TreeOptions]) -> Draft:
    """Return the draft as `parse` does, but with Galileo's dynamic gates as they are written.

    >>> parse_as_written("t wsp a b;").nodes["t"].gates[0].value.dynamic
    'wsp'
    """
    return _draft(text, file, shown=True, **reading)


def parse_file_as_written(path: os.PathLike[str] | str, **reading: Unpack[TreeOptions]) -> Draft:
    """Return the draft as `parse_file` does, but with Galileo's dynamic gates as they are written."""
    name = os.fspath(path)
    folder = Path(name).parent if reading.get("confine_imports", False) else None
    return _draft(file_text(name, folder), name, shown=False, **reading)


def file_text(name: str, within: Path | None = None) -> str:
    """Return the text of a file of trees, `within` a folder if that is given.

    Raises `OSError` and `LanguageError`.
    """
    note_input(name)
    try:
        with Path(name).open("rb") if within is None else opened_within(within, Path(name)) as stream:
            data = stream.read(MAX_FILE + 1)  # a device has no end
    except OSError as error:
        raise OSError(error.errno, f"cannot read the file: {error.strerror}", name) from error
    except ValueError as error:  # an invalid path
        raise LanguageError(f"cannot read the file: {error}", file=name) from error
    return decoded(data, name)


def decoded(data: bytes, name: str) -> str:
    """Return the text of a file; raises `LanguageError` if it is too large or not UTF-8."""
    if len(data) > MAX_FILE:
        raise LanguageError(f"the file is larger than {MAX_FILE // 1024**2} MiB, the limit for trees", file=name)
    try:
        return data.decode("utf-8-sig")
    except UnicodeDecodeError as error:
        line = data.count(b"\n", 0, error.start) + 1
        raise LanguageError("the file is not valid UTF-8", file=name, line=line) from error


@dataclass(slots=True)
class _Source(Page):
    """A file being read: its remaining statements, and its imports."""

    identity: str
    text: str
    shown: bool = False
    """Whether any error may quote the text."""
    statements: Iterator[Statement | ImportStatement] = field(default_factory=lambda: iter(()))
    imported: list[str] = field(default_factory=list)

    def begin(self) -> "_Source":
        if self.is_document:
            from rvaft.language.other_formats import read_other_format  # noqa: PLC0415 -- imported on use

            self.draft.persistent = True
            read_other_format(self.text, self)
            return self
        self.draft.persistent |= is_galileo(self.file)
        self.statements = iter(_parse(self.text, self.file, "tree"))
        return self

    @property
    def is_document(self) -> bool:
        """Whether this is an XML document, whose errors quote nothing unless it is a tree."""
        return self.file.lower().endswith(XML) or is_document(self.text)


@no_collections()
def _read_all(main: _Source, *, confined: bool) -> None:
    """Read a file and its imports into its draft, depth first, each file once.

    The `toplevel` of the importing file takes precedence.
    """
    toplevels: dict[str, list[Located[str]]] = {}
    folder = Path(os.path.realpath(os.path.dirname(main.file)))  # noqa: PTH120 - of a text, the current folder
    open_files = [_begun(main, main, folder)]
    while open_files:
        source = open_files[-1]
        for statement in source.statements:
            if not isinstance(statement, ImportStatement):
                statement(source)
                continue
            inner = _imported(source, statement.path, open_files, folder, confined=confined)
            source.imported.append(inner.identity)
            if inner.identity not in toplevels:
                open_files.append(_begun(inner, main, folder))
                break
        else:
            inherited = (toplevel for identity in source.imported for toplevel in toplevels[identity])
            toplevels[source.identity] = source.toplevels or list(dict.fromkeys(inherited))
            open_files.pop()
    main.draft.toplevels = toplevels[main.identity]


def _is_outside(identity: str, folder: Path) -> bool:
    return not Path(identity).is_relative_to(folder)


def _begun(source: _Source, main: _Source, folder: Path) -> _Source:
    """Parse a file; errors quote no file outside the folder of the tree, and none that begins as no tree does."""
    try:
        return source.begin()
    except LanguageError as error:
        if source.shown:
            raise
        if source is not main and _is_outside(source.identity, folder):
            why = "the text of a file outside the folder of the tree is not shown"
        elif source.is_document or Path(source.identity).suffix.lower() in SUFFIXES:
            raise
        elif not _begins_as_tree(source.text, error):
            why = "the text of a file that begins as no tree does is not shown"
        else:
            raise
        what = f"this is not in the language of trees ({why})"
        raise LanguageError(what, file=error.file, line=error.line, column=error.column) from None


def _begins_as_tree(text: str, error: LanguageError) -> bool:
    """Whether a whole statement stands before the place of an error."""
    lines = text.removeprefix("\ufeff").splitlines(keepends=True)[: error.line]
    before = "".join([*lines[:-1], lines[-1][: error.column - 1]]) if lines else ""
    try:
        return bool(_parse(before[: before.rfind(";") + 1], error.file, "tree"))
    except LanguageError:
        return False


def _imported(source: _Source, path: Token, open_files: list[_Source], folder: Path, *, confined: bool) -> _Source:
    def error(message: str) -> LanguageError:
        return error_at(message, source.text.removeprefix("\ufeff"), path.start_pos or 0, source.file)

    name = os.path.join(os.path.dirname(source.file), path)  # noqa: PTH118, PTH120 - keeps "./" as written
    try:
        identity = os.path.realpath(name)
    except ValueError as inner:  # an invalid path
        raise error(f"cannot import {shown(path)}: cannot read the file: {inner}") from inner
    if confined and _is_outside(identity, folder):
        raise error(
            f"cannot import {shown(path)}: it is outside the folder of the tree; "
            "move it there, or read the tree without --confine-imports"
        )
    try:
        text = file_text(name, folder if confined else None)
    except LanguageError as inner:
        if isinstance(inner.__cause__, UnicodeDecodeError):
            raise
        raise error(f"cannot import {shown(path)}: {inner.message}") from inner
    except OSError as inner:
        raise error(f"cannot import {shown(path)}: {inner.strerror}") from inner
    if any(identity == other.identity for other in open_files):
        raise error(f"import cycle: {shown(path)} is being read already")
    return _Source(name, source.draft, [], identity, text)
