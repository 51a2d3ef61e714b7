"""The whole text: event types, equations of the VOT gates, and the union of the branches."""

import re

from backends.rml.paper.gates import OR, Choices, Writer, branches, reading_order
from backends.rml.paper.types import Declarations
from rvaft.errors import NotExpressible
from rvaft.guards import Guard, holds
from rvaft.guards import variables as guard_variables
from rvaft.patterns import rigid_variables
from rvaft.tree import RVAFT
from rvaft.verdict import Semantics

_TOKEN = re.compile(r"\w+|/\\|\\/|>>|[^\s\w]")


def specification(tree: RVAFT, semantics: Semantics, limit: int) -> tuple[str, int, int]:
    """The text, the number of tokens of its equations, and how many these are."""
    types = Declarations(semantics.value)
    writer = Writer(limit)
    terms = []
    for number, choices in enumerate(branches(tree, limit), 1):
        guards = _folded(tree, choices)
        if guards is not None:
            names = {name: _event(tree, types, name, guards[name]) for name in guards}
            terms.append(writer.branch(tree, choices, names.get, f"V{number}_"))
    terms = [term for term in terms if term]
    if not terms:
        reason = "as the paper unrolls the gates, every branch has a guard that never holds"
        raise NotExpressible(reason, backend="rml-paper", semantics=semantics, nodes=[tree.root])
    union = terms[0] if len(terms) == 1 else f"({OR.join(f'({term})' for term in terms)})"
    variables = sorted(types.variable(name) for name in tree.variables)
    main = f"{union} all" if len(terms) > 1 or not _loose(union) else f"({union}) all"
    if variables:
        main = f"{{let {', '.join(variables)}; {main}}}"
    if semantics is Semantics.PROJECTED:
        main = _filtered(tree, types, main)
    equations = [f"{name} = {body};" for name, body in writer.equations.items()]
    body = [f"Main = {main};", *equations]
    symbols = sum(len(_TOKEN.findall(line)) for line in body)
    return "\n".join([f"// {semantics}, as the paper translates it", *types.lines, *body, ""]), symbols, len(body)


def _loose(term: str) -> bool:
    """Whether a union stands outside all parentheses."""
    depth = 0
    for index, character in enumerate(term):
        depth += (character == "(") - (character == ")")
        if depth == 0 and term.startswith("\\/", index):
            return True
    return False


def _folded(tree: RVAFT, choices: Choices) -> dict[str, list[Guard]] | None:
    """For each occurrence of a branch the guards it checks: those whose last variable, in writing, it binds.

    None where a guard without variables does not hold.
    """
    order = reading_order(tree, choices)
    guards: dict[str, list[Guard]] = {name: [] for name in order}
    binders = [(name, set(rigid_variables(pattern))) for name in order if (pattern := tree.pattern(name)) is not None]
    for name in _nodes(tree, choices):
        guard = tree.nodes[name].when
        if guard is None:
            continue
        names = set(guard_variables(guard))
        if not names:
            if not holds(guard, {}):
                return None
            continue
        first = {v: next(n for n, bound in binders if v in bound) for v in names}
        guards[max(first.values(), key=order.index)].append(guard)
    return guards


def _nodes(tree: RVAFT, choices: Choices) -> list[str]:
    kept = {tree.root}
    for name in tree.order:
        if name in kept:
            kept.update((choices[name],) if name in choices else tree.nodes[name].children)
    return [name for name in tree.order if name in kept]


def _event(tree: RVAFT, types: Declarations, name: str, guards: list[Guard]) -> str:
    pattern = tree.pattern(name)
    assert pattern is not None
    on = tree.nodes[name].on
    return types.event(name if on is None else on.event, pattern, guards, name)


def _filtered(tree: RVAFT, types: Declarations, main: str) -> str:
    """`relevant >> …`, and around it a filter for each `ignore`."""
    parents = []
    for entry in tree.alphabet:
        term = types.event(f"seen_{entry.node}", entry.pattern, [] if entry.when is None else [entry.when], entry.node)
        if term.startswith("("):
            raise types.refuse("a guard that a filter cannot check", entry.node)
        parents.append(re.sub(r"\w+(?=[,)])", "_", term) if "(" in term else term)
    relevant = types.declare("relevant", [], f"matches {' | '.join(dict.fromkeys(parents))}")
    main = f"{relevant} >> ({main})"
    for ignore in tree.ignores:
        term = types.event(
            "ignored", tree.instantiate(ignore.on), [] if ignore.when is None else [ignore.when], "ignore"
        )
        if term.startswith("("):
            raise types.refuse("an `ignore` whose guard a filter cannot check", "ignore")
        call = re.sub(r"\w+(?=[,)])", "_", term) if "(" in term else term
        kept = types.declare("kept", [], f"not matches {call}")
        main = f"{kept} >> ({main})"
    return main
