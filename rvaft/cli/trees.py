"""The trees of a command line: one, several that end at `--`, or those of a folder."""

import os
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path, PurePath
from typing import Final

import click

from rvaft.cli import options
from rvaft.errors import RvaftError
from rvaft.language.parser import TREES, NoTree
from rvaft.model.tree import RVAFT
from rvaft.readers.log import scheme, suffix
from rvaft.readers.registry import suffixes

ONE_BRANCH: Final = "--branch is for one tree: each tree numbers its own branches"
_LARGE: Final = 1_000_000
"""A larger file that is named as a log is not read as a tree, in bytes."""
_BEFORE: Final = "before"
"""The key of the number of arguments before `--` in the context."""


class TreesCommand(options.GroupedCommand):
    """Parses `TREE... -- LOG...`: the first argument is `tree`, the others have one name."""

    def parse_args(self, ctx: click.Context, args: list[str]) -> list[str]:
        """Parse; note how many words stand before `--`."""
        ctx.meta[_BEFORE] = self._before(ctx, args)
        return super().parse_args(ctx, args)

    def _before(self, ctx: click.Context, args: list[str]) -> int | None:
        """Return the number of arguments before `--`, or None without it."""
        for place in (place for place, word in enumerate(args) if word == "--"):
            try:
                found, _, _ = self.make_parser(ctx).parse_args(args[:place])
            except click.UsageError:  # this is the value of an option, or an option is wrong
                continue
            names = [one.name for one in self.params if isinstance(one, click.Argument) and one.nargs == -1]
            words = [value for name in names if isinstance(value := found.get(name), (tuple, list))]
            return isinstance(found.get("tree"), str) + sum(map(len, words))
        return None


def trees_given(tree: str, words: Sequence[str]) -> tuple[dict[str, str], tuple[str, ...]]:
    """Return the trees, with their folder or "", and the logs of a command line.

    Trees end at `--`. Without it, or with one argument before it, there is one TREE, or a folder of trees.
    """
    context = click.get_current_context()
    _check_tree(tree, words, context.command_path)
    before = context.meta[_BEFORE]
    several = before is not None and before > 1
    others, logs = (words[: (before or 1) - 1], words[(before or 1) - 1 :]) if several else ((), words)
    if others and not any(map(_seems_tree, others)):
        others, logs = (), words  # `--` stands among logs
    wrong = next((one for one in others if not _seems_tree(one)), None)
    options.refuse(wrong, f"before -- stand trees only ({', '.join(TREES)}), but {wrong} is none: name logs after --")
    told = f"to monitor several trees, end them with --, as in: {context.command_path} A.rvaft B.rvaft -- LOG"
    log = next((one for one in logs if PurePath(one).suffix.lower() == TREES[0]), None)
    options.refuse(log, f"{log} is a tree, where a log is expected; {told}")
    option = next((one for one in logs if one.startswith("-") and one != "-" and not os.path.lexists(one)), None)
    late = option if before is not None and (others or Path(tree).is_dir()) else None
    options.refuse(late, f"{late} stands after --, where only logs are expected: put options before it")
    given_word = context.params.get("word") is not None
    options.refuse(others and not logs and not given_word, "no log after --: name one, or - for standard input")
    return tree_files((tree, *others)), tuple(logs)


def tree_files(names: Sequence[str]) -> dict[str, str]:
    """Return the trees of these names and in these folders, with their folder or ""."""
    files: dict[str, str] = {}
    places: dict[str, str] = {}
    for given in names:
        folder = given if Path(given).is_dir() else ""
        for file in _in_folder(given) if folder else [given]:
            same = places.setdefault(os.path.realpath(file), file)
            twice = f"the tree {file} is given twice{'' if same == file else f', also as {same}'}"
            options.refuse(same != file or file in files, twice)
            files[file] = folder
    return files


def _check_tree(tree: str, words: Sequence[str], command: str) -> None:
    """Refuse a log in place of the tree, and say what leads on."""
    if tree == "-" or _seems_tree(tree) or not _seems_log(tree):
        return
    other = next(filter(_seems_tree, words), None)
    right = f"{command} {other or 'TREE'} {'LOG' if other is None else tree}"
    start = "" if other else "; rvaft infer LOG and rvaft new write a tree to start from"
    why = f"{tree} seems to be a log, and the tree comes first: {right}{start}"
    raise click.UsageError(why, click.get_current_context())


def _seems_log(name: str) -> bool:
    """Whether this is named as a log is, or a file that begins as JSON; and is no tree."""
    if scheme(name) or suffix(Path(name)) in (suffixes() | {".log"}):
        return not _is_tree(name)
    try:
        with Path(name).open("rb") as stream:
            return Path(name).is_file() and stream.read(64).lstrip(b"\xef\xbb\xbf \t\r\n")[:1] in (b"{", b"[")
    except OSError:
        return False


def _is_tree(name: str) -> bool:
    """Whether a file that is named as a log is holds a tree all the same."""
    try:
        if not Path(name).is_file() or Path(name).stat().st_size > _LARGE:
            return False
        options.read_draft(name)
    except (RvaftError, OSError):
        return False
    return True


def _seems_tree(name: str) -> bool:
    """Whether this is the name of a tree, or a folder with trees."""
    if Path(name).is_dir():
        return any(Path(name).glob(f"*{TREES[0]}"))
    return PurePath(name).suffix.lower() in TREES and not scheme(name)


def _in_folder(name: str) -> list[str]:
    """Return the trees in a folder, by name."""
    found = sorted(file for file in Path(name).iterdir() if file.suffix == TREES[0] and file.is_file())
    options.refuse(not found, f"{click.format_filename(name)}: Is a directory without a tree (*{TREES[0]})")
    return list(map(str, found))


def loaded(files: Mapping[str, str]) -> dict[str, RVAFT]:
    """Load trees; of those in a folder some may only declare what others import."""
    found: dict[str, RVAFT] = {}
    for file, folder in files.items():
        try:
            found[file] = options.load_tree(file)
        except NoTree as error:
            if not (error.is_part and folder):
                raise
    options.refuse(not found, f"{', '.join(set(files.values()))}: the files only declare what trees import")
    return found


@contextmanager
def about(name: str, *, many: bool) -> Iterator[None]:
    """Name the tree in errors, if there are several."""
    try:
        yield
    except RvaftError as error:
        if many:
            error.add_note(f"the tree is {click.format_filename(name)}")
        raise
