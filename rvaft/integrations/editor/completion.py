"""What can be written at a place of a text: the grammar decides which words, names and values."""

from collections.abc import Iterator, Mapping, Sequence
from typing import Final, NamedTuple

from rvaft.integrations.editor.document import Document
from rvaft.integrations.editor.sample_log import Sample
from rvaft.language.lexemes import GATES, Lexeme, Statement, accepted, patterns, words_of
from rvaft.language.words import WORDS, Sort
from rvaft.model.event_time import TimeFormat
from rvaft.model.expressions import name_text, word_text
from rvaft.model.nodes import Assumption, ValueType
from rvaft.model.verdict import Semantics

MOST: Final = 500
"""The maximum number of proposals."""
_SORTS: Final[Mapping[str, Sort]] = {
    **dict.fromkeys(("POINT", "FUNCTION"), Sort.FUNCTION),
    **dict.fromkeys(("NOT", "IN"), Sort.OPERATOR),
    **dict.fromkeys(("TRUE", "FALSE", "NULL"), Sort.CONSTANT),
}
_FORCED: Final = {word.lower(): word for word in ("TIME", "SEMANTICS", "ASSUME", "SHOW")}
"""Keywords that only the words after them make keywords."""


class Proposal(NamedTuple):
    """A text that can replace that from `start` to `end`; `detail` is its meaning."""

    label: str
    sort: Sort
    start: int
    end: int
    detail: str = ""


class _Place(NamedTuple):
    """A place in a statement: the lexemes before it, and the bounds of the word at it."""

    before: tuple[Lexeme, ...]
    start: int
    end: int
    accepts: frozenset[str]

    def ends_with(self, *terminals: str) -> bool:
        """Whether the last lexemes have these terminals."""
        return tuple(one.terminal for one in self.before[-len(terminals) :]) == terminals


def proposals(document: Document, offset: int, sample: Sample) -> list[Proposal]:
    """Return what can be written at an offset, each text once.

    >>> text = "top or a b; a w"
    >>> [one.label for one in proposals(Document(text), len(text), Sample())][:3]
    ['when', 'within', 'without']
    """
    found: dict[str, Proposal] = {}
    for place in _places(document, offset):
        word = document.text[place.start : offset]
        for one in _proposed(document, place, sample):
            plain = one.label.lstrip('"').lower()
            if plain.startswith(word.lstrip('"').lower()):
                found.setdefault(one.label, one)
            if len(found) >= MOST:
                break
    return list(found.values())


def _places(document: Document, offset: int) -> Iterator[_Place]:
    """Yield the readings of the text before an offset; two where the first word may be a keyword."""
    statement = next((one for one in document.statements if one.start <= offset <= one.end), None)
    if statement is None:  # after the last lexeme of a statement without its end, or between two
        earlier = [one for one in document.statements if one.end < offset]
        last = earlier[-1] if earlier else None
        statement = last if last is not None and last.lexemes[-1].terminal != "SEMICOLON" else None
    elif statement.end == offset and statement.lexemes[-1].terminal == "SEMICOLON":
        statement = None
    before = tuple(one for one in (statement.lexemes if statement else ()) if one.end <= offset)
    around = next((one for one in (statement.lexemes if statement else ()) if one.start < offset <= one.end), None)
    start = offset
    if around is not None and (around.text[:1].isalnum() or around.text[:1] in '_"'):
        start = around.start
    if (opened := _open_quote(document, statement, offset)) is not None:
        start = opened
    before = tuple(one for one in before if one.end <= start)
    end = offset + (document.text[start : start + 1] == '"' == document.text[offset : offset + 1] and start < offset)
    text = document.text[before[0].start : start] if before else ""
    if before and (forced := _FORCED.get(before[0].text)) and (found := accepted(text, forced)):
        first = before[0]._replace(terminal=forced, sort=Sort.STATEMENT)
        yield _Place((first, *before[1:]), start, end, found)
    if found := accepted(text):
        yield _Place(before, start, end, found)


def _open_quote(document: Document, statement: Statement | None, offset: int) -> int | None:
    """Return the start of a string without its end on the line of an offset."""
    for one in reversed(statement.lexemes if statement else ()):
        if one.start < offset and one.sort is Sort.ERROR and one.text == '"':
            return None if "\n" in document.text[one.start : offset] else one.start
    return None


def _proposed(document: Document, place: _Place, sample: Sample) -> Iterator[Proposal]:
    """Yield proposals: values and names first, then the words of the language."""
    first = place.before[0].terminal if place.before else ""
    accepts = place.accepts

    def of(labels: Sequence[str], sort: Sort, detail: str = "") -> Iterator[Proposal]:
        return (Proposal(label, sort, place.start, place.end, detail) for label in labels)

    if first == "EVENT":
        yield from _in_event(place, sample)
    elif first in _FORCED.values():
        yield from of(_choices(document, place, first, sample), Sort.CHOICE)
    elif place.ends_with("ON") or place.ends_with("WITHOUT") or place.ends_with("IGNORE"):
        yield from of([word_text(name) for name in _names(document, Sort.EVENT, place)], Sort.EVENT)
    else:
        if "NAME" in accepts and first not in ("TOPIC", "PARAM"):
            yield from of([name_text(name) for name in _names(document, Sort.NODE, place)], Sort.NODE)
        if "VARIABLE" in accepts:
            yield from of(_argument_values(document, place, sample), Sort.STRING)
            yield from of(list(_variables(document, place)), Sort.VARIABLE)
    for terminal in sorted(filter(accepts.__contains__, patterns()), key="DYNAMIC".__eq__):  # Galileo's last
        sort = _sort(terminal, place)
        if terminal == "K_OF_N":
            yield from of(["2of3"], Sort.GATE, WORDS[Sort.GATE]["2of3"].meaning)
        for word in words_of(terminal):
            known = WORDS[sort].get(word)
            yield Proposal(word, sort, place.start, place.end, known.meaning if known else "")


def _sort(terminal: str, place: _Place) -> Sort:
    """Return the sort of the words of a terminal at a place."""
    if not place.before:
        return Sort.STATEMENT
    if terminal in GATES:
        return Sort.GATE if len(place.before) == 1 else Sort.OPERATOR
    return _SORTS.get(terminal, Sort.CLAUSE)


def _choices(document: Document, place: _Place, first: str, sample: Sample) -> list[str]:
    """Return the words that a setting can have."""
    match first:
        case "SEMANTICS":
            return list(map(str, Semantics)) if len(place.before) == 1 else []
        case "ASSUME":
            return list(map(str, Assumption)) if "WORD" in place.accepts else []
        case "SHOW":
            return list(_variables(document, place)) if "WORD" in place.accepts else []
    if place.ends_with("AS"):
        return list(map(str, TimeFormat))
    path = [one.name for one in place.before if one.sort in (Sort.FIELD, Sort.NODE, Sort.STRING)]
    if place.ends_with("TIME") or place.ends_with("DOT"):
        return sample.fields(path)
    return []


def _in_event(place: _Place, sample: Sample) -> Iterator[Proposal]:
    """Yield types of parameters; fields and values of a pattern; and parameters."""
    names = [one.terminal for one in place.before]
    if "EQUALS" not in names:
        if place.ends_with("COLON"):
            yield from (Proposal(str(type_), Sort.CHOICE, place.start, place.end) for type_ in ValueType)
        return
    equals = names.index("EQUALS")
    path, is_field = _path(place.before[equals:])
    if is_field:
        if path is not None:
            yield from (Proposal(field, Sort.FIELD, place.start, place.end) for field in sample.fields(path))
        return
    if path is not None:
        yield from (Proposal(value, Sort.STRING, place.start, place.end) for value in sample.values(path))
    parameters = [one.text for one in place.before[:equals] if one.sort is Sort.PARAMETER]
    yield from (Proposal(name, Sort.PARAMETER, place.start, place.end) for name in parameters)


def _path(pattern: Sequence[Lexeme]) -> tuple[list[str] | None, bool]:
    """Return the path at the end of the beginning of a pattern, and whether a field is expected there.

    The path is None within a list.
    """
    path: list[str | None] = []
    brackets: list[tuple[str, int]] = []
    for number, one in enumerate(pattern):
        match one.terminal:
            case "LBRACE" | "LBRACKET":
                brackets.append((one.terminal, len(path)))
                if one.terminal == "LBRACKET":
                    path.append(None)
            case "RBRACE" | "RBRACKET" if brackets:
                del path[brackets.pop()[1] :]
            case "COMMA" if brackets and brackets[-1][0] == "LBRACE":
                del path[brackets[-1][1] :]
            case "COLON":
                path.append(pattern[number - 1].name)
    last = pattern[-1].terminal
    is_field = bool(brackets) and brackets[-1][0] == "LBRACE" and last in ("LBRACE", "COMMA")
    known = [name for name in path if name is not None]
    return (known if len(known) == len(path) else None), is_field


def _argument_values(document: Document, place: _Place, sample: Sample) -> list[str]:
    """Return the values of the parameter whose argument a place is in the call of an event type."""
    opened = [number for number, one in enumerate(place.before) if one.terminal == "LPAR"]
    if not opened or opened[-1] == 0 or place.before[opened[-1] - 1].sort is not Sort.EVENT:
        return []
    inner = place.before[opened[-1] :]
    if any(one.terminal == "RPAR" for one in inner):
        return []
    number = sum(one.terminal == "COMMA" for one in inner)
    called = place.before[opened[-1] - 1].name
    for page in document.pages:
        for statement in page.statements:
            if any(one.defines and one.sort is Sort.EVENT and one.name == called for one in statement.lexemes[:2]):
                return _values_of(statement, number, sample)
    return []


def _values_of(statement: Statement, number: int, sample: Sample) -> list[str]:
    names = [one.terminal for one in statement.lexemes]
    if "EQUALS" not in names:
        return []
    equals = names.index("EQUALS")
    parameters = [one.text for one in statement.lexemes[:equals] if one.sort is Sort.PARAMETER]
    if number >= len(parameters):
        return []
    for end in range(equals + 1, len(names)):
        one = statement.lexemes[end]
        if one.sort is Sort.PARAMETER and one.text == parameters[number]:
            path, is_field = _path(statement.lexemes[equals:end])
            return sample.values(path) if path and not is_field else []
    return []


def _others(document: Document, place: _Place) -> Iterator[Lexeme]:
    """Yield the lexemes of all files but the one that is being written."""
    for page in document.pages:
        yield from (one for one in page.lexemes if page is not document or one.start != place.start)


def _names(document: Document, sort: Sort, place: _Place) -> list[str]:
    """Return the names of nodes or event types."""
    return list(dict.fromkeys(one.name for one in _others(document, place) if one.sort is sort))


def _variables(document: Document, place: _Place) -> list[str]:
    return list(dict.fromkeys(one.text for one in _others(document, place) if one.terminal == "VARIABLE"))
