"""The published compiler and monitor say what is emitted, what the reader says, and what the Prolog
form says, but for the table of deviations.
"""

import json
import re
from collections.abc import Iterable, Sequence, Set
from contextlib import suppress
from itertools import product
from pathlib import Path
from random import Random
from typing import TypeAlias

import pytest

from backends.conformance import examples, traces
from backends.conformance.requirements import asks_of_strings
from backends.rml import RmlBackend, writer
from backends.rml.prolog import prolog
from backends.rml.reader.parser import parse
from backends.rml.reader.syntax import references
from cross_check.generate.traces import NoTraceFound, guided, random_event, random_trace
from cross_check.generate.trees import Shape, random_tree
from cross_check.published.rml_deviations import touching
from rvaft.api import loads
from rvaft.core.restriction import restrict
from rvaft.errors import NotExpressible, TooLarge
from rvaft.language.printer import dumps
from rvaft.model.assumptions import first_violation
from rvaft.model.patterns import Anything, SomeItem, walk
from rvaft.model.tree import RVAFT
from rvaft.model.values import Json, is_finite
from rvaft.model.verdict import Semantics
from rvaft.semantics import Reference
from tests.backends.rml.programs import CASES as PROGRAM_CASES
from tests.backends.rml.programs import Programs, events, letters, trace
from tests.backends.rml.published import compiled, needs_published, verdicts
from tests.backends.texts import SHAPES, signs
from tests.semantics.cases import CASES
from tests.tables import rows

pytestmark = [pytest.mark.published, needs_published]

VOT_WITHIN = ("sand n d", "sand d n", "or n d", "and n d", "sand d n e")
VOT_AROUND = ("or a b", "and a b", "sand a b", "sand_rl a b", "or m c; m and a b", "2of3 a b c")
PROGRAMS, TRACES = 300, 6
FEW = 3_000
"""So many paths through equations the published compiler is asked to walk; texts with more run in our Prolog alone."""

Sample: TypeAlias = tuple[RVAFT, Semantics, list[list[Json]]]


@pytest.mark.parametrize("name", ["plain", "variable-free", "read-once", "variables"])
def test_random_trees(name: str, tmp_path: Path) -> None:
    random = Random(f"published {name}")
    trees = [random_tree(random, SHAPES[name]) for _ in range(40)]
    samples = [(tree, one, [random_trace(random, tree) for _ in range(8)]) for tree in trees for one in Semantics]
    assert _compared(samples, tmp_path) > 100


NUMBERS = Shape(max_nodes=8, typed_events=0.9, variables=1, guards=0.5, times=0, counted=0.15, pand=0.4, functions=0.1)


@pytest.mark.parametrize("names", ["ABCDEFGHIJKLMNOPQRSTUVWXYZ", "XYZ"])
def test_variables_over_numbers(names: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Whole numbers alone: of these the guards of emitted texts are the same everywhere, and
    nothing of them is left out.

    With many names most variables are of one event each, as `consecutive` and `scattered` ask.
    """
    monkeypatch.setattr("cross_check.generate.trees.LITERALS", range(4))
    monkeypatch.setattr("cross_check.generate.trees.VARIABLES", tuple(names))
    monkeypatch.setattr("cross_check.generate.values.COMMON", range(4))
    random, samples = Random(f"published numbers {names}"), list[Sample]()
    for tree, semantics in product([random_tree(random, NUMBERS) for _ in range(40)], Semantics):
        some = [[random_event(random, tree, range(4)) for _ in range(random.randint(1, 9))] for _ in range(6)]
        with suppress(NoTraceFound):
            some += [guided(random, tree, semantics) for _ in range(4)]
        samples.append((tree, semantics, some))
    assert _compared(samples, tmp_path) > 500


def test_rows_of_the_definition_and_the_suite(tmp_path: Path) -> None:
    """Each tree under every semantics, on all its traces: also counted leaves, parts that end in
    order, and variables.
    """
    rows_of = dict.fromkeys((case.tree, case.branch, case.kind) for case in CASES)
    trees = [restrict(loads(text), branch=branch, kind=kind) for text, branch, kind in rows_of]
    own = [[c.events for c in CASES if (c.tree, c.branch, c.kind) == key] for key in rows_of]
    some = [*zip(trees, own, strict=True)]
    some += [(one.tree, [[*t] for t in traces(one, 4, Random(one.name))]) for one in examples()]
    assert _compared([(tree, one, given) for tree, given in some for one in Semantics], tmp_path) > 2_000


@pytest.mark.parametrize("counted", [False, True])
def test_vot(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, *, counted: bool) -> None:
    """Small votes as they are, and counted like large ones."""
    if counted:
        monkeypatch.setattr(writer, "SMALL", 0)
    alone = [f"top {k}of{n} {' '.join('abcdef'[:n])};" for n in (3, 4, 6) for k in range(1, n)]
    within = [f"top {whole}; n {k}of3 a b c;" for k in (1, 2) for whole in VOT_WITHIN]
    around = [f"top {k}of3 n e f; n {child};" for k in (1, 2) for child in VOT_AROUND]
    trees, random = [loads(text) for text in (*alone, *within, *around)], Random("published vot")
    samples = [(tree, one, [random_trace(random, tree) for _ in range(8)]) for tree in trees for one in Semantics]
    assert _compared(samples, tmp_path) > 100


OF_FLOATS = {"1 and 1.0", "tolerance of guards"}
"""Deviations that small whole numbers do not show, as emitted texts spell theirs both ways."""


def _compared(samples: Iterable[Sample], tmp_path: Path) -> int:
    """How many traces have the verdicts of the reference after every prefix; those that touch a
    deviation are left out.
    """
    found = []
    for tree, semantics, some in samples:
        try:
            made = RmlBackend().translate(tree, semantics, limit=3_000)
        except TooLarge:
            continue
        except NotExpressible:
            patterns = [tree.pattern(name) or Anything() for name in tree.nodes]
            lists = any(isinstance(part, SomeItem) for pattern in patterns for part in walk(pattern))
            assert tree.variables or tree.time is not None or lists or asks_of_strings(tree, semantics), dumps(tree)
            continue
        text = made.text
        kept = [one for one in some if all(map(is_finite, one)) and not _deviations(text, one)]
        kept = [one for one in kept if first_violation(tree, one, made.assumes) is None]
        found.append((text, kept, ["?" + signs(Reference(tree, semantics), one) for one in kept]))
    few = _all_compiled([text for text, _, _ in found if _is_compiled(text)], tmp_path)
    compilations, jobs = iter(few), []
    for number, (text, some, _) in enumerate(found):
        if _is_compiled(text):
            path = next(compilations)
        else:
            (path := tmp_path / f"our{number}.pl").write_text(prolog(text), encoding="utf-8")
        jobs.append((path, some))
    for (text, some, expected), run in zip(found, verdicts(jobs), strict=True):
        for one, wanted, got in zip(some, expected, run, strict=True):
            assert got == wanted, f"{text}\n{one}"
    return sum(len(some) for _, some, _ in found)


def _deviations(text: str, some: list[Json]) -> Set[str]:
    small = not (re.search(r"\d{7}|\.\d*[1-9]", text) or re.search(r"\d[.e]|\d{7}", json.dumps(some)))
    return {one.title for one in touching(text, some)} - (OF_FLOATS if small else set())


def _is_compiled(text: str) -> bool:
    """Whether the compiler takes it: not with letters beyond ASCII, and its check walks every path
    from `Main` that meets no equation twice.
    """
    if not text.isascii():
        return False
    equations = parse(text).equations
    uses = {name: references(equation.body) for name, equation in equations.items()}
    paths: list[tuple[str, ...]] = [("Main",)]
    for path in paths:
        if len(paths) > FEW:
            return False
        paths += [(*path, name) for name in uses[path[-1]] if name not in path]
    return True


def _all_compiled(texts: Sequence[str], tmp_path: Path) -> list[Path]:
    targets = compiled(texts, tmp_path)
    assert [target for target in targets if isinstance(target, str)] == []
    return [Path(target) for target in targets]


@pytest.mark.parametrize("ours", [False, True], ids=["their Prolog", "our Prolog"])
def test_the_published_tools_still_say_what_was_observed(tmp_path: Path, *, ours: bool) -> None:
    paths = [tmp_path / f"our{index}.pl" for index in range(len(PROGRAM_CASES))]
    if ours:
        for case, path in zip(PROGRAM_CASES, paths, strict=True):
            path.write_text(prolog(case.text), encoding="utf-8")
    else:
        paths = _all_compiled([case.text for case in PROGRAM_CASES], tmp_path)
    jobs = [(path, [events(trace) for trace in case.runs]) for path, case in zip(paths, PROGRAM_CASES, strict=True)]
    for case, found in zip(PROGRAM_CASES, verdicts(jobs), strict=True):
        assert {trace: run[1:] for trace, run in zip(case.runs, found, strict=True)} == case.runs, case.name


def test_the_published_tools_deviate_as_the_table_says(tmp_path: Path) -> None:
    shown = rows(__file__, "deviations.txt")
    paths = _all_compiled([text for _, text, _, _, _ in shown], tmp_path)
    found = verdicts([(path, [trace]) for path, (_, _, trace, _, _) in zip(paths, shown, strict=True)])
    assert [run[1:] for (run,) in found] == [published for _, _, _, published, _ in shown]


def test_the_reader_and_our_prolog_agree_on_random_programs(tmp_path: Path) -> None:
    random = Random(20)
    texts = [Programs(random).text() for _ in range(PROGRAMS)]
    given = [[trace(random, text) for _ in range(TRACES)] for text in texts]
    targets = compiled(texts, tmp_path)
    samples = [sample for sample in zip(targets, texts, given, strict=True) if isinstance(sample[0], Path)]
    assert len(samples) > PROGRAMS * 0.9  # the published compiler takes them
    theirs = verdicts([(Path(path), some) for path, _, some in samples])
    for path, text, _ in samples:
        Path(path).write_text(prolog(text), encoding="utf-8")
    assert verdicts([(Path(path), some) for path, _, some in samples]) == theirs
    compared = masked = 0
    for (_, text, some), found in zip(samples, theirs, strict=True):
        for one, published in zip(some, found, strict=True):
            if "E" in published or touching(text, one):
                masked += 1
            else:
                compared += 1
                assert letters(text, one) == published[1:], (text, one)
    assert compared > max(4 * masked, PROGRAMS * TRACES * 0.7)
