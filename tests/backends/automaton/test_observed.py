"""What a HOA text asks of events."""

import pytest

from backends.automaton import AutomatonBackend
from rvaft.backend import Observed
from rvaft.errors import LanguageError
from rvaft.language.parser import parse_guard, parse_pattern
from rvaft.model.guards import Operation, Operator
from rvaft.model.patterns import Literal, ObjectPattern, Variable

pytestmark = pytest.mark.spot
pytest.importorskip("spot")

BODY = """\
Acceptance: 1 Inf(0)
acc-name: Buchi
--BODY--
State: 0 {0}
[t] 0
--END--
"""


def text(propositions: str, *lines: str) -> str:
    names = propositions.split()
    said = "".join(f"{line}\n" for line in lines)
    quoted = " ".join(f'"{name}"' for name in names)
    return f"HOA: v1\nStates: 1\nStart: 0\nAP: {len(names)} {quoted}\n{said}{BODY}"


def observed(given: str, **atoms: str) -> set[Observed]:
    return set(AutomatonBackend().observed(given, atoms={name: parse_pattern(one) for name, one in atoms.items()}))


def test_propositions_by_default_by_the_caller_and_by_the_header() -> None:
    given = text("alive a b c", 'event: 3 "{ x: _1, y: _1 }"')
    assert observed(given, b="{v: 1}", c="{v: 1}") == {
        Observed(ObjectPattern((("event", Literal("a")),))),
        Observed(parse_pattern("{v: 1}")),
        Observed(parse_pattern("{x: _1, y: _1}")),
    }


def test_variables_of_relevance_are_its_own() -> None:
    lines = ('alphabet: "{ v: X }" "X > 1"', 'ignore: "{ w: X }"')
    guard = Operation(Operator.GT, (Variable("_X"), Literal(1)))
    expected = {
        Observed(ObjectPattern((("v", Variable("_X")),)), guard),
        Observed(ObjectPattern((("w", Variable("_X")),))),
    }
    assert observed(text("alive r", "relevant: 1", *lines)) == expected
    assert observed(text("alive", *lines)) == set(), "without a proposition for relevance nobody looks"


def test_variables_of_propositions_are_shared_and_their_guards_asked_there() -> None:
    given = text("alive a g", 'event: 1 "{ v: X }"', 'guard: 2 "X > 1"')
    pattern = parse_pattern("{v: X}")
    assert observed(given) == {Observed(pattern), Observed(pattern, parse_guard("X > 1"))}


def test_bad_texts() -> None:
    for given in ("", text("alive a", 'event: 7 "{ v: X }"'), text("alive a", "event: 1 1")):
        with pytest.raises(LanguageError):
            AutomatonBackend().observed(given)
