"""Common slips in statements and names: one function each; the first that knows something speaks."""

import re
from typing import Final

from rvaft.language.advice import Advice, Hint, meant
from rvaft.language.lexemes import Lexeme, Situation
from rvaft.language.words import CLAUSES, DYNAMIC, GATES, OPERATORS, RESERVED, STATEMENTS, TOPIC, expectation, shown
from rvaft.printable import visible

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
