"""Trees that take much time or memory: the cost is linear, or they are refused before the work."""

from collections.abc import Callable
from pathlib import Path
from time import monotonic

import pytest

from rvaft.backend import all_backends, backend
from tests.cli.runs import process, written
from tests.tables import sampled

SECONDS = 40
"""Many times what each case takes on a quiet machine; before, most took more than a minute."""


def conjuncts(number: int) -> str:
    guard = " and ".join(f"(X > {one} or X < -{one})" for one in range(number))
    return f'event e(x) = {{ event: "a", x: x }};\ntop and a b; a on e(X) when {guard}; b;\n'


def leaves(number: int) -> str:
    return f"top or {' '.join(f'l{one}' for one in range(number))};\n"


def shared(upper: str, lower: str, depth: int) -> str:
    """Gates of which each reaches the next one in two ways."""
    level = "g{0} {2} h{0} k{0}; h{0} {3} g{1} x{0}; k{0} {3} g{1} y{0};\n"
    return f"toplevel g0;\n{''.join(level.format(one, one + 1, upper, lower) for one in range(depth))}g{depth};\n"


CASES: dict[str, tuple[Callable[[], str], tuple[str, ...]]] = {
    "a guard of many conjuncts": (lambda: conjuncts(1_000), ("monitor", "@", "log")),
    "a guard of many conjuncts, checked": (lambda: conjuncts(1_000), ("check", "@")),
    "many branches": (lambda: leaves(2_000), ("branches", "@")),
    "many branches as mathematics": (lambda: leaves(2_000), ("branches", "@", "--format", "unicode")),
    "many scenarios of a query": (lambda: leaves(2_000), ("emit", "@", "--to", "sql", "--semantics", "scattered")),
    "too many scenarios": (lambda: leaves(10_000), ("emit", "@", "--to", "kql", "--semantics", "scattered")),
    **{
        f"shared gates, {upper} over {lower}, {name}": (
            lambda upper=upper, lower=lower: shared(upper, lower, 40),  # type: ignore[misc]
            ("emit", "@", "--to", name, "--semantics", "scattered"),
        )
        for name in ("ltlf", "automaton", "c", "rml")
        for upper, lower in (("sand", "or"), ("and", "or"), ("or", "and"))
    },
}


@pytest.mark.parametrize("name", sampled([(name,) for name in CASES], 2))
def test_a_large_tree(name: str, tmp_path: Path) -> None:
    text, words = CASES[name]
    files = {
        "@": written(tmp_path / "t.rvaft", text()),
        "log": written(tmp_path / "log.jsonl", '{"event": "a", "x": 5}\n'),
    }
    begun = monotonic()
    done = process(*(files.get(word, word) for word in words), timeout=120)
    assert monotonic() - begun < SECONDS
    assert "Traceback" not in done.stderr
    assert done.returncode in (0, 2)
    assert done.returncode == 0 or done.stderr.startswith("rvaft: error: too large: "), done.stderr


@pytest.mark.parametrize("name", sampled([(name,) for name in all_backends()], 4))
def test_a_huge_tree_is_refused_before_the_work(name: str, tmp_path: Path) -> None:
    most = backend(name).most_nodes
    if most > 50_000:
        pytest.skip("its translation is linear")
    tree = written(tmp_path / "t.rvaft", leaves(most + 1))
    begun = monotonic()
    done = process("emit", tree, "--to", name, timeout=120)
    assert monotonic() - begun < SECONDS
    assert done.returncode == 2
    assert "nodes of the tree (limit 20000); raise it with --limit N" in done.stderr
