"""Addresses at which something is served, and who may ask there: hosts, origins, and what cannot be listened at.

A page in somebody's browser must not be able to speak to a server on their machine. A browser says
with `Origin` where a page comes from, and with `Host` what it was told the server is called. A name
that an attacker can point at this machine is no proof of anything, so only addresses, `localhost`
and what was allowed are taken; and an origin only with the port that the request went to, since
other servers have other pages.
"""

import errno
import os
import re
import socket
from collections.abc import Collection, Sequence
from ipaddress import ip_address
from typing import Final
from urllib.parse import urlsplit

from rvaft.errors import OptionError

LOCAL: Final = "127.0.0.1"
"""Reached from this machine alone."""
_PORTS: Final = {"http": 80, "https": 443}
"""The schemes of web pages, and the ports that their origins do not name."""
_ADDRESS: Final = re.compile(r"[0-9A-Fa-f.:]+(?:%[A-Za-z0-9._-]+)?")
_NAME: Final = re.compile(r"(?!-)[A-Za-z0-9_-]{1,63}(?<!-)(?:\.(?!-)[A-Za-z0-9_-]{1,63}(?<!-))*\.?")
_NUMBER: Final = re.compile(r"(?:.*\.)?(?:[0-9]+|0[xX][0-9A-Fa-f]*)\.?")
"""The system reads `0` and `0x7f.1` as addresses, the first as all of this machine; no name ends so."""


def require_host(text: str) -> None:
    """Raise `OptionError` for what is no IP address and no host name (RFC 1123, and `_`, which containers have)."""
    if not is_address(text) and (len(text) > 253 or not _NAME.fullmatch(text) or _NUMBER.fullmatch(text)):
        raise OptionError(f'"{text}" is no IP address and no host name: write it alone, as in 127.0.0.1 or robot.local')


def is_address(text: str) -> bool:
    """Whether a text is an IP address, of IPv6 also with a zone."""
    try:
        return bool(_ADDRESS.fullmatch(text) and ip_address(text))
    except ValueError:
        return False


def origin(text: str) -> str:
    """An origin as a browser sends it.

    A final slash and the scheme's own port are dropped; raises `OptionError` for what is none.
    """
    try:
        parts = urlsplit(text.lower())
        name, port = parts.hostname or "", parts.port
        require_host(name)
    except ValueError:  # an `OptionError` is one
        parts, name, port = urlsplit(""), "", None
    number = "" if port in (None, _PORTS.get(parts.scheme)) else f":{port}"
    plain = f"{parts.scheme}://{f'[{name}]' if ':' in name else name}"
    if parts.scheme not in _PORTS or text.lower().removesuffix("/") not in (f"{plain}{number}", f"{plain}:{port}"):
        raise OptionError(f'"{text}" is no origin: write http:// or https://, a host and, where there is one, a port')
    return f"{plain}{number}"


def allowed(origins: Sequence[str], host: str | None, extra: Collection[str]) -> bool:
    """Whether a request with these `Origin` headers and this `Host` header is taken.

    `extra` are allowed, as `origin` gives them.
    """
    if len(origins) != 1 or origins[0].lower() in extra:
        return len(origins) < 2
    return host is not None and origins[0] == f"http://{host}" and own([host], ())  # nothing that is looked up


def own(hosts: Sequence[str], extra: Collection[str]) -> bool:
    """Whether a request with these `Host` headers asks for this server by an address, as
    `localhost`, or as the host of one of these origins.
    """
    if len(hosts) != 1:
        return False
    try:
        name = urlsplit(f"//{hosts[0]}").hostname or ""
    except ValueError:
        return False
    known = {urlsplit(one).hostname for one in extra}
    return name == "localhost" or is_address(name) or name in known


def unavailable(error: OSError, url: str) -> OSError:
    """The error of an address that cannot be listened at, with what to do."""
    code = error.errno or 0
    remedy = {
        errno.EADDRINUSE: "the port is in use: choose another with --port",
        errno.EACCES: "not permitted: choose a --port above 1023",
        errno.EADDRNOTAVAIL: "no address of this machine: choose another --host",
    }
    unknown = f"no such host: {error.strerror}" if isinstance(error, socket.gaierror) else os.strerror(code)
    return OSError(code, remedy.get(code, unknown), url)
