"""What names, labels and values of users could break out of a text with, for the tests of every language."""

from typing import Final

INJECTIONS: Final = (
    "'; DROP TABLE events; --",
    "*/ or /*",
    "-- // #",
    "' OR '1' = '1",
    "\\' OR \\'",
    "\\",
    "'",
    '"',
    '\\"',
    "]) FOLLOWEDBY ([",
    "a: b\n- c: &d *d",
    "---\n...",
    "{{ x }} ${x} %s %(x)s",
    "}]}",
    "line\nline\r\nline\u2028line",
    "\t",
    "nul\0nul",
    "🤖 é é",
    "true",
    "null",
    "1",
    "select",
    "%_*?",
    "x_ref",
    "type",
)
"""Each is the name of a field, of a node, or a string that an event has."""
