"""`rvaft traces`: example logs for a tree."""

from collections.abc import Mapping, Sequence
from dataclasses import replace
from enum import StrEnum
from pathlib import Path
from random import Random
from typing import Any, Final

import click

from cross_check.generate.disturbances import near_miss as missing
from cross_check.generate.times import apart
from cross_check.generate.traces import PLAIN, NoTraceFound, detecting, random_trace
from rvaft.api import monitor
from rvaft.backend import backend
from rvaft.cli import options
from rvaft.model.tree import resolve_semantics
from rvaft.model.values import Json
from rvaft.model.verdict import Semantics, Verdict
from rvaft.rules.validity import valid_part
from rvaft.support.files import deliver, error_context, write_whole
from rvaft.support.terminal import readable_json

DEFAULT_NUMBER: Final = 5
"""Number of traces for a folder; standard output takes one."""
RANDOM_LENGTH: Final = 10
"""Default maximum length of a random trace."""
_REDRAWS: Final = 20


class LogForm(StrEnum):
    """Formats of logs."""

    JSONL = "jsonl"
    SIGMA = "sigma"
    STIX = "stix"
    EQL = "eql"


@click.command("traces")
@options.tree_argument
@click.option("--detect", is_flag=True, help="Traces whose last event detects the tree (the default).")
@click.option("--near-miss", is_flag=True, help="Traces that do not detect the tree, one edit away from one that does.")
@click.option("--random", "chance", is_flag=True, help="Random events with fields and values of the tree.")
@options.number("-n", "wanted", text="Number of traces; default: 5 with -o, else 1.")
@options.semantics_option
@click.option("--seed", type=int, default=0, show_default=True, metavar="S", help="Seed of the random generator.")
@options.number("--length", metavar="L", text="Maximum length of a trace.")
@options.part_options
@options.choice("--format", "form", words=LogForm, default=LogForm.JSONL, text="Log format of a language.")
@options.mapping_option
@click.option("-o", "--output", metavar="DIR", help="Write DIR/detect-1.jsonl and so on instead of to standard output.")
def traces_command(
    *,
    tree: str,
    near_miss: bool,
    chance: bool,
    length: int | None,
    form: LogForm,
    mapping: Mapping[str, Any] | None,
    output: str | None,
    **given: Any,
) -> int:
    """Write example logs for a tree: N traces as JSON Lines, or in the language named by --format.

    One trace goes to standard output, several to files of a folder, which is created if necessary;
    files of the same names are replaced. The same options give the same traces.
    """
    options.exclusive(**{"detect": given["detect"], "near-miss": near_miss, "random": chance})
    folder = None if output in (None, "-") else Path(output or "")
    wanted = given["wanted"] or (DEFAULT_NUMBER if folder is not None else 1)
    options.refuse(folder is None and wanted > 1, f"{wanted} traces need a folder: name it with -o")
    part, manner = valid_part(options.load_tree(tree), given["branch"], given["kind"]), replace(PLAIN, longest=length)
    meaning = resolve_semantics(part, given["semantics"])
    options.refuse(form is LogForm.JSONL and mapping is not None, "--mapping is for --format stix")
    if form is not LogForm.JSONL:  # these languages express only `scattered`
        other = given["semantics"] not in (None, Semantics.SCATTERED)
        options.refuse(other, f"--format {form} requires the semantics scattered, the only one of {form}")
        meaning = Semantics.SCATTERED
    name = "near-miss" if near_miss else "random" if chance else "detect"

    def drawn(random: Random) -> list[Json]:
        if near_miss:
            return missing(random, part, meaning, manner).trace
        if chance:
            return random_trace(random, part, max_length=length or RANDOM_LENGTH, plain=True)
        return detecting(random, part, meaning, manner)

    def log(events: Sequence[Json]) -> str:
        if form is LogForm.JSONL:
            return "".join(f"{readable_json(event)}\n" for event in events)
        language = backend(form)
        return (language if mapping is None else language.mapped(mapping)).log(part, events)

    def make(random: Random) -> list[Json] | None:
        """Return a trace, or None if its times do not increase as the format requires."""
        events = drawn(random)
        if form is LogForm.JSONL or part.time is None:
            return events
        if (moved := apart(part, events)) is None or chance:
            return moved
        verdicts = [*monitor(part, semantics=meaning).run(moved)]
        detected = Verdict.TRUE in verdicts[-1:], Verdict.TRUE in verdicts[:-1]
        return moved if detected == (not near_miss, False) else None

    texts: list[str] = []
    for place in range(1, wanted + 1):  # one seed per trace: a larger N keeps the first traces
        random = Random(f"{given['seed']} {name} {place}")  # noqa: S311 (no secret)
        text = ""
        for _ in range(_REDRAWS):
            try:
                if (events := make(random)) is None:
                    continue
                text = log(events)
            except NoTraceFound as error:
                remedy = "another --seed" if length is None else "a larger --length or another --seed"
                raise click.ClickException(f"{click.format_filename(tree)}: {error}; try {remedy}") from error
            if events and text not in texts:
                break
        if not text and form is not LogForm.JSONL:
            why = "no trace found with increasing times in whole microseconds; try another --seed"
            raise click.ClickException(f"{click.format_filename(tree)}: {why}")
        texts.append(text)
    if folder is None:
        deliver(texts[0].encode(), output)
        return 0
    with error_context("cannot make the folder", folder):
        folder.mkdir(exist_ok=True)
    for place, text in enumerate(texts, 1):
        write_whole(
            folder / f"{name}-{place}.{'json' if form is LogForm.STIX else 'jsonl'}", text.encode(), follow=False
        )
    return 0
