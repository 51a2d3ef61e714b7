"""Every shipped tree: its traces get the verdicts that are stored with it, from everybody."""

from itertools import product

import pytest

from cross_check.comparison import Roster
from cross_check.participants import Absent, Participant, reports_detections_only
from cross_check.results import Job
from rvaft import NotExpressible, Semantics, TooLarge, ToolMissing, Verdict, all_backends
from rvaft.backend import backend
from rvaft.model.assumptions import first_violation
from rvaft.rules.registry import check_tree
from tests.tables import sampled
from tests.trees import shipped

ONLY = frozenset(name for name in all_backends() if Verdict.FALSE not in backend(name).verdicts)
"""Languages that tell detections alone; what they cannot say their own tests have."""


LARGE = {("cloudtrail/takeover", "automaton"), ("absence/spray", "automaton")}
"""Trees that count so many events that their automaton is beyond the limit."""


@pytest.mark.parametrize("name", sampled(shipped.names(), 4))
def test_the_reference_gives_the_stored_verdicts(name: str) -> None:
    assert shipped.computed(name) == shipped.expected(name)
    assert len(dict(shipped.traces(name))) >= 6


EVERY = [*product(shipped.names(), Semantics)]
STATED = [(name, one) for name, one in EVERY if one is (shipped.load(name).semantics or Semantics.SCATTERED)]
"""Each tree under the semantics that it states."""
FURTHER = [pair for pair in EVERY if pair not in STATED and "detections/" not in pair[0]]
"""The trees besides the many of detections, under the others."""
OTHERS = [pytest.param(*pair, marks=pytest.mark.slow) for pair in EVERY if pair not in (*STATED, *FURTHER)]


@pytest.mark.parametrize(("name", "semantics"), [*sampled(STATED, 5), *sampled(FURTHER, 12, ci=3), *OTHERS])
def test_the_engine_and_every_text_give_the_stored_verdicts(name: str, semantics: Semantics) -> None:
    tree, traces, expected = shipped.load(name), dict(shipped.traces(name)), shipped.expected(name)
    columns = [column for column in next(iter(expected.values()))[semantics] if column in ("tree", "1", "2")]
    for column in columns:
        job = Job(name, semantics, branch=None if column == "tree" else int(column))
        for participant, enlist in [*Roster().candidates(tree, job)][1:]:  # the reference, the first, is asked above
            made = enlist()
            if isinstance(made, Absent):
                joined = participant == "rml" and tree.variables and semantics is Semantics.SCATTERED
                hard = tree.time is not None or semantics is Semantics.CONSECUTIVE or joined or participant in ONLY
                large = isinstance(made.error, TooLarge) and (name, participant) in LARGE
                refused = isinstance(made.error, NotExpressible) or large
                assert (refused and hard) or isinstance(made.error, ToolMissing), made.error
                continue
            assert isinstance(made, Participant)
            assumes = frozenset() if made.specification is None else made.specification.assumes
            kept = [one for one in traces if first_violation(tree, traces[one], assumes) is None]
            told = [one for one in kept if made.left_open is None or not made.left_open(traces[one])]
            told = (
                told[::6] if reports_detections_only(made) else told
            )  # their programs look at whole traces, and take long
            try:
                answers = made.answers([traces[one] for one in told])
            except TooLarge:
                assert (name, semantics) == ("cloudtrail/takeover", Semantics.SCATTERED)
                assert participant in ("automaton", "ltlf")
                continue
            for trace, verdicts in zip(told, answers, strict=True):
                said, stored = "".join(verdict.symbol for verdict in verdicts), expected[trace][semantics][column]
                wanted = stored.replace("⊥", "?") if reports_detections_only(made) else stored
                assert said == wanted, f"{participant} on {trace}, {column}"


@pytest.mark.parametrize(("name", "base"), shipped.ADDING.items())
def test_a_tree_that_adds_to_another_means_the_same(name: str, base: str) -> None:
    more, tree = shipped.load(name), shipped.load(base)
    said = [
        [list(one.nodes.items()), list(one.events.items()), one.root, one.ignores, one.causality]
        for one in (more, tree)
    ]
    assert said[0] == said[1]
    assert more.topics
    assert not check_tree(more)
