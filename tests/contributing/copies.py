"""A copy of the project in which a recipe of CONTRIBUTING.md is carried out."""

import os
import subprocess
import sys
import tomllib
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from shutil import copy2, copytree
from typing import Final, NamedTuple, TypeAlias

ROOT: Final = Path(__file__).parents[2]
FOLDERS: Final = ("rvaft", "backends", "cross_check")


class Edit(NamedTuple):
    """A text that goes into a file right after `place`, which the file has once; without a place the file is new."""

    file: str
    place: str
    text: str


Recipe: TypeAlias = Mapping[str, Sequence[Edit]]
"""The steps of a recipe by a short name."""


@dataclass(frozen=True, slots=True)
class Copy:
    """A copy of the packages; commands run in it, and import it in place of the project."""

    path: Path

    @classmethod
    def made(cls, path: Path) -> "Copy":
        """A new copy of the project in an empty folder."""
        for folder in FOLDERS:
            copytree(ROOT / folder, path / folder)
        copy2(ROOT / "pyproject.toml", path)
        return cls(path)

    def follow(self, recipe: Recipe, *, without: Iterable[str] = ()) -> "Copy":
        """Carry out a recipe but for some of its steps."""
        assert set(without) <= set(recipe), f"no such step: {set(without) - set(recipe)}"
        for name, edits in recipe.items():
            for edit in edits if name not in without else ():
                self.edit(edit)
        self._register()
        return self

    def edit(self, edit: Edit) -> None:
        """Make one edit."""
        file, place, text = self.path / edit.file, edit.place, edit.text
        before = file.read_text("utf-8") if place else ""
        assert before.count(place) == 1 or not place, f"{edit.file} has {place!r} {before.count(place)} times"
        file.write_text(before.replace(place, place + text) if place else text, "utf-8")

    def write(self, name: str, text: str) -> str:
        """A file with this text; returns its name."""
        (self.path / name).write_text(text, "utf-8")
        return name

    def rvaft(self, *words: str, stdin: str | None = None) -> subprocess.CompletedProcess[str]:
        """Run the command of the copy."""
        return self._run(["-m", "rvaft", *words], stdin)

    def python(self, code: str) -> subprocess.CompletedProcess[str]:
        """Run a program with the packages of the copy."""
        return self._run(["-c", code])

    def _run(self, words: list[str], stdin: str | None = None) -> subprocess.CompletedProcess[str]:
        environment = {**os.environ, "PYTHONPATH": str(self.path), "COLUMNS": "200"}
        return subprocess.run(
            [sys.executable, *words],
            cwd=self.path,
            env=environment,
            input=stdin,
            capture_output=True,
            text=True,
            timeout=300,
            check=False,
        )

    def _register(self) -> None:
        """Write the entry points of `pyproject.toml` where Python finds them, as `pip install -e .` does."""
        project = tomllib.loads((self.path / "pyproject.toml").read_text("utf-8"))["project"]
        found = self.path / f"rvaft-{project['version']}.dist-info"
        found.mkdir(exist_ok=True)
        lines = list[str]()
        for group, entries in project["entry-points"].items():
            lines += [f"[{group}]", *(f"{name} = {value}" for name, value in entries.items())]
        (found / "entry_points.txt").write_text("\n".join(lines), "utf-8")
        (found / "METADATA").write_text(f"Metadata-Version: 2.1\nName: rvaft\nVersion: {project['version']}\n", "utf-8")


_CONFORMANCE: Final = """
from backends.conformance import rows, run
from rvaft.backend import backend
from rvaft.semantics import Reference
for name in {names!r}:
    trees = [row for row in rows() if {about!r} in row.name]
    report = run(backend(name), Reference, required=lambda *_: False, trees=trees, words=2)
    print(report)
    assert report.passed, report
"""
"""Holds backends against the reference on the trees of the suite that are about one operator or one construct."""


def conformance(about: str, *names: str) -> str:
    """A program that fails where one of these backends fails on a row of the suite with this word in its name."""
    return _CONFORMANCE.format(names=names, about=about)
