"""Where events come from: files, several by one pattern, and streams."""

import errno
import os
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import BinaryIO

from rvaft.compressed import opened

_WILD = "*?["


def expanded(name: str) -> list[str]:
    """The files that a name stands for: itself, or, where there is no such file, those that match it as a pattern.

    In a pattern `**` stands for any folders, none included. Raises `FileNotFoundError` where nothing matches.
    """
    if not any(sign in name for sign in _WILD) or os.path.lexists(name):
        return [name]
    from glob import iglob  # noqa: PLC0415 -- imported on use

    found = sorted(path for path in iglob(name, recursive=True) if not Path(path).is_dir())  # noqa: PTH207 (as typed)
    if not found:
        raise FileNotFoundError(errno.ENOENT, "no file matches the pattern", name)
    return found


@dataclass(frozen=True, slots=True)
class LogFile:
    """A file of events; `regular` is one that can be read again, and `size` its bytes on the disk."""

    name: str
    regular: bool
    size: int

    @classmethod
    def find(cls, name: str) -> "LogFile":
        """The file of that name, whether it is there or not."""
        regular = Path(name).is_file()
        return cls(name, regular, Path(name).stat().st_size if regular else 0)

    @contextmanager
    def open(self) -> Iterator[BinaryIO]:
        """Its bytes, decompressed; raises `OSError` and `ToolMissing`."""
        if Path(self.name).is_dir():
            hint = f"'{os.path.join(self.name, '*.jsonl')}'"  # noqa: PTH118 (as typed)
            raise IsADirectoryError(errno.EISDIR, f"Is a directory; name the logs in it, for example {hint}", self.name)
        with opened(Path(self.name)) as stream:
            yield stream


def place(stream: BinaryIO) -> int:
    """How many bytes of the file on the disk have been read; 0 where nobody knows."""
    inner = getattr(stream, "fileobj", stream)  # what a decompressor reads
    try:
        return int(inner.tell())
    except (OSError, ValueError, AttributeError):
        return 0
