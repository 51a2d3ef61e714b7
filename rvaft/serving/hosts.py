"""What may be named as a host: what one can connect to, not what the system reads as any address."""

import re
from ipaddress import ip_address
from typing import Final

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
