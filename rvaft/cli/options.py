"""Options that several commands share; `log_options` has those of logs."""

import json
import math
import os
import sys
from collections.abc import Callable, Iterable, Iterator, Mapping
from contextlib import contextmanager
from enum import StrEnum
from errno import EISDIR
from functools import partial, reduce, wraps
from pathlib import Path
from typing import Any, BinaryIO, ClassVar, Final, TypeVar, cast

import click

from rvaft.backend import UnknownBackend, backend, speaking
from rvaft.errors import OptionError, TooLarge
from rvaft.language.draft import Draft
from rvaft.language.parser import decoded, parse, parse_as_written, parse_file, parse_file_as_written
from rvaft.model.event_time import duration
from rvaft.model.nodes import Kind
from rvaft.model.tree import RVAFT
from rvaft.model.verdict import Semantics
from rvaft.rules.validity import load, loads
from rvaft.support.files import error_context, note_input, opened_within, require_folder, require_target
from rvaft.support.wording import did_you_mean

F = TypeVar("F", bound=Callable[..., Any])
Word = TypeVar("Word", bound=StrEnum)


class GroupedCommand(click.Command):
    """A command whose help has its options in `groups`: headings with the parameters of each."""

    groups: ClassVar[Mapping[str, tuple[str, ...]]] = {}
    others: ClassVar[str] = "Other options"

    def format_options(self, ctx: click.Context, formatter: click.HelpFormatter) -> None:
        """Write the options by heading, and those of no group at the end."""
        params = [one for one in self.get_params(ctx) if isinstance(one, click.Option)]
        records = {str(one.name): found for one in params if (found := one.get_help_record(ctx))}
        grouped = {name for names in self.groups.values() for name in names}
        rest = tuple(name for name in records if name not in grouped)
        for heading, names in (*self.groups.items(), (self.others if self.groups else "Options", rest)):
            if rows := [records[name] for name in names if name in records]:
                with formatter.section(heading):
                    formatter.write_dl(rows)


def number(
    *names: str, text: str, least: int = 1, most: int | None = None, default: int | None = None, metavar: str = "N"
) -> Callable[[F], F]:
    """An option with an integer value of at least `least`."""
    kind, shown = click.IntRange(least, most), default is not None
    return click.option(*names, type=kind, default=default, show_default=shown, metavar=metavar, help=text)


def choice(*names: str, words: Iterable[str], text: str, default: str | None = None) -> Callable[[F], F]:
    """An option whose value is one of these words or members."""
    kind, first = click.Choice(list(map(str, words))), None if default is None else str(default)
    member: Callable[[str], str] = words if isinstance(words, type) else str
    callback = lambda _context, _parameter, word: None if word is None else member(word)  # noqa: E731
    shown = first is not None
    return click.option(*names, type=kind, default=first, show_default=shown, callback=callback, help=text)


def output_format(*words: str, text: str = "Output format.") -> Callable[[F], F]:
    """The option `--format`; the first word is the default."""
    return choice("--format", "form", words=words, text=text, default=words[0])


def timeout_option(text: str, default: float | None = None) -> Callable[[F], F]:
    """Return the option `--timeout SECONDS`."""
    kind, shown = click.FloatRange(0, 1_000_000, min_open=True), default is not None
    return click.option(
        "--timeout", type=kind, callback=finite, default=default, show_default=shown, metavar="SECONDS", help=text
    )


flag: Final = partial(click.option, is_flag=True, default=None)
"""A Boolean option with a negative form, by default None."""
_READING: Final = {
    "strict_galileo": "Refuse dynamic gates of Galileo; by default they are read as observed failures.",
    "confine_imports": "Refuse files outside the folder of the tree, also by links.",
}


def _remember(context: click.Context, parameter: click.Parameter, value: bool | int | None) -> None:
    context.meta[str(parameter.name)] = value


_YEAR: Final[dict[str, Any]] = {
    "type": click.IntRange(1, 9999),
    "metavar": "N",
    "help": "The year of times whose format has none.",
}
year_option: Final = click.option("--year", expose_value=False, callback=_remember, **_YEAR)


def reading_options(function: F) -> F:
    """Add `--year`, `--strict-galileo` and `--confine-imports` as the last options of the help."""
    for name, text in reversed(_READING.items()):
        option = f"--{name.replace('_', '-')}"
        flag = click.option(
            option, name, is_flag=True, is_eager=True, expose_value=False, callback=_remember, help=text
        )
        function = flag(function)
    function = year_option(function)
    params: list[click.Parameter] = vars(function)["__click_params__"]  # click lists the last one first
    added = len(_READING) + 1
    params[:] = params[-added:] + params[:-added]
    return function


def tree_argument(function: F) -> F:
    """Add the argument TREE and the options for reading it."""
    return click.argument("tree", metavar="TREE")(reading_options(function))


output_option = click.option("-o", "--output", metavar="FILE", help="Write to this file instead of standard output.")
semantics_option: Final = choice(
    "--semantics",
    words=Semantics,
    text="Which events of a trace a match may use.  [default: that of the tree, else projected]",
)


def part_options(function: F) -> F:
    """Add `--branch` and `--kind`, which exclude each other and every `--per` but the first."""

    @wraps(function)
    def checked(**given: Any) -> Any:
        per = given.get("per", "tree")
        exclusive(branch=given["branch"], kind=given["kind"], per=None if per == "tree" else per)
        return function(**given)

    kind = choice("--kind", words=Kind, text="Only the branches of this kind.")
    branch = click.option("--branch", type=int, metavar="N", help="Only this branch; numbers start at 1.")
    return cast("F", branch(kind(checked)))


def _mapping(_context: object, _parameter: object, path: str | None) -> dict[str, Any] | None:
    if path is None:
        return None
    import tomllib  # noqa: PLC0415 -- imported on use

    data = read_named(path)
    try:
        text = data.decode("utf-8-sig")
        found = json.loads(text) if path.endswith(".json") else tomllib.loads(text)
    except (ValueError, RecursionError) as error:
        raise OptionError(f"{click.format_filename(path)} is not a valid mapping: {error}") from None
    if not isinstance(found, dict):
        raise OptionError(
            f"{click.format_filename(path)} is not a valid mapping: expected an object from event types to fields"
        )
    return found


mapping_option = click.option(
    "--mapping",
    metavar="FILE",
    callback=_mapping,
    help="For stix: a TOML or .json file that maps the fields of each event type to STIX object properties.",
)


def _columns(_context: object, _parameter: object, text: str | None) -> dict[str, str]:
    pairs = [pair.partition("=") for pair in text.split(",")] if text else []
    if wrong := next(("".join(pair) for pair in pairs if not (pair[0] and pair[2])), None):
        raise click.BadParameter(f"{wrong!r} is not FIELD=COLUMN")
    if len(found := {name: column for name, _, column in pairs}) < len(pairs):
        raise click.BadParameter("a field has two columns")
    return found


def table_options(function: F) -> F:
    """Add the options that describe a table of events, and pass them as `mapping`."""

    @wraps(function)
    def checked(*, table: str | None, dialect: str | None, mapping: dict[str, Any] | None, **given: Any) -> Any:
        described = {name: given.pop(name) for name in ("columns", "time", "position", "partition")}
        stated = {name: value for name, value in described.items() if value}
        if table is None:
            refuse(stated, f"--{next(iter(stated), '')} describes a table: name the table with --table")
            return function(dialect=dialect, mapping=mapping, **given)
        refuse(mapping is not None, "--table describes the columns: omit --mapping")
        language = given["language"]
        typed = language != "dot" and backend(language).language in ("sql", "kql")
        refuse(not typed, f"--table is for sql and kql, not for {language}")
        options = {"table": table, **stated, **({} if dialect is None else {"dialect": dialect})}
        return function(dialect=None, mapping=options, **given)

    every = [
        click.option(
            "--table", metavar="NAME", help="For sql and kql: a table whose columns hold the fields of events."
        ),
        click.option(
            "--columns",
            metavar="FIELD=COLUMN,...",
            callback=_columns,
            help="With --table: columns that do not have the name of their field.",
        ),
        click.option("--time", metavar="COLUMN", help=_TIME_COLUMN),
        click.option("--position", metavar="COLUMN", help=_POSITION),
        click.option("--partition", metavar="COLUMN", help="With --table: a column with one log for each value."),
    ]
    return cast("F", reduce(lambda found, option: option(found), reversed(every), checked))


_TIME_COLUMN: Final = (
    "With --table: the column of the time; COLUMN:TYPE with timestamp, double (seconds), s, ms, us or ns "
    "states its type."
)
_POSITION: Final = "With --table: the column that orders the rows.  [default: rowid in SQLite and DuckDB]"
_COOLDOWN: Final = "With --repeat: suppress detections within this event time after a reported one, as in '10 min'."


def _duration(_context: object, _parameter: object, text: str | None) -> int | None:
    try:
        return None if text is None else duration(text)
    except OptionError as error:
        raise click.BadParameter(str(error)) from None


_REPEAT_BY: Final = "As --repeat, but restart only what has the detected value of this variable."
_CLOCK: Final = "While no event comes, give the monitor the time this often: it decides `for D after`."
_COMPLETE: Final = "Take the end of a log as its end, which decides `for D after`."


def repeat_options(function: F) -> F:
    """Add `--repeat`, and `--cooldown DURATION`, which needs it."""
    repeat = click.option("--repeat", is_flag=True, help="Restart the monitor after each detection.")
    function = click.option("--repeat-by", metavar="VARIABLE", help=_REPEAT_BY)(function)
    return repeat(click.option("--cooldown", metavar="DURATION", callback=_duration, help=_COOLDOWN)(function))


clock_option: Final = click.option("--clock", metavar="DURATION", callback=_duration, help=_CLOCK)
complete_option: Final = click.option("--complete", is_flag=True, help=_COMPLETE)


def require_times(clock: int | None, trees: Iterable[RVAFT]) -> None:
    """Refuse a clock if no tree reads times."""
    timeless = clock is not None and all(tree.time is None for tree in trees)
    refuse(timeless, "--clock needs the time of events: add `time FIELD as FORMAT;` to the tree")


def deadline_options(function: F) -> F:
    """Add `--clock DURATION` and `--complete`, for `without ... after`."""
    return complete_option(clock_option(function))


def refuse(wrong: object, why: str) -> None:
    """Raise a usage error with this reason if `wrong` holds."""
    if wrong:
        raise click.UsageError(why, click.get_current_context())


def exclusive(**options: object) -> None:
    """Refuse more than one of these options."""
    given = [f"--{name}" for name, value in options.items() if value is not None and value is not False]
    refuse(len(given) > 1, f"{' and '.join(given)} exclude each other")


def require_writable(outputs: Iterable[str], trees: Iterable[str] = (), folder: str | None = None) -> None:
    """Refuse outputs that cannot be written or would overwrite an input, such as these trees.

    Raises `OSError` and `OptionError`.
    """
    for tree in trees:
        note_input(tree)
    given = list(outputs)
    places = {file: Path(os.path.realpath(file)) for file in given if file != "-"}
    if len({*places.values()}) + ("-" in given) < len(given):
        raise OptionError("two outputs name the same file")
    for file, place in places.items():
        if place.is_dir():
            raise IsADirectoryError(EISDIR, "cannot write to a folder: name a file", file)
        require_target(Path(file))
    if folder is not None:
        absolute = Path(os.path.realpath(folder))
        with error_context("cannot write", Path(folder)):
            require_folder(next(there for there in (absolute, *absolute.parents) if there.exists()))


def standard_input(argument: str) -> BinaryIO:
    """Return standard input; raises a usage error if it is closed."""
    refuse(sys.stdin is None, f"standard input is closed: name a {argument}")
    return sys.stdin.buffer


def _standard_text() -> str:
    stream = standard_input("TREE")
    try:
        return decoded(stream.read(), "<stdin>")
    except OSError as error:
        raise OSError(error.errno, f"cannot read the file: {error.strerror}", "<stdin>") from error


def is_confined() -> bool:
    """Whether `--confine-imports` is given."""
    return bool(click.get_current_context().meta.get("confine_imports"))


def read_named(path: str | Path, folder: Path | None = None) -> bytes:
    """Return the bytes of a file beside a tree; with `--confine-imports` a regular file in the folder.

    The default folder is that of the path. Raises `OSError`.
    """
    note_input(path)
    if not is_confined():
        return Path(path).read_bytes()
    with opened_within(Path(path).parent if folder is None else folder, Path(path)) as stream:
        return stream.read()


def load_tree(path: str) -> RVAFT:
    """Load a tree with the reading options; raises as `rvaft.load` does."""
    return load(path, **_reading())


def read_tree(tree: str) -> RVAFT:
    """Load a tree from a file or standard input (`-`)."""
    if tree != "-":
        return load_tree(tree)
    return loads(_standard_text(), "<stdin>", **_reading())


def read_draft(tree: str) -> Draft:
    """Parse a draft from a file or standard input (`-`)."""
    if tree != "-":
        return parse_file(tree, **_reading())
    return parse(_standard_text(), "<stdin>", **_reading())


def read_draft_as_written(tree: str) -> Draft:
    """Parse a draft, as `read_draft` does, with Galileo's dynamic gates as they are written."""
    if tree != "-":
        return parse_file_as_written(tree, **_reading())
    return parse_as_written(_standard_text(), "<stdin>", **_reading())


def _reading() -> dict[str, Any]:
    meta = click.get_current_context().meta
    return {name: bool(meta.get(name)) for name in _READING} | {"year": meta.get("year")}


_CONVERTED: Final = "{0} reads converted Sigma rules: --to sigma -o rules.yml, then sigma convert -t {1} rules.yml"
_PRODUCTS: Final = {
    "splunk": _CONVERTED.format("Splunk", "splunk"),
    "qradar": _CONVERTED.format("QRadar", "qradar-aql"),
    "loki": _CONVERTED.format("Loki", "loki"),
    "opensearch": _CONVERTED.format("OpenSearch", "opensearch_lucene"),
    **dict.fromkeys(("elastic", "elasticsearch", "kibana"), "Elastic reads EQL: --to eql"),
    **dict.fromkeys(("sentinel", "defender", "azure", "kusto"), "Microsoft Sentinel and Defender read KQL: --to kql"),
    **dict.fromkeys(("postgres", "postgresql"), "PostgreSQL reads --to sql-postgres"),
    "sqlite": "SQLite reads --to sql",
    "duckdb": "DuckDB reads --to sql-duckdb",
    "flink": "Flink reads --to match-recognize",
    "monpoly": "MonPoly reads --to mfotl",
    "reelay": "Reelay reads --to mtl",
    "r2u2": "R2U2 reads --to mtl-r2u2",
    "spot": "Spot reads --to automaton and --to ltlf",
    "ros": "ROSMonitoring runs rvaft serve and the monitors of --to rml; see rvaft rosmonitoring --help",
    "python": "in Python, rvaft.monitor(rvaft.load(TREE)) is the monitor",
}
"""The languages of products that people name, in the words of an error."""


@contextmanager
def suggesting() -> Iterator[None]:
    """Add hints to errors."""
    try:
        yield
    except UnknownBackend as error:
        meant, product = speaking(error.name), _PRODUCTS.get(error.name.lower())
        hint = f"; did you mean {meant}?" if meant else did_you_mean(error.name.removeprefix("."), error.known)
        hint = hint if product is None else f"; {product}"
        raise OptionError(f"{error}{hint}") from error
    except TooLarge as error:
        given = click.get_current_context().params
        if {"language", "limit"} <= given.keys():
            language = backend(given["language"])
            if error.limit in (given["limit"], language.default_limit, language.most_nodes):
                error.add_note("raise it with --limit N")
        raise


# callbacks of options: they convert a text, or None for a missing option


def finite(_context: object, _parameter: object, value: float | None) -> float | None:
    """Refuse NaN, which passes every range check."""
    if value is not None and math.isnan(value):
        raise click.BadParameter("NaN is not allowed")
    return value


def some(words: type[Word]) -> Callable[[object, object, str | None], tuple[Word, ...] | None]:
    """Return a callback for a list of members; `all` means all."""

    def chosen(_context: object, _parameter: object, value: str | None) -> tuple[Word, ...] | None:
        if value is None or value == "all":
            return None if value is None else tuple(words)
        named = [word.lower() for word in _words(value)] or [value]
        for wrong in [word for word in named if word not in list(words)]:
            known = f"{', '.join(words)}{did_you_mean(wrong, words)}"
            raise click.BadParameter(f"unknown {words.__name__.lower()} {wrong}; known: {known}")
        return tuple(dict.fromkeys(map(words, named)))

    return chosen


def some_backends(named: str | None) -> tuple[str, ...] | None:
    """Return the backends named in a list; raises `OptionError`."""
    if named is None:
        return None
    names = tuple(dict.fromkeys(_words(named)))
    with suggesting():
        for name in names:
            backend(name)
    return names


def _words(value: str) -> list[str]:
    return [word for part in value.split(",") if (word := part.strip())]
