"""The gates of section 3.2, each over three events, in several languages."""

import re
from collections.abc import Iterator
from pathlib import Path
from typing import Final

import rvaft
from papers.fmas2022 import tex
from papers.fmas2022.transitions import transitions
from rvaft.backend import Specification
from rvaft.export.latex import escaped

GATES: Final = {
    "or": r"\textsc{or}",
    "vot": r"\textsc{vot} 2/3",
    "and": r"\textsc{and}",
    "sand": r"\textsc{sand}, left to right",
    "sand_rl": r"\textsc{sand}, right to left",
}
"""The trees of `trees/gates`, in the order of the paper."""
LANGUAGES: Final = ("rml-paper", "rml", "ltlf", "automaton")
_NOTES: Final = (
    r"\texttt{rml-paper} is the translation of the paper, with \texttt{all} behind it, so that a detection is final.",
    r"\texttt{V} with numbers is the paper's $\tau$ with the children that are left, from 0.",
    (
        r"\texttt{automaton}: of each state the events that lead on and whereto, from 0 on. In $\top$ it has "
        r"detected; before, any other event ends it."
    ),
    "Symbols are those of the property alone; of an automaton those of the body of its text in HOA.",
)
_STATES: Final = 3
"""States of an automaton per line."""
_DEFINITION: Final = re.compile(r"^\w+ := .*$", re.MULTILINE)


def gate_table(folder: Path) -> str:
    """Return every gate in every language under `strict` as LaTeX; `folder` holds one tree per
    gate.
    """
    return tex.table(
        r"l>{\raggedright\arraybackslash\frenchspacing\ttfamily\footnotesize}p{.68\linewidth}r",
        ["Language", r"\normalfont\small Property", "Symbols"],
        [line for name in GATES for line in _rows(folder, name)],
        caption=r"The gates over $a$, $b$ and $c$ in every language, under \emph{strict} (section 3.2 of the paper).",
        label="tab:gates",
        notes=_NOTES,
    )


def _rows(folder: Path, name: str) -> Iterator[str]:
    tree = rvaft.load(folder / f"{name}.rvaft")
    yield tex.heading(GATES[name], 3)
    for language in LANGUAGES:
        made = rvaft.translate(tree, language, semantics="strict")
        body = r"\newline ".join(escaped(line) for line in property_lines(made))
        yield tex.row([tex.typewriter(language), body, str(made.metrics.symbols)])


def property_lines(made: Specification) -> list[str]:
    """Return the property of a text without event types, header and comments; for automata its
    transitions.
    """
    match made.language:
        case "rml":
            return made.text[made.text.index("Main =") :].splitlines()
        case "ltlf":
            header, _, formula = made.text.rpartition("*/")
            return [*_DEFINITION.findall(header), formula.strip()]
        case _:
            states = transitions(made.text)
            return ["; ".join(states[first : first + _STATES]) for first in range(0, len(states), _STATES)]
