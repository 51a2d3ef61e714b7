"""Readers of LTLf and HOA against the definition of a text with variables (`sliced`), for texts of a person."""

from collections.abc import Sequence
from random import Random

import pytest

from rvaft.backend import backend
from rvaft.model.verdict import Verdict
from tests.backends.sliced import COMPARISONS, Atom, Event, Formula, HoaText, LtlfText, Text

NEEDS_SPOT = pytest.mark.spot


def atom(random: Random, name: str, names: list[str], *, guarded: bool) -> Atom:
    """An atom with one or two fields, perhaps with a guard about any variables."""
    chosen = random.sample(["n", "m"], random.choice([1, 1, 2]))
    values: list[str | int] = [*names, *names, 0, 1]
    fields = tuple((field, random.choice(values)) for field in chosen)
    return Atom(name, fields, (guard(random, names),) if guarded and random.random() < 0.5 else ())


def guard(random: Random, names: list[str]) -> tuple[str, str, str | int]:
    """A comparison of a variable."""
    others: list[str | int] = [*names, 0, 1]
    return random.choice(names), random.choice(list(COMPARISONS)), random.choice(others)


def formula(random: Random, names: list[str], depth: int) -> Formula:
    """A formula over atoms."""
    if depth == 0 or random.random() < 0.15:
        return random.choice(names), ()
    sign = random.choice(["!", "&", "|", "X[!]", "X", "F", "G", "U", "&", "|"])
    return sign, tuple(formula(random, names, depth - 1) for _ in range(2 if sign in "&|U" else 1))


def ltlf(random: Random) -> Text:
    """A formula over two or three atoms with one or two variables."""
    names = ["X", "Y"][: random.choice([1, 2, 2])]
    atoms = tuple(atom(random, name, names, guarded=True) for name in "abc"[: random.choice([2, 3])])
    return LtlfText(atoms, formula(random, [one.name for one in atoms], random.choice([2, 3, 3])))


def hoa(random: Random) -> Text:
    """An automaton of three or four states, over two events and perhaps a guard."""
    names = ["X", "Y"][: random.choice([1, 2, 2])]
    atoms = [atom(random, name, names, guarded=False) for name in "ab"]
    atoms += [Atom("g", (), (guard(random, names),))] * random.choice([0, 1, 1])
    last = random.choice([2, 3])
    letters = Text.letters_of(atoms)
    targets = [{letter: random.randrange(last + 1) for letter in letters} for _ in range(last)]
    marked = random.choice([[False] * last + [True], [random.random() < 0.5 for _ in range(last + 1)]])
    return HoaText(tuple(atoms), [*targets, dict.fromkeys(letters, last)], marked)


def differences(text: Text, language: str, trace: Sequence[Event]) -> list[tuple[Verdict, Verdict]]:
    """The verdicts of the reader and of the definition, where they differ."""
    found = backend(language).read(str(text)).run(trace)
    expected = (text.verdict(trace[: length + 1]) for length in range(len(trace)))
    return [pair for pair in zip(found, expected, strict=True) if pair[0] is not pair[1]]


@NEEDS_SPOT
@pytest.mark.parametrize("language", ["ltlf", "automaton"])
@pytest.mark.parametrize(
    ("seed", "number"), [(0, 60), *(pytest.param(seed, 800, marks=pytest.mark.slow) for seed in range(1, 5))]
)
def test_random_texts(language: str, seed: int, number: int) -> None:
    for one in range(number):
        random = Random(f"{seed} {one}")
        text = (ltlf if language == "ltlf" else hoa)(random)
        for _ in range(6):
            trace: list[Event] = [
                {field: random.choice([0, 1, 2]) for field in random.sample(["n", "m"], random.choice([1, 2]))}
                for _ in range(random.choice([1, 2, 3, 4]))
            ]
            assert differences(text, language, trace) == [], (str(text), trace)


A, B = ("a", ()), ("b", ())
PINNED = {
    "two variables of one event": (
        LtlfText((Atom("a", (("m", "X"),)), Atom("b", (("n", "Y"),))), ("X[!]", (("&", (A, B)),))),
        [{"n": 2}, {"n": 2, "m": 1}],
        Verdict.TRUE,
    ),
    "a guard of another variable that does not hold": (
        LtlfText(
            (Atom("a", (("n", "X"),)), Atom("b", (("m", 1),), (("X", "<", 1),))),
            ("X[!]", (("&", (("!", (B,)), ("X[!]", (A,)))),)),
        ),
        [{"n": 2}, {"m": 1}, {"n": 2}],
        Verdict.TRUE,
    ),
}


@NEEDS_SPOT
@pytest.mark.parametrize("name", PINNED)
def test_a_slice_may_need_a_value_before_its_state_reads_it(name: str) -> None:
    text, trace, verdict = PINNED[name]
    assert text.verdict(trace) is verdict
    assert [*backend("ltlf").read(str(text)).run(trace)][-1] is verdict


@NEEDS_SPOT
def test_a_variable_of_one_event_is_never_bound() -> None:
    """Clause: two events whose time is `_t` need not have the same time."""
    atoms = "atom a := { n: 1 } at _t\natom b := { n: 2 } at _t"
    text = f"/* rvaft\ntime t as s\n{atoms}\n*/\nF(a & X[!] F b)"
    assert [*backend("ltlf").read(text).run([{"n": 1, "t": 0}, {"n": 2, "t": 1}])][-1] is Verdict.TRUE
    one = text.replace("_t", "T")
    assert [*backend("ltlf").read(one).run([{"n": 1, "t": 0}, {"n": 2, "t": 1}])][-1] is Verdict.UNKNOWN
