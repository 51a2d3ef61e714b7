"""How far, in small trees where it is easy to see."""

import pytest

from rvaft import loads
from rvaft.coverage import Coverage


def reached(tree: str, words: str, semantics: str) -> tuple[int, int, int | None, set[str]]:
    """What the first branch reached and needed, where, and what could have come next."""
    coverage = Coverage(loads(tree), semantics, branch=1)
    coverage.add("log", [{"event": word} for word in words.split()])
    (branch,) = coverage.report().branches
    return branch.reached, branch.needed, branch.event, {one.node for one in branch.awaited}


@pytest.mark.parametrize(
    ("tree", "words", "semantics", "expected"),
    [
        # without KofN: how many of its events were matched
        ("top sand a b c;", "a noise b", "projected", (2, 3, 3, {"c"})),
        ("top sand a b c;", "a noise b", "strict", (1, 3, 1, {"b"})),
        ("top sand a b c;", "a c b", "projected", (1, 3, 1, {"b"})),
        ("top sand a b c;", "a c b", "scattered", (2, 3, 3, {"c"})),
        ("top and a b c;", "c a", "strict", (2, 3, 2, {"b"})),
        ("top sand a b c;", "noise", "strict", (0, 3, None, {"a"})),
        ("top sand a b c;", "", "projected", (0, 3, None, {"a"})),
        ("top sand a b;", "a b a", "projected", (2, 2, 2, set())),
        # with KofN: how near the nearest end was
        ("top sand v d; v 2of3 a b c;", "a b c", "projected", (2, 3, 2, {"c", "d"})),
        ("top 1of2 x y; x and a b c d e; y and p q;", "p a", "projected", (1, 2, 1, {"a", "b", "c", "d", "e", "q"})),
        ("top 1of2 x y; x and a b c d e; y and p q;", "a b c d", "projected", (1, 2, 4, {"e", "p", "q"})),
        ("top 1of2 x y; x and a b c d e; y and p q;", "a b c", "projected", (0, 2, None, {*"abcde", "p", "q"})),
        # the match that came nearest, not what else had begun
        ("top 1of2 x y; x sand a b c; y and d e;", "a d", "scattered", (1, 2, 2, {"a", "e"})),
        ("top or x z; x sand a b c; z;", "a z", "scattered", (1, 3, 1, {"b"})),
    ],
)
def test_progress(tree: str, words: str, semantics: str, expected: object) -> None:
    assert reached(tree, words, semantics) == expected


@pytest.mark.parametrize("order", ["a b", "b a"])
def test_the_order_in_which_shared_nodes_came_decides_what_is_lacking(order: str) -> None:
    """Either event can be either node; only one way round leads to the shorter end."""
    tree = f'event e(n) = {{ event: n }}; top 1of2 v u; v and a b d f; u sand {order} c; a on e("l"); b on e("l");'
    assert reached(tree, "l l", "strict") == (2, 3, 2, {"c", "d", "f"})
