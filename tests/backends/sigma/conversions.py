"""What pySigma's backends make of the rules of the shipped trees, run on their logs where a runner exists.

`python -m tests.backends.sigma.conversions` writes `conversions.txt` and the table in the page of
the language anew.
"""

import json
import re
import sqlite3
import subprocess
from collections.abc import Iterator, Mapping
from itertools import islice
from pathlib import Path
from typing import Any, Final

import yaml

import rvaft
from rvaft import RVAFT, LanguageError, NotExpressible, Semantics, Verdict
from rvaft.backend import backend
from rvaft.monitors import DetectionMonitor
from tests.trees import shipped

ROOT: Final = Path(__file__).parents[3]
PYTHON: Final = ROOT / ".venv-sigma/bin/python"
PAGE: Final = ROOT / "docs/reference/languages/sigma.md"
DETECTIONS: Final = "detections/"
STORED: Final = Path(__file__).with_name("conversions.txt")
BUCKETS: Final = re.compile(r"bin _time span=|date_trunc\(|span\(@timestamp, ")
SHAPES: Final = ("rule", "event_count", "temporal", "temporal with condition", "temporal_ordered")
OUTCOMES: Final = ("agrees", "converts", "buckets", "no window", "differs", "invalid")
"""Run and right; not run; counts in fixed buckets of time; counts without time; run and wrong; not of the language."""
EXCLUDED: Final = {
    **dict.fromkeys(("attacktag", "d3_fendtag", "sigmahq_tags_techniques_without_tactics"), "downloads MITRE's data"),
    **dict.fromkeys(
        ("sigmahq_category_event_id", "sigmahq_category_windows_provider_name"), "downloads SigmaHQ's data"
    ),
    **dict.fromkeys(("sigmahq_fieldname_cast", "sigmahq_invalid_fieldname"), "downloads SigmaHQ's data"),
    **dict.fromkeys(("sigmahq_redundant_field", "sigmahq_logsource_unknown"), "downloads SigmaHQ's data"),
    "sigmahq_unknown_field": "the key `rvaft` says where events have their time",
}
"""Validators that are not asked, and why; those of file names are silent without files."""

Found = tuple[str, str, dict[str, list[str]]]
"""A tree, the kind of its text or why there is none, and the targets by what they do."""


def run(texts: Mapping[str, str]) -> dict[str, Any]:
    """The conversions of texts by target, and the issues of the validators."""
    given = json.dumps([texts, sorted(EXCLUDED)])
    script = str(Path(__file__).with_name("convert.py"))
    done = subprocess.run([PYTHON, script], input=given, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    found: dict[str, Any] = json.loads(done.stdout)
    return found


def kind(text: str) -> str:
    """Which rule or correlation the text ends in."""
    last = list(yaml.safe_load_all(text))[-1].get("correlation")
    if last is None:
        return "rule"
    return f"{last['type']} with condition" if last["type"] == "temporal" and "condition" in last else str(last["type"])


def first(tree: RVAFT, trace: list[Any]) -> int | None:
    """The event at which the engine detects."""
    verdicts = [*rvaft.monitor(tree, semantics="scattered").run(trace)]
    return verdicts.index(Verdict.TRUE) + 1 if Verdict.TRUE in verdicts else None


def columns(value: Any, prefix: str = "") -> Iterator[tuple[str, Any]]:
    """The fields of an event by path."""
    for name, inner in value.items():
        if isinstance(inner, dict):
            yield from columns(inner, f"{prefix}{name}.")
        else:
            yield f"{prefix}{name}", json.dumps(inner) if isinstance(inner, bool | list) else inner


def found_by_sqlite(query: str, log: str) -> int | None:
    """The event at which the query first finds something in a log, one event a line."""
    rows = [dict(columns(json.loads(line))) for line in log.splitlines()]
    names = dict.fromkeys([*re.findall(r"`([^`]+)`", query), *(name for row in rows for name in row)])
    names.pop("rowid", None)
    table = sqlite3.connect(":memory:")
    table.execute(f"CREATE TABLE logs ({', '.join(f'`{name}`' for name in names)})")
    insert = f"INSERT INTO logs VALUES ({', '.join('?' * len(names))})"
    numbers: list[int] = [len(rows), *range(1, len(rows))]
    for number in numbers:
        table.execute("DELETE FROM logs")
        table.executemany(insert, [[row.get(name) for name in names] for row in rows[:number]])
        if table.execute(query).fetchone() is None:
            if number == len(rows):
                return None
        elif number < len(rows):
            return number
    return len(rows)


def sign(tree: RVAFT, traces: Mapping[str, list[Any]], target: str, query: str) -> str:
    """Whether a query finds what the engine finds, as far as it can be run."""
    if target in ("splunk", "esql", "ppl") and "stats " in query:
        return "buckets" if BUCKETS.search(query) else "no window"
    language = backend("sigma" if target == "sqlite" else "eql")
    logs = [language.log(tree, trace) for trace in traces.values()]
    try:
        if target == "sqlite":
            found = [found_by_sqlite(query, log) for log in logs]
        elif target == "eql":
            monitor = backend("eql").read(query)
            assert isinstance(monitor, DetectionMonitor)
            found = [*monitor.first_detections([[*map(json.loads, log.splitlines())] for log in logs])]
        else:
            return "converts"
    except LanguageError as error:
        return f"invalid: {error.message}"
    wrong = [name for name, one, log in zip(traces, found, traces.values(), strict=True) if one != first(tree, log)]
    return f"differs: {', '.join(wrong)}" if wrong else "agrees"


def measured() -> tuple[list[Found], list[str]]:
    """The table, and the issues of the validators."""
    refused, texts = dict[str, str](), dict[str, str]()
    for name in shipped.names():
        try:
            texts[name] = rvaft.translate(shipped.load(name), "sigma", semantics=Semantics.SCATTERED).text
        except NotExpressible as error:
            refused[name] = str(error)
    done = run(texts)
    table = list[Found]()
    for name in shipped.names():
        logs = dict(islice(shipped.traces(name), None if name.startswith(DETECTIONS) else 2))  # others take long
        by = dict[str, list[str]]()
        for target, (query, message) in done[name][0].items() if name in done else ():
            said = message if query is None else sign(shipped.load(name), logs, target, query)
            by.setdefault(str(said), []).append(target)
        table.append((name, refused[name] if name in refused else kind(texts[name]), by))
    return table, [f"{name}: {one}" for name in done if name.startswith(DETECTIONS) for one in done[name][1]]


def page(table: list[Found]) -> str:
    """The table of the page: what each target does with the kinds of texts of the detections."""
    cells: dict[str, dict[str, set[str]]] = {}
    for name, shape, by in table:
        for said, targets in by.items() if name.startswith(DETECTIONS) else ():
            word = said.partition(":")[0]
            for target in targets:
                cells.setdefault(target, {}).setdefault(shape, set()).add(word if word in OUTCOMES else "refuses")
    lines = [f"| | {' | '.join(f'`{shape}`' for shape in SHAPES)} |", "| --- |" + " --- |" * len(SHAPES)]
    alike = dict[str, list[str]]()
    for target, found in sorted(cells.items()):
        alike.setdefault(" | ".join(", ".join(sorted(found[shape])) for shape in SHAPES), []).append(target)
    lines += [f"| {', '.join(targets)} | {row} |" for row, targets in alike.items()]
    return "\n".join(lines) + "\n"


if __name__ == "__main__":
    rows, issues = measured()
    print(page(rows), *issues, sep="\n")
    STORED.write_text("".join(f"{json.dumps(row, ensure_ascii=False)}\n" for row in rows), encoding="utf-8")
    whole = PAGE.read_text(encoding="utf-8")
    PAGE.write_text(
        re.sub(r"\| \| `rule` \|.*?\n(?!\|)", lambda _: page(rows), whole, flags=re.DOTALL), encoding="utf-8"
    )
