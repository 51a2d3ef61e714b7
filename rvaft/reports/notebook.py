"""What a notebook shows of values that are not trees: tables in HTML, and texts of specifications.

The entry points `rvaft.displays` name these functions, since the values are in lower layers.
"""

from collections.abc import Iterable, Sequence
from dataclasses import fields
from html import escape

from rvaft.backend import Specification
from rvaft.diagnosis.near_misses import NearMisses
from rvaft.monitors import Explanation
from rvaft.support.terminal import readable_json, visible


def table_html(head: Sequence[str], rows: Iterable[Sequence[object]], *, below: str = "") -> str:
    """Return a table of texts, which are escaped, with a line below it.

    >>> table_html(["node"], [["<b>"]])
    '<table><thead><tr><th>node</th></tr></thead><tbody><tr><td>&lt;b&gt;</td></tr></tbody></table>'
    """

    def cells(name: str, texts: Sequence[object]) -> str:
        return "".join(f"<{name}>{escape(visible(str(text)))}</{name}>" for text in texts)

    body = "".join(f"<tr>{cells('td', row)}</tr>" for row in rows)
    line = f"<p>{escape(visible(below))}</p>" if below else ""
    return f"<table><thead><tr>{cells('th', head)}</tr></thead><tbody>{body}</tbody></table>{line}"


def _numbers(events: Iterable[int]) -> str:
    return ", ".join(map(str, events))


def explanation_html(explanation: Explanation) -> str:
    """Return a table of the nodes of a match with the numbers of their events, and the values."""
    rows: list[Sequence[object]] = [(node, _numbers(events), "") for node, events in explanation.events.items()]
    rows += [(absence.node, "", absence.text) for absence in explanation.absences]
    rows += [(name, "", f"= {readable_json(value)}") for name, value in explanation.variables.items()]
    branch = "" if explanation.branch is None else f"branch {explanation.branch}"
    kinds = ", ".join(sorted(kind.value for kind in explanation.kinds))
    return table_html(["node", "events", "values"], rows, below=": ".join(filter(None, [branch, kinds])))


def specification_html(specification: Specification) -> str:
    """Return the text of a specification, and its sizes."""
    metrics = specification.metrics
    sizes = {one.name: getattr(metrics, one.name) for one in fields(metrics) if one.name != "seconds"}
    shown = ", ".join(f"{name}: {size}" for name, size in sizes.items() if size is not None)
    return f"<pre>{escape(specification.text)}</pre><p>{escape(specification.language)}; {shown}</p>"


def near_misses_html(misses: NearMisses) -> str:
    """Return a table of near misses: what lacks, and the events and values that came."""
    rows = [
        (
            one.text,
            one.node,
            _numbers(one.events),
            ", ".join(f"{name} = {readable_json(value)}" for name, value in one.explanation.variables.items()),
        )
        for one in misses.found
    ]
    skipped = f"not all looked for at: {', '.join(misses.skipped)}" if misses.skipped else ""
    below = skipped or ("" if rows else "no near miss")
    return table_html(["near miss", "node", "events", "values"], rows, below=below)
