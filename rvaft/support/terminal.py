"""What a terminal shows: text made safe, aligned columns, the progress of a long run."""

import io
import sys
import time
import unicodedata
from collections.abc import Iterable, Sequence
from contextlib import suppress
from typing import TYPE_CHECKING, Final

if TYPE_CHECKING:
    from rich.console import RenderableType
    from rich.progress import Progress as Bar

_JOINERS: Final = "\u200c\u200d"
"""Invisible, but parts of words in several scripts."""
_WIDEST: Final = 1_000_000
"""Columns of a terminal that is never too narrow."""


def visible(text: str) -> str:
    """The text with every character that could move, hide or reorder others on a screen written as an escape."""

    def shown(character: str) -> str:
        if character.isprintable() or character in _JOINERS:
            return character
        return " " if unicodedata.category(character) == "Zs" else character.encode("unicode_escape").decode("ascii")

    return text if text.isprintable() else "".join(map(shown, text))


def cut(text: str, most: int = 40) -> str:
    """The text, or the start of one that is too long.

    >>> cut("a long story", 6)
    'a long…'
    """
    return text if len(text) <= most else f"{text[:most]}…"


def columns(rows: Iterable[Sequence[str]]) -> list[str]:
    """Rows of cells as lines with aligned columns, two spaces between them; nothing is ever cut or wrapped."""
    from rich.table import Table  # noqa: PLC0415 -- imported on use
    from rich.text import Text  # noqa: PLC0415 -- imported on use

    table = Table.grid(padding=(0, 2))
    for row in rows:
        table.add_row(*(Text(visible(cell), no_wrap=True) for cell in row))
    return rendered([table])


def rendered(things: Iterable["RenderableType"], width: int | None = None) -> list[str]:
    """The lines of what rich draws, without colours, on a terminal of so many columns or one that
    is never too narrow.
    """
    from rich.console import Console  # noqa: PLC0415 -- imported on use

    wide = width or _WIDEST
    console = Console(file=io.StringIO(), width=wide, color_system=None, legacy_windows=False, force_jupyter=False)
    with console.capture() as captured:
        for thing in things:
            console.print(thing)
    return [line.rstrip() for line in captured.get().splitlines()]


_PATIENCE: Final = 0.5
"""Seconds after which a run is long."""
_PAUSE: Final = 0.1
"""Seconds between two drawings."""


class ProgressBar:
    """A bar on standard error; never shown where that is no terminal, where the run is short, or
    where nothing is known of its length.
    """

    def __init__(self, total: int) -> None:
        self._total = total if total and sys.stderr is not None and sys.stderr.isatty() else 0
        self._before = 0
        self._next = time.monotonic() + _PATIENCE
        self._bar: Bar | None = None

    def finish(self, size: int) -> None:
        """A file of that size has been read."""
        self._before += size
        self.reach(None)

    def reach(self, stream: object) -> None:
        """The present file has been read as far as this stream, or what a decompressor in it reads,
        knows; None is not at all.
        """
        if not self._total or (now := time.monotonic()) < self._next:
            return
        self._next = now + _PAUSE
        if self._bar is None:
            self._bar = _bar(self._total)
        self._bar.start()
        place = 0
        with suppress(OSError, ValueError, AttributeError):
            place = int(getattr(stream, "fileobj", stream).tell())  # type: ignore[attr-defined]
        self._bar.update(self._bar.task_ids[0], completed=self._before + place, refresh=True)

    def hide(self) -> None:
        """Make room for what is printed; the bar comes back with the next bytes."""
        if self._bar is not None and self._bar.live.is_started:
            self._bar.stop()


def _bar(total: int) -> "Bar":
    from rich import progress  # noqa: PLC0415 -- imported on use
    from rich.console import Console  # noqa: PLC0415 -- imported on use

    bar = progress.Progress(
        *(progress.TextColumn("monitoring"), progress.BarColumn()),
        *(progress.DownloadColumn(), progress.TimeRemainingColumn()),
        console=Console(stderr=True),
        transient=True,
        # no thread draws: processes may still be forked, and what is printed never meets it
        # half-way
        auto_refresh=False,
        redirect_stdout=False,
        redirect_stderr=False,
    )
    bar.add_task("", total=total)
    return bar
