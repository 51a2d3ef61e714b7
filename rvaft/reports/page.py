"""Pages as one file: their templates, which share a style sheet, and their security policy."""

import re
from base64 import b64encode
from collections.abc import Iterable, Mapping
from functools import cache
from hashlib import sha256
from importlib.resources import files
from io import BytesIO
from itertools import chain
from typing import Final

_STYLE: Final = "{{STYLE}}\n"
_STYLE_AND_SCRIPT: Final = re.compile(r"<(?:style|script)>(.*?)</(?:style|script)>", re.DOTALL)


@cache
def template(name: str) -> str:
    """Return the template of a page, with the style sheet that all pages share."""
    page, style = (files("rvaft.reports").joinpath(file).read_text(encoding="utf-8") for file in (name, "page.css"))
    return page.replace(_STYLE, style)


def filled(text: str, parts: Mapping[str, Iterable[str]]) -> bytes:
    """Return a template with parts in place of their names: `{{NAME}}`.

    >>> filled("<p>{{WHO}}</p>", {"WHO": ["you", " and I"]})
    b'<p>you and I</p>'
    """
    before, *rest = text.split("{{")
    found = BytesIO()
    found.write(before.encode())
    for piece in rest:
        word, after = piece.split("}}", 1)
        for part in chain(parts[word], [after]):
            found.write(part.encode(errors="replace"))
    return found.getvalue()


@cache
def policy(name: str, *, live: bool = False) -> str:
    """Return the Content-Security-Policy of a page; the script of a `live` one asks its server."""
    style, *script = (
        f"'sha256-{b64encode(sha256(one.encode()).digest()).decode()}'"
        for one in _STYLE_AND_SCRIPT.findall(template(name))
    )
    scripts = "".join(f"; script-src {one}" for one in script)
    asking = "; connect-src 'self'" if live else ""
    return f"default-src 'none'; base-uri 'none'; form-action 'none'; img-src data:; style-src {style}{scripts}{asking}"
