"""Whose connections are taken: a page in somebody's browser must not be able to speak to a monitor on their machine.

A browser says with `Origin` where a page comes from. Programs say nothing there, or, like the client that ROSMonitoring uses, the
address they connect to. A name that an attacker can point at this machine is no proof of that, so only addresses, `localhost`
and what was allowed are taken; and of these only with the port that the request went to, since other servers have other pages.
"""

import re
from collections.abc import Collection, Sequence
from ipaddress import ip_address
from typing import Final
from urllib.parse import urlsplit

from rvaft.errors import OptionError

_LONGEST: Final = 253
_ADDRESS: Final = re.compile(r"[0-9A-Fa-f.:]+(?:%[A-Za-z0-9._-]+)?")
_NAME: Final = re.compile(r"(?!-)[A-Za-z0-9_-]{1,63}(?<!-)(?:\.(?!-)[A-Za-z0-9_-]{1,63}(?<!-))*\.?")
_NUMBER: Final = re.compile(r"(?:.*\.)?(?:[0-9]+|0[xX][0-9A-Fa-f]*)\.?")
"""The system reads `0` and `0x7f.1` as addresses, the first as all of this machine; no name ends so."""


def host(text: str) -> str:
    """A text that is an IP address or a host name (RFC 1123, and `_`, which containers have); raises `OptionError`."""
    if not is_address(text) and (len(text) > _LONGEST or not _NAME.fullmatch(text) or _NUMBER.fullmatch(text)):
        raise OptionError(f'"{text}" is no IP address and no host name: write it alone, as in 127.0.0.1 or robot.local')
    return text


def is_address(text: str) -> bool:
    """Whether a text is an IP address, of IPv6 also with a zone."""
    try:
        return bool(_ADDRESS.fullmatch(text) and ip_address(text))
    except ValueError:
        return False


_PORTS: Final = {"http": 80, "https": 443}
"""The schemes of web pages, and the ports that their origins do not name."""


def origin(text: str) -> str:
    """An origin as a browser sends it: a final slash and the scheme's own port are dropped; raises `OptionError` for what is none."""
    try:
        parts = urlsplit(text.lower())
        name, port = parts.hostname or "", parts.port
        host(name)
    except ValueError:  # an `OptionError` is one
        parts, name, port = urlsplit(""), "", None
    number = "" if port in (None, _PORTS.get(parts.scheme)) else f":{port}"
    plain = f"{parts.scheme}://{f'[{name}]' if ':' in name else name}"
    if parts.scheme not in _PORTS or text.lower().removesuffix("/") not in (f"{plain}{number}", f"{plain}:{port}"):
        raise OptionError(f'"{text}" is no origin: write http:// or https://, a host and, where there is one, a port')
    return f"{plain}{number}"


def allowed(origins: Sequence[str], host: str | None, extra: Collection[str]) -> bool:
    """Whether a request with these `Origin` headers and this `Host` header is taken; `extra` are allowed, as `origin` gives them."""
    match origins:
        case []:
            return True
        case [said]:
            return said.lower() in extra or (host is not None and said == f"http://{host}" and _literal(host))
        case _:
            return False


def _literal(host: str) -> bool:
    """Whether a `Host` header names an IP address or `localhost`, and nothing that is looked up."""
    try:
        name = urlsplit(f"//{host}").hostname or ""
    except ValueError:
        return False
    return name == "localhost" or is_address(name)
