"""Mutants of RML texts: none is certified that has other verdicts than the tree."""

import re
from collections import Counter
from random import Random

import pytest

from backends.rml.writer.terms import KEYWORDS
from cross_check.generate.traces import random_trace
from cross_check.generate.trees import Shape, random_tree
from rvaft import RVAFT, RvaftError, Semantics, load
from rvaft.backend import backend
from rvaft.semantics import Reference
from tests.proofs.test_certify import TREES, certified, drops_late_events, emitted
from tests.proofs.verified import built

TOKENS = re.compile(r"'[^']*'|\d+\.?\d*|\w+|\\/|/\\|[<>=!]=|>>|[^\s\w]")
GROUPS = [{"\\/", "/\\", "|"}, {"<", "<=", ">", ">=", "==", "!="}, {"all", "empty", "none", "any"}, {"+", "-"}]
VARIABLES = Shape(max_nodes=5, times=0, functions=0, assumptions=0)


def mutants(random: Random, text: str, number: int) -> list[str]:
    """Texts of RML in which a token is another one of its kind, or is left out, or two are exchanged."""
    found: list[str] = []
    body = text.index("\n\n") + 2
    places = [(body + one.start(), body + one.end()) for one in TOKENS.finditer(text[body:])]
    words = sorted({text[a:b] for a, b in places})
    for _ in range(50 * number):
        (a, b), (c, d) = sorted(random.sample(places, 2))
        token = text[a:b]
        match random.choice(["another", "another", "another", "nothing", "exchange"]):
            case "another":
                kinds = [group for group in GROUPS if token in group]
                if not kinds:
                    alike = [one for one in words if one[0].isalpha() == token[0].isalpha() and one not in KEYWORDS]
                    kinds = [{*alike, "_"} if token[0].isalnum() or token[0] in "'_" else {token}]
                mutant = text[:a] + random.choice(sorted(kinds[0])) + text[b:]
            case "nothing":
                mutant = text[:a] + text[b:]
            case _:
                mutant = text[:a] + text[c:d] + text[b:c] + token + text[d:]
        try:
            backend("rml").read(mutant)
        except RvaftError:
            continue
        if mutant != text:
            found.append(mutant)
        if len(found) == number:
            break
    return found


def false_certificates(random: Random, tree: RVAFT, semantics: Semantics, number: int) -> Counter[int]:
    """The statuses of mutants; asserts that those with a certificate have the verdicts of the tree."""
    statuses: Counter[int] = Counter()
    text = emitted(tree, "rml", semantics)
    if text is None or drops_late_events(tree) or certified(tree, text, "rml", semantics)[0] != 0:
        return statuses
    traces = [random_trace(random, tree, max_length=8) for _ in range(150)]
    expected = [list(Reference(tree, semantics).run(trace)) for trace in traces]
    for mutant in mutants(random, text, number):
        status, why = certified(tree, mutant, "rml", semantics)
        statuses[status] += 1
        if status == 0:
            found = [list(backend("rml").read(mutant).run(trace)) for trace in traces]
            assert found == expected, (why, semantics, mutant)
    return statuses


NAMES = ["remote_inspection/pruned", "pipeline/pollution", "vehicle/takeover", "detections/aws_trail_off"]


@built
@pytest.mark.slow
@pytest.mark.parametrize("name", NAMES)
@pytest.mark.parametrize("semantics", [Semantics.STRICT, Semantics.PROJECTED])
def test_mutants_of_the_trees(name: str, semantics: Semantics) -> None:
    statuses = false_certificates(Random(name), load(TREES / f"{name}.rvaft"), semantics, 60)
    assert statuses.total() == 60
    print(statuses)


@built
@pytest.mark.slow
@pytest.mark.parametrize("seed", range(10))
def test_mutants_of_random_trees(seed: int) -> None:
    statuses: Counter[int] = Counter()
    for number in range(12):
        random = Random(f"mutants {seed} {number}")
        for semantics in (Semantics.STRICT, Semantics.PROJECTED):
            statuses += false_certificates(random, random_tree(random, VARIABLES), semantics, 12)
    assert statuses.total() > 40
    print(statuses)
