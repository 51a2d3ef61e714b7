"""What an editor shows about a text: findings, meanings, places of names, and symbols."""

from collections.abc import Iterator
from pathlib import Path
from typing import Final, NamedTuple

from rvaft.errors import LanguageError, RvaftError
from rvaft.integrations.editor.document import MAX_TEXT, Document, Region, Target
from rvaft.integrations.editor.sample_log import Sample
from rvaft.language.lexemes import Lexeme, Statement
from rvaft.language.parser import NoTree, TreeOptions, parse
from rvaft.language.words import WORDS, Sort, Word
from rvaft.model.nodes import Place
from rvaft.rules.registry import SYNTAX, check, meanings
from rvaft.rules.rule import Finding, Severity
from rvaft.support.terminal import visible

_STATEMENTS: Final = 20
"""The maximum number of statements in a hover."""


class Problem(NamedTuple):
    """A finding at a region of the text; `origin` is its place if that is in an imported file."""

    region: Region
    severity: Severity
    code: str
    message: str
    explanation: str
    origin: Target | None = None


def problems(document: Document, options: TreeOptions | None = None) -> list[Problem]:
    """Return what `rvaft check` reports about a text, also about the files that it imports.

    >>> [(one.code, one.region.start) for one in problems(Document("top or a b; a;"))]
    [('undeclared', Position(line=0, character=9))]
    """
    start = Place(document.file, 1, 1)
    if len(document.text) > MAX_TEXT:
        message = f"the text is not analysed here: it has more than {MAX_TEXT} characters"
        return [_problem(document, Finding(start, Severity.WARNING, SYNTAX, message))]
    reading: TreeOptions = {"confine_imports": document.confined, **(options or {})}
    try:
        found = check(parse(document.text, document.file, **reading))
    except LanguageError as error:
        if isinstance(error, NoTree) and error.is_part:
            return []
        place = Place(error.file, error.line, error.column)
        found = [Finding(place, Severity.ERROR, SYNTAX, error.message)]
    except RvaftError as error:
        found = [Finding(start, Severity.ERROR, SYNTAX, str(error))]
    return [_problem(document, one) for one in found]


def _problem(document: Document, finding: Finding) -> Problem:
    code = finding.code
    explanation = meanings()[code].explanation if code in meanings() and code != SYNTAX else ""
    message, origin = visible(finding.message), None
    if finding.place.file == document.file:
        region = _region(document, finding.place)
    else:
        message = f"{visible(str(finding.place))}: {message}"
        page = next((one for one in document.pages if one.file == finding.place.file), None)
        origin = Target(page.file, _region(page, finding.place)) if page is not None else None
        via = _import_of(document, finding.place.file)
        region = document.region(via.start, via.end) if via is not None else document.region(0, 0)
    return Problem(region, finding.severity, code, message, explanation, origin)


def _region(document: Document, place: Place) -> Region:
    """Return the region of the lexeme at a place, or of one character."""
    start = document.offset_of(place)
    one = document.lexeme_at(start)
    end = one.end if one is not None and one.start <= start < one.end else min(start + 1, len(document.text))
    return document.region(start, end)


def _import_of(document: Document, file: str) -> Lexeme | None:
    """Return the import that leads to a file, or the first one."""
    for one in document.imports:
        for page in document.pages:
            inner = page.file == document.imported(one)
            if inner and any(reached.file == file for reached in page.pages):
                return one
    return next(iter(document.imports), None)


class Hover(NamedTuple):
    """Markdown about a region."""

    region: Region
    markdown: str


def hover(document: Document, offset: int, sample: Sample) -> Hover | None:
    """Return the meaning of the word at an offset, or None.

    >>> print(hover(Document("top sand a b;"), 5, Sample()).markdown)
    `sand a b`: all children occur, from left to right
    """
    one = document.lexeme_at(offset)
    if one is None:
        return None
    match one.sort:
        case Sort.NODE:
            parts = _about_node(document, one.name, sample)
        case Sort.EVENT:
            parts = _about_event(document, one.name, sample)
        case _:
            word = meaning(one)
            parts = [f"`{word.usage}`: {word.meaning}"] if word else []
    return Hover(document.region(one.start, one.end), "\n\n".join(parts)) if parts else None


def meaning(one: Lexeme) -> Word | None:
    """Return the meaning of a keyword, or None for another lexeme."""
    names = {"K_OF_N": "2of3", "VOT_K": "2of3", "PDEP": "pdep"}
    return WORDS.get(one.sort, {}).get(names.get(one.terminal, one.text))


def _defining(document: Document, sort: Sort, name: str) -> Iterator[tuple[Document, Statement]]:
    """Yield the statements about a node or an event type, in all files."""
    for page in document.pages:
        for statement in page.statements:
            if any(one.defines and one.sort is sort and one.name == name for one in statement.lexemes[:2]):
                yield page, statement


def _code(texts: list[str]) -> str:
    fence = "```"
    while any(fence in text for text in texts):
        fence += "`"
    return "\n".join([f"{fence}rvaft", *texts[:_STATEMENTS], fence])


def _about_node(document: Document, name: str, sample: Sample) -> list[str]:
    found = list(_defining(document, Sort.NODE, name))
    lexemes = [one for _, statement in found for one in statement.lexemes]
    events = [one.name for one in lexemes if one.sort is Sort.EVENT]
    texts = [page.text_of(statement) for page, statement in found]
    texts += [text for event in dict.fromkeys(events) for text in _texts(document, Sort.EVENT, event)]
    parts = [_code(texts)] if texts else []
    tree = document.tree
    pattern = tree.pattern(name) if tree is not None and name in tree.nodes else None
    if tree is not None and name in tree.nodes and pattern is not None:
        node = tree.nodes[name]
        if node.on is None:
            parts.append("The node observes its default event.")
        count = sample.count(pattern, node.when)
        parts += [f"{visible(count)}."] if count else []
    return parts


def _texts(document: Document, sort: Sort, name: str) -> list[str]:
    return [page.text_of(statement) for page, statement in _defining(document, sort, name)]


def _about_event(document: Document, name: str, sample: Sample) -> list[str]:
    texts = _texts(document, Sort.EVENT, name)
    count = ""
    if document.tree is not None and name in document.tree.events:
        count = sample.count(document.tree.events[name].pattern)
    return [*([_code(texts)] if texts else []), *([f"{visible(count)}."] if count else [])]


def definition(document: Document, offset: int) -> list[Target]:
    """Return the statements about the node or event type at an offset, or the imported file.

    >>> [found.region.start.character for found in definition(Document("top or a b; a fault;"), 7)]
    [12]
    """
    one = document.lexeme_at(offset)
    if one is None:
        return []
    if one in document.imports:
        file = document.imported(one)
        return [Target(file, Document("").region(0, 0))] if Path(file).is_file() else []
    return [target for target, found in _uses(document, one) if found.defines]


def references(document: Document, offset: int, *, declarations: bool = True) -> list[Target]:
    """Return the uses of the node or event type at an offset, in this text and what it imports."""
    one = document.lexeme_at(offset)
    if one is None:
        return []
    return [target for target, found in _uses(document, one) if declarations or not found.defines]


def _uses(document: Document, name: Lexeme) -> Iterator[tuple[Target, Lexeme]]:
    if name.sort not in (Sort.NODE, Sort.EVENT):
        return
    for page in document.pages:
        for one in page.lexemes:
            if one.sort is name.sort and one.name == name.name:
                yield page.target(one), one


class Symbol(NamedTuple):
    """A statement about a node or an event type: `sort` is NODE or EVENT."""

    name: str
    sort: Sort
    detail: str
    region: Region
    selection: Region


def symbols(document: Document) -> list[Symbol]:
    """Return the statements about nodes and event types.

    >>> [(one.name, one.detail) for one in symbols(Document("top or a b; a fault;"))]
    [('top', 'or a b'), ('a', '')]
    """
    found = []
    for statement in document.statements:
        for number, one in enumerate(statement.lexemes[:2]):
            if one.defines and one.name:
                end = number + 1
                while end < len(statement.lexemes) and statement.lexemes[end].sort in (Sort.GATE, Sort.NODE):
                    end += 1
                detail = " ".join(other.text for other in statement.lexemes[number + 1 : end])
                whole = document.region(statement.start, statement.end)
                found.append(Symbol(one.name, one.sort, detail, whole, document.region(one.start, one.end)))
    return found
