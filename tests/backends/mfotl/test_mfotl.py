"""MFOTL: pinned texts, what is refused, a stand-in for MonPoly, and MonPoly itself with its
verified kernel where `MONPOLY` names the program.
"""

import os
import re
import stat
from collections import Counter
from contextlib import suppress
from pathlib import Path
from random import Random

import pytest

from backends.mfotl import MfotlBackend
from backends.mfotl.predicates import MfotlHeader
from cross_check import comparison
from cross_check.published.monpoly import first_detections
from cross_check.results import Job, Status
from cross_check.traces import ONE_TREE
from rvaft import RVAFT, RvaftError, Semantics, ToolFailed, ToolMissing, load, loads
from rvaft.backend import backend
from rvaft.model.assumptions import first_violation
from rvaft.model.values import Json
from rvaft.rules.validity import require_valid
from tests.backends.judged import all_show, cases, first
from tests.cli.runs import failed, run
from tests.engine.dense import CHOOSING, Dense, dense_trace, dense_tree
from tests.tables import rows

PROGRAM = Path(os.environ.get("MONPOLY", "/nowhere"))
published = pytest.mark.skipif(not PROGRAM.is_file(), reason="MONPOLY does not name the program MonPoly")
TREES = Path(__file__).parents[3] / "trees"
EVENTS = "event e(v) = { e: v }; event p(v, w) = { v: v, w: w }; "


def emitted(tree: str) -> str:
    return backend("mfotl").translate(loads(tree), Semantics.SCATTERED).text


@pytest.mark.parametrize(("tree", "text"), rows(__file__, "texts.txt"))
def test_texts(tree: str, text: str) -> None:
    assert emitted(tree) == text


@pytest.mark.parametrize(
    ("tree", "compared"),
    [
        ("sand a b c d", 1),
        ("and a b c d", 12),
        ("sand a g d; g and b c", 1),
        ("and a g; g sand b c d", 3),
        ("sand g h; g and a b; h and c d", 4),
        ("sand g a; g and b c; a times 2", 2),
    ],
)
def test_a_window_compares_the_first_and_the_last_events_of_a_log_in_order(tree: str, compared: int) -> None:
    top, _, gates = tree.partition(";")
    text = emitted(f"time ts as s late 0 s; top {top} within 5 s; {gates}{';' * bool(gates)}")
    bounds = re.findall(r"\(T(\d)_time - T(\d)_time\) <= 5000000000", text)
    assert len(bounds) == compared
    orders, random = re.findall(r"i(\d) < i(\d)", text), Random(tree)
    of_place = {place: time for time, place in re.findall(r"\(T(\d)_kind,(?: T\d_time,)? i(\d)\)", text)}
    assert len(of_place) == 4
    assert all(f'T{one}_kind = "n"' in text for one in of_place.values())
    held = Counter[bool]()
    while min(held[True], held[False]) < 50:
        position = dict(zip(of_place, random.sample(range(4), 4), strict=True))
        times = sorted(random.choices(range(9), k=4))
        time = {of_place[one]: times[place] for one, place in position.items()}
        if all(position[before] < position[after] for before, after in orders):
            found = all(time[later] - time[sooner] <= 5 for later, sooner in bounds)
            assert found is (times[-1] - times[0] <= 5), (time, text)
            held[found] += 1


@pytest.mark.parametrize(("tree", "semantics", "formula"), rows(__file__, "semantics.txt"))
def test_texts_of_each_semantics(tree: str, semantics: str, formula: str) -> None:
    """Under `projected` and `consecutive`, `relevant` has an alternative for each node."""
    header, _, found = backend("mfotl").translate(loads(tree), Semantics(semantics)).text.partition("*)\n")
    assert found == formula
    assert ("\nrelevant := " in header) is (semantics != "strict")


def test_the_signature_and_the_facts_of_an_event() -> None:
    tree = (
        'time t as s; event p(v, w) = { v: v, w: w }; top sand a b within 1 s; a on p(X, "*) '
        'p(\\"1\\")"); b on p(X, Y) when Y > 1;'
    )
    text = emitted(tree)
    assert MfotlBackend.signature(text).splitlines() == [
        "a(T1_kind: string, T1_time: int, X_text: string, position: int)",
        "b(T2_kind: string, T2_time: int, X_text: string, position: int)",
    ]
    header = MfotlHeader.read(text)
    event = {"v": '"), a("\n', "w": '*) p("1")', "t": 2}
    assert [*header.facts(event, 7)] == ['a("n",2000000000,"%22%22%29%2C%20a%28%22%0A",7)']
    assert [*header.facts({"v": [1.0, None], "w": 2}, 0)] == ['b("o",0,"%5B1%2Cnull%5D",0)']


def test_the_command_writes_the_signature_to_a_file(tmp_path: Path) -> None:
    tree, signature = TREES / "gates" / "sand.rvaft", tmp_path / "sand.sig"
    found = run("emit", tree, "--to", "mfotl", "--semantics", "scattered", "--signature", signature)
    assert (found.exit_code, found.stdout) == (0, emitted(tree.read_text()))
    assert signature.read_text() == MfotlBackend.signature(found.stdout)
    failed(
        run("emit", tree, "--to", "rml", "--signature", signature),
        "rml specifications have no signature: omit --signature",
    )
    failed(run("emit", tree, "--to", "dot", "--signature", signature), "omit --signature")


STAND_IN = '#!/bin/sh\nif [ "$1" = -version ]; then echo MonPoly; exit; fi\n{}\n'


@pytest.mark.parametrize(
    ("script", "said"),
    [
        ("echo '@1 (time point 1): true'", [2]),
        ("exit 0", [None]),
        ("echo 'The analyzed formula is NOT monitorable.'", "NOT monitorable"),
        ("echo 'cannot read' >&2; exit 3", "cannot read"),
        ("exit 3", "exit status 3"),
    ],
)
def test_what_a_program_says(tmp_path: Path, script: str, said: list[int | None] | str) -> None:
    (program := tmp_path / "monpoly").write_text(STAND_IN.format(script))
    program.chmod(program.stat().st_mode | stat.S_IXUSR)
    text, trace = emitted("top sand a b;"), [{"event": "a"}, {"event": "b"}]
    if isinstance(said, str):
        with pytest.raises(ToolFailed, match=said):
            first_detections(program, text, [trace])
    else:
        assert first_detections(program, text, [trace]) == said
    for other in (tmp_path / "nowhere", tmp_path, Path("/bin/true")):
        with pytest.raises(ToolMissing, match="give the path of the monpoly program"):
            first_detections(other, text, [trace])


def compared(tree: RVAFT, program: Path, semantics: Semantics = Semantics.SCATTERED) -> dict[str, Status]:
    """How a comparison of MonPoly and VeriMon with the reference ends."""
    roster, job = comparison.Roster(backends=(), monpoly=program), Job("tree", semantics)
    found = comparison.Comparison(tree, job, ONE_TREE).run(roster.candidates(tree, job))
    return {one.participant: one.status for one in found}


def test_without_the_program_it_is_missing() -> None:
    found = compared(loads("top sand a b;"), Path("/nowhere"))
    assert found["mfotl-monpoly"] is found["mfotl-verimon"] is Status.TOOL_MISSING


@pytest.mark.published
@published
@pytest.mark.parametrize("verified", [False, True])
def test_both_kernels_say_what_the_definition_says(*, verified: bool) -> None:
    asked = 0
    for text, traces, wanted in cases("mfotl", MfotlHeader, Random("mfotl"), 60, 4):
        assert first_detections(PROGRAM, text, traces, verified=verified) == wanted, text
        asked += len(traces)
    assert asked > 2_000


TIED = (
    "time t as s; event n(k, x) = { k: k, y: x }; event e(k, x) = { k: k, x: x }; top sand a both within 1 s; "
    "both and b c d when Y < Z; a on n(1, Y); b on n(_, Z); c on e(2, X); d on e(_, X);"
)
FAULTS = {
    "an order dropped": ("(i1 < i2)", "(i1 <= i1)"),
    "an order turned round": ("(i1 < i2)", "(i2 < i1)"),
    "one event serves two": ("NOT (i3 = i4)", "NOT (i1 = i4)"),
    "a variable of its own": ("ONCE d(T4_kind, T4_time, X_text", "ONCE d(T4_kind, T4_time, _"),
    "a guard dropped": ("(Y_number < Z_number)", "(Y_number <= Y_number)"),
    "a window one unit off": ("<= 1000000000", "<= 999999999"),
}


@pytest.mark.published
@published
def test_planted_faults_show() -> None:
    """Each text that is edited detects something else than the tree, on one of these traces."""
    tree = loads(TIED)
    text = backend("mfotl").translate(tree, Semantics.SCATTERED).text
    events: list[Json] = [{"k": k, "y": y} for k in (1, 3) for y in (1, 2)]
    events += [{"k": k, "x": x} for k in (2, 3) for x in (1, 2)]
    random = Random("faults")
    traces: list[list[Json]] = [[{**random.choice(events), "t": n * 0.25} for n in range(8)] for _ in range(60)]
    ends: list[Json] = [{"k": 3, "y": 2, "t": 0.5}, {"k": 2, "x": 1, "t": 0.6}, {"k": 3, "x": 1, "t": 1}]
    traces.append([{"k": 1, "y": 1, "t": 0}, *ends])
    wanted = [first(tree, Semantics.SCATTERED, one) for one in traces]
    assert first_detections(PROGRAM, text, traces) == wanted
    assert wanted[-1] == 4
    all_show(FAULTS, text, lambda edited: first_detections(PROGRAM, edited, traces))


FOLLOWING = "event e(k, x) = { k: k, x: x }; ignore e(2, 0); top sand a b; a on e(1, X); b on e(_, X);"
COUNTS = "((EXISTS i. relevant(i)) AND (NOT (EXISTS i. ignored(i))))"
FAULTS_OF = {
    "strict": {"one event later": ("i2 < 2", "i2 < 3"), "one event sooner": ("i2 < 2", "i2 < 1")},
    "projected": {
        "not from the first": (f" AND NOT (PREVIOUS (ONCE {COUNTS}))", ""),
        "ignored events count": (f"(NOT {COUNTS}) SINCE", "(NOT (EXISTS i. relevant(i))) SINCE"),
        "an ignored event is taken": ("))) AND NOT (EXISTS i. ignored(i)))", "))))"),
    },
    "consecutive": {
        "relevant events are skipped": (f"((NOT {COUNTS}) SINCE ", "(ONCE "),
        "the event before alone": (f"((NOT {COUNTS}) SINCE ", "("),
    },
}


@pytest.mark.published
@published
@pytest.mark.parametrize("semantics", FAULTS_OF)
def test_planted_faults_show_under_each_semantics(semantics: str) -> None:
    tree, random = loads(FOLLOWING), Random("following")
    text = backend("mfotl").translate(tree, Semantics(semantics)).text
    events: list[Json] = [{"k": k, "x": x} for k in (1, 2) for x in (0, 1)] + [{}]
    traces: list[list[Json]] = [[random.choice(events) for _ in range(5)] for _ in range(80)]
    assert first_detections(PROGRAM, text, traces) == [first(tree, Semantics(semantics), one) for one in traces]
    all_show(FAULTS_OF[semantics], text, lambda edited: first_detections(PROGRAM, edited, traces))


@pytest.mark.published
@published
@pytest.mark.parametrize("semantics", Semantics)
@pytest.mark.parametrize("tree", sorted(TREES.glob("gates/*.rvaft")), ids=lambda path: path.stem)
def test_the_shipped_gates_are_compared(tree: Path, semantics: Semantics) -> None:
    found = compared(load(tree), PROGRAM, semantics)
    assert found["mfotl-monpoly"] is found["mfotl-verimon"] is Status.TESTED


ABSENT = {
    "events": Dense(absences=0.4, nodes=5, sharing=0.3, guards=0, gates=CHOOSING),
    "values": Dense(absences=0.5, nodes=4, variables=0.6, guards=0.2),
    "times": Dense(absences=0.6, nodes=4, variables=0.4, windows=0.2, points=0.1),
}


@pytest.mark.published
@published
@pytest.mark.parametrize("verified", [False, True])
@pytest.mark.parametrize("shape", ABSENT)
def test_absent_events_of_random_trees(shape: str, *, verified: bool) -> None:
    random, asked, found = Random(f"{shape} {verified}"), 0, 0
    while asked < 200:
        tree = dense_tree(random, ABSENT[shape])
        with suppress(RvaftError):
            require_valid(tree)
            semantics = random.choice(list(Semantics))
            made = backend("mfotl").translate(tree, semantics) if tree.absences else None
            if made is None or len(made.text) > 8_000:
                continue
            traces = [dense_trace(random, ABSENT[shape], 7) for _ in range(12)]
            header = MfotlHeader.read(made.text)
            kept = [one for one in traces if not (first_violation(tree, one, made.assumes) or header.left_open(one))]
            wanted = [first(tree, semantics, one) for one in kept]
            assert first_detections(PROGRAM, made.text, kept, verified=verified) == wanted, made.text
            asked, found = asked + len(kept), found + sum(one is not None for one in wanted)
    assert found > 20


@pytest.mark.parametrize("own", ["T1", "T2", "Z"])
def test_the_time_of_an_event_has_no_name_of_a_clause(own: str) -> None:
    """A variable of its own that is called like a time is another one."""
    text = emitted(
        f"time t as s; event e(k, x) = {{ k: k, x: x }}; top sand a b within 5 s without e(3, {own}) when {own} > 1; "
        "a on e(1, _); b on e(2, _);"
    )
    a, b, absent = (line[line.index("(") + 1 : -1].split(", ") for line in MfotlBackend.signature(text).splitlines())
    assert {*absent} & {*a, *b} == {"position: int"}


LASTING = (
    "semantics scattered; time t as s; event e(x, y) = { x: x, y: y };"
    "low on e(1, Y) without e(2, Y) for 2 s after without e(3, Y) for 2 s before;"
)
FAULTS_OF_ABSENCE = {
    "a clause dropped": ("(q2 < d2)", "(q2 < i1)"),
    "a duration one unit longer": ("<= 2000000000", "<= 2000000001"),
    "decided one unit early": ("< -2000000000", "< -1999999999"),
    "at the wrong end": ("(q1 < i1)", "(i1 < q1)"),
    "the value of another": (
        "ONCE low_3(T3_kind, T3_time, Y_text, q2)",
        "ONCE (EXISTS z. low_3(T3_kind, T3_time, z, q2))",
    ),
}


@pytest.mark.published
@published
def test_planted_faults_in_absent_events_show() -> None:
    tree, random = loads(LASTING), Random("lasting")
    text = backend("mfotl").translate(tree, Semantics.SCATTERED).text
    times = (0, 1, 1.999999999, 2, 2.000000001, 3, 4, 4.000000001)
    near: list[Json] = [{"x": 3, "y": 1, "t": 0}, {"x": 1, "y": 1, "t": 2.000000001}, {"t": 5}]
    traces = [near]
    for _ in range(100):
        some = sorted(random.choices(times, k=6))
        traces.append([{"x": random.choice((1, 2, 3)), "y": random.choice((1, 2)), "t": one} for one in some])
    wanted = [first(tree, Semantics.SCATTERED, one) for one in traces]
    assert first_detections(PROGRAM, text, traces) == wanted
    all_show(FAULTS_OF_ABSENCE, text, lambda edited: first_detections(PROGRAM, edited, traces))
