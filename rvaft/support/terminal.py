"""Output to a terminal: escaped text, aligned columns, a progress bar."""

import io
import json
import os
import re
import sys
import time
import unicodedata
from collections.abc import Callable, Iterable, Sequence
from contextlib import suppress
from itertools import zip_longest
from typing import TYPE_CHECKING, Final, TextIO

if TYPE_CHECKING:
    from rich.console import RenderableType
    from rich.progress import Progress as Bar

_JOINERS: Final = "\u200c\u200d"
"""Invisible, but parts of words in several scripts."""
_WIDEST: Final = 1_000_000
"""The width of an unlimited terminal."""


def takes_colour(stream: TextIO | None) -> bool:
    """Whether a stream is a terminal whose user has not set `NO_COLOR`."""
    plain = os.environ.get("NO_COLOR") or os.environ.get("TERM") == "dumb"
    return stream is not None and not plain and stream.isatty()


def is_hidden(character: str) -> bool:
    """Whether a character is a control, invisible or bidirectional one, which no output has raw."""
    return not (character.isprintable() or character in _JOINERS or unicodedata.category(character) == "Zs")


def escaped(text: str, escape: Callable[[str], str], *, but: str = "") -> str:
    """Return the text with hidden characters replaced by their escapes, except those in `but`."""
    if text.isprintable() or not (found := {one for one in set(text).difference(but) if is_hidden(one)}):
        return text
    return text.translate({ord(one): escape(one) for one in found})


def visible(text: str) -> str:
    """Return the text with control, invisible and bidirectional characters escaped."""
    if text.isprintable():
        return text
    found = escaped(text, lambda one: one.encode("unicode_escape").decode("ascii"))
    return found.translate({ord(one): " " for one in set(found) if unicodedata.category(one) == "Zs"})


def visible_lines(text: str) -> str:
    """Return several lines as `visible` does, with their line ends and tabs."""
    return escaped(text, lambda one: one.encode("unicode_escape").decode("ascii"), but="\n\t")


def escaped_json(text: str) -> str:
    """Return JSON text with hidden characters in strings escaped; other characters stay as they are."""
    found = escaped(text, _json_escape, but="\n")
    return found.replace("##[", r"#\u0023[") if "##[" in found else found


def _json_escape(character: str) -> str:
    units = character.encode("utf-16-be", "surrogatepass").hex()
    return "".join(f"\\u{units[at : at + 4]}" for at in range(0, len(units), 4))


def readable_json(value: object, *, indent: int | None = None) -> str:
    r"""Return a value as JSON in which letters stay readable and hidden characters are escaped.

    >>> print(readable_json({"é": "\x1b\x9b\u202e"}))
    {"é": "\u001b\u009b\u202e"}
    """
    return escaped_json(_encode(value) if indent is None else json.dumps(value, ensure_ascii=False, indent=indent))


_encode: Final = json.JSONEncoder(ensure_ascii=False).encode  # as `json.dumps`, which makes an encoder each time


def inert(text: str) -> str:
    r"""Return lines none of which GitHub Actions takes for a command, whatever names they quote.

    >>> print(inert("::add-mask::x: fine"))
    \x3a:add-mask::x: fine
    """
    if "##[" in text:
        text = text.replace("##[", r"#\x23[")
    return _COMMAND.sub(r"\1\\x3a:", text) if "::" in text else text


_COMMAND: Final = re.compile(r"^(\s*)::", re.MULTILINE)


def cut(text: str, most: int = 40) -> str:
    """Return the text, shortened if it is too long.

    >>> cut("a long story", 6)
    'a long…'
    """
    return text if len(text) <= most else f"{text[:most]}…"


def columns(rows: Iterable[Sequence[str]]) -> list[str]:
    """Return rows of cells as lines with aligned columns, never cut or wrapped."""
    from rich.cells import cell_len  # noqa: PLC0415 -- imported on use

    table = [[visible(cell) for cell in row] for row in rows]
    widths = [max(map(cell_len, cells)) for cells in zip_longest(*table, fillvalue="")]
    padded = (
        [cell + " " * (width - cell_len(cell)) for cell, width in zip(row, widths, strict=False)] for row in table
    )
    return ["  ".join(row).rstrip() for row in padded]


def rendered(things: Iterable["RenderableType"], width: int | None = None) -> list[str]:
    """Return the lines of rich renderables without colours; the default width is unlimited."""
    from rich.console import Console  # noqa: PLC0415 -- imported on use

    wide = width or _WIDEST
    console = Console(file=io.StringIO(), width=wide, color_system=None, legacy_windows=False, force_jupyter=False)
    with console.capture() as captured:
        for thing in things:
            console.print(thing)
    return [line.rstrip() for line in captured.get().splitlines()]


_PATIENCE: Final = 0.5
"""Seconds before the bar is shown."""
_PAUSE: Final = 0.1
"""Seconds between two updates."""


class ProgressBar:
    """A progress bar for long runs with a known total, on standard error if that is a terminal."""

    def __init__(self, total: int, work: str = "monitoring") -> None:
        self._work = work
        self._total = total if total and sys.stderr is not None and sys.stderr.isatty() else 0
        self._before = 0
        self._next = time.monotonic() + _PATIENCE
        self._bar: Bar | None = None

    def finish(self, size: int) -> None:
        """Record that a file of this size has been read."""
        self._before += size
        self.reach(None)

    def reach(self, stream: object) -> None:
        """Update the bar to the position of this stream, or of the file under a decompressor."""
        if not self._total or (now := time.monotonic()) < self._next:
            return
        self._next = now + _PAUSE
        if self._bar is None:
            self._bar = _bar(self._total, self._work)
        self._bar.start()
        place = 0
        with suppress(OSError, ValueError, AttributeError):
            place = int(getattr(stream, "fileobj", stream).tell())  # type: ignore[attr-defined]
        self._bar.update(self._bar.task_ids[0], completed=self._before + place, refresh=True)

    def hide(self) -> None:
        """Hide the bar until the next bytes, so that text can be printed."""
        if self._bar is not None and self._bar.live.is_started:
            self._bar.stop()


def _bar(total: int, work: str) -> "Bar":
    from rich import progress  # noqa: PLC0415 -- imported on use
    from rich.console import Console  # noqa: PLC0415 -- imported on use

    bar = progress.Progress(
        *(progress.TextColumn(work), progress.BarColumn()),
        *(progress.DownloadColumn(), progress.TimeRemainingColumn()),
        console=Console(stderr=True),
        transient=True,
        # No thread draws the bar: processes may still be forked, and printed text must not be
        # interrupted.
        auto_refresh=False,
        redirect_stdout=False,
        redirect_stderr=False,
    )
    bar.add_task("", total=total)
    return bar


def spreadsheet_cell(text: str) -> str:
    """Return a text for a cell of a CSV file, so that no spreadsheet reads it as a formula.

    >>> spreadsheet_cell("=1+2"), spreadsheet_cell("tree")
    ("'=1+2", 'tree')
    """
    return f"'{text}" if text.lstrip("'").startswith(FORMULAS) else text


FORMULAS = ("=", "+", "-", "@", "\t", "\r")
"""The beginnings of a cell that spreadsheets read as a formula."""
