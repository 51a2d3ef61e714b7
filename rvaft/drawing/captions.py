"""The words of a drawing: what stands at a node, the same in every format."""

from dataclasses import dataclass

from rvaft.language import guard_text, on_text
from rvaft.model import Gate, Kind, Node


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
