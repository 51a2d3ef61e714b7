"""What `show --highlight` marks: a branch, or what a trace detects."""

import re

from rvaft.api import monitor
from rvaft.drawing.marks import Marks, branch_marks, marks
from rvaft.errors import OptionError
from rvaft.monitoring.told import counted, matched_events
from rvaft.reads import TreeReads
from rvaft.traces import read
from rvaft.tree import RVAFT

_BRANCH = re.compile(r"branch:(.*)", re.DOTALL)


def highlighted(tree: RVAFT, what: str, semantics: str) -> Marks:
    """The marks for `branch:N`, or for the trace of that name.

    Raises `TreeError` where there is no such branch, `OptionError` for a number that is none and a trace that detects nothing,
    `TraceError` and `OSError` for one that cannot be read.
    """
    if found := _BRANCH.fullmatch(what):
        if not re.fullmatch(r"[0-9]{1,9}", found[1]):
            raise OptionError(f"--highlight branch:N takes the number of a branch, not {found[1]!r}")
        return branch_marks(tree, int(found[1]))
    watching = monitor(tree, semantics=semantics)
    events = {}
    for number, event in enumerate(read(what, reads=TreeReads(tree)), 1):
        events[number] = event
        if watching.step(event).final:
            break
    explanation = watching.explanation
    if explanation is None:
        raise OptionError(
            f"{what}: nothing is detected (the verdict is {watching.verdict} after {counted(len(events))})"
        )
    return marks(tree, explanation, {number: events[number] for number in matched_events([explanation])})
