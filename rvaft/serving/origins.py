"""Whose connections are taken: a page in somebody's browser must not be able to speak to a monitor on their machine.

A browser says with `Origin` where a page comes from. Programs say nothing there, or, like the client that ROSMonitoring uses, the
address they connect to. A name that an attacker can point at this machine is no proof of that, so only addresses, `localhost`
and what was allowed are taken.
"""

from collections.abc import Collection, Sequence
from ipaddress import ip_address
from urllib.parse import urlsplit


def allowed(origins: Sequence[str], host: str | None, extra: Collection[str]) -> bool:
    """Whether a request with these `Origin` headers and this `Host` header is taken; `extra` are origins allowed by the user."""
    match origins:
        case []:
            return True
        case [origin]:
            return origin in extra or (host is not None and origin == f"http://{host}" and _literal(host))
        case _:
            return False


def _literal(host: str) -> bool:
    """Whether a `Host` header names an IP address or `localhost`, and nothing that is looked up."""
    try:
        name = urlsplit(f"//{host}").hostname or ""
        return name == "localhost" or bool(ip_address(name))
    except ValueError:
        return False
