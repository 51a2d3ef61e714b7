"""From text or file to the tree, with all rules checked."""

import os
from collections.abc import Iterable

from rvaft.errors import TreeError, WrongType
from rvaft.findings import Finding, Severity
from rvaft.language.draft import Draft
from rvaft.language.reader import parse, parse_file
from rvaft.tree import RVAFT


def loads(text: str, file: str = "<text>") -> RVAFT:
    """The tree that a text stands for; imports are relative to the folder of `file`.

    Raises `LanguageError` for what is not in the language and `TreeError` for the first rule that the tree breaks.
    """
    if not isinstance(text, str):
        raise WrongType("the text of a tree", text, "a str")
    return _checked(parse(text, file))


def load(path: os.PathLike[str] | str) -> RVAFT:
    """The tree in a file, Galileo's static part included; raises as `loads` does, and `OSError` where it cannot be read."""
    if not isinstance(path, (str, os.PathLike)):
        raise WrongType("the path of a tree", path, "a str or a path")
    return _checked(parse_file(path))


def _checked(draft: Draft) -> RVAFT:
    from rvaft.rules import check_draft, check_tree, require_valid  # noqa: PLC0415 - the rules look at drafts

    _raise_first_error(check_draft(draft))
    tree = draft.build()
    try:
        require_valid(tree)  # errors only, and remembered for whoever asks next
    except TreeError:
        _raise_first_error(check_tree(tree))  # the same error, with its place
        raise
    return tree


def _raise_first_error(findings: Iterable[Finding]) -> None:
    for finding in findings:
        if finding.severity is Severity.ERROR:
            raise TreeError(f"{finding.place}: {finding.message}", rule=finding.code, nodes=finding.nodes)
