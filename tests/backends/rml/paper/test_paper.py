"""The published translation: to the letter, and known to differ from the tree where it does."""

from time import process_time

import pytest

from backends.rml.paper import RmlPaperBackend
from rvaft.api import loads
from rvaft.errors import NotExpressible, TooLarge
from rvaft.model.verdict import Semantics
from rvaft.semantics import Reference
from tests.tables import rows
from tests.trees import shipped

PINNED = rows(__file__, "gates.txt")


@pytest.mark.parametrize(("tree", "equations"), PINNED, ids=[tree for tree, _ in PINNED])
def test_the_gates_as_printed(tree: str, equations: str) -> None:
    text = RmlPaperBackend().translate(loads(tree), Semantics.STRICT).text
    assert text[text.index("Main") :].strip() == equations


COMMON_START = 'top or x y; x sand a b; y sand a2 c; a2 on e(); a on e(); event e() = { event: "k" };'
OVERLAP = "top and m n; m on p(1); n on q(1); event p(x) = { x: x }; event q(y) = { y: y };"
DIFFERS = [
    ("VOT over a compound child loses an interleaving", "top 2of3 s b c; s sand a d;", "a b d", "?FF", "??T"),
    ("VOT followed by an event means exactly K", "top sand v d; v 2of3 a b c;", "a b c d", "??FF", "???T"),
    ("branches with a common start: the later one is missed", COMMON_START, "k c", "?F", "?T"),
    ("AND over overlapping events commits to the left", OVERLAP, [{"x": 1, "y": 1}, {"x": 1}], "?F", "?T"),
]


@pytest.mark.parametrize(("why", "text", "trace", "published", "meant"), DIFFERS, ids=[row[0] for row in DIFFERS])
def test_where_it_is_known_to_differ(why: str, text: str, trace: object, published: str, meant: str) -> None:
    tree = loads(text)
    events = [{"event": word} for word in trace.split()] if isinstance(trace, str) else trace
    assert isinstance(events, list)
    signs = {"true": "T", "false": "F", "unknown": "?"}
    monitor = RmlPaperBackend().translate(tree, Semantics.STRICT).monitor()
    assert "".join(signs[v] for v in monitor.run(events)) == published
    assert "".join(signs[v] for v in Reference(tree, Semantics.STRICT).run(events)) == meant


def test_the_union_of_the_branches_misses_the_attack() -> None:
    tree = shipped.load("remote_inspection/pruned")
    events = dict(shipped.traces("remote_inspection/pruned"))["table2_row3"]
    monitor = RmlPaperBackend().translate(tree, Semantics.PROJECTED).monitor()
    assert [str(v) for v in monitor.run(events)][-1] == "false"
    assert [str(v) for v in Reference(tree).run(events)][-1] == "true"


@pytest.mark.parametrize("name", shipped.names())
@pytest.mark.parametrize("semantics", [Semantics.STRICT, Semantics.PROJECTED])
def test_every_shipped_tree_gives_a_text_that_runs(name: str, semantics: Semantics) -> None:
    specification = RmlPaperBackend().translate(shipped.load(name), semantics)
    for _, events in shipped.traces(name):
        assert list(specification.monitor().run(events))
    assert specification.metrics.symbols > 3


def test_scattered_is_not_in_the_paper() -> None:
    with pytest.raises(NotExpressible, match="the paper does not say how"):
        RmlPaperBackend().translate(loads("top or a b;"), Semantics.SCATTERED)


def test_the_unrolled_vot_explodes_at_a_limit() -> None:
    start = process_time()
    for threshold, children in ((20, 40), (3, 190)):
        tree = loads(f"top {threshold}of{children} {' '.join(f'e{i}' for i in range(children))};")
        with pytest.raises(TooLarge, match="10 allowed for each term"):
            RmlPaperBackend().translate(tree, Semantics.STRICT)
    assert process_time() - start < 0.5  # counted, not built
    with pytest.raises(TooLarge):
        RmlPaperBackend().translate(loads("top or a b c;"), Semantics.STRICT, limit=2)


def test_equations_are_counted() -> None:
    for text, equations in (("top and a b;", 1), ("top 2of3 a b c;", 5), ("top 3of4 a b c d;", 1 + 1 + 4 + 6)):
        assert RmlPaperBackend().translate(loads(text), Semantics.PROJECTED).metrics.states == equations


def test_it_is_not_faithful() -> None:
    assert not RmlPaperBackend.faithful


def test_a_tree_that_the_unrolled_gates_leave_nothing_of_is_refused() -> None:
    """A VOT is one branch, with all its guards, though the child that has the guard is not needed."""
    tree = loads("event on(v) = { v: v };\ntoplevel r; r 1of2 a b; a on on(1); b on on(2) when 1.5 < 0;\n")
    with pytest.raises(NotExpressible, match="every branch has a guard that never holds"):
        RmlPaperBackend().translate(tree, Semantics.STRICT)
