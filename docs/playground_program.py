"""What the playground page runs in Pyodide: `answer` takes and returns JSON texts.

A request has `tree`, `log`, `semantics`, `languages` and, to compare a rule with the tree, `rule` and `language`.
"""

import json
from collections.abc import Iterator
from random import Random
from typing import Any

import rvaft
from rvaft import RVAFT, Explanation, Semantics, Verdict
from rvaft.backend import backend
from rvaft.diagnosis.near_misses import near_misses
from rvaft.errors import LanguageError, RvaftError
from rvaft.export.svg import svg_text
from rvaft.model.tree import resolve_semantics

TRACES = 100
"""The number of generated logs of each kind for a comparison."""


def answer(request: str) -> str:
    """Return what the page shows."""
    given = json.loads(request)
    try:
        tree = rvaft.loads(given["tree"], "tree")
    except LanguageError as error:
        return json.dumps({"errors": [[error.line, error.column, error.message]]})
    except RvaftError as error:
        return json.dumps({"errors": [[1, 1, str(error)]]})
    semantics = resolve_semantics(tree, given["semantics"] or None)
    found: dict[str, Any] = {"errors": [], "semantics": semantics.value, "drawing": svg_text(tree, badges=True)}
    found["findings"] = [
        [one.place.line, one.place.column, f"{one.severity}: {one.message} [{one.code}]"] for one in rvaft.check(tree)
    ]
    found["names"] = list(tree.order)
    if "rule" in given:
        found["comparison"] = comparison(tree, given["log"], semantics, given["rule"], given["language"])
        return json.dumps(found)
    found |= watched(tree, given["log"], semantics)
    found["texts"] = {name: written(tree, name, semantics) for name in given["languages"]}
    return json.dumps(found)


def events_of(log: str) -> Iterator[tuple[int, Any]]:
    """Yield the events with their lines; raises `ValueError` with the line in its second argument."""
    for number, line in enumerate(log.splitlines(), 1):
        if line.strip():
            try:
                event = json.loads(line)
            except ValueError as error:
                raise ValueError(f"no JSON: {error}", number) from None
            if not isinstance(event, dict):
                raise ValueError("not a JSON object", number)
            yield number, event


def watched(tree: RVAFT, log: str, semantics: Semantics) -> dict[str, Any]:
    """Return the verdict after each line, and the first detection or else the near misses."""
    monitor, events, lines, wrong = rvaft.monitor(tree, semantics=semantics), [], [], None
    explanation: Explanation | None = None
    try:
        for number, event in events_of(log):
            verdict = monitor.step(event)
            events.append((number, event))
            lines.append([number, verdict.symbol])
            explanation = explanation or monitor.explanation
    except ValueError as error:
        wrong = [error.args[-1] if len(error.args) > 1 else len(lines) + 1, error.args[0]]
    except RvaftError as error:
        wrong = [len(lines) + 1, str(error)]
    made: dict[str, Any] = {"verdict": str(monitor.verdict), "lines": lines, "wrong": wrong, "matched": [], "near": []}
    if explanation is not None:
        made["matched"] = [[one.node, events[one.event - 1][0]] for one in explanation.matched]
        made["variables"] = [f"{name} = {json.dumps(value)}" for name, value in explanation.bound(tree).items()]
        made["kept"] = [[parent, child] for parent, some in explanation.scenario.items() for child in some]
        made["nodes"] = list(explanation.scenario)
    elif events:
        at = dict(events)
        misses = near_misses(tree, events, semantics=semantics, numbered=True).found
        made["near"] = [[one.line(tree, at), one.events] for one in misses[:5]]
    return made


def written(tree: RVAFT, language: str, semantics: Semantics) -> list[str]:
    """Return the text in a language, or "" and the reason why there is none."""
    try:
        return [rvaft.translate(tree, language, semantics=semantics).text, ""]
    except RvaftError as error:
        return ["", str(error)]
    except ImportError as error:
        return ["", f"this language needs a program that is not in this page: {error}"]


def comparison(tree: RVAFT, log: str, semantics: Semantics, rule: str, language: str) -> dict[str, Any]:
    """Return where a rule detects another prefix of a log than the tree."""
    try:
        if language == "rvaft":
            other = rvaft.loads(rule, "rule")
            fresh = rvaft.monitor(other, semantics=resolve_semantics(other, None))
        else:
            reader = backend(language)
            fresh = reader.read(rule if tree.time is None else reader.timed(rule, tree.time))
        told = compared(tree, semantics, fresh, list(traces(tree, log, semantics)))
    except RvaftError as error:
        return {"error": str(error)}
    except (ImportError, ValueError) as error:
        return {"error": f"{type(error).__name__}: {error}"}
    return told


def traces(tree: RVAFT, log: str, semantics: Semantics) -> Iterator[list[Any]]:
    """Yield the log of the page, and generated logs: detecting ones and near misses."""
    from cross_check.generate.disturbances import near_miss  # noqa: PLC0415 -- imported on use
    from cross_check.generate.traces import PLAIN, NoTraceFound, detecting  # noqa: PLC0415

    yield [event for _, event in events_of(log)]
    random = Random(0)  # noqa: S311 (no secret)
    for _ in range(TRACES):
        try:
            yield detecting(random, tree, semantics, PLAIN)
            yield near_miss(random, tree, semantics, PLAIN).trace
        except NoTraceFound:
            continue


def compared(tree: RVAFT, semantics: Semantics, fresh: rvaft.Monitor, logs: list[list[Any]]) -> dict[str, Any]:
    """Return the shortest difference, or how many logs agree."""
    differing: list[tuple[int, list[Any], list[str], list[str]]] = []
    left_out = 0
    for events in logs:
        if fresh.left_open is not None and fresh.left_open(events):
            left_out += 1
            continue
        mine, theirs = rvaft.monitor(tree, semantics=semantics), fresh.fork()
        theirs.expect(events)
        rows = [(mine.step(event), theirs.step(event)) for event in events]
        first = next((at for at, (one, two) in enumerate(rows, 1) if (one is Verdict.TRUE) != (two is Verdict.TRUE)), 0)
        if first:
            ours, others = ([pair[side].symbol for pair in rows[:first]] for side in (0, 1))
            differing.append((first, events[:first], ours, others))
    if not differing:
        return {"agree": len(logs) - left_out, "left_out": left_out}
    _, events, ours, others = min(differing, key=lambda one: one[0])
    shown = [[json.dumps(event), *both] for event, *both in zip(events, ours, others, strict=True)]
    return {"rows": shown, "of": len(differing)}
