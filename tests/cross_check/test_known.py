"""Where the paper's translation is known to differ from the meaning, pinned: the tree, the trace, and what both shrink to."""

from dataclasses import dataclass

import pytest

from cross_check.campaign import Task
from cross_check.comparison import Roster
from cross_check.counterexamples import shrunk
from cross_check.participants import verdicts_of
from cross_check.results import Job, Status
from cross_check.traces import Effort
from rvaft import loads
from rvaft.language.printer import dumps
from rvaft.model.values import Json
from rvaft.model.verdict import Semantics

PAPER = Roster(backends=("rml-paper",))


@dataclass(frozen=True)
class Known:
    """A tree and a trace with the verdicts of both, and the smallest tree and trace of that kind."""

    name: str
    tree: str
    trace: tuple[Json, ...]
    reference: str
    paper: str
    small_tree: str
    small_trace: tuple[Json, ...]


def word(letters: str) -> tuple[Json, ...]:
    return tuple({"event": letter} for letter in letters.split())


KNOWN = [
    Known(
        "VOT with a compound child: the unrolled alternatives start alike, and only the first is followed",
        "toplevel r; r 2of3 s b c; s sand a d; a; b; c; d;",
        word("a b d"),
        "??⊤",
        "?⊥⊥",
        "toplevel r;\nr 1of2 s b;\ns and a d;\na;\nd;\nb;\n",
        word("a b"),
    ),
    Known(
        "VOT followed by an event: a third child after the second is not at least two",
        "toplevel r; r sand v d; v 2of3 a b c; a; b; c; d;",
        word("a b c d"),
        "???⊤",
        "??⊥⊥",
        "toplevel r;\nr and v d;\nv 1of2 a b;\na;\nb;\nd;\n",
        word("a b"),
    ),
    Known(
        "OR branches with a common start: the attack is missed",
        "toplevel r; r sand a outcome; outcome or late altered; late fault; altered attack; a;",
        word("a altered"),
        "?⊤",
        "?⊥",
        "toplevel r;\nr       and a outcome;\na;\noutcome or late altered;\nlate;\naltered;\n",
        word("a altered"),
    ),
    Known(
        "AND children with overlapping events: the first child takes the event that only the second could do without",
        "event both(x, y) = { x: x, y: y }; event one(x) = { x: x };\ntoplevel r; r and p q; p on one(1); q on both(1, _);",
        ({"x": 1, "y": 2}, {"x": 1}),
        "?⊤",
        "?⊥",
        "event e() = { y: _ };\n\ntoplevel r;\nr and p q;\np;\nq         on e();\n",
        ({"y": 0, "event": "p"}, {"event": "p"}),
    ),
]


@pytest.mark.parametrize("known", KNOWN, ids=lambda known: known.name.partition(":")[0])
def test_the_paper_s_translation_differs(known: Known) -> None:
    job = Job(known.name, Semantics.STRICT)
    said = {}
    for name, enlist in PAPER.candidates(loads(known.tree), job):
        verdicts = verdicts_of(enlist(), known.trace)
        assert isinstance(verdicts, tuple)
        said[name] = "".join(verdict.symbol for verdict in verdicts)
    assert said == {"reference": known.reference, "engine": known.reference, "rml-paper": known.paper}


@pytest.mark.parametrize("known", KNOWN, ids=lambda known: known.name.partition(":")[0])
def test_the_checker_finds_and_shrinks_it(known: Known) -> None:
    task = Task(loads(known.tree), Job("known", Semantics.STRICT), PAPER, Effort())
    (differing,) = [result for result in task.run() if result.status is Status.DIFFERS]
    assert differing.participant == "rml-paper"
    case = shrunk(task, differing)
    assert dumps(case.tree) == known.small_tree
    assert case.trace == known.small_trace
    assert set(case.verdicts) == {"reference", "rml-paper"}
    assert case.specifications["rml-paper"][0] == "rml"
