"""The rules of `rvaft check`, one function each; its docstring states what the rule requires."""

from rvaft.rules.registry import (
    RULES,
    UnknownRule,
    check,
    check_draft,
    check_tree,
    explain,
    meanings,
    require_valid,
    valid_part,
)
from rvaft.rules.rule import Rule

__all__ = [
    "RULES",
    "Rule",
    "UnknownRule",
    "check",
    "check_draft",
    "check_tree",
    "explain",
    "meanings",
    "require_valid",
    "valid_part",
]
