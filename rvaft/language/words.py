"""The words of the language, and how its terminals are called in messages to people."""

from typing import Final

from rvaft.model.expressions import GATES, STATEMENTS
from rvaft.support.terminal import visible


def shown(text: str) -> str:
    """A piece of somebody's text as it can stand in a message: marked, short, and without control characters."""
    return f"`{visible(text if len(text) <= 40 else text[:37] + '...')}`"


_PUNCTUATION: Final = {
    "SEMICOLON": "`;`",
    "COMMA": "`,`",
    "COLON": "`:`",
    "EQUALS": "`=`",
    "LPAR": "`(`",
    "RPAR": "`)`",
    "LBRACE": "`{`",
    "RBRACE": "`}`",
    "LBRACKET": "`[`",
    "RBRACKET": "`]`",
}

_GROUPS: Final = (
    # what it is called, the terminals that must be possible for it, and the terminals that it covers
    ("a statement", {"EVENT"}, {*(word.upper() for word in STATEMENTS), "TOPIC", "NAME", "STRING"}),
    (f"a gate ({', '.join(GATES)}, 2of3)", {"K_OF_N"}, {*(word.upper() for word in GATES), "K_OF_N", "VOT_K"}),
    ("a name", {"NAME"}, {"NAME", "STRING"}),
    ("a word or a string in quotes", {"WORD", "STRING"}, {"WORD", "STRING"}),
    ("a value", {"VALUE"}, {"VALUE", "STRING"}),
    ("on, when, fault, attack, label or key=value", {"ON"}, {"ON", "WHEN", "FAULT", "ATTACK", "LABEL", "KEY"}),
    ("a comparison", {"COMPARISON"}, {"COMPARISON", "PLUS", "MINUS", "TIMES", "SLASH", "AND", "OR"}),
    ("an operator", {"PLUS"}, {"PLUS", "MINUS", "TIMES", "SLASH", "AND", "OR"}),
    ("and", {"AND"}, {"AND"}),
    ("or", {"OR"}, {"OR"}),
    ("a condition", {"NOT"}, {"NOT", "LPAR", "VARIABLE", "STRING", "NUMBER", "MINUS", "TRUE", "FALSE", "NULL"}),
    (
        "a pattern",
        {"LBRACE", "TRUE"},
        {"LBRACE", "LBRACKET", "WORD", "ANY", "STRING", "NUMBER", "MINUS", "TRUE", "FALSE", "NULL"},
    ),
    (
        "an argument (a Variable, _, a literal)",
        {"ANY"},
        {"VARIABLE", "ANY", "STRING", "NUMBER", "MINUS", "TRUE", "FALSE", "NULL"},
    ),
    ("a value", {"VARIABLE"}, {"LPAR", "VARIABLE", "STRING", "NUMBER", "MINUS", "TRUE", "FALSE", "NULL"}),
    ("a number", {"NUMBER"}, {"NUMBER"}),
    ("a word", {"WORD"}, {"WORD"}),
    ("a string in quotes", {"STRING"}, {"STRING"}),
    ("when", {"WHEN"}, {"WHEN"}),
    ("type", {"TYPE"}, {"TYPE"}),
    ("from", {"FROM"}, {"FROM"}),
    ("top_down or bottom_up", {"TOP_DOWN"}, {"TOP_DOWN", "BOTTOM_UP"}),
    ("the end", {"$END"}, {"$END"}),
)


def expectation(terminals: frozenset[str]) -> str:
    """What could stand at a place, in words, given the grammar's terminals that could."""
    left = set(terminals)
    found: list[str] = []
    for phrase, needed, covered in _GROUPS:
        if needed <= left:
            found.append(phrase)
            left -= covered
    found += [_PUNCTUATION[terminal] for terminal in _PUNCTUATION if terminal in left]
    return " or ".join([", ".join(found[:-1]), found[-1]] if len(found) > 1 else found)
