"""Where the reports of a comparison go: what cannot be written at the end, or would cost what is there, is refused before anything runs."""

import os
from collections.abc import Iterable
from dataclasses import dataclass
from errno import EACCES, EISDIR, ENOTDIR
from pathlib import Path

from rvaft.comparison.plots import library
from rvaft.errors import OptionError


@dataclass(frozen=True, slots=True)
class Outputs:
    """The files and the folder that were asked for; `-` is standard output."""

    csv: str | None
    latex: str | None
    plots: str | None

    @property
    def files(self) -> list[str]:
        """Those that are no standard output."""
        return [file for file in (self.csv, self.latex) if file not in (None, "-")]

    def check(self, trees: Iterable[str]) -> None:
        """Raise `OptionError` for two reports in one place or one over a tree, `OSError` for what cannot be written, `ToolMissing`."""
        taken = {Path(tree).resolve() for tree in trees}
        for file in self.files:
            if (place := Path(file).resolve()) in taken:
                raise OptionError(f"{file} would be written over, but it is one of the trees: name another file")
            if Path(file).is_dir():
                raise IsADirectoryError(EISDIR, "cannot write: it is a folder; name a file", file)
            if place.is_file() or not Path(file).exists():  # a pipe or a device is written to where it is
                _check_folder(place.parent, file)
        if self.csv is not None and self.latex is not None and _same(self.csv, self.latex):
            raise OptionError("two reports go to one file")
        if self.plots is not None:
            library()
            folder = Path(self.plots).resolve()
            _check_folder(next(there for there in (folder, *folder.parents) if there.exists()), self.plots)


def _same(first: str, second: str) -> bool:
    return first == second or ("-" not in (first, second) and Path(first).resolve() == Path(second).resolve())


def _check_folder(folder: Path, output: str) -> None:
    if not folder.is_dir():
        raise NotADirectoryError(ENOTDIR, f"cannot write: {folder} is no folder", output)
    if not os.access(folder, os.W_OK | os.X_OK):
        raise PermissionError(EACCES, f"cannot write: no permission for {folder}", output)
