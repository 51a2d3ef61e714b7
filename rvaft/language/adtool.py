"""Attack trees of ADTool (`adtree` and `sandtree`), read into a draft.

A node without inner nodes is a basic action, known by its label: the same label is the same action, as it has the same
values in ADTool. The domains of minimal cost and of probability become `cost` and `prob`. Countermeasures are refused,
because a monitor would have to know that an event stays out.
"""

import math
from typing import Final

from rvaft.language.builder import Page
from rvaft.language.draft import DraftNode, GateUse, Located, Reading
from rvaft.language.markup import Element
from rvaft.model.nodes import Gate
from rvaft.support.wording import listing

ROOTS: Final = ("adtree", "sandtree")
"""The root elements of a tree."""
_REFINEMENTS: Final = {
    "disjunctive": Gate.OR,
    "or": Gate.OR,
    "conjunctive": Gate.AND,
    "and": Gate.AND,
    "sequential": Gate.SAND,
}
_DOMAINS: Final = {"MinCost": "cost", "ProbSucc": "prob"}
"""The domains of values that have an attribute here, by the last part of their class."""
_NAMED: Final = {"cost": "cost", "likelihood": "prob"}
"""The parameters of TreeMaker's trees, which ADTool reads, too."""
_PARTS: Final = ("node", "label", "comment", "parameter", "ranking")


def read_attack_tree(root: Element, page: Page) -> None:
    """Add an attack tree to a page; raises `LanguageError`.

    >>> from rvaft.language.parser import parse
    >>> leaf = '<node refinement="disjunctive"><label>{}</label></node>'
    >>> inner = "".join(map(leaf.format, ["find note", "force"]))
    >>> draft = parse(f'<adtree><node refinement="conjunctive"><label>PIN</label>{inner}</node></adtree>')
    >>> draft.root, [child.value for child in draft.nodes["PIN"].children()]
    ('PIN', ['find note', 'force'])
    """
    tops = [child for child in root.children if child.name != "domain"]
    if len(tops) != 1 or tops[0].name != "node":
        raise root.error(f"<{root.name}> has one <node>, the root of the tree, and its domains")
    domains = _domains(root)
    elements = _checked(tops[0])
    actions = {_label(one) for one in elements if next(one.named("node"), None) is None}
    names: dict[int, str] = {}
    taken = set(actions)
    for one in elements:
        label = name = _label(one)
        if next(one.named("node"), None) is not None:
            number = 1
            while name in taken:
                number += 1
                name = f"{label} ({number})"
            taken.add(name)
        names[id(one)] = name
    unread: dict[str, None] = {}
    values: dict[tuple[str, str], str] = {}
    for one in elements:
        name = names[id(one)]
        node = page.draft.nodes.setdefault(name, DraftNode(name))
        node.statements.append(one.place)
        below = list(one.named("node"))
        if not below:
            unread |= _read_values(one, node, domains, values)
            continue
        if name != _label(one):
            node.labels.append(Located(_label(one), one.place))
        gate = _REFINEMENTS[one.attribute("refinement").lower()]
        children = tuple([Located(names[id(child)], child.place) for child in below])
        node.gates.append(Located(GateUse(gate, children), one.place))
    top = names[id(tops[0])]
    page.toplevels.append(Located(top, tops[0].place))
    say = page.draft.readings.append
    say(Reading(tops[0].place, "this attack tree of ADTool is read as `scattered`: what was attained stays so", (top,)))
    if unread:
        sentence = f"the values of {listing(list(unread))} are left out: they are neither a cost nor a probability"
        say(Reading(tops[0].place, sentence, ()))


def _label(element: Element) -> str:
    label = element.first("label")
    if label is None or not label.text:
        raise element.error("this node has no label, by which it is known; add <label>…</label>")
    return label.text


def _domains(root: Element) -> dict[str, str]:
    """Return the attribute of each domain by its id, or its name if it has none."""
    found: dict[str, str] = {}
    for domain in root.named("domain"):
        kind = domain.first("class")
        name = kind.text.rpartition(".")[2] if kind is not None else ""
        found[domain.attribute("id")] = _DOMAINS.get(name, f"the domain {name or domain.attribute('id')}")
    return found


def _checked(top: Element) -> list[Element]:
    """Return the nodes of a tree, parents first; raises `LanguageError` for what has no meaning here."""
    found: list[Element] = []
    todo = [top]
    while todo:
        element = todo.pop()
        found.append(element)
        if element.attributes.get("switchRole", "no").lower() not in ("no", "false"):
            why = "a monitor would have to know that it stays out; remove it, or write `without` in a tree of rvaft"
            raise element.error(f"the countermeasure {_label(element)} cannot be read: {why}")
        if wrong := next((child for child in element.children if child.name not in _PARTS), None):
            raise wrong.error(f"<{wrong.name}> is no part of a node of ADTool; remove it")
        below = list(element.named("node"))
        if below and element.attribute("refinement").lower() not in _REFINEMENTS:
            word = element.attributes["refinement"]
            raise element.error(f"unknown refinement {word!r}: known are disjunctive, conjunctive and sequential")
        todo += reversed(below)
    return found


def _read_values(
    element: Element, node: DraftNode, domains: dict[str, str], values: dict[tuple[str, str], str]
) -> dict[str, None]:
    """Add the values of a basic action as attributes, and return the domains that are no attributes."""
    unread: dict[str, None] = {}
    for parameter in element.named("parameter"):
        if parameter.attributes.get("category", "basic") != "basic":
            continue  # computed from others
        if "name" in parameter.attributes:
            name = parameter.attribute("name")
            key = _NAMED.get(name, f"the parameter {name}")
        else:
            domain = parameter.attribute("domainId")
            if domain not in domains:
                raise parameter.error(f"the domain {domain} is not declared; add its <domain>, or remove the value")
            key = domains[domain]
        if key not in _NAMED.values():
            unread[key] = None
            continue
        text = parameter.text
        if not _is_value(text, most=1 if key == "prob" else math.inf):
            expected = "a number from 0 to 1" if key == "prob" else "a number of at least 0"
            raise parameter.error(f"the {key} of {node.name} is {expected}, not {text!r}")
        known = values.setdefault((node.name, key), text)
        if known is text:
            node.attributes.append(Located((key, text), parameter.place))
        elif float(known) != float(text):
            raise parameter.error(f"the action {node.name} has two values of {key}, {known} and {text}; give it one")
    return unread


def _is_value(text: str, *, most: float) -> bool:
    try:
        return 0 <= float(text) <= most and math.isfinite(float(text)) and "_" not in text
    except ValueError:
        return False
