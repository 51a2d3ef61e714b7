"""Texts, refusals, formulas that people write, a stand-in for R2U2, and R2U2 itself where `R2U2` names the program."""

import os
import re
import stat
from collections.abc import Mapping
from itertools import product
from pathlib import Path
from random import Random
from types import SimpleNamespace

import pytest

from backends.mtl import MtlBackend
from backends.mtl.r2u2 import MtlR2u2Backend
from backends.mtl.reader import _densely, _reelay, _run_densely
from cross_check.generate.traces import random_trace
from cross_check.generate.trees import VARIABLE_FREE, random_tree
from cross_check.participants import faithful_backends
from cross_check.published.r2u2 import first_detections
from rvaft import (
    RVAFT,
    EventType,
    Gate,
    Node,
    NotExpressible,
    On,
    OptionError,
    RvaftError,
    Semantics,
    TooLarge,
    ToolFailed,
    ToolMissing,
    TraceError,
    loads,
)
from rvaft.errors import Cause
from rvaft.model.patterns import Literal, ObjectPattern
from rvaft.model.values import Json
from rvaft.monitors import DetectionMonitor
from rvaft.semantics import Reference
from tests.backends.injections import INJECTIONS
from tests.backends.judged import first
from tests.backends.texts import events, signs
from tests.cli.runs import run
from tests.tables import rows, sampled

BACKEND, BOUNDED, SCATTERED = MtlBackend(), MtlR2u2Backend(), Semantics.SCATTERED
TEXTS = rows(__file__, "texts.txt")
PROGRAM = Path(os.environ.get("R2U2", "/nowhere"))
published = pytest.mark.skipif(not PROGRAM.is_file(), reason="R2U2 does not name the program R2U2")


@pytest.mark.parametrize(("text", "expected"), TEXTS)
def test_text(text: str, expected: str) -> None:
    assert BACKEND.translate(loads(text), Semantics.SCATTERED).text.splitlines()[-1] == expected


def test_what_is_too_deep() -> None:
    with pytest.raises(TooLarge):
        BACKEND.read("not " * 5_000 + "{a: true}")


@pytest.mark.parametrize(("text", "semantics", "expected", "bounded"), rows(__file__, "semantics.txt"))
def test_text_of_each_semantics(text: str, semantics: str, expected: str, bounded: str) -> None:
    """Relevant events are those of the whole tree, whatever the match."""
    found = BACKEND.translate(loads(text), Semantics(semantics)).text.splitlines()
    assert found[-1] == expected
    assert ("relevant := " in "".join(found)) is ("relevant: true" in expected)
    other = BOUNDED.translate(loads(text), Semantics(semantics)).text.splitlines()
    assert other[-1].replace("1073741823", "H") == bounded


@pytest.mark.parametrize(("text", "time", "expected"), rows(__file__, "windows.txt"))
def test_text_of_windows(text: str, time: str, expected: str) -> None:
    lines = BACKEND.translate(loads(text), SCATTERED).text.splitlines()
    assert (lines[1], lines[-1]) == (time, expected)


ABSENT = "time t as s; event e(k, n) = { event: k, n: n }; "
LOST = f'{ABSENT}top sand a b; a on e("a", _); b on e("b", _) without e("c", V) when V > 1 for 2 s after;'
QUIET = f'{ABSENT}top sand a b without e("c", _) for 2 s before; a on e("a", _); b on e("b", _);'


WORDS = [
    (LOST, "a0 b1 x3 x3.5", 4),
    (LOST, "a0 b1 c3 x3.5 b4 c9", 6),
    (LOST, "a0 b1 c1 x3.5", None),
    (LOST, "a0 b1 d3 c x4", 5),
    (LOST, "a0 b x4 x9", None),
    (LOST, "a0 b1 b2 x3.5", 4),
    (LOST, "a0 b1 c2 b2 x4 x4.5", 6),
    (QUIET, "c0 a2 b3", None),
    (QUIET, "c0 a2.5 b3", 3),
    (QUIET, "c a1 b3", 3),
    (QUIET, "a1 c1 b3", 3),
    (QUIET, "c1 a1 b3 a3.5 b4", 5),
    (QUIET, "a1 b a4 b4", 4),
    (QUIET, "a b1", None),
    (LOST, "a0 b1 x2.5 c2.6 x9", None),
    (LOST, "a0 b1 x x3.5", 4),
]
"""A tree, events with their times, and the number of the detection; `d` is `c` with the number 1, the others have 2."""


def timed_word(word: str) -> list[Json]:
    made: list[Json] = []
    for one in word.split():
        event = {"event": one[0].replace("d", "c"), "n": 1 if one[0] == "d" else 2}
        made.append(event | ({"t": float(one[1:])} if one[1:] else {}))
    return made


@pytest.mark.parametrize(("text", "word", "number"), WORDS)
def test_absence_within_a_duration(text: str, word: str, number: int | None) -> None:
    trace, monitor = timed_word(word), BACKEND.read(BACKEND.translate(loads(text), SCATTERED).text)
    assert monitor.first_detections([trace]) == [number]
    assert first(loads(text), SCATTERED, trace) == number


def absent_tree(random: Random) -> str:
    """A tree of one to three events with absent events, some of them within a duration."""

    def without() -> str:
        own, when = random.choice((("_", ""), ("_", ""), ("V", " when V > 1")))
        side = random.choice(
            (" for 2 s after", " for 1 s after", " for 1.5 s before", " for 2 s before", "", " before")
        )
        absent = f' without e("{random.choice("cde")}", {own}){when}{side}'
        return random.choice(("", absent))

    def gate(name: str, children: str) -> str:
        return f"{name} {random.choice(('and', 'sand', 'or'))} {children}{without()}; "

    leaves = [
        f'l{number} on e("{random.choice("abcd")}", _){without()}; ' for number in range(random.choice((1, 2, 3)))
    ]
    gates = {1: "top and l0; ", 2: gate("top", "l0 l1"), 3: gate("top", "g l2") + gate("g", "l0 l1")}
    late = random.choice(("", " late 0 s"))
    return f"{ABSENT.replace('as s', f'as s{late}')}toplevel top; {gates[len(leaves)]}{''.join(leaves)}"


def absent_trace(random: Random, count: int) -> list[Json]:
    clock, made = 0.0, list[Json]()
    for _ in range(count):
        clock += random.choice((0, 0.5, 1, 1, 2, 2.5, 3))
        event = {"event": random.choice("abcdex"), "n": random.choice((1, 2, 3))}
        made.append(event | ({"t": clock} if random.random() < 0.85 else {}))
    return made


@pytest.mark.parametrize("seed", [0, *(pytest.param(seed, marks=pytest.mark.slow) for seed in range(1, 5))])
def test_absence_within_a_duration_in_random_trees(seed: int) -> None:
    random, compared, detected, left = Random(f"absent {seed}"), 0, 0, 120 if seed else 8
    while left:
        text = absent_tree(random)
        if " for " not in text:
            continue
        try:
            made, semantics = loads(text), random.choice([*Semantics])
            monitor = BACKEND.translate(made, semantics).monitor()
        except RvaftError:
            continue
        left -= 1
        assert isinstance(monitor, DetectionMonitor)
        traces = [absent_trace(random, count) for count in (4, 7, 10)]
        for trace, found in zip(traces, monitor.first_detections(traces), strict=True):
            assert found == first(made, semantics, trace), f"{semantics}\n{text}\n{trace}"
            compared, detected = compared + 1, detected + (found is not None)
    assert compared / 20 < detected < compared


@pytest.mark.parametrize(
    ("old", "new"),
    [
        ("not once[0:2]", "not once[0:3]"),
        ("not once[0:2]", "not once[0:1]"),
        (" and not pre((not", " and pre((not"),
        ("once[0:1]({p2: true}) and pre", "pre"),
        ("{p3: true}) and once[0:1]({p3: true})", "{p3: true})"),
        ("once[0:1]({p2: true} or not {p2: true}) and ", ""),
    ],
)
def test_a_fault_in_a_formula_is_found(old: str, new: str) -> None:
    text = BACKEND.translate(loads(LOST), SCATTERED).text
    assert old in text
    words, numbers = zip(*((word, number) for tree, word, number in WORDS if tree == LOST), strict=True)
    assert BACKEND.read(text.replace(old, new)).first_detections([*map(timed_word, words)]) != [*numbers]


@pytest.mark.parametrize(("text", "semantics", "reason"), rows(__file__, "windows_refused.txt"))
def test_windows_that_are_not_written(text: str, semantics: str, reason: str) -> None:
    """This claims nothing of the language; the form for R2U2 has no windows."""
    for language, said in ((BACKEND, reason), (BOUNDED, "R2U2 counts steps, and windows are durations")):
        with pytest.raises(NotExpressible, match=re.escape(said)) as raised:
            language.translate(loads(text), Semantics(semantics))
        assert raised.value.cause is Cause.WRITER


DENSE = "/* rvaft\ntime t as s, bounds in ms\n*/\n"


@pytest.mark.parametrize(
    ("formula", "times", "number"),
    [
        ("{b: true} and once[0:5000]{a: true}", "a0 b5", 2),
        ("{b: true} and once[0:5000]{a: true}", "a0 b5.001", None),
        ("{b: true} and once[0:5000]{a: true}", "a0 b5.0004 b5", None),
        ("{b: true} and once[0:5000]{a: true}", "a b0 a1 b", None),
        ("{b: true} and once[0:5000]{a: true}", "a0 b a1 b2", 4),
        ("{b: true} and once[0:5000]({a: true} and pre({b: true}))", "a0 b1 b2 a3 x3 b4", 6),
        ("{b: true} and pre({a: true})", "a0 x1 b1 a1 b9", 5),
        ("{b: true} and ((not {x: true}) since[2000:3000] {a: true})", "a0 b1 x2 b2 a5 b6 b8", 7),
        ("{x: true} and historically[1000:]({b: true} or {x: true})", "b0 a1 x1 a2 x3", 3),
        ("{a: true}", "a", 1),
        ("{a: true}", "", None),
    ],
)
def test_dense_time(formula: str, times: str, number: int | None) -> None:
    trace: list[Json] = [{"event": one[0], **({"t": float(one[1:])} if one[1:] else {})} for one in times.split()]
    monitor = BACKEND.read(DENSE + formula)
    assert isinstance(monitor, DetectionMonitor)
    if times == "a0 b5.0004 b5":
        assert monitor.left_open(trace) == "times go backwards"
        with pytest.raises(TraceError, match="times go backwards"):
            monitor.first_detections([trace])
        return
    assert list(monitor.first_detections([trace, [], trace])) == [number, None, number]


def test_times_beyond_the_numbers_of_reelay_are_left_open() -> None:
    monitor = BACKEND.read(DENSE.replace("ms", "ns") + "{b: true} and once[0:1]{a: true}")
    assert isinstance(monitor, DetectionMonitor)
    far = [{"event": "a", "t": 0}, {"event": "b", "t": 40_000_000}]
    assert monitor.left_open(far) == "the times are too many for the numbers of Reelay"
    assert monitor.left_open([{"event": "a", "t": 0}, {"event": "b", "t": 4_000}]) == ""


@pytest.mark.parametrize(("text", "word", "number"), rows(__file__, "runs.txt"))
def test_hand_written(text: str, word: str, number: int | None) -> None:
    """Beside other traces: nothing of one is left for another."""
    monitor = BACKEND.read(text)
    assert isinstance(monitor, DetectionMonitor)
    trace = events(word)
    assert monitor.first_detections([trace, [], trace, trace[:-1], trace])[::2] == [number] * 3


@pytest.mark.parametrize(("text", "inputs", "formula"), rows(__file__, "r2u2.txt"))
def test_the_form_for_r2u2(text: str, inputs: str, formula: str) -> None:
    """Each way back is `S` from one event before, to the horizon; what the inputs are is as in `mtl`."""
    found = BOUNDED.translate(loads(text), Semantics.SCATTERED)
    lines = found.text.replace("[1,1073741823]", "").splitlines()
    assert lines[-4:] == ["INPUT", f"    {inputs}: bool;", "PTSPEC", f"    detection: {formula};"]
    defined = [line for line in BACKEND.translate(loads(text), Semantics.SCATTERED).text.splitlines() if ":=" in line]
    assert lines[1:-4] == [f"-- {line}" for line in defined]
    assert found.text.count("true S[1,1073741823] ") == formula.count("S ")


def test_the_form_is_only_emitted_and_misses_what_is_beyond_the_horizon() -> None:
    assert (BOUNDED.faithful, BOUNDED.form_of, BOUNDED.readable) == (False, "mtl", False)
    assert "mtl-r2u2" not in faithful_backends()
    found = BOUNDED.translate(loads("top sand a b;"), Semantics.SCATTERED)
    assert "misses what comes after 1073741824 events" in found.text.splitlines()[0]
    assert signs(found.monitor(), events("b a b")) == "??T"  # that of the formula for Reelay
    with pytest.raises(OptionError, match="mtl-r2u2 is only emitted"):
        BOUNDED.read(found.text)


@pytest.mark.parametrize("text", INJECTIONS)
def test_no_name_ends_a_comment_of_c2po(text: str) -> None:
    event = EventType("seen", (), ObjectPattern(((text, Literal(text)),)))
    made = RVAFT("top", [Node("top", Gate.SAND, ("x", text)), Node("x"), Node(text, on=On("seen", ()))], [event])
    lines = re.split(r"[\r\n]", BOUNDED.translate(made, Semantics.SCATTERED).text)
    assert ([line[:2] for line in lines[:3]], lines[3:5]) == (["--"] * 3, ["INPUT", "    p1, p2: bool;"])


SLIPS = {
    "order dropped": (
        "top sand a b;",
        "once({p2: true} and pre(once({p1: true})))",
        "once({p2: true}) and once({p1: true})",
    ),
    "one event for two": ("top sand o; o and a b; a times 2;", "pre(once({p1: true}))", "once({p1: true})"),
    "one less of K": ("top 2of3 a b c;", " and pre(once(({p1: true} or {p2: true})))", ""),
    "a guard dropped": ("event e(k) = { k: k }; top sand a b; a on e(X) when X > 2;", " when X > 2", ""),
    "order turned round": ("top sand a b;", "{p2: true} and pre(once({p1", "{p1: true} and pre(once({p2"),
    "now for once": ("top sand a b;", "pre(once({p1: true}))", "pre({p1: true})"),
    "an order forgotten": ("top and a b;", " or once({p1: true} and pre(once({p2: true})))", ""),
}
SLIPS_OF: Mapping[str, tuple[str, Mapping[str, tuple[str, str]]]] = {
    "strict": (
        "top sand a b;",
        {
            "not from the start": (" and not pre(({p1: true} or not {p1: true}))", ""),
            "a gap": ("pre({p1: true} and not pre(({p1: true} or not {p1: true})))", "pre(once({p1: true}))"),
            "the first alone": (" and pre({p1: true} and not pre(({p1: true} or not {p1: true})))", ""),
        },
    ),
    "projected": (
        "top or s; s sand a b; ignore e(1); event e(k) = { k: k };",
        {
            "not from the first relevant": ("and not pre(once(({relevant: true} and not {ignored: true})))", ""),
            "ignored events count": (
                "not ({relevant: true} and not {ignored: true}) since",
                "not {relevant: true} since",
            ),
            "an ignored event is taken": ("{p1: true} and not {ignored: true}", "{p1: true}"),
            "the next alone": (
                "(not ({relevant: true} and not {ignored: true}) since (",
                "(not ({p1: true} or not {p1: true}) since (",
            ),
        },
    ),
    "consecutive": (
        "top sand a b c;",
        {
            "relevant events are skipped": ("(not {relevant: true} since", "(({p1: true} or not {p1: true}) since"),
            "a part alone": (
                " since ({p2: true} and pre((not {relevant: true} since ({p1: true}))))",
                " since ({p2: true})",
            ),
        },
    ),
}


@pytest.mark.parametrize("slip", SLIPS)
def test_a_slip_in_the_text_shows(slip: str) -> None:
    text, right, wrong = SLIPS[slip]
    made, same = loads(text), {"event": "a", "k": 1}
    written = BACKEND.translate(made, Semantics.SCATTERED).text
    assert right in written
    monitor = BACKEND.read(written.replace(right, wrong))
    letters = [same, {"event": "b", "k": 3}, {"event": "c"}]
    traces = [[one, other, third] for one in letters for other in letters for third in letters]
    traces += [[{"event": "a"}], [{"event": "b"}], [{"event": "c"}]]
    assert isinstance(monitor, DetectionMonitor)
    wanted = [signs(Reference(made, Semantics.SCATTERED), trace).find("T") + 1 or None for trace in traces]
    assert list(monitor.first_detections(traces)) != wanted


@pytest.mark.parametrize(
    ("semantics", "slip"),
    sampled([(semantics, slip) for semantics, (_, slips) in SLIPS_OF.items() for slip in slips], 3),
)
def test_a_slip_in_a_form_shows(semantics: str, slip: str) -> None:
    tree, slips = SLIPS_OF[semantics]
    made, (right, wrong) = loads(tree), slips[slip]
    written = BACKEND.translate(made, Semantics(semantics)).text
    assert right in written
    letters: list[Json] = [{"event": "a"}, {"event": "b"}, {"event": "c"}, {"event": "a", "k": 1}, {"event": "x"}]
    traces = [list(trace) for length in range(1, 5) for trace in product(letters, repeat=length)]
    wanted = [first(made, Semantics(semantics), trace) for trace in traces]
    for text, same in ((written, True), (written.replace(right, wrong), False)):
        monitor = BACKEND.read(text)
        assert isinstance(monitor, DetectionMonitor)
        assert (list(monitor.first_detections(traces)) == wanted) is same


WINDOWED = "time t as s; top and p c; p sand a b within 2 s;"
WINDOW_SLIPS = {
    "one unit longer": ("[0:2]", "[0:3]"),
    "one unit shorter": ("[0:2]", "[0:1]"),
    "no window": ("[0:2]", ""),
    "a part forgotten": (" and once({p3: true})", ""),
}


@pytest.mark.parametrize("slip", sampled([None, *WINDOW_SLIPS], 3))
def test_a_slip_in_a_window_shows(slip: str | None) -> None:
    made = loads(WINDOWED)
    text = BACKEND.translate(made, SCATTERED).text
    right, wrong = ("", "") if slip is None else WINDOW_SLIPS[slip]
    assert right in text
    monitor, random = BACKEND.read(text.replace(right, wrong)), Random("window")
    traces: list[list[Json]] = []
    for _ in range(60):
        times = sorted(random.choice([0, 1, 1.5, 2, 3, 4]) for _ in range(random.randint(0, 5)))
        traces.append(
            [{"event": random.choice("abc"), **({"t": time} if random.random() < 0.9 else {})} for time in times]
        )
    assert isinstance(monitor, DetectionMonitor)
    wanted = [first(made, SCATTERED, trace) for trace in traces]
    assert (list(monitor.first_detections(traces)) == wanted) is (slip is None)


def test_a_formula_in_dense_time_is_as_long_as_its_text() -> None:
    """Reelay reads a formula anew for each trace, so that no part may be written twice at each depth."""
    lengths = []
    for depth in (4, 8):
        formula = "{a: true}"
        for _ in range(depth):
            formula = f"once[0:2]({{b: true}} and pre(once({formula})))"
        lengths.append(len(_densely(formula, 1, 1, 2)[0]))
    assert lengths[1] < 2.5 * lengths[0]


def test_reelay_is_asked_once_for_prefixes_and_events_that_fit_alike(monkeypatch: pytest.MonkeyPatch) -> None:
    text, made = BACKEND.translate(loads(WINDOWED), SCATTERED).text, list[str]()
    extension, options = _reelay()

    def make(formula: str, options: object) -> object:
        made.append(formula)
        return extension.dense_monitor.make(formula, options)

    dense = SimpleNamespace(make=make)
    monkeypatch.setattr("backends.mtl.reader._reelay", lambda: (SimpleNamespace(dense_monitor=dense), options))
    _run_densely.cache_clear()
    monitor = BACKEND.read(text)
    assert isinstance(monitor, DetectionMonitor)
    traces: list[list[Json]] = [
        [{"event": "a", "t": 0}, {"event": "b", "t": 1, "more": more}, {"event": "c", "t": 2}] for more in range(9)
    ]
    assert monitor.first_detections(traces) == [3] * 9
    assert len(made) == 1
    assert monitor.first_detections([trace[:2] for trace in traces]) == [None] * 9
    assert len(made) == 2


@pytest.mark.parametrize("semantics", Semantics)
def test_random_trees(semantics: Semantics) -> None:
    """The formula detects what the definition does, with choices, votes, sharing and `ignore`."""
    random, asked = Random(f"mtl {semantics}"), 0
    while asked < 60:
        made = random_tree(random, VARIABLE_FREE)
        try:
            text = BACKEND.translate(made, semantics, limit=60)
        except RvaftError:
            continue
        traces = [random_trace(random, made) for _ in range(3)]
        monitor = text.monitor()
        assert isinstance(monitor, DetectionMonitor)
        assert list(monitor.first_detections(traces)) == [first(made, semantics, one) for one in traces], text.text
        asked += len(traces)


_PREVIOUS = "{b: true} and pre((not ({a: true} or {b: true})) since "
_FROM_THE_FIRST = f"{_PREVIOUS}({{a: true}} and not pre(once({{a: true}} or {{b: true}}))))"


@pytest.mark.parametrize(
    ("formula", "semantics"),
    [
        ("once({p2: true} and pre((not {p1: true} and not {p2: true}) since {p1: true}))", "consecutive"),
        (
            _FROM_THE_FIRST,
            "projected",
        ),
    ],
)
def test_formulas_that_people_write_agree(
    tmp_path_factory: pytest.TempPathFactory, formula: str, semantics: str
) -> None:
    folder = tmp_path_factory.mktemp("formula")
    (folder / "tree.rvaft").write_text(f"semantics {semantics}; top sand a b;")
    header = '/* rvaft\np1 := { event: "a" }\np2 := { event: "b" }\n*/\n' if "p1" in formula else ""
    (folder / "rule.mtl").write_text(header + formula)
    found = run("cross-check", folder / "tree.rvaft", "--against", folder / "rule.mtl", "--backends", "mtl")
    assert (found.exit_code, found.output.count("detections only")) == (0, 2), found.output


def test_a_formula_is_held_against_a_tree(tmp_path_factory: pytest.TempPathFactory) -> None:
    file = tmp_path_factory.mktemp("rule") / "rule.mtl"
    file.write_text("{c: true} and pre(once({b: true} and pre(once({a: true}))))")
    good = run(
        "cross-check", "trees/gates/sand.rvaft", "--against", file, "--semantics", "scattered", "--backends", "mtl"
    )
    assert (good.exit_code, "detections only" in good.output) == (0, True)
    file.write_text("{c: true} and once({b: true} and once({a: true")
    assert run("cross-check", "trees/gates/sand.rvaft", "--against", file).exit_code == 2


COMPILES = """
import pathlib, sys
_, spec, _, signals, _, made = sys.argv[1:]
pathlib.Path(made).write_text(pathlib.Path(signals).read_text() + pathlib.Path(spec).read_text())
"""


def checkout(folder: Path, compiler: str, monitor: str) -> Path:
    """A stand-in for a checkout of R2U2, and the monitor that was built in it."""
    (folder / "compiler").mkdir()
    (folder / "compiler" / "c2po.py").write_text(compiler)
    (program := folder / "r2u2").write_text(f"#!/bin/sh\n{monitor}\n")
    program.chmod(program.stat().st_mode | stat.S_IXUSR)
    return program


@pytest.mark.parametrize(
    ("compiler", "monitor", "said"),
    [
        (COMPILES, "printf '0:0,F\\n0:1,F\\n0:2,T\\n'", 3),
        (COMPILES, "printf '0:0,F\\n0:2,T\\n'", 2),
        (COMPILES, "printf '0:2,F\\n'", None),
        (
            COMPILES,
            'grep -q "^p1:0$" "$1" && grep -q "detection: p2" "$1" && sed 1d "$2" | tr "\\n" " " >&2; exit 3',
            "0,0 0,1",
        ),
        (COMPILES, "printf '0:1,F\\n'", "gives no verdict from event 3 on; if the text exceeds the bounds"),
        (COMPILES, "kill -11 $$", "exit status -11; if the text exceeds"),
        ("raise SystemExit('no formula')", "", "C2PO failed: no formula"),
    ],
)
def test_what_r2u2_says(tmp_path: Path, compiler: str, monitor: str, said: int | str | None) -> None:
    program, text = checkout(tmp_path, compiler, monitor), BOUNDED.translate(loads("top sand a b;"), SCATTERED).text
    if isinstance(said, str):
        with pytest.raises(ToolFailed, match=said):
            first_detections(program, text, [events("x b a")])
    else:
        assert first_detections(program, text, [events("a x b"), []]) == [said, None]


def test_without_r2u2_or_its_compiler_it_is_missing(tmp_path: Path) -> None:
    result = run(
        "cross-check",
        "trees/gates/sand.rvaft",
        "--r2u2",
        tmp_path / "r2u2",
        "--semantics",
        "scattered",
        "--backends",
        "mtl",
    )
    assert (result.exit_code, "with compiler/c2po.py in a parent folder" in result.output) == (2, True)
    program = checkout(tmp_path, COMPILES, "")
    program.chmod(stat.S_IRUSR)
    with pytest.raises(ToolMissing, match="give the path of the program"):
        first_detections(program, BOUNDED.translate(loads("top sand a b;"), SCATTERED).text, [events("a")])


@pytest.mark.published
@published
def test_r2u2_says_what_the_definition_says() -> None:
    random, asked = Random("r2u2"), 0
    while asked < 300:
        made, semantics = random_tree(random, VARIABLE_FREE), random.choice([*Semantics])
        try:
            text = BOUNDED.translate(made, semantics, limit=30).text
        except RvaftError:
            continue
        traces = [random_trace(random, made) for _ in range(4)]
        assert first_detections(PROGRAM, text, traces) == [first(made, semantics, trace) for trace in traces], text
        asked += len(traces)
