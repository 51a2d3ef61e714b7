"""Addresses of servers, and the requests that a server accepts.

A foreign page in a browser must not reach a server on the user's machine. An attacker can point a
name at this machine, so only addresses, `localhost` and allowed names are accepted as `Host`. An
`Origin` must have the port of the request, since other servers have other pages.
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
_PORTS: Final = {"http": 80, "https": 443}
_ADDRESS: Final = re.compile(r"[0-9A-Fa-f.:]+(?:%[A-Za-z0-9._-]+)?")
_NAME: Final = re.compile(r"(?!-)[A-Za-z0-9_-]{1,63}(?<!-)(?:\.(?!-)[A-Za-z0-9_-]{1,63}(?<!-))*\.?")
_NUMBER: Final = re.compile(r"(?:.*\.)?(?:[0-9]+|0[xX][0-9A-Fa-f]*)\.?")
"""Texts such as `0` and `0x7f.1`, which the system reads as addresses."""


def require_host(text: str) -> None:
    """Raise `OptionError` unless the text is an IP address or a host name (RFC 1123, and `_`)."""
    if not is_address(text) and (len(text) > 253 or not _NAME.fullmatch(text) or _NUMBER.fullmatch(text)):
        raise OptionError(
            f'"{text}" is not an IP address or a host name; write only that, as in 127.0.0.1 or robot.local'
        )


def is_address(text: str) -> bool:
    """Whether a text is an IP address; IPv6 may have a zone."""
    try:
        return bool(_ADDRESS.fullmatch(text) and ip_address(text))
    except ValueError:
        return False


def origin(text: str) -> str:
    """Return an origin as a browser sends it, without a final slash and the scheme's default port.

    Raises `OptionError` for other texts.
    """
    try:
        parts = urlsplit(text.lower())
        name, port = parts.hostname or "", parts.port
        require_host(name)
    except ValueError:  # `OptionError` is a `ValueError`
        parts, name, port = urlsplit(""), "", None
    number = "" if port in (None, _PORTS.get(parts.scheme)) else f":{port}"
    plain = f"{parts.scheme}://{f'[{name}]' if ':' in name else name}"
    if parts.scheme not in _PORTS or text.lower().removesuffix("/") not in (f"{plain}{number}", f"{plain}:{port}"):
        raise OptionError(f'"{text}" is not an origin; write http:// or https://, a host and optionally a port')
    return f"{plain}{number}"


def allowed(origins: Sequence[str], host: str | None, extra: Collection[str]) -> bool:
    """Whether to accept a request with these `Origin` headers and this `Host` header.

    `extra` are allowed origins, as returned by `origin`.
    """
    if len(origins) != 1 or origins[0].lower() in extra:
        return len(origins) < 2
    return host is not None and origins[0] == f"http://{host}" and own([host], ())  # without a name look-up


def own(hosts: Sequence[str], extra: Collection[str]) -> bool:
    """Whether the `Host` headers name an address, `localhost`, or the host of an allowed origin."""
    if len(hosts) != 1:
        return False
    try:
        name = urlsplit(f"//{hosts[0]}").hostname or ""
    except ValueError:
        return False
    known = {urlsplit(url).hostname for url in extra}
    return name == "localhost" or is_address(name) or name in known


def unavailable(error: OSError, url: str) -> OSError:
    """Return the error for an unavailable address, with a correction."""
    code = error.errno or 0
    remedy = {
        errno.EADDRINUSE: "the port is in use: choose another with --port",
        errno.EACCES: "not permitted: choose a --port above 1023",
        errno.EADDRNOTAVAIL: "not an address of this machine: choose another --host",
    }
    unknown = f"no such host: {error.strerror}" if isinstance(error, socket.gaierror) else os.strerror(code)
    return OSError(code, remedy.get(code, unknown), url)
