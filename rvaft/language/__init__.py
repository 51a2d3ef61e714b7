"""The language of trees: a superset of Galileo's static part, read and written."""

from rvaft.language.expressions import guard_text, name_text, on_text, pattern_text
from rvaft.language.loading import load, loads
from rvaft.language.parser import parse_guard, parse_pattern
from rvaft.language.printer import dumps
from rvaft.language.reader import parse, parse_file

__all__ = [
    "dumps",
    "guard_text",
    "load",
    "loads",
    "name_text",
    "on_text",
    "parse",
    "parse_file",
    "parse_guard",
    "parse_pattern",
    "pattern_text",
]
