"""The words of a drawing: what stands at a node, the same in every format."""

import re
import unicodedata
from dataclasses import dataclass
from typing import Final

from rvaft.language import guard_text, on_text
from rvaft.model import Gate, Kind, Node
from rvaft.printable import visible


@dataclass(frozen=True, slots=True)
class Caption:
    """What is written at a node; a part that the node lacks is None. Texts are not escaped for any format."""

    name: str
    gate: str | None
    kind: Kind | None
    label: str | None
    on: str | None
    when: str | None


def caption(node: Node) -> Caption:
    """The words at a node. A default event is not among them: it says no more than the name."""
    return Caption(
        node.name,
        gate_text(node),
        node.kind,
        node.label,
        None if node.on is None else on_text(node.on),
        None if node.when is None else guard_text(node.when),
    )


def gate_text(node: Node) -> str | None:
    """The short form of a gate, with the direction of a SAND and the k/n of a VOT."""
    match node.gate:
        case None:
            return None
        case Gate.SAND:
            return "SAND →"
        case Gate.SAND_RL:
            return "SAND ←"
        case Gate.VOT:
            return f"VOT {node.threshold}/{len(node.children)}"
        case Gate.AND | Gate.OR:
            return node.gate.value.upper()


def wrapped(text: str, width: int) -> list[str]:
    """The lines of a text of at most `width` columns; line ends in the text are kept, other control codes shown.

    A word that is a little wider, by half at most, is not broken.
    """
    return [line for paragraph in _paragraphs(text) for line in _filled(paragraph, width, _WORDS)]


def wrapped_code(text: str, width: int) -> list[str]:
    """The lines of an event or a guard, broken behind an opening parenthesis where a blank is too far, otherwise as `wrapped` does it."""
    return [line for paragraph in _paragraphs(text) for line in _filled(paragraph, width, _PIECES)]


_WORDS: Final = re.compile(r"\s*\S+")
_PIECES: Final = re.compile(r"\s*[^\s(]*\(|\s*[^\s(]+")


def _paragraphs(text: str) -> list[str]:
    return [visible(line.replace("\t", " ")) for line in text.splitlines()]


def _filled(text: str, width: int, piece: re.Pattern[str]) -> list[str]:
    """As many pieces on a line as it has room for; what is still much too wide is broken anywhere."""
    lines = [""]
    for word in piece.findall(text):
        if _columns(lines[-1] + word) <= width or not lines[-1]:
            lines[-1] += word if lines[-1] else word.lstrip()
        else:
            lines.append(word.lstrip())
        while _columns(lines[-1]) > width + width // 2:
            cut = _fitting(lines[-1], width)
            lines[-1:] = [lines[-1][:cut], lines[-1][cut:]]
    return lines


def _fitting(text: str, width: int) -> int:
    """How many characters of a text fit, at least one."""
    total = 0
    for place, character in enumerate(text):
        total += _columns(character)
        if total > width:
            return max(place, 1)
    return len(text)


def _columns(text: str) -> int:
    """The columns of a text: two for what is as wide as it is high, none for marks upon other characters."""
    return sum(
        0 if unicodedata.combining(character) else 2 if unicodedata.east_asian_width(character) in "WF" else 1
        for character in text
    )
