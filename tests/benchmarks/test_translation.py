"""Seconds and sizes of the translations: AND and SAND over 3, 6, 9, 12 leaves and VOT k of 12, under each semantics.

`pytest tests/benchmarks/test_translation.py -s` prints the table.
"""

import time

import pytest
from pytest_benchmark.fixture import BenchmarkFixture

from rvaft.api import loads
from rvaft.backend import backend
from rvaft.errors import NotExpressible, TooLarge
from rvaft.model.nodes import Gate
from rvaft.model.tree import RVAFT
from rvaft.model.verdict import Semantics
from tests.benchmarks.trees import flat, text_of_size

TREES = {
    **{f"AND/{n}": flat(Gate.AND, n) for n in (3, 6, 9, 12)},
    **{f"SAND/{n}": flat(Gate.SAND, n) for n in (3, 6, 9, 12)},
    **{f"VOT {k}/12": flat(Gate.VOT, 12, k) for k in range(1, 13)},
}
LANGUAGES = ("rml", "ltlf", "automaton")


def row(name: str, tree: RVAFT, language: str, semantics: Semantics) -> str:
    start = time.perf_counter()
    try:
        metrics = backend(language).translate(tree, semantics).metrics
    except (NotExpressible, TooLarge) as error:
        return f"{name:9} {language:9} {semantics:9} {type(error).__name__}"
    seconds = time.perf_counter() - start
    sizes = f"symbols {metrics.symbols:7} subformulas {metrics.subformulas or '-':>6} states {metrics.states or '-':>6}"
    return f"{name:9} {language:9} {semantics:9} {seconds:7.3f} s  {sizes}"


@pytest.mark.benchmark
@pytest.mark.parametrize("language", LANGUAGES)
def test_table(language: str, capsys: pytest.CaptureFixture[str]) -> None:
    rows = [row(name, tree, language, semantics) for name, tree in TREES.items() for semantics in Semantics]
    with capsys.disabled():
        print("", *rows, sep="\n")
    assert all("NotExpressible" not in line for line in rows)


@pytest.mark.benchmark
def test_and_12_to_hoa(benchmark: BenchmarkFixture) -> None:
    """Aim: under 3 s."""
    spec = benchmark.pedantic(backend("automaton").translate, (flat(Gate.AND, 12), Semantics.STRICT), rounds=3)
    benchmark.extra_info.update(states=spec.metrics.states, bytes=len(spec.text))
    assert spec.metrics.states == 2**12 + 2


@pytest.mark.benchmark
def test_loading_ten_thousand_nodes(benchmark: BenchmarkFixture) -> None:
    tree = benchmark.pedantic(loads, (text_of_size(10_000),), rounds=3)
    assert len(tree.nodes) >= 9_999
