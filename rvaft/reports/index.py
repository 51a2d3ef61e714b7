"""The page that lists the pages of several trees, with the number of detections of each."""

import re
from collections.abc import Iterable, Sequence
from html import escape
from pathlib import PurePath
from typing import Final, NamedTuple

from rvaft.reports.page import filled, policy, template
from rvaft.support.terminal import visible

INDEX: Final = "index"
"""The name of this page, which no other page has."""
PAGE: Final = "index.html"
_REFRESH: Final = '<meta http-equiv="refresh" content="2">\n'


class Row(NamedTuple):
    """A tree: the address of its page, what is detected, and how often until when."""

    name: str
    address: str
    label: str
    detections: int
    last: str


def page_names(trees: Iterable[str]) -> tuple[str, ...]:
    """Return a different name for the page of each tree, which an address may contain.

    >>> page_names(["a/frost.rvaft", "b/Frost.rvaft", "c/heat wave.rvaft"])
    ('frost', 'Frost-2', 'heat_wave')
    """
    names, taken = list[str](), {INDEX}
    for tree in trees:
        name = first = re.sub(r"[^A-Za-z0-9_-]", "_", PurePath(tree).stem) or "_"
        number = 1
        while name.lower() in taken:  # file systems may not tell cases apart
            number += 1
            name = f"{first}-{number}"
        taken.add(name.lower())
        names.append(name)
    return tuple(names)


def index_page(rows: Sequence[Row], told: Sequence[str], *, live: bool = False) -> bytes:
    """Return the page as one file, with the messages of the run; a `live` page loads itself again."""
    lines = "".join(f"<li>{escape(visible(line))}</li>\n" for line in told)
    parts = {
        "TITLE": [f"{len(rows)} trees"],
        "POLICY": [policy(PAGE)],
        "REFRESH": [_REFRESH] if live else [],
        "ROWS": ["\n".join(map(_row, rows))],
        "TOLD": [f"<section><h2>Messages</h2><ul>\n{lines}</ul></section>\n"] if told else [],
    }
    return filled(template(PAGE), parts)


def _row(row: Row) -> str:
    name, label, last = (escape(visible(text)) for text in (row.name, row.label, row.last))
    found = ' class="found"' if row.detections else ""
    link = f'<a href="{escape(row.address)}">{name}</a>'
    return f'<tr{found}><td>{link}</td><td>{label}</td><td class="number">{row.detections}</td><td>{last}</td></tr>'
