"""Trees as fault trees of the Open-PSA Model Exchange Format, and what is lost in it.

Open-PSA has `and`, `or` and `atleast` over basic events. A tree whose meaning needs more is refused; what only
describes how its events are observed is left out.
"""

import math
import re
from collections import Counter
from collections.abc import Iterator, Mapping
from typing import Final, assert_never
from xml.sax.saxutils import escape

from rvaft.errors import OptionError
from rvaft.model.nodes import Gate, Node
from rvaft.model.tree import RVAFT
from rvaft.model.verdict import Semantics

_IDENTIFIER: Final = re.compile(r"[A-Za-z]\w*(-\w+)*", re.ASCII)
"""The names of Open-PSA."""
_NUMBER: Final = re.compile(r"[+-]?([0-9]+\.?[0-9]*|\.[0-9]+)([eE][+-]?[0-9]+)?")
_UNWRITABLE: Final = re.compile("[^\t\n\r\x20-\ud7ff\ue000-\ufffd\U00010000-\U0010ffff]")
"""The characters that XML 1.0 lacks."""
_SPECIAL: Final = {'"': "&quot;", "\n": "&#10;", "\r": "&#13;", "\t": "&#9;"}
_LAWS: Final[Mapping[str, str]] = {
    "prob": '<float value="{}"/>',
    "lambda": '<exponential><float value="{}"/><system-mission-time/></exponential>',
}


def open_psa_text(tree: RVAFT) -> str:
    """Return the reachable nodes as an Open-PSA model, gates first; raises `OptionError`.

    >>> import rvaft
    >>> print(open_psa_text(rvaft.loads("top 2of3 a b c; a prob=0.1;")), end="")
    <?xml version="1.0" encoding="UTF-8"?>
    <opsa-mef>
      <define-fault-tree name="top">
        <define-gate name="top">
          <atleast min="2">
            <basic-event name="a"/>
            <basic-event name="b"/>
            <basic-event name="c"/>
          </atleast>
        </define-gate>
      </define-fault-tree>
      <model-data>
        <define-basic-event name="a">
          <float value="0.1"/>
        </define-basic-event>
        <define-basic-event name="b"/>
        <define-basic-event name="c"/>
      </model-data>
    </opsa-mef>
    """
    nodes = list(tree.top_down())
    _check(tree, nodes)
    lines = ['<?xml version="1.0" encoding="UTF-8"?>', "<opsa-mef>", f'  <define-fault-tree name="{tree.root}">']
    for node in nodes:
        if not node.leaf:
            lines += _defined("define-gate", node, _formula(tree, node))
    lines += ["  </define-fault-tree>", "  <model-data>"]
    for node in nodes:
        if node.leaf:
            law = _law(node)
            lines += _defined("define-basic-event", node, [] if law is None else [_LAWS[law[0]].format(law[1])])
    return "\n".join([*lines, "  </model-data>", "</opsa-mef>"]) + "\n"


def losses(tree: RVAFT) -> Iterator[str]:
    """Yield what the Open-PSA text lacks, one clause each."""
    nodes = list(tree.top_down())
    for lost, what in (
        (sum(node.on is not None for node in nodes), "runtime event{} left out: a basic event stands for each"),
        (sum(node.kind is not None for node in nodes), "fault or attack mark{} left out"),
        (sum(not _is_writable(node.label or "") for node in nodes), "label{} left out that XML cannot write"),
        (sum(not _is_pair(*pair) for node in nodes for pair in node.attributes), "attribute{} left out that XML lacks"),
    ):
        if lost:
            yield f"{lost} {what.format('s' * (lost != 1))}"
    for declared, what in (
        (tree.ignores, "ignore declarations"),
        (tree.topics, "topic declarations"),
        (tree.time, "the time of events"),
        (tree.assumes, "assumptions"),
    ):
        if declared:
            yield f"{what} left out"
    if tree.semantics != Semantics.SCATTERED:
        yield f"semantics {tree.semantics or 'projected'} left out; the file is read as scattered: failures persist"
    unrated = sum(node.leaf and _law(node) is None for node in nodes)
    if unrated:
        yield f"{unrated} basic event{'s' * (unrated != 1)} without a rate or probability, which most tools require"


def _check(tree: RVAFT, nodes: list[Node]) -> None:
    """Raise `OptionError` for what a model of Open-PSA cannot mean."""
    bound = Counter(name for node in nodes if node.on for name in set(node.on.variables) - {*node.own_values})
    shared = {name for name, count in bound.items() if count > 1}
    for node in nodes:
        if not _IDENTIFIER.fullmatch(node.name):
            why = "a name is a letter, followed by letters, digits, _ and single -"
            raise OptionError(f"Open-PSA cannot write the name {node.name!r}: {why}; rename the node")
        for lost, what in (
            (node.on is not None and not node.leaf, "the event of a gate"),
            (node.when is not None, "a guard"),
            (node.within is not None, "a window (within)"),
            (node.without, "an absent event (without)"),
            (node.times > 1, "a number of events (times)"),
            (node.on is not None and not shared.isdisjoint(node.on.variables), "a variable that several events share"),
            (len(node.children) > 1 and node.gate in (Gate.SAND, Gate.SAND_RL, Gate.PAND), f"the order of {node.gate}"),
        ):
            if lost:
                raise OptionError(f"Open-PSA cannot write {node.name}: it has no place for {what}")
    if tree.nodes[tree.root].leaf:
        raise OptionError(f"Open-PSA cannot write {tree.root}: the top event is a gate, as in top or a;")


def _defined(word: str, node: Node, body: list[str]) -> list[str]:
    inner = []
    if node.label is not None and _is_writable(node.label):
        inner.append(f"<label>{escape(node.label)}</label>")
    law = _law(node) if node.leaf else None
    kept = [pair for pair in node.attributes if pair != law and _is_pair(*pair)]
    if kept:
        rows = [f"  <attribute name={_quoted(key)} value={_quoted(value)}/>" for key, value in kept]
        inner += ["<attributes>", *rows, "</attributes>"]
    inner += body
    start = f'<{word} name="{node.name}"'
    if not inner:
        return [f"    {start}/>"]
    return [f"    {start}>", *(f"      {line}" for line in inner), f"    </{word}>"]


def _formula(tree: RVAFT, node: Node) -> list[str]:
    match node.gate:
        case Gate.OR:
            word = start = "or"
        case Gate.AND | Gate.SAND | Gate.SAND_RL | Gate.PAND:  # of one child, if it is an order
            word = start = "and"
        case Gate.VOT:
            word, start = "atleast", f'atleast min="{node.threshold}"'
        case None:
            return []
        case _ as never:
            assert_never(never)
    rows = [f'  <{"basic-event" if tree.nodes[one].leaf else "gate"} name="{one}"/>' for one in node.children]
    return [f"<{start}>", *rows, f"</{word}>"]


def _law(node: Node) -> tuple[str, str] | None:
    """Return the only probability or rate of a basic event, if it is a number."""
    laws = [pair for pair in node.attributes if pair[0] in _LAWS]
    if len(laws) != 1 or not _NUMBER.fullmatch(laws[0][1]) or not math.isfinite(float(laws[0][1])):
        return None
    return laws[0]


def _quoted(text: str) -> str:
    return f'"{escape(text, _SPECIAL)}"'


def _is_writable(text: str) -> bool:
    return not _UNWRITABLE.search(text)


def _is_pair(key: str, value: str) -> bool:
    return bool(key) and key == key.strip() and _is_writable(key) and _is_writable(value)
