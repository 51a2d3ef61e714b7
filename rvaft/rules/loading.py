"""Valid trees from texts and files."""

import os
from collections.abc import Iterable
from typing import Unpack

from rvaft.errors import TreeError, expect
from rvaft.language.draft import Draft
from rvaft.language.parser import TreeOptions, parse, parse_file
from rvaft.model.tree import RVAFT
from rvaft.rules.rule import Finding, Severity
from rvaft.rules.validity import check_draft, require_valid
from rvaft.support.collector import no_collections


@no_collections()
def loads(text: str, file: str = "<text>", **reading: Unpack[TreeOptions]) -> RVAFT:
    """Return the tree in a text; imports are relative to the folder of `file`.

    `confine_imports` refuses imports from outside that folder. `strict_galileo` refuses the dynamic
    gates of Galileo, which are otherwise read as observed failures. `year` is for a format of times
    that has none. Raises `LanguageError` for
    invalid text and `TreeError` for a broken rule.

    >>> loads("top sand a b;")
    <RVAFT top: 3 nodes>
    """
    expect("the text of a tree", text, str, "a str")
    return checked(parse(text, file, **reading))


@no_collections()
def load(path: os.PathLike[str] | str, **reading: Unpack[TreeOptions]) -> RVAFT:
    """Return the tree in a file, also in Galileo's format; raises `OSError` and the errors of
    `loads`.

    >>> load("trees/gates/and.rvaft")
    <RVAFT top: 4 nodes>
    """
    expect("the path of a tree", path, str | os.PathLike, "a str or a path")
    return checked(parse_file(path, **reading))


def checked(draft: Draft) -> RVAFT:
    """Return the tree of a draft; raises `TreeError` for a broken rule."""
    _raise_first(check_draft(draft))
    tree = draft.build()
    try:
        require_valid(tree)  # caches the result
    except TreeError:
        from rvaft.rules.registry import check_tree  # noqa: PLC0415 -- imported on use

        _raise_first(check_tree(tree))
        raise
    return tree


def _raise_first(findings: Iterable[Finding]) -> None:
    for finding in findings:
        if finding.severity is Severity.ERROR:
            raise TreeError(f"{finding.place}: {finding.message}", rule=finding.code, nodes=finding.nodes)
