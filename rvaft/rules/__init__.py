"""The rules of `rvaft check`: one function and one code per rule."""

from rvaft.rules.checks import check, check_draft, check_tree, require_valid
from rvaft.rules.registry import RULES, UnknownRule, explain
from rvaft.rules.rule import Rule

__all__ = ["RULES", "Rule", "UnknownRule", "check", "check_draft", "check_tree", "explain", "require_valid"]
