"""The engine against the reference where guards have the start and the end of nodes with choices."""

import pickle
from collections.abc import Callable
from functools import partial
from itertools import islice
from random import Random
from typing import Any, Final

import pytest

import rvaft
from rvaft.engine import Engine, pointed_run, subsumption
from rvaft.engine.compiled_tree import Register
from rvaft.engine.latest_starts import LatestStarts
from rvaft.engine.partial_matches import Matching
from rvaft.engine.pointed_run import PointedRun
from rvaft.errors import TooLarge
from rvaft.model.verdict import Semantics, Verdict
from tests.engine.checking import compare
from tests.engine.pointed import SHAPES, pointed_trace, pointed_trees
from tests.tables import sampled

SEEDS: Final = [0, *(pytest.param(seed, marks=pytest.mark.slow) for seed in range(1, 31))]


def campaign(shape: str, semantics: Semantics, seed: object, count: int) -> dict[Verdict, int]:
    """The verdicts of so many trees, of which each is compared on three traces."""
    random, told = Random(f"{shape} {semantics} {seed}"), dict.fromkeys(Verdict, 0)
    for tree in islice(pointed_trees(random, shape), count):
        for _ in range(3):
            trace = pointed_trace(random, tree, semantics)
            engine = compare(tree, trace, semantics)
            told[engine.verdict if engine else Verdict.UNKNOWN] += 1
            if random.random() < 0.1:
                compare(tree, trace, semantics, branch=random.randint(1, 3))
                compare(tree, trace, semantics, kind=random.choice(("fault", "attack")))
    return told


@pytest.mark.parametrize("seed", SEEDS)
@pytest.mark.parametrize("semantics", sampled(Semantics, 4))
@pytest.mark.parametrize("shape", SHAPES)
def test_verdicts_and_explanations(shape: str, semantics: Semantics, seed: int) -> None:
    told = campaign(shape, semantics, seed, 60 if seed else 4 if shape == "shared" else 8)
    assert told[Verdict.TRUE] > 2 or not seed
    assert told[Verdict.FALSE] > 3 or not semantics.ends


def forgets_the_present(register: Register, binding: dict[str, Any], now: Any) -> None:
    """A register of the events before the present one."""
    for name, extreme in ((register.least, min), (register.greatest, max)):
        before = binding.setdefault(name, now)
        previous = binding.setdefault(f"previous {name}", before)
        binding[name] = None if before is None or previous is None else extreme(before, previous)


def wrong_term(sign: int, extreme: Any) -> subsumption.Term:
    """The opposite direction for the registers of time points."""
    return TERM(-sign if any("[" in name for name in extreme.names) else sign, extreme)


TERM: Final = subsumption.Term
MERITS: Final = PointedRun._merits_of


def wrong_merits(run: PointedRun, node: int, *, first: bool) -> Callable[[Any], tuple[Any, ...]]:
    """The opposite direction for the values of time points."""
    merits = MERITS(run, node, first=first)
    return lambda match: merits((*match[:4], tuple((place, -value) for place, value in match[4]), match[5]))


def keeps_few(run: PointedRun, *arguments: Any, **options: Any) -> None:
    """A gate with a threshold keeps no more children than it needs."""
    INIT(run, *arguments, **options)
    run._moving = [False] * len(run._moving)


INIT: Final = PointedRun.__init__
ABC: Final = "p:a q:b b:c z:a"
CASES: Final = [
    # of two partial matches with the same events, the one that ends later, or earlier
    ("top sand a b when start(b) - end(a) <= 3 s; a and o x; o or p q", "p:a q:b x:a b:c", "a0 a1 a5 c6"),
    ("top sand a b when start(b) - end(a) >= 3 s; a and o x; o or p q", "p:a q:b x:a b:c", "a0 a1 a5 c6"),
    # the same of the matches of a node
    ("top sand a b when start(b) - end(a) <= 3 s; a or p q", "p:a q:b b:c", "a0 b5 c6"),
    ("top sand a b when start(b) - end(a) >= 3 s; a or p q", "p:a q:b b:c", "a0 b5 c6"),
    # more children than the gate needs
    ("top sand a b when end(a) - start(a) >= 3 s; a 1of2 p q", "p:a q:b b:c", "a0 b5 c6"),
    # the guard does not hold at first, while the gate may keep more children
    ("top and a b when start(b) <= end(a); a 1of3 p q r", "p:a q:a r:a b:b", "a0 b4 a5"),
    # an event that ends a part, without which the part may have another event
    (
        "top and s z when start(z) - end(a) <= 3 s and start(z) - start(a) > 6 s; s sand a b; a 1of2 p q",
        ABC,
        "a1 c2 b5 c6 a8",
    ),
    # the first event of the later part, and the earlier part as it was before
    ("top sand a b when start(b) - end(a) <= 1 s; a or p q; b and r s", "p:a q:b r:c s:d", "a0 c1 a5 d6"),
]
"""Trees, the letters of their leaves, and words of letters with their times, of which only the last event detects."""


@pytest.mark.parametrize("late", ["", " late 0 s", " late 1 s"])
@pytest.mark.parametrize(("tree", "leaves", "word"), CASES)
def test_what_is_remembered(tree: str, leaves: str, word: str, late: str) -> None:
    of_word(tree, leaves, word, late)


def of_word(tree: str, leaves: str, word: str, late: str = "") -> None:
    """Compare on a word, of which only the last event detects."""
    events = [{"n": one[0], "t": int(one[1:])} for one in word.split()]
    on = "".join(f'; {name} on e("{letter}")' for name, letter in (one.split(":") for one in leaves.split()))
    engine = compare(rvaft.loads(f"time t as s{late}; event e(n) = {{ n: n }}; {tree}{on};"), events, "scattered")
    assert engine is not None
    assert engine.verdict is Verdict.TRUE
    assert engine.explanation is not None
    assert engine.explanation.matched[-1].event == len(events)


def of_seed(shape: str, semantics: Semantics, seed: int) -> Callable[[], object]:
    return partial(campaign, shape, semantics, f"fault {seed}", 4)


POINTED: Final = Matching.pointed
FAULTS: Final[dict[str, tuple[object, str, object, Callable[[], object]]]] = {
    "a register lacks the last event": (
        Register,
        "noted",
        forgets_the_present,
        of_seed("few letters", Semantics.PROJECTED, 6),
    ),
    "a guard is decided at once": (
        Matching,
        "is_final",
        lambda *_: True,
        of_seed("few letters", Semantics.CONSECUTIVE, 28),
    ),
    "a failing guard ends the match": (
        Matching,
        "lasting_bounds",
        lambda own, _, guard: [one for part in own.compiled.conjuncts[guard] for one in part.differences or ()],
        of_seed("few letters", Semantics.SCATTERED, 21),
    ),
    "a failing guard is no more looked at": (
        Matching,
        "pointed",
        lambda own, one, node: [guard for guard in POINTED(own, one, node) if not one.failing >> guard & 1],
        of_seed("counts", Semantics.STRICT, 0),
    ),
    "the wrong of two partial matches is dropped": (subsumption, "Term", wrong_term, partial(of_word, *CASES[0])),
    "the wrong of two matches is dropped": (PointedRun, "_merits_of", wrong_merits, partial(of_word, *CASES[2])),
    "a gate keeps no further children": (PointedRun, "__init__", keeps_few, partial(of_word, *CASES[4])),
}
"""By fault: the place, the name and the replacement of a function, and a comparison that finds it."""


@pytest.mark.parametrize("fault", FAULTS)
def test_a_planted_fault_is_found(fault: str, monkeypatch: pytest.MonkeyPatch) -> None:
    place, name, replacement, comparison = FAULTS[fault]
    monkeypatch.setattr(place, name, replacement)
    with pytest.raises((AssertionError, KeyError)):
        comparison()


@pytest.mark.parametrize("fault", FAULTS)
def test_the_comparisons_pass_without_the_fault(fault: str) -> None:
    *_, comparison = FAULTS[fault]
    comparison()


def tree_of(choices: int, guard: str, late: str = " late 0 s") -> rvaft.RVAFT:
    names = [f"o{number}" for number in range(choices)]
    leaves = " ".join(f"{name} or p{name} q{name}; p{name}; q{name};" for name in names)
    return rvaft.loads(f"time t as s{late}; top sand a b when {guard}; b; a and {' '.join(names)}; {leaves}")


@pytest.mark.parametrize("semantics", Semantics)
@pytest.mark.parametrize("late", [" late 0 s", ""])
def test_a_guard_over_many_choices(semantics: Semantics, late: str) -> None:
    """The times of the last events of 30 choices; the lowest of 2^30 branches."""
    word = [f"{'pq'[number % 2]}o{number}" for number in range(30)]
    for gap, verdict in ((10, Verdict.TRUE), (11, Verdict.FALSE if semantics.ends else Verdict.UNKNOWN)):
        engine = Engine(tree_of(30, "start(b) - end(a) <= 10 s", late), semantics)
        for time, name in enumerate(word):
            assert engine.step({"event": name, "t": time}) is Verdict.UNKNOWN
        assert engine.step({"event": "b", "t": 29 + gap}) is verdict
        if verdict is Verdict.TRUE:
            assert engine.explanation is not None
            assert engine.explanation.branch == 1 + sum(1 << number for number in range(1, 30, 2))


@pytest.mark.parametrize("guard", ["start(b) - end(a) <= 10 s", "start(b) - end(a) >= 10 s", "end(a) - start(a) > 9 s"])
def test_what_many_choices_remember(guard: str) -> None:
    """One match for each choice, whatever the length of the log; what the last events say is computed by hand."""
    engine, random = Engine(tree_of(10, guard), "scattered"), Random(guard)
    came: dict[str, list[int]] = {"o0": [0]}
    engine.step({"event": "po0", "t": 0})
    detections = 0
    for time in range(3, 9_000, 3):
        name = f"{random.choice('pq')}o{random.randrange(10)}" if random.random() < 0.95 else "b"
        came.setdefault(name[1:], []).append(time)
        own = [times for one, times in came.items() if one]
        ready = len(own) == 10
        first, last, begun = max(one[0] for one in own), max(one[-1] for one in own), min(one[0] for one in own)
        expected = name == "b" and ready
        if "<=" in guard:
            expected = expected and time - last <= 10
        elif ">=" in guard:
            expected = expected and time - first >= 10
        else:
            expected = expected and last - begun > 9
        assert (engine.step({"event": name, "t": time}) is Verdict.TRUE) is expected, time
        if expected:
            detections += 1
            assert engine.explanation is not None
            assert engine.explanation.branch is not None
            engine, came = Engine(engine.tree, "scattered"), {"o0": [time]}
            engine.step({"event": "po0", "t": time})
        elif time % 999 == 0:
            assert len(pickle.dumps(engine)) < 200_000
    assert detections > 3


@pytest.mark.parametrize("shape", ["few letters", "values", "one letter each", "a common value"])
@pytest.mark.parametrize("semantics", sampled(Semantics, 4))
def test_copies_and_pickles(shape: str, semantics: Semantics) -> None:
    random, told = Random(f"copies {shape} {semantics}"), dict.fromkeys(Verdict, 0)
    for tree in islice(pointed_trees(random, shape), 8):
        straight, copied, pickled = (Engine(tree, semantics) for _ in range(3))
        for event in pointed_trace(random, tree, semantics):
            straight.step(event)
            copied.fork().step(event)
            copied = copied.fork()
            copied.step(event)
            pickled = pickle.loads(pickle.dumps(pickled))
            pickled.step(event)
            for other in (copied, pickled):
                assert other.verdict is straight.verdict
                assert other.explanation == straight.explanation
                assert other.pending() == straight.pending()
                assert other.state == straight.state
        told[straight.verdict] += 1
    assert sum(told.values())


def test_the_branch_is_unknown_if_too_many_events_may_matter(monkeypatch: pytest.MonkeyPatch) -> None:
    guard = "start(b) - end(a) <= 10 s and start(b) - end(a) >= 2 s"
    for most, known in ((pointed_run.REMEMBERED, True), (20, False)):
        monkeypatch.setattr(pointed_run, "REMEMBERED", most)
        engine = Engine(tree_of(3, guard), "scattered")
        for time in range(100):
            assert engine.step({"event": f"{'pq'[time % 2]}o{time % 3}", "t": time}) is Verdict.UNKNOWN
        assert engine.step({"event": "b", "t": 103}) is Verdict.TRUE
        assert engine.explanation is not None
        assert (engine.explanation.branch == 1) is known
        assert (engine.explanation.branch is None) is not known
        assert [one.event for one in engine.explanation.matched][-1] == 101


def test_matches_of_no_known_order_are_bounded() -> None:
    """Where only equal times are comparable, each is kept, up to the limit."""
    tree = rvaft.loads("time t as s; top and a b when end(a) == end(b); a or p q; b or r s; p; q; r; s;")
    engine = Engine(tree, "scattered", limit=100)
    assert isinstance(engine._strategy, LatestStarts)
    with pytest.raises(TooLarge, match="partial matches") as caught:
        for _ in engine.run({"event": "p", "t": time} for time in range(1_000)):
            pass
    assert "late 0 s" in caught.value.__notes__[0]
