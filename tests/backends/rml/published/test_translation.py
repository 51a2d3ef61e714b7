"""What the `rml` backend emits, compiled and run by the published tools, has the verdicts of the reference after every prefix.

Left out are only the pairs of text and trace that the table of deviations names.
"""

from collections.abc import Iterable
from pathlib import Path
from random import Random

import pytest

from backends.conformance import strings_ordered
from backends.rml import RmlBackend, writer
from backends.rml.reader.deviations import touching
from cross_check.generate.traces import random_trace
from cross_check.generate.trees import PLAIN, VARIABLE_FREE, Shape, random_tree
from rvaft.api import loads
from rvaft.errors import NotExpressible, TooLarge
from rvaft.language.printer import dumps
from rvaft.model.tree import RVAFT
from rvaft.model.verdict import Semantics
from rvaft.semantics import Reference
from tests.backends.rml.published.runner import compiled, needs_published, verdicts

pytestmark = [pytest.mark.published, needs_published]

VOT_WITHIN = ("sand n d", "sand d n", "or n d", "and n d", "sand d n e")
VOT_AROUND = ("or a b", "and a b", "sand a b", "sand_rl a b", "or m c; m and a b", "2of3 a b c")
LETTERS = {"true": "T", "false": "F", "unknown": "?"}
SHAPES = {
    "plain": PLAIN,
    "variable-free": VARIABLE_FREE,
    "read-once": Shape(sharing=0, typed_events=0.1, variables=0, guards=0.1, ignores=0.1, max_nodes=11),
    "variables": Shape(variables=1, guards=0.4, max_nodes=7),
}


def _may_be_refused(name: str, tree: RVAFT, semantics: Semantics, error: NotExpressible | TooLarge) -> bool:
    """Without variables nothing is, but for relevance that depends on the order of strings."""
    if name == "variables":
        return True
    return isinstance(error, NotExpressible) and semantics is Semantics.PROJECTED and strings_ordered(tree, semantics)


@pytest.mark.parametrize("name", SHAPES)
def test_random_trees(name: str, tmp_path: Path) -> None:
    random = Random(f"published {name}")
    _compare(name, (random_tree(random, SHAPES[name]) for _ in range(40)), random, tmp_path)


@pytest.mark.parametrize("counted", [False, True])
def test_vot(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, *, counted: bool) -> None:
    """Small votes as they are, and counted like large ones."""
    if counted:
        monkeypatch.setattr(writer, "SMALL", 0)
    leaves = "abcdef"
    alone = [f"top {k}of{n} {' '.join(leaves[:n])};" for n in (3, 4, 6) for k in range(1, n)]
    within = [f"top {whole}; n {k}of3 a b c;" for k in (1, 2) for whole in VOT_WITHIN]
    around = [f"top {k}of3 n e f; n {child};" for k in (1, 2) for child in VOT_AROUND]
    _compare("vot", (loads(text) for text in (*alone, *within, *around)), Random("published vot"), tmp_path)


def _compare(name: str, trees: Iterable[RVAFT], random: Random, tmp_path: Path) -> None:
    found = []
    for tree in trees:
        for semantics in Semantics:
            try:
                text = RmlBackend().translate(tree, semantics, limit=3_000).text
            except (NotExpressible, TooLarge) as error:
                assert _may_be_refused(name, tree, semantics, error), f"{error}\n{dumps(tree)}"  # noqa: PT017
                continue
            traces = [random_trace(random, tree) for _ in range(8)]
            expected = [
                "?" + "".join(LETTERS[verdict.value] for verdict in Reference(tree, semantics).run(trace))
                for trace in traces
            ]
            found.append((text, traces, expected))
    targets = compiled([text for text, _, _ in found], tmp_path)
    assert [target for target in targets if isinstance(target, str)] == []
    runs = verdicts([(target, traces) for target, (_, traces, _) in zip(targets, found, strict=True)])  # type: ignore[misc]
    compared = 0
    for (text, traces, expected), run in zip(found, runs, strict=True):
        for trace, wanted, got in zip(traces, expected, run, strict=True):
            if not touching(text, trace):
                compared += 1
                assert got == wanted, f"{text}\n{trace}"
    assert compared > 100
