"""Common slips in statements and names: one function each; the first that knows something speaks."""

import re
from collections.abc import Callable
from dataclasses import dataclass
from difflib import get_close_matches
from typing import Final, NamedTuple, TypeAlias

from lark.exceptions import UnexpectedCharacters, UnexpectedInput, UnexpectedToken

from rvaft.errors import LanguageError
from rvaft.language.words import CLAUSES, DYNAMIC, GATES, OPERATORS, RESERVED, STATEMENTS, TOPIC, expectation, shown
from rvaft.support.terminal import visible

# A second, tolerant look at a text that did not parse: what stands around the place where it went wrong.

_LEXEME: Final = re.compile(
    r"""(?P<skip>\s+|//[^\n]*|\#[^\n]*|/\*.*?\*/)
      | "[^"\\\n]*(?:\\.[^"\\\n]*)*"
      | \w+
      | == | != | <= | >= | && | \|\| | <> | =< | => | .""",
    re.VERBOSE | re.DOTALL,
)


@dataclass(frozen=True, slots=True)
class Lexeme:
    """A piece of text: a string with its quotes, a word or number, a sign; the empty text stands for the end."""

    text: str
    start: int
    line: int

    @property
    def end(self) -> int:
        """The position after the piece."""
        return self.start + len(self.text)

    @property
    def is_word(self) -> bool:
        """Whether it is a word (and no number)."""
        return self.text[:1].isalpha() or self.text[:1] == "_"

    @property
    def is_name(self) -> bool:
        """Whether it is a word or a string."""
        return self.is_word or (len(self.text) > 1 and self.text[0] == '"')


@dataclass(frozen=True, slots=True)
class Situation:
    """Where a text went wrong: the statement so far, what cannot stand there, what follows, what could stand there."""

    before: tuple[Lexeme, ...]
    bad: Lexeme
    after: tuple[Lexeme, ...]
    possible: frozenset[str]

    def can(self, *terminals: str) -> bool:
        """Whether all these terminals could stand there."""
        return self.possible.issuperset(terminals)

    @property
    def last(self) -> Lexeme | None:
        """The piece before the bad one."""
        return self.before[-1] if self.before else None

    @property
    def new_line(self) -> bool:
        """Whether the bad piece stands on a later line than the one before it."""
        return self.last is not None and self.last.line < self.bad.line


def situation(text: str, position: int, possible: frozenset[str]) -> Situation:
    """What stands around a position of a text; the end of the text where nothing follows."""
    before: list[Lexeme] = []
    around: list[Lexeme] = []
    line = 1
    for found in _LEXEME.finditer(text):
        piece = found.group()
        if found.lastgroup != "skip":
            lexeme = Lexeme(piece, found.start(), line)
            if found.end() <= position:
                before.append(lexeme)
                if piece == ";":
                    before.clear()
            else:
                around.append(lexeme)
                if len(around) == 3:
                    break
        line += piece.count("\n")
    bad = around[0] if around else Lexeme("", len(text), line)
    return Situation(tuple(before), bad, tuple(around[1:]), possible)


# What the advice on common slips has in common: what is told, and which word may have been meant.


class Advice(NamedTuple):
    """What to tell, and the position in the text that it is about."""

    message: str
    position: int


Hint: TypeAlias = Callable[[Situation], Advice | None]
"""A function that knows one slip: what to tell about it where it is met, else None."""


def meant(word: str, known: tuple[str, ...]) -> str | None:
    """The known word that a misspelt one comes close to."""
    if len(word) > 20:  # difflib would take its time
        return None
    if word.lower() in known:
        return word.lower()
    for candidate in known:
        if sorted(word) == sorted(candidate):  # letters swapped, which difflib finds too far away in short words
            return candidate
    return next(iter(get_close_matches(word, known, 1, 0.75)), None)


_VOTE: Final = re.compile(r"[0-9]+of[0-9]+|vot[0-9]+")


def _gate(lexeme: Lexeme) -> bool:
    return lexeme.text in GATES or _VOTE.fullmatch(lexeme.text) is not None


def _dynamic_gate(at: Situation) -> Advice | None:
    """Gates of Galileo and its relatives that are refused, also in the form `pdep=0.2`."""
    statement = (*at.before, at.bad)
    if len(statement) < 2 or not statement[0].is_name or statement[0].text in RESERVED:
        return None
    gate = statement[1]
    if gate.text.lower() not in DYNAMIC:
        return None
    name = shown(statement[0].text.strip('"'))
    return Advice(f"the gate {shown(gate.text)} of {name} has no meaning here yet", gate.start)


def _vote(at: Situation) -> Advice | None:
    if not at.can("K_OF_N") or not at.bad.text[:1].isdigit():
        return None
    found = re.match(r"([0-9]+)of([0-9]+)", "".join(x.text for x in (at.bad, *at.after)))
    example = f"{found[1]}of{found[2]}" if found else "2of3"
    return Advice(f"K of N is written without spaces, as in {example}", at.bad.start)


def _misspelt_statement(at: Situation) -> Advice | None:
    if len(at.before) != 1 or not at.can("K_OF_N") or not at.before[0].is_word:
        return None
    word = at.before[0].text
    known = meant(word, STATEMENTS)
    return Advice(f"unknown statement {shown(word)}: did you mean {known}?", at.before[0].start) if known else None


def _second_gate(at: Situation) -> Advice | None:
    """A gate where a child or a clause stands: a forgotten semicolon, or two gates in one statement."""
    if len(at.before) < 2 or not at.can("SEMICOLON") or at.can("PLUS"):
        return None
    name, previous = at.before[-1], at.before[-2]
    new_statement = at.can("NAME") and len(at.before) > 3 and previous.line < name.line
    if new_statement and (_gate(at.bad) or at.bad.text in DYNAMIC):
        return Advice(f"a `;` is missing after {shown(previous.text)}", previous.end)
    if not _gate(at.bad):
        return None
    if not _gate(at.before[1]):
        return Advice("the gate stands right after the name, before on, when and the rest", at.bad.start)
    if not at.can("NAME"):
        return Advice("a node has one gate, and this one has one already", at.bad.start)
    mend = f"end the statement before {shown(name.text)} with `;`, or give the inner gate a node of its own"
    return Advice(f"a node has one gate: {mend}", at.bad.start)


def _continues(at: Situation) -> bool:
    """Whether a word on a new line looks like a misspelt operator or clause and not like the name of a node."""
    if meant(at.bad.text, (*OPERATORS, *CLAUSES)) is None or not at.after:
        return False
    following = at.after[0]
    return not (_gate(following) or following.text in CLAUSES or following.text in (";", "="))


def _missing_semicolon(at: Situation) -> Advice | None:
    if not at.can("SEMICOLON") or at.last is None:
        return None
    starts = at.bad.text in (*STATEMENTS, TOPIC) or (at.new_line and at.bad.is_name and not _continues(at))
    if at.bad.text and not starts:
        return None
    return Advice(f"a `;` is missing after {shown(at.last.text)}", at.last.end)


def _unknown_gate(at: Situation) -> Advice | None:
    if len(at.before) != 1 or not at.can("K_OF_N") or not at.bad.is_word:
        return None
    if at.after and at.after[0].text[:1].isdigit():
        return Advice(f"an attribute has an equals sign: {shown(at.bad.text)[1:-1]}=…", at.bad.start)
    known = meant(at.bad.text, (*GATES, *CLAUSES))
    mend = f"did you mean {known}?" if known else "the gates are or, and, sand, sand_rl and KofN (2of3)"
    what = "word" if known in CLAUSES else "gate"
    return Advice(f"unknown {what} {shown(at.bad.text)}: {mend}", at.bad.start)


def _misspelt_word(at: Situation) -> Advice | None:
    """A word where operators, clauses or statements can go on, close to one of them."""
    possible = tuple(word for word in (*OPERATORS, *CLAUSES, "top_down", "bottom_up") if word.upper() in at.possible)
    if at.bad.is_word and (known := meant(at.bad.text, possible)):
        return Advice(f"unknown word {shown(at.bad.text)}: did you mean {known}?", at.bad.start)
    if at.last is not None and at.last.text in ("NOT", "AND", "OR") and at.can("PLUS"):
        return Advice(f"{shown(at.last.text)} is written {at.last.text.lower()}", at.last.start)
    return None


def _misspelt_clause(at: Situation) -> Advice | None:
    """`a or b whn X > 1`: the misspelt word and what follows were read as children."""
    if not at.can("NAME", "ON", "SEMICOLON") or at.bad.is_word or not at.bad.text:
        return None
    for lexeme in reversed(at.before[2:]):
        if lexeme.is_word and (known := meant(lexeme.text, CLAUSES)):
            return Advice(f"unknown word {shown(lexeme.text)}: did you mean {known}?", lexeme.start)
    return None


def _odd_name(at: Situation) -> Advice | None:
    """`B-1`, `9a`, `Überdruck` without quotes."""
    last, text = at.last, at.bad.text
    message = 'a name with other characters than letters, digits and _ is quoted: "{}"'
    if last is not None and last.is_word and last.end == at.bad.start and at.can("SEMICOLON") and not at.can("PLUS"):
        if (text and not text.isascii()) or text in ("-", ".", ":", "@", "$", "/", "\\", "+", "*", "'", "%", "~"):
            rest = at.after[0].text if at.after and at.after[0].start == at.bad.end else ""
            return Advice(message.format(visible(last.text + text + rest)), last.start)
    elif at.can("NAME") and (text[:1].isdigit() or not text.isascii()):
        return Advice(message.format(visible(text)), at.bad.start) if len(text) < 40 else None
    return None


def _reserved_name(at: Situation) -> Advice | None:
    word = at.bad.text
    if at.can("NAME") and (word in RESERVED or _VOTE.fullmatch(word)):
        message = f'expected {expectation(at.possible)}; a node named {word} is written "{word}"'
        return Advice(message, at.bad.start)
    return None


def _comma_between_children(at: Situation) -> Advice | None:
    if at.bad.text == "," and at.can("NAME", "SEMICOLON"):
        return Advice("names are separated by blanks, not by commas", at.bad.start)
    return None


STATEMENT_SLIPS: Final[tuple[Hint, ...]] = (
    _dynamic_gate,
    _vote,
    _misspelt_statement,
    _second_gate,
    _missing_semicolon,
    _unknown_gate,
    _misspelt_word,
    _misspelt_clause,
    _odd_name,
    _reserved_name,
    _comma_between_children,
)

# Common slips in guards, calls, patterns and strings: one function each; the first that knows something speaks.

_SIGNS: Final = {
    "&&": "and",
    "&": "and",
    "||": "or",
    "|": "or",
    "!": "not",
    "<>": "!=",
    "=<": "<=",
    "=>": ">=",
    "=": "==",
    "≤": "<=",
    "≥": ">=",
    "≠": "!=",
    "∧": "and",
    "∨": "or",
    "¬": "not",
}
_COMPARISONS: Final = ("==", "!=", "<=", ">=", "<", ">")


def _open_comment(at: Situation) -> Advice | None:
    last = at.last
    if at.bad.text == "/" and at.after and at.after[0].text == "*" and at.after[0].start == at.bad.end:
        return Advice("this comment has no end: it is closed by */", at.bad.start)
    if at.bad.text == "*" and last is not None and last.text == "/" and last.end == at.bad.start:
        return Advice("this comment has no end: it is closed by */", last.start)
    return None


def _bad_string(at: Situation) -> Advice | None:
    text = at.bad.text
    if text == '"':
        return Advice('this string has no end: the closing " must be on the same line', at.bad.start)
    if text.startswith('"') and any(c < " " for c in text):
        return Advice("a tab or control character in a string is written as an escape, such as \\t", at.bad.start)
    if text in ("'", "`", "‘", "’", "“", "”", "«", "»"):
        return Advice('a string is written in straight double quotes: "text"', at.bad.start)
    return None


def _chained_comparison(at: Situation) -> Advice | None:
    if at.bad.text in _COMPARISONS and at.can("PLUS") and not at.can("COMPARISON"):
        return Advice("comparisons do not chain: write `A < B and B < C`", at.bad.start)
    return None


def _foreign_sign(at: Situation) -> Advice | None:
    """`&&`, `||`, `!`, `=` and their like in a guard."""
    if at.bad.text not in _SIGNS or not (at.can("PLUS") or at.can("VARIABLE", "LPAR")):
        return None
    if at.bad.text == "=" and at.last is not None and at.last.text in _COMPARISONS:
        return Advice("equality is written ==", at.last.start)
    return Advice(f"{shown(at.bad.text)} is written {_SIGNS[at.bad.text]} here", at.bad.start)


def _lower_case_variable(at: Situation) -> Advice | None:
    if not at.can("VARIABLE") or not at.bad.is_word:
        return None
    word = at.bad.text
    if word == "not":
        return Advice("`not` binds weaker than a comparison: put parentheses around it", at.bad.start)
    bare = word.lstrip("_")
    mend = f": {bare[:1].upper()}{bare[1:]}" if bare[:1].isalpha() else ""
    message = f'{shown(word)} is no variable, which starts with a capital{mend}; for text write "{word}"'
    return Advice(message if len(word) <= 40 else "a variable starts with a capital", at.bad.start)


def _bad_number(at: Situation) -> Advice | None:
    if at.can("NUMBER") and (at.bad.text[:1].isdigit() or at.bad.text in (".", "+")):
        return Advice("a number is written as in JSON: 10, -0.5, 1e-3", at.bad.start)
    return None


def _no_arguments(at: Situation) -> Advice | None:
    if at.possible == {"LPAR"} and at.last is not None:
        name = shown(at.last.text)[1:-1]
        return Advice(f"an event type has parentheses: {name}(…), or {name}() without arguments", at.last.end)
    return None


def _trailing_comma(at: Situation) -> Advice | None:
    if at.last is not None and at.last.text == "," and at.bad.text in (")", "}", "]"):
        return Advice(f"no comma stands before {shown(at.bad.text)}", at.last.start)
    return None


LEXICAL_SLIPS: Final[tuple[Hint, ...]] = (_open_comment, _bad_string)
"""Slips that leave no lexeme to reason about; asked first."""

TERM_SLIPS: Final[tuple[Hint, ...]] = (
    _chained_comparison,
    _foreign_sign,
    _lower_case_variable,
    _bad_number,
    _no_arguments,
    _trailing_comma,
)

# Common slips in `topic` statements: one function each; the first that knows something speaks.

_EXAMPLE: Final = 'as in topic "/name" type "package.msg.Name"'


def _string(lexeme: Lexeme) -> bool:
    return lexeme.text[:1] == '"' and lexeme.is_name


def _starting(at: Situation) -> bool:
    """Whether the statement so far is the word `topic`, which no string, `type` and string follow."""
    return [lexeme.text for lexeme in at.before] == [TOPIC] and at.can("K_OF_N")


def _misspelt_topic(at: Situation) -> Advice | None:
    if len(at.before) != 1 or not _string(at.bad) or not at.after or at.after[0].text != "type":
        return None
    word = at.before[0]
    if word.text != TOPIC and meant(word.text, (TOPIC,)):
        return Advice(f"unknown statement {shown(word.text)}: did you mean {TOPIC}?", word.start)
    return None


def _bare_topic(at: Situation) -> Advice | None:
    if not _starting(at):
        return None
    if at.bad.text in ("/", "~") or (at.bad.is_word and at.after and at.after[0].text == "type"):
        return Advice(f"the name of a topic stands in quotes, {_EXAMPLE}", at.bad.start)
    return None


def _no_type(at: Situation) -> Advice | None:
    if not _starting(at) or not _string(at.bad):
        return None
    following = at.after[0] if at.after else None
    if following is not None and following.text == "type":
        return Advice(f"the message type of a topic stands in quotes, {_EXAMPLE}", at.after[-1].start)
    if following is not None and following.is_word and meant(following.text, ("type",)):
        return Advice(f"unknown word {shown(following.text)}: did you mean type?", following.start)
    return Advice(f"the message type of topic {shown(at.bad.text)[1:-1]} is missing, {_EXAMPLE}", at.bad.end)


def _misspelt_from(at: Situation) -> Advice | None:
    if at.can("FROM") and not at.new_line and at.bad.is_word and meant(at.bad.text, ("from",)):
        return Advice(f"unknown word {shown(at.bad.text)}: did you mean from?", at.bad.start)
    return None


def _between_publishers(at: Situation) -> Advice | None:
    if at.can("COMMA", "SEMICOLON") and at.bad.is_name and not at.new_line:
        return Advice("publishers are separated by commas", at.bad.start)
    return None


def _bare_publisher(at: Situation) -> Advice | None:
    if not at.can("NAME") or at.bad.text not in ("/", "~") or [x.text for x in at.before[:1]] != [TOPIC]:
        return None
    text = at.bad.text + (at.after[0].text if at.after else "")
    return Advice(f'a name with other characters than letters, digits and _ is quoted: "{visible(text)}"', at.bad.start)


TOPIC_SLIPS: Final[tuple[Hint, ...]] = (
    _misspelt_topic,
    _bare_topic,
    _no_type,
    _misspelt_from,
    _between_publishers,
    _bare_publisher,
)

# From the parser library's exceptions to `LanguageError`: where, what was expected, and how to mend common slips.

_LONGEST_LINE: Final = 300
"""Above this a source line is not shown: nobody finds the caret."""


def diagnose(error: UnexpectedInput, text: str, file: str) -> LanguageError:
    """The error to raise for what the parser library reports."""
    at = situation(text, _position(error, text), _possible(error))
    for slip in (*LEXICAL_SLIPS, *TOPIC_SLIPS, *STATEMENT_SLIPS, *TERM_SLIPS):
        if advice := slip(at):
            return error_at(advice.message, text, advice.position, file)
    advice = _unexpected(at)
    return error_at(advice.message, text, advice.position, file)


def error_at(message: str, text: str, position: int, file: str) -> LanguageError:
    """A `LanguageError` about a position of a text."""
    line = text.count("\n", 0, position) + 1
    start = text.rfind("\n", 0, position) + 1
    end = text.find("\n", position)
    source = _source_line(text[start : end if end >= 0 else len(text)])
    return LanguageError(message, file=file, line=line, column=position - start + 1, source=source)


def error_in_line(message: str, text: str, line: int, column: int, file: str) -> LanguageError:
    """A `LanguageError` about a line and column of a text."""
    source = _source_line(text.split("\n", line)[line - 1])
    return LanguageError(message, file=file, line=line, column=column, source=source)


def _source_line(line: str) -> str:
    """A line as it can be shown, or nothing where it is too long."""
    line = line.rstrip("\r")
    if len(line) > _LONGEST_LINE:
        return ""
    return "".join(c if c.isprintable() or c == "\t" else "?" for c in line)


def _unexpected(at: Situation) -> Advice:
    expected = expectation(at.possible)
    if not at.bad.text:
        position = at.last.end if at.last else 0
        return Advice(f"the text ends too early: expected {expected}", position)
    return Advice(f"unexpected {shown(at.bad.text)}: expected {expected}", at.bad.start)


def _position(error: UnexpectedInput, text: str) -> int:
    match error:
        case UnexpectedToken(token=token) if token.type == "$END":
            return len(text)
        case UnexpectedToken(token=token):
            return token.start_pos or 0
        case UnexpectedCharacters():
            return error.pos_in_stream or 0
        case _:
            return len(text)


def _possible(error: UnexpectedInput) -> frozenset[str]:
    parser = getattr(error, "interactive_parser", None)
    return frozenset(parser.accepts()) if parser is not None else frozenset()
