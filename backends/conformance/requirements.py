"""Which examples a backend has to write."""

from collections.abc import Callable, Iterator
from typing import Final, TypeAlias

from backends.conformance.trees import Example
from rvaft.model.guards import FUNCTIONS, NUMERIC, ORDERINGS, Operation, Operator, walk
from rvaft.model.patterns import ListPattern, Literal, SomeItem, Variable, rigid_variables
from rvaft.model.patterns import walk as walk_pattern
from rvaft.model.tree import RVAFT
from rvaft.model.verdict import Semantics

Required: TypeAlias = Callable[[Example, Semantics], bool]
OF_STRINGS: Final = FUNCTIONS - NUMERIC


def everything(example: Example, semantics: Semantics) -> bool:  # noqa: ARG001 -- a `Required`
    """Require every tree under every semantics."""
    return True


def no_variables_of_items(example: Example, semantics: Semantics) -> bool:  # noqa: ARG001 -- a `Required`
    """Require every tree, except variables inside `[..., P, ...]`."""
    return not any(rigid_variables(part.item) for part in _some_items(example.tree))


def _some_items(tree: RVAFT) -> Iterator[SomeItem]:
    patterns = (pattern for name in tree.occurrences if (pattern := tree.pattern(name)) is not None)
    return (part for pattern in patterns for part in walk_pattern(pattern) if isinstance(part, SomeItem))


def no_texts_of_several(example: Example, semantics: Semantics) -> bool:
    """Require every tree, except guards that search a string of one event in that of another."""
    functions = (Operator.STARTSWITH, Operator.ENDSWITH, Operator.CONTAINS)
    names = (f"operator `{name}`, two events" for name in functions)
    return everything(example, semantics) and example.name not in names


def without_variables(example: Example, semantics: Semantics) -> bool:  # noqa: ARG001 -- a `Required`
    """Require every tree without variables, also of counted events, and times."""
    return not (example.tree.variables or _has_own_values(example.tree)) and example.tree.time is None


def without_variables_or_determinate(example: Example, semantics: Semantics) -> bool:
    """Require also determinate trees with variables, unless the semantics skips events.

    Trees that test strings or times are not required.
    """
    if asks_of_strings(example.tree, semantics) or example.tree.time is not None or any(_some_items(example.tree)):
        return False
    anywhere = semantics in (Semantics.SCATTERED, Semantics.CONSECUTIVE)
    determinate = example.determinate and not anywhere and not _has_own_values(example.tree)
    return without_variables(example, semantics) or determinate


def _has_own_values(tree: RVAFT) -> bool:
    return any(node.own_values for node in tree.top_down())


def scattered_by_single_events(example: Example, semantics: Semantics) -> bool:
    """Require `scattered` trees without variables and times whose patterns compare with constants."""
    parts = (
        part
        for name in example.tree.occurrences
        if (p := example.tree.pattern(name)) is not None
        for part in walk_pattern(p)
    )
    simple = all(not isinstance(part, ListPattern | SomeItem) and part != Literal(None) for part in parts)
    return semantics is Semantics.SCATTERED and without_variables(example, semantics) and simple


def asks_of_strings(tree: RVAFT, semantics: Semantics) -> bool:
    """Return whether a guard orders or searches strings.

    Under `projected` and `consecutive`, the guards of `ignore` and of the alphabet count too.
    """
    tested_guards = [node.when for node in tree.top_down()]
    if semantics.projects:
        tested_guards += [entry.when for entry in tree.alphabet] + [ignore.when for ignore in tree.ignores]
    parts = [part for guard in tested_guards for part in walk(guard)]
    if any(isinstance(part, Operation) and part.operator in OF_STRINGS for part in parts):
        return True
    ordering = [part for part in parts if isinstance(part, Operation) and part.operator in ORDERINGS]
    kinds = ([type(one.value) if isinstance(one, Literal) else type(one) for one in part.operands] for part in ordering)
    return any(Variable in some and str in some for some in kinds)
