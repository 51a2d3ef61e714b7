"""Messages that are no events."""

from typing import Final

BROKEN: Final[tuple[str | bytes, ...]] = (
    "",
    " ",
    "{",
    "null",
    "true",
    "7",
    '"event"',
    '[{"event": "a"}]',
    '{"event": "a"} {"event": "b"}',
    "{'event': 'a'}",
    '{"event": NaN}',
    '{"event": Infinity}',
    '{"event": 1e999}',
    '{"event": "\\ud800"}',
    '{"event": "a", "event": "b"}',
    b'{"event": "\xff"}',
    b"\xef\xbb\xbf{}",
    b"\x00",
    '{"x": ' + "9" * 900_000 + "}",
    '{"x":' * 501 + "1" + "}" * 501,
    "[" * 900_000,
)
