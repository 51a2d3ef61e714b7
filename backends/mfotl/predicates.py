"""The predicates of a text: their signature for MonPoly and VeriMon, and the facts of events.

The arguments of a predicate are its columns and the position of the event. A null column becomes
`""` or 0.
"""

import json
from collections.abc import Iterator
from decimal import Decimal
from typing import ClassVar, Final, TypeAlias
from urllib.parse import quote

from backends.event_columns import EventColumns
from rvaft.model.guards import Guard
from rvaft.model.values import Json

Column: TypeAlias = tuple[Guard, str]
"""A variable or an expression over one event, and an aspect of it."""

_TYPES: Final = {"text": "string", "kind": "string", "number": "float", "string": "string", "time": "int"}
"""Type of each aspect in a signature."""
_NULLS: Final = {"string": '""', "float": "0.0", "int": "0"}


class MfotlHeader(EventColumns):
    """The predicates of a text by name, in order."""

    comment: ClassVar[tuple[str, str]] = ("(*", "*)")

    def signature(self) -> str:
        """Return the predicates with argument types, in the format of the tools."""
        lines = []
        for name in self.fitting:
            arguments = [f"{column}: {_TYPES[one.aspect]}" for column, one in self.values.get(name, {}).items()]
            lines.append(f"{name}({', '.join([*arguments, 'position: int'])})\n")
        return "".join(lines)

    def facts(self, event: Json, position: int) -> Iterator[str]:
        """Yield the facts of an event at a position; raises `OverflowError` for inexact numbers."""
        for name, cells in self.cells(event).items():
            if cells is not None:
                aspects = (one.aspect for one in self.values.get(name, {}).values())
                arguments = map(argument, aspects, cells.values())
                yield f"{name}({','.join([*arguments, str(position)])})"


def argument(aspect: str, cell: Json) -> str:
    """Return a column value as logs and formulas write it.

    >>> argument("text", '"a b"'), argument("text", "1"), argument("number", -2.5e-7), argument("time", None)
    ('"a%20b"', '"1"', '-0.00000025', '0')
    """
    if cell is None:
        return _NULLS[_TYPES[aspect]]
    match aspect:
        case "text":
            text = json.loads(cell) if cell[0] == '"' else cell
            mark = "%22" if cell[0] == '"' and (not text or text[0] in '"-0123456789{[nft') else ""
            return f'"{mark}{quote(text, safe="", errors="surrogatepass")}"'
        case "number":
            digits = f"{Decimal(repr(float(cell))):f}"
            return digits if "." in digits else f"{digits}.0"
        case "time":
            return str(cell)
        case _:
            return f'"{cell}"'
