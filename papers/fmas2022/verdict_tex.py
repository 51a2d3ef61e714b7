"""Tables 2 and 3 as LaTeX: computed cells, with differences from the print marked and explained."""

import json
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Final

from cross_check.participants import ENGINE
from papers.fmas2022 import printed, tex
from papers.fmas2022.notes import Notes, difference
from papers.fmas2022.verdicts import Enlisted, Monitors, Trace, absent, enlist, listed, monitors, present, traces
from rvaft.export.latex import escaped
from rvaft.model.tree import RVAFT
from rvaft.model.values import Json

_BLANK: Final = r"\textcolor{black!55}"
_GREY: Final = rf"{_BLANK}{{Grey}}: the cell is empty in the print, or its event is not there."
_ADDED: Final = r"\textsuperscript{+}\,The print leaves this event out. Without it the verdicts are: "


def verdict_tables(tree: RVAFT, folder: Path) -> Mapping[int, str]:
    """Return Table 2 and Table 3 by number, from the traces in a folder; raises `Disagreement`,
    `OSError`.
    """
    enlisted = enlist(tree)
    found, checked = list(traces(enlisted, folder)), list(_checked(enlisted))
    return {
        number: _table(tree, number, [one for one in found if one.table == number], checked) for number in printed.LAST
    }


def _checked(enlisted: Enlisted) -> Iterator[str]:
    """Yield notes on the source of the verdicts, agreeing and absent participants."""
    others = listed(tex.typewriter(name) for name in present(enlisted) if name != ENGINE)
    yield (
        f"Verdicts are those of the engine under the projected semantics. The same ones, in every cell, give {others}."
    )
    for name, reason in absent(enlisted).items():
        yield f"Not run: {tex.typewriter(name)} ({escaped(reason)})."


def _table(tree: RVAFT, number: int, found: list[Trace], checked: list[str]) -> str:
    notes, signs = Notes(), monitors(tree)
    rows = [row for trace in found for row in _rows(tree, trace, notes)]
    added = [f"trace {trace.number}: {_word(trace, signs)}" for trace in found if trace.as_printed]
    return tex.table(
        rf"r>{{\raggedright\arraybackslash\frenchspacing\ttfamily\scriptsize}}p{{.64\linewidth}}*{{{len(signs)}}}{{c}}",
        ["", r"\normalfont\small Event", *(tex.math(tex.phi(branch)) for branch in signs.values())],
        rows,
        caption=f"The traces of Table {number} of the paper, completed, and their verdicts, computed.",
        label=f"tab:verdicts{number}",
        notes=[*notes.lines(), *([f"{_ADDED}{'; '.join(added)}."] if added else []), _GREY, *checked],
    )


def _rows(tree: RVAFT, trace: Trace, notes: Notes) -> Iterator[str]:
    signs = monitors(tree)
    yield tex.heading(f"Trace {trace.number}", len(signs) + 2)
    for place, event in enumerate(trace.events, 1):
        cells = []
        for sign, branch in signs.items():
            verdict, before = trace.verdicts[sign][place - 1], trace.printed(branch, place)
            cell = tex.math(tex.SIGNS[verdict])
            if before is None:
                cell = f"{_BLANK}{{{cell}}}"
            elif before is not verdict:
                letter = notes.letter(difference(tree, branch, trace.events[:place], before))
                cell = rf"{cell}\rlap{{\textsuperscript{{{letter}}}}}"
            cells.append(cell)
        number = rf"{place}\rlap{{\textsuperscript{{+}}}}" if trace.left_out(place) else str(place)
        yield tex.row([number, escaped(shown(event)), *cells])


def shown(event: Json) -> str:
    """Return an event as JSON without nested values."""
    assert isinstance(event, dict), "a trace is a list of objects"
    inner = (f"{json.dumps(name)}: {_value(value)}" for name, value in event.items())
    return f"{{{', '.join(inner)}}}"


def _value(value: Json) -> str:
    return "{...}" if isinstance(value, (dict, list)) else json.dumps(value, ensure_ascii=False)


def _word(trace: Trace, signs: Monitors) -> str:
    """Return the verdicts on the trace as printed, for monitors with printed verdicts."""
    words = {
        tex.phi(branch): "".join(tex.SIGNS[verdict] for verdict in trace.as_printed[sign])
        for sign, branch in signs.items()
        if trace.printed(branch, len(trace.events)) is not None
    }
    return " and ".join(rf"${phi}\colon {word}$" for phi, word in words.items())
