"""The texts: the formula of each gate, where compositional forms give way to a sum, names, strings, guards."""

from pathlib import Path

import pytest

from backends.ltlf import LtlfBackend
from rvaft.api import loads
from rvaft.errors import LanguageError
from rvaft.model.nodes import Gate, Node
from rvaft.model.tree import RVAFT
from rvaft.model.values import Json
from rvaft.model.verdict import Semantics
from rvaft.monitors import Monitor
from rvaft.semantics import Reference
from tests.backends.texts import events, needs_spot
from tests.tables import rows, sampled

BACKEND = LtlfBackend()

FORMULAS = rows(__file__, "formulas.txt")


def text_of(tree: str, semantics: str) -> str:
    return BACKEND.translate(loads(tree), Semantics(semantics)).text


def body(text: str) -> list[str]:
    """Definitions and formula, without the lines about events."""
    about = ("/* rvaft", "*/", "atom ", "relevant ", "ignored ")
    return [line for line in text.splitlines() if not line.startswith(about)]


@pytest.mark.parametrize(("tree", "semantics", "expected"), FORMULAS)
def test_formula(tree: str, semantics: str, expected: list[str]) -> None:
    assert body(text_of(tree, semantics)) == expected


@pytest.mark.spot
@needs_spot
@pytest.mark.parametrize("tree", [tree for tree, _, _ in FORMULAS[-9:]] + ["t sand a b; a or x s; b or y s;"])
@pytest.mark.parametrize("semantics", sampled(Semantics, 4))
def test_every_short_word(tree: str, semantics: Semantics) -> None:
    """The trees with the counterexamples, on every word of up to four events."""
    made = loads(tree)
    letters: list[Json] = [{"e": 1}, {"e": 2}] if "event e" in tree else events("b s x y z")
    pairs: list[tuple[Monitor, Monitor, list[Json]]]
    pairs = [(BACKEND.translate(made, semantics).monitor(), Reference(made, semantics), [])]
    for _ in range(4):
        longer = [
            (one.fork(), other.fork(), [*word, letter]) for one, other, word in pairs for letter in [*letters, {}]
        ]
        for one, other, word in longer:
            assert one.step(word[-1]) is other.step(word[-1]), word
        pairs = longer


@pytest.mark.parametrize("tree", sorted(Path(__file__).with_name("pinned").glob("*.rvaft")), ids=lambda path: path.stem)
def test_whole_text(tree: Path) -> None:
    """Guards stand at every event that binds one of their variables; relevance is as the tree says."""
    assert text_of(tree.read_text(), tree.stem.split(".")[1]) == tree.with_suffix(".ltlf").read_text()


def test_names_are_legal_and_different() -> None:
    leaves = ("a", "A", "x y", "x_y", "true", "xor", "1st", "é", "F", "a_2", "s1", "rel")
    tree = RVAFT("top", [Node("top", Gate.SAND, leaves), *map(Node, leaves)])
    lines = BACKEND.translate(tree, Semantics.PROJECTED).text.splitlines()
    given = [line.split()[1] for line in lines if line.startswith("atom ")]
    assert len(set(given)) == len(leaves)
    assert all(name.isascii() and name == name.lower() and not name[0].isdigit() for name in given)


@pytest.mark.spot
@needs_spot
def test_no_field_of_an_event_is_taken_for_its_time() -> None:
    tree = loads('time t as s; event x(v) = { v: v, "time of the event": 5 }; top and a b within 3 s; b; a on x(_);')
    monitor = BACKEND.translate(tree, Semantics.SCATTERED).monitor()
    trace: list[Json] = [{"t": 9, "event": "b"}, {"t": 1, "v": 0, "time of the event": 5}]
    trace += [{"t": 8, "v": 0, "time of the event": 5}]
    assert [monitor.step(event).symbol for event in trace] == ["?", "?", "⊤"]


@pytest.mark.parametrize(
    ("line", "message"),
    [
        ("atom a := {} at 1", "expected the name of a variable after `at`"),
        ("atom a := {} at X at Y", "`at` stands once, right after the pattern"),
        ("atom a := {} when X > 1 at X", "`at` stands once, right after the pattern"),
    ],
)
def test_the_variable_of_a_time_stands_after_the_pattern(line: str, message: str) -> None:
    with pytest.raises(LanguageError, match=message):
        BACKEND.read(f"/* rvaft\ntime t as s\n{line}\n*/\nF a")
