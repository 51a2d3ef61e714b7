"""Messages for texts that are not in the language: the position, what was expected, a correction.

The first common mistake that matches the lexemes around the position determines the message.
"""

import re
from collections.abc import Iterator
from itertools import chain
from typing import Final, NamedTuple, TypeAlias

from lark.exceptions import UnexpectedCharacters, UnexpectedInput, UnexpectedToken

from rvaft.errors import LanguageError, error_at
from rvaft.language.builder import FORMATS, WHOLE_NUMBER, shown
from rvaft.language.draft import DYNAMIC_GATES
from rvaft.language.galileo import UNSUPPORTED
from rvaft.model.event_time import UNITS
from rvaft.model.expressions import CLAUSES, DYNAMIC, GATES, OPERATOR_WORDS, RESERVED, STATEMENTS, TOPIC
from rvaft.model.guards import COMPARISONS, FUNCTIONS, POINTS, Operator
from rvaft.model.verdict import Semantics
from rvaft.support.terminal import visible

_LITERALS: Final = "STRING NUMBER MINUS TRUE FALSE NULL"
_GROUPS: Final = (
    # a phrase, the terminals that it requires, and further terminals that it covers
    ("a statement", "EVENT", f"{' '.join(STATEMENTS).upper()} TOPIC NAME STRING"),
    (f"a gate ({', '.join(GATES)}, 2of3)", "K_OF_N", f"{' '.join(GATES).upper()} VOT_K"),
    ("a name", "NAME", "STRING"),
    ("a word or a string in quotes", "WORD STRING", ""),
    ("a value", "VALUE", "STRING"),
    (
        "on, when, fault, attack, label, times, within, without or key=value",
        "ON",
        "WHEN FAULT ATTACK LABEL TIMES WITHIN WITHOUT KEY",
    ),
    ("a comparison", "COMPARISON", "PLUS MINUS STAR SLASH AND OR IN"),
    ("an operator", "PLUS", "MINUS STAR SLASH AND OR"),
    *((word, word.upper(), "") for word in ("and", "or")),
    ("a condition", "NOT", f"LPAR VARIABLE DURATION POINT FUNCTION {_LITERALS}"),
    ("a pattern", "LBRACE TRUE", f"LBRACKET WORD ANY {_LITERALS}"),
    ("an argument (a Variable, _, a literal)", "ANY", f"VARIABLE {_LITERALS}"),
    ("a value", "LPAR VARIABLE", f"DURATION POINT FUNCTION {_LITERALS}"),
    ("a variable", "VARIABLE", ""),
    ("a duration (10 s, 1.5 h)", "DURATION", ""),
    ("a literal", "STRING NUMBER TRUE", "MINUS FALSE NULL"),
    ("a number", "NUMBER", ""),
    ("a word", "WORD", ""),
    ("a string in quotes", "STRING", ""),
    *((word, word.upper(), "") for word in ("when", "type", "as", "late", "from", "by")),
    *((word, word.upper(), "") for word in ("distinct", "each", "for", "after", "before")),
    ("top_down or bottom_up", "TOP_DOWN", "BOTTOM_UP"),
    ("the end", "$END", ""),
    *(
        (f"`{sign}`", name, "")
        for sign, name in zip(
            [*";,.:=(){}[]", "..."],
            [
                "SEMICOLON",
                "COMMA",
                "DOT",
                "COLON",
                "EQUALS",
                "LPAR",
                "RPAR",
                "LBRACE",
                "RBRACE",
                "LBRACKET",
                "RBRACKET",
                "DOTS",
            ],
            strict=True,
        )
    ),
)


def expectation(terminals: frozenset[str]) -> str:
    """Return what the grammar allows at a position, in words."""
    left = set(terminals)
    found: list[str] = []
    for phrase, needed, more in _GROUPS:
        if left.issuperset(needed.split()):
            found.append(phrase)
            left.difference_update(needed.split(), more.split())
    return " or ".join([", ".join(found[:-1]), found[-1]] if len(found) > 1 else found)


_LEXEME: Final = re.compile(
    r"""(?P<skip>\s+|//[^\n]*|\#[^\n]*|/\*.*?\*/)
      | "[^"\\\n]*(?:\\.[^"\\\n]*)*"
      | \w+
      | == | != | <= | >= | && | \|\| | <> | =< | => | .""",
    re.VERBOSE | re.DOTALL,
)
_VOTE: Final = re.compile(r"[0-9]+of[0-9]+|vot[0-9]+")
"""The maximum length of a source line in a message."""


class _Lexeme(NamedTuple):
    """A string with its quotes, a word, a number or a sign; empty at the start and the end."""

    text: str
    start: int
    line: int

    @property
    def end(self) -> int:
        return self.start + len(self.text)

    @property
    def is_word(self) -> bool:
        return self.text[:1].isalpha() or self.text[:1] == "_"

    @property
    def is_string(self) -> bool:
        return len(self.text) > 1 and self.text[0] == '"'

    @property
    def is_gate(self) -> bool:
        return self.text in GATES or _VOTE.fullmatch(self.text) is not None


class _Situation(NamedTuple):
    """An error: the statement so far, its last lexeme, the wrong lexeme, the next two."""

    before: tuple[_Lexeme, ...]
    last: _Lexeme
    bad: _Lexeme
    after: tuple[_Lexeme, ...]
    following: _Lexeme
    possible: frozenset[str]

    def can(self, *terminals: str) -> bool:
        return self.possible.issuperset(terminals)

    @property
    def is_on_new_line(self) -> bool:
        return self.last.line < self.bad.line

    def misspelt(self, *words: str) -> "Advice":
        known = _meant(self.bad.text, tuple(word for word in words if self.can(word.upper())))
        if self.bad.is_word and known:
            yield f"unknown word {shown(self.bad.text)}: did you mean {known}?", self.bad.start


def diagnose(error: UnexpectedInput, text: str, file: str) -> LanguageError:
    """Return the error for a report of the parser library."""
    match error:
        case UnexpectedToken(token=token) if token.type != "$END":
            position = token.start_pos or 0
        case UnexpectedCharacters():
            position = error.pos_in_stream or 0
        case _:
            position = len(text)
    parser = getattr(error, "interactive_parser", None)
    at = _situation(text, position, frozenset(parser.accepts()) if parser is not None else frozenset())
    slips = chain.from_iterable(
        find(at) for find in (_lexical_slips, _topic_slips, _time_slips, _statement_slips, _term_slips)
    )
    expected = expectation(at.possible)
    unexpected = f"unexpected {shown(at.bad.text)}: expected {expected}", at.bad.start
    early = f"the text ends too early: expected {expected}", at.last.end
    message, position = next(slips, unexpected if at.bad.text else early)
    return error_at(message, text, position, file)


def _situation(text: str, position: int, possible: frozenset[str]) -> _Situation:
    before: list[_Lexeme] = []
    around: list[_Lexeme] = []
    line = 1
    for found in _LEXEME.finditer(text):
        piece = found.group()
        if found.lastgroup != "skip":
            lexeme = _Lexeme(piece, found.start(), line)
            if found.end() > position:
                around.append(lexeme)
                if len(around) == 3:
                    break
            elif piece == ";":
                before.clear()
            else:
                before.append(lexeme)
        line += piece.count("\n")
    bad, *after = around or [_Lexeme("", len(text), line)]
    last = before[-1] if before else _Lexeme("", 0, bad.line)
    following = after[0] if after else _Lexeme("", -1, bad.line)
    return _Situation(tuple(before), last, bad, tuple(after), following, possible)


def _meant(word: str, known: tuple[str, ...]) -> str | None:
    if len(word) > 20:  # difflib is slow for long words
        return None
    if word.lower() in known:
        return word.lower()
    for candidate in known:
        if sorted(word) == sorted(candidate):  # swapped letters, which difflib rates too low in short words
            return candidate
    from difflib import get_close_matches  # noqa: PLC0415 -- imported on use

    return next(iter(get_close_matches(word, known, 1, 0.75)), None)


Advice: TypeAlias = Iterator[tuple[str, int]]
"""Messages with their positions in the text."""


def _lexical_slips(at: _Situation) -> Advice:
    bad, last = at.bad, at.last
    for sign, star in ((bad, at.following), (last, bad)):
        if (sign.text, star.text) == ("/", "*") and star.start == sign.end:
            yield "this comment has no end: it is closed by */", sign.start
    if bad.text == '"':
        yield 'this string has no end: the closing " must be on the same line', bad.start
    if bad.text.startswith('"') and any(c < " " for c in bad.text):
        yield "a tab or control character in a string is written as an escape, such as \\t", bad.start
    if bad.text in ("'", "`", "‘", "’", "“", "”", "«", "»"):
        yield 'a string is written in straight double quotes: "text"', bad.start


_TOPIC_EXAMPLE: Final = 'as in topic "/name" type "package.msg.Name"'
_NAME_IN_QUOTES: Final = 'a name with other characters than ASCII letters, digits and _ is quoted: "{}"'


def _topic_slips(at: _Situation) -> Advice:
    bad, following = at.bad, at.following
    words = [lexeme.text for lexeme in at.before]
    if words == [TOPIC] and at.can("K_OF_N"):
        if bad.text in ("/", "~") or (bad.is_word and following.text == "type"):
            yield f"the name of a topic stands in quotes, {_TOPIC_EXAMPLE}", bad.start
        if bad.is_string and following.text == "type":
            yield f"the message type of a topic stands in quotes, {_TOPIC_EXAMPLE}", at.after[-1].start
        if bad.is_string and following.is_word and _meant(following.text, ("type",)):
            yield f"unknown word {shown(following.text)}: did you mean type?", following.start
        if bad.is_string:
            yield f"the message type of topic {shown(bad.text)[1:-1]} is missing, {_TOPIC_EXAMPLE}", bad.end
    if (
        words[:1] == [TOPIC]
        and at.can("COMMA", "SEMICOLON")
        and (bad.is_word or bad.is_string)
        and not at.is_on_new_line
    ):
        yield "publishers are separated by commas", bad.start
    if at.can("NAME") and bad.text in ("/", "~") and words[:1] == [TOPIC]:
        yield _NAME_IN_QUOTES.format(visible(bad.text + following.text)), bad.start


_UNIT_NAMES: Final = {
    **dict.fromkeys(("sec", "secs", "second", "seconds", "S"), "s"),
    **dict.fromkeys(("m", "mins", "minute", "minutes", "M"), "min"),
    **dict.fromkeys(("hour", "hours", "hr", "hrs", "H"), "h"),
    **dict.fromkeys(("day", "days", "D"), "d"),
    **dict.fromkeys(("msec", "millis", "milliseconds"), "ms"),
    **dict.fromkeys(("usec", "micros", "microseconds", "µs"), "us"),
    **dict.fromkeys(("nsec", "nanos", "nanoseconds"), "ns"),
}
_MEASURE: Final = re.compile(r"(0|[1-9][0-9]*)(\w*)")


def _time_slips(at: _Situation) -> Advice:
    bad, last, following = at.bad, at.last, at.following
    goes_on = bad.is_gate or bad.text in (*CLAUSES, *DYNAMIC, ";", "") or following.text == "="
    if len(at.before) == 1 and at.can("K_OF_N") and not at.is_on_new_line and not goes_on:
        meant = {"time": following.text in ("as", "."), "semantics": bad.text in tuple(Semantics)}
        meant[TOPIC] = bad.is_string and following.text == "type"
        known = _meant(last.text, tuple(meant))
        if known is not None and known != last.text and meant[known]:
            yield f"unknown statement {shown(last.text)}: did you mean {known}?", last.start
        if last.text == "time":
            at_sign = f'"@{following.text}"' if bad.text == "@" else "FIELD"
            own = (bad.is_word or bad.is_string) and bad.text not in ("as", "in")
            field = shown(bad.text)[1:-1] if own else at_sign
            yield f"`time` declares the time field of events, as in time {field} as iso8601;", bad.start
        if last.text == "semantics":
            yield f"`semantics` is followed by one word, {', '.join(Semantics)}, and `;`", bad.start
    if at.possible == {"WORD", "STRING"} and last.text == "as":
        yield f"the format of times is one of {FORMATS}", bad.start
    if at.can("NUMBER") and last.text == "times":
        yield WHOLE_NUMBER, bad.start if bad.text else last.end
    if at.can("ON") and bad.text.isdigit() and following.text == "times":
        yield f"`times` stands before its number: times {shown(bad.text)[1:-1]}", bad.start
    if following.text[:1].isdigit():
        yield from at.misspelt("times", "within")
    unit_alone = bad.text in _UNIT_NAMES and last.text[:1].isdigit() and at.can("PLUS")
    number = last if unit_alone else bad
    if unit_alone or (at.can("DURATION") and not at.can("NUMBER") and bad.text not in ("-", ".")):
        found = _MEASURE.fullmatch(number.text) if len(number.text) < 20 and following.text != "." else None
        named = (bad.text if unit_alone else found[2] or following.text) if found else ""
        unit = named if named in UNITS else _UNIT_NAMES.get(named, "s")
        example = f"{found[1]} {unit}" if found and (not found[2] or found[2] in _UNIT_NAMES) else "10 s"
        yield f"a duration is a number and a unit, one of {', '.join(UNITS)}, as in {example}", number.start


_UNSUPPORTED: Final = {
    "inhibit": "write `and`, with the condition as a child",
    "rdep": "it changes failure rates, and a monitor observes failures; leave it out",
}
"""Why a gate is refused, and what to write; the others are about events that stay out."""


def _statement_slips(at: _Situation) -> Advice:
    bad, last, following = at.bad, at.last, at.following
    starts_node = len(at.before) == 1 and at.can("K_OF_N")
    name, gate, *_ = (*at.before, bad, _Lexeme("", 0, 0))
    names_node = (name.is_word or name.is_string) and name.text not in RESERVED
    # gates of Galileo and related languages
    if names_node and gate.text.lower() in DYNAMIC.difference(DYNAMIC_GATES):
        of = shown(name.text.strip('"'))
        why = _UNSUPPORTED.get(gate.text.lower(), UNSUPPORTED)
        yield f"the gate {shown(gate.text)} of {of} is not supported: {why}", gate.start
    if names_node and gate.text in DYNAMIC_GATES and bad.text == "-" and bad.start == gate.end:
        of = shown(name.text.strip('"'))
        yield f"the gate {shown(f'{gate.text}-{following.text}')} of {of} is not supported", gate.start
    if name.text == "toplevel" and last.text == gate.text and bad.text[:1].isdigit():
        yield "a root has no costs here; write them as attributes of leaves", bad.start
    if at.can("K_OF_N") and bad.text[:1].isdigit():
        found = re.match(r"([0-9]+)of([0-9]+)", "".join(x.text for x in (bad, *at.after)))
        yield f"K of N is written without spaces, as in {f'{found[1]}of{found[2]}' if found else '2of3'}", bad.start
    if starts_node and last.is_word and (known := _meant(last.text, STATEMENTS)):
        yield f"unknown statement {shown(last.text)}: did you mean {known}?", last.start
    if len(at.before) >= 2 and at.can("SEMICOLON") and not at.can("PLUS"):
        yield from _second_gate(at)
    if at.can("SEMICOLON") and at.before:
        follows_a_name = following.is_gate or following.text in ("", *CLAUSES, ";", "=")
        goes_on = not follows_a_name and _meant(bad.text, (*OPERATOR_WORDS, *CLAUSES)) is not None
        starts_line = at.is_on_new_line and (bad.is_word or bad.is_string) and not goes_on
        if not bad.text or bad.text in (*STATEMENTS, TOPIC) or starts_line:
            yield f"a `;` is missing after {shown(last.text)}", last.end
    if starts_node and bad.is_word:
        if following.text[:1].isdigit():
            yield f"an attribute has an equals sign: {shown(bad.text)[1:-1]}=…", bad.start
        known = _meant(bad.text, (*GATES, *DYNAMIC_GATES, *CLAUSES))
        mend = f"did you mean {known}?" if known else f"the gates are {', '.join(GATES)} and KofN (2of3)"
        yield f"unknown {'word' if known in CLAUSES else 'gate'} {shown(bad.text)}: {mend}", bad.start
    yield from at.misspelt(*OPERATOR_WORDS, *CLAUSES, "top_down", "bottom_up", "late", "from")
    if last.text in ("NOT", "AND", "OR") and at.can("PLUS"):
        yield f"{shown(last.text)} is written {last.text.lower()}", last.start
    if at.can("NAME", "ON", "SEMICOLON") and not bad.is_word and bad.text:  # `a or b whn X > 1`, read as children
        for lexeme in reversed(at.before[2:]):
            if lexeme.is_word and (known := _meant(lexeme.text, CLAUSES)):
                yield f"unknown word {shown(lexeme.text)}: did you mean {known}?", lexeme.start
    yield from _odd_names(at)
    if bad.text == "," and at.can("NAME", "SEMICOLON"):
        yield "names are separated by blanks, not by commas", bad.start


def _second_gate(at: _Situation) -> Advice:
    """A gate in place of a child or a clause."""
    bad, previous, name = at.bad, at.before[-2], at.before[-1]
    starts_statement = at.can("NAME") and len(at.before) > 3 and previous.line < name.line
    if starts_statement and (bad.is_gate or bad.text in DYNAMIC):
        yield f"a `;` is missing after {shown(previous.text)}", previous.end
    if bad.is_gate and not at.before[1].is_gate:
        yield "the gate stands right after the name, before on, when and the rest", bad.start
    if bad.is_gate and not at.can("NAME"):
        yield "this node already has a gate", bad.start
    if bad.is_gate:
        mend = f"end the statement before {shown(name.text)} with `;`, or give the inner gate a node of its own"
        yield f"a node has one gate: {mend}", bad.start


def _odd_names(at: _Situation) -> Advice:
    """`B-1`, `9a`, `Überdruck` and reserved words without quotes."""
    bad, last = at.bad, at.last
    if last.is_word and last.end == bad.start and at.can("SEMICOLON") and not at.can("PLUS"):
        odd = bad.text and not bad.text.isascii()
        if odd or bad.text in ("-", ".", ":", "@", "$", "/", "\\", "+", "*", "'", "%", "~"):
            rest = at.following.text if at.following.start == bad.end else ""
            yield _NAME_IN_QUOTES.format(visible(last.text + bad.text + rest)), last.start
    elif at.can("NAME") and (bad.text[:1].isdigit() or not bad.text.isascii()) and len(bad.text) < 40:
        yield _NAME_IN_QUOTES.format(visible(bad.text)), bad.start
    if at.can("NAME") and (bad.text in RESERVED or _VOTE.fullmatch(bad.text)):
        yield f'expected {expectation(at.possible)}; a node named {bad.text} is written "{bad.text}"', bad.start


_SPELLINGS: Final = ("and && & ∧", "or || | ∨", "not ! ¬", "== =", "!= <> ≠", "<= =< ≤", ">= => ≥")
_FOREIGN_SIGNS: Final = {sign: ours for ours, *signs in map(str.split, _SPELLINGS) for sign in signs}
"""Signs of other languages in a guard, with their equivalents here."""


_FUNCTIONS: Final = tuple(operator.value for operator in Operator if operator in FUNCTIONS)


def _function_slips(at: _Situation) -> Advice:
    bad, last, following = at.bad, at.last, at.following
    pieces = [lexeme.text for lexeme in (*at.before[-4:], bad, following)]
    if "in" in pieces and (bad.text in ("in", "not") or "in" in pieces[-4:-2] or pieces[-5:-3] == ["in", "("]):
        message = 'membership is written `X in (1, "a")`, or `not X in (1, "a")`: of numbers, strings and constants'
        yield message, bad.start
    calls = bad.text == "(" and last.is_word and at.can("COMPARISON")
    if bad.text == "." and last.is_word and at.can("COMPARISON") and at.after[-1:] and at.after[-1].text == "(":
        yield f"a function stands before its values: {shown(f'{following.text}({last.text}, …)')}", bad.start
    if bad.text in _FUNCTIONS and at.can("COMPARISON") and last.is_word:
        yield f"a function stands before its values: {bad.text}({shown(last.text)[1:-1]}, …)", bad.start
    if bad.text == "IN" and at.can("IN"):
        yield "`IN` is written in", bad.start
    if at.possible == {"LPAR"} and last.text in _FUNCTIONS:
        yield f"a function has parentheses: {last.text}(…)", last.end
    if at.possible == {"LPAR"} and last.text in POINTS and "when" in {lexeme.text for lexeme in at.before}:
        yield f"a time point needs a node: {last.text}(NODE)", last.end
    if bad.text == "*" and len(at.before) > 3 and [lexeme.text for lexeme in at.before[-4:-2]] == ["like", "("]:
        yield 'the pattern of like stands in quotes: "*"', bad.start
    if at.can("COMMA", "RPAR", "PLUS") and (bad.is_word or bad.is_string or bad.text[:1].isdigit()):
        yield "the values of a function are separated by commas", bad.start
    word = last if calls else bad
    if calls or (at.can("VARIABLE", "LPAR") and bad.is_word and following.text == "("):
        meant = _meant(word.text, _FUNCTIONS)
        known = f"there are {', '.join(_FUNCTIONS)}, and the times {', '.join(POINTS)} of nodes"
        mend = f"did you mean {meant}(…)?" if meant else known
        yield f"unknown function {shown(word.text)}: {mend}", word.start


def _term_slips(at: _Situation) -> Advice:
    bad, last, following = at.bad, at.last, at.following
    if bad.text in COMPARISONS and at.can("PLUS") and not at.can("COMPARISON"):
        yield "comparisons do not chain: write `A < B and B < C`", bad.start
    if bad.text in _FOREIGN_SIGNS and (at.can("PLUS") or at.can("VARIABLE", "LPAR")):
        if bad.text == "=" and last.text in COMPARISONS:
            yield "equality is written ==", last.start
        yield f"{shown(bad.text)} is written {_FOREIGN_SIGNS[bad.text]} here", bad.start
    yield from _function_slips(at)
    if at.can("VARIABLE") and bad.text == "not":
        yield "`not` binds weaker than a comparison: put parentheses around it", bad.start
    if at.can("VARIABLE") and bad.is_word:
        bare = bad.text.lstrip("_")
        mend = f": {bare[:1].upper()}{bare[1:]}" if bare[:1].isalpha() else ""
        message = f'{shown(bad.text)} is not a variable, which starts with a capital{mend}; for text write "{bad.text}"'
        yield message if len(bad.text) <= 40 else "a variable starts with a capital", bad.start
    if (bad.text == "." == following.text) or last.text == "..." or [one.text for one in at.before[-3:]] == [*"..."]:
        yield "dots stand on both sides of one pattern: `[..., P, ...]`, a list in which some item matches P", bad.start
    if at.can("NUMBER") and (bad.text[:1].isdigit() or bad.text in (".", "+")):
        yield "a number is written as in JSON: 10, -0.5, 1e-3", bad.start
    if at.possible == {"LPAR"} and at.before:
        name = shown(last.text)[1:-1]
        yield f"an event type has parentheses: {name}(…), or {name}() without arguments", last.end
    if last.text == "," and bad.text in (")", "}", "]"):
        yield f"no comma stands before {shown(bad.text)}", last.start
