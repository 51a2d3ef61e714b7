"""What is compared and measured: gates, walks, sizes and speeds; the three words, and what goes wrong."""

import mmap
import multiprocessing
import os
import signal
import time
from collections import Counter
from collections.abc import Callable
from contextlib import closing
from functools import partial
from math import inf
from typing import Any, ClassVar

import pytest

import rvaft
from backends.rml.reader.monitor import RmlMonitor, rules
from papers.languages import measurement
from papers.languages.measurement import (
    EVENTS,
    LONGEST,
    Cell,
    Measurement,
    Outcome,
    Settings,
    Subject,
    Walk,
    cells_of,
    default_languages,
    gate_subjects,
    measured,
    walks,
)
from rvaft import Backend, Gate, Metrics, Monitor, OptionError, Semantics, Verdict, all_backends
from rvaft import backend as registry
from rvaft.backend import SpecificationText, backend
from rvaft.capabilities import JSON_VALUES, Feature, Ties
from rvaft.core.property import PARTS, Property
from rvaft.engine import Engine
from rvaft.model.guards import Operator
from rvaft.model.values import Json
from rvaft.monitors import DetectionMonitor
from rvaft.rules.validity import require_valid
from tests.cli.runs import PRUNED
from tests.tables import sampled

pytestmark = pytest.mark.usefixtures("quick")
SUBJECTS = {subject.name: subject for subject in gate_subjects()}
STRICT, PROJECTED, CONSECUTIVE, SCATTERED = Semantics


def test_every_gate_with_every_number_of_children_and_every_threshold() -> None:
    sizes = range(1, 13)
    votes = [f"vot {k}/{n}" for n in sizes for k in range(1, n + 1)]
    plain = {str(gate): [f"{gate} {n}" for n in sizes] for gate in Gate}
    assert [*SUBJECTS] == [name for gate in Gate for name in (votes if gate is Gate.VOT else plain[str(gate)])]
    assert len({subject.digest for subject in SUBJECTS.values()}) == len(SUBJECTS)
    for subject in SUBJECTS.values():
        require_valid(subject.tree)


def test_cells_are_in_order_and_the_languages_all_but_second_forms_the_unfaithful_last() -> None:
    cells = cells_of(gate_subjects([Gate.AND], 2), iter(Semantics), iter(["rml", "ltlf"]))
    names = [(name, choice, one) for name in ("and 1", "and 2") for choice in Semantics for one in ("rml", "ltlf")]
    assert [(cell.subject.name, cell.semantics, cell.language) for cell in cells] == names
    found = [backend(name) for name in all_backends()]
    faithful = sorted(one.name for one in found if one.faithful and not one.form_of and one.name != "c")
    assert default_languages() == (*faithful, "rml-paper")


@pytest.mark.parametrize(
    ("subjects", "semantics", "languages", "said"),
    [
        ([], [STRICT], ["rml"], "nothing to compare"),
        ([SUBJECTS["or 1"]], [], ["rml"], "nothing to compare"),
        ([SUBJECTS["or 1"]], [STRICT], [], "nothing to compare"),
        (
            [Subject("a", SUBJECTS[name].tree) for name in ("or 1", "or 2")],
            [STRICT],
            ["rml"],
            r"2 .* have the name a: .* \./a",
        ),
    ],
)
def test_what_is_refused(subjects: Any, semantics: Any, languages: Any, said: str) -> None:
    with pytest.raises(OptionError, match=said):
        cells_of(subjects, semantics, languages)


@pytest.mark.parametrize("semantics", Semantics)
def test_walks(semantics: Semantics) -> None:
    """The same for the same seed, all of them of use, and with the verdicts of the tree."""
    tree = rvaft.load(PRUNED)
    found, again, other = (walks(tree, semantics, seed, events=150) for seed in (5, 5, 6))
    assert found == again != other
    assert sum(len(walk.events) for walk in found) == 150
    for walk in found:
        assert 0 < len(walk.events) <= LONGEST
        assert tuple(Engine(tree, semantics).run(walk.events)) == walk.verdicts
        assert not any(verdict.final for verdict in walk.verdicts[:-1])
    assert any(walk.verdicts[-1] is Verdict.TRUE for walk in found)
    assert walks(tree, semantics, 5, seconds=0) == ()


@pytest.mark.parametrize("gate", Gate)
@pytest.mark.parametrize("semantics", Semantics)
def test_walks_through_gates_detect_or_lose_all_hope(gate: Gate, semantics: Semantics) -> None:
    tree = SUBJECTS["vot 3/5" if gate is Gate.VOT else f"{gate} 5"].tree
    ends = Counter(walk.verdicts[-1] for walk in walks(tree, semantics, 0))
    assert ends[Verdict.UNKNOWN] <= 1  # the last, which ends where the events do
    hopeless = semantics is STRICT or (semantics is PROJECTED and gate is not Gate.OR)
    assert (ends[Verdict.FALSE] >= ends.total() // 4 - 1) if hopeless else ends[Verdict.FALSE] == 0
    assert ends[Verdict.TRUE] >= ends.total() // 2


# -- backends that misbehave, put in the place of the real ones -------------------------------------------------------


class Odd(Backend):
    """Does something else where it should translate, or where it should read."""

    name = language = "odd"
    suffix = ".odd"
    default_limit = 1
    semantics, says, operators = frozenset(Semantics), frozenset(PARTS), frozenset(Operator)
    features, values, ties = frozenset(Feature), JSON_VALUES, Ties.ANY

    def __init__(self, translating: Callable[[], object] = int, reader: Callable[[str], Any] | None = None) -> None:
        self.translating, self.reader = translating, reader

    def write(self, prop: Property, semantics: Semantics, limit: int) -> SpecificationText:  # noqa: ARG002
        self.translating()
        return SpecificationText("text", Metrics(symbols=7))

    def read(self, text: str, *, atoms: object = None) -> Monitor:  # noqa: ARG002
        assert self.reader is not None
        found: Monitor = self.reader(text)
        return found


def spin(seconds: float, *_text: object, **_options: object) -> None:
    end = time.thread_time() + seconds
    while time.thread_time() < end:
        pass


endless, busy, waiting = partial(spin, inf), partial(spin, 0.4), partial(time.sleep, 60)


def greedy(*_text: str) -> None:
    bytearray(2**40)


def killed(*_text: str) -> None:
    os.kill(os.getpid(), signal.SIGKILL)


def broken() -> None:
    raise ZeroDivisionError("a defect\nof somebody")


def plant(monkeypatch: pytest.MonkeyPatch, odd: Odd) -> None:
    """Let `odd` be measured; processes are forked, so they have it too. Nothing warms it up."""
    real, warm_up = registry.backend, measurement._warm_up
    monkeypatch.setattr(measurement, "backend", lambda name: odd if name == "odd" else real(name))
    monkeypatch.setattr(measurement, "_warm_up", lambda name, semantics: name == "odd" or warm_up(name, semantics))


def one(
    subject: str | Subject = "and 2", semantics: Semantics = STRICT, language: str = "odd", **settings: Any
) -> Measurement:
    cell = Cell(SUBJECTS[subject] if isinstance(subject, str) else subject, semantics, language)
    ((_, row),) = measured([cell], Settings(**settings))
    return row


OK = (Outcome.OK, "")
ODD = [  # how the translation and the run ended, and why
    (Odd(endless), {"timeout": 0.2}, (Outcome.TIMEOUT, "not within 0.2 s", None, "")),
    (Odd(waiting), {"timeout": 0.02}, (Outcome.TIMEOUT, "not within 0.2 s by the clock", None, "")),
    (Odd(reader=endless), {"timeout": 0.8}, (*OK, Outcome.TIMEOUT, "not within 0.8 s")),
    (Odd(busy, busy), {"timeout": 0.6}, (*OK, Outcome.TIMEOUT, "not within 0.6 s")),  # for both together
    (Odd(greedy), {"memory": 5000}, (Outcome.TOO_LARGE, "megabytes of memory (limit 5000)", None, "")),
    (Odd(reader=greedy), {"memory": 5000}, (*OK, Outcome.TOO_LARGE, "megabytes of memory (limit 5000)")),
    (Odd(killed), {}, (Outcome.FAILED, "the process that measured it was killed (SIGKILL)", None, "")),
    (Odd(reader=killed), {}, (*OK, Outcome.FAILED, "the process that measured it was killed (SIGKILL)")),
    (Odd(broken), {}, (Outcome.FAILED, "ZeroDivisionError: a defect of somebody", None, "")),
]


@pytest.mark.ci
@pytest.mark.parametrize(("odd", "settings", "ended"), sampled(ODD, 2))
def test_what_goes_wrong_is_in_the_row(
    monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str], odd: Odd, settings: dict[str, Any], ended: Any
) -> None:
    """Whoever only waits is ended by the clock; what a reader does wrong does not cost the sizes."""
    plant(monkeypatch, odd)
    monkeypatch.setattr(measurement, "GRACE", 0 if odd.translating is waiting else measurement.GRACE)
    start = time.monotonic()
    row = one(**settings)
    assert time.monotonic() - start < 40  # who waits would take 60 s; others may use this machine
    assert (row.result, row.reason, row.run, row.run_reason) == ended
    assert row.symbols == (7 if row.result is Outcome.OK else None)
    assert row.events_per_second is None
    assert capfd.readouterr().err == ""


def test_memory_that_a_process_inherits_does_not_count(monkeypatch: pytest.MonkeyPatch) -> None:
    plant(monkeypatch, Odd(partial(bytearray, 1 << 28)))
    with closing(mmap.mmap(-1, 6 << 30)):
        row = one(memory=2048)
    assert (row.result, row.reason) == OK


@pytest.mark.ci
def test_events_are_not_found_at_the_expense_of_a_language(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(measurement, "walks", lambda *of, **more: busy() or walks(*of, **more))
    row = one("and 1", STRICT, "rml", timeout=0.35)
    assert (row.run, row.events) == (Outcome.OK, 240)


def test_a_tree_that_is_too_much_for_the_engine(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(measurement, "walks", endless)
    monkeypatch.setattr(measurement, "WALKING", 0.05)
    row = one("and 1", STRICT, "rml")
    assert (row.run, row.walks, row.events, row.events_per_second) == (Outcome.OK, 0, 0, None)
    assert row.run_reason.startswith("no events: ")


@pytest.mark.ci
def test_several_at_a_time_hinder_nobody_and_nothing_is_left_behind(monkeypatch: pytest.MonkeyPatch) -> None:
    plant(monkeypatch, Odd(endless))
    odd, nobody = (Cell(SUBJECTS["and 2"], STRICT, language) for language in ("odd", "nobody"))
    cells = [odd, *(Cell(SUBJECTS[f"and {n}"], STRICT, "rml") for n in (1, 2)), nobody]
    rows = dict(measured(cells, Settings(timeout=0.7), jobs=2))
    assert [rows[cell].result for cell in cells] == [Outcome.TIMEOUT, Outcome.OK, Outcome.OK, Outcome.FAILED]
    with closing(measured([cells[1], odd, Cell(SUBJECTS["and 2"], PROJECTED, "odd")], Settings(), jobs=3)) as found:
        next(found)
        assert multiprocessing.active_children()
    assert not multiprocessing.active_children()
    with closing(measured([cells[1], odd], Settings())) as found:
        next(found)
        (worker,) = multiprocessing.active_children()
        worker.terminate()
        worker.join(10)
        assert worker.exitcode == 1  # told to stop it ends, in the middle of whatever it does
        assert [row.result for _, row in found] == [Outcome.FAILED]


@pytest.mark.spot
@pytest.mark.parametrize("language", ["automaton", "ltlf", "rml", "rml-paper"])
def test_a_whole_measurement(language: str) -> None:
    pytest.importorskip("spot") if language in ("automaton", "ltlf") else None
    last = one("vot 2/3", PROJECTED, language, seed=3)
    assert (last.result, last.run) == (Outcome.OK, Outcome.OK)
    assert (last.tree, last.gate, last.children, last.threshold) == ("vot 2/3", Gate.VOT, 3, 2)
    assert (last.events, last.differing, last.seed) == (EVENTS, 0, 3)
    assert 1 <= (last.first_events or 0) <= EVENTS
    for number in (last.seconds, last.read_seconds, last.events_per_second, last.again_per_second):
        assert 0 < (number or 0) < float("inf")


@pytest.mark.parametrize("language", ["sql", "stix", "sigma", "eql", "mtl"])
def test_a_language_that_tells_detections_alone_runs_whole_traces(language: str) -> None:
    """What its program knows is all that is compared, and told."""
    for module in backend(language).modules:
        pytest.importorskip(module)
    row = one("sand 2", SCATTERED, language)
    assert (row.run, row.run_reason, row.events, row.differing) == (Outcome.OK, "detections only", EVENTS, 0)
    assert row.detections_only
    assert 0 < (row.events_per_second or 0) < (row.again_per_second or 0) < float("inf")


@pytest.mark.parametrize(
    ("found", "left_open", "differing", "said"),
    [
        (lambda walk: walk.detection, "", 0, "detections only"),
        (lambda walk: walk.detection and walk.detection - 1, "", 1, "detections only"),
        (lambda _: None, "why", 0, "detections only, {walks} of {walks} traces are left open"),
    ],
)
def test_detections_are_held_against_the_tree(
    monkeypatch: pytest.MonkeyPatch, found: Callable[[Walk], int | None], left_open: str, differing: int, said: str
) -> None:
    known = walks(SUBJECTS["sand 2"].tree, STRICT, 0)  # of which one in four ends without hope
    right = {str(walk.events): found(walk) for walk in known}
    monitor = DetectionMonitor(lambda traces: [right[str(trace)] for trace in traces], lambda _: left_open)
    plant(monkeypatch, Odd(reader=lambda _text: monitor))
    row = one("sand 2", STRICT)
    assert row.run_reason == said.format(walks=len(known))
    assert bool(row.differing) == bool(differing)
    assert row.walks == (0 if left_open else len(known))


def test_events_have_times_where_a_tree_reads_them() -> None:
    tree = rvaft.loads("time ts as s; top sand a b within 10 s; a; b;")
    found = walks(tree, SCATTERED, 0)
    assert all(walk.events[1]["ts"] - walk.events[0]["ts"] == 1 for walk in found if len(walk.events) > 1)
    assert {walk.verdicts[-1] for walk in found[:-1]} == {Verdict.TRUE}


@pytest.mark.ci
def test_the_papers_translation_is_caught() -> None:
    """Its union of branches commits to the first, and misses what the others would detect."""
    pruned = Subject("pruned", rvaft.load(PRUNED))
    wrong, right = (one(pruned, PROJECTED, language) for language in ("rml-paper", "rml"))
    assert wrong.differing
    assert right.differing == 0
    assert wrong.walks == right.walks


class Slow(Monitor):
    """A reader that is slow with what the process has not met before, and remembers nothing else of a trace."""

    met: ClassVar[set[str]] = set()
    state = Monitor.verdict

    def _advance(self, event: Json) -> Verdict:
        spin(0.002 if str(event) not in self.met else 0)
        self.met.add(str(event))
        return Verdict.TRUE


@pytest.mark.ci
def test_the_first_time_is_that_of_readers_that_have_met_nothing(monkeypatch: pytest.MonkeyPatch) -> None:
    """Under OR each trace is one event, nearly always one of five: one reader for all of them would have met it."""
    plant(monkeypatch, Odd(reader=lambda _text: Slow()))
    monkeypatch.setattr(measurement, "READERS", 12)
    monkeypatch.setattr(measurement, "PATIENCE", 0.4)
    row = one("or 5")
    assert row.first_events == 12
    assert 0 < (row.events_per_second or 0) <= 500
    assert (row.again_per_second or 0) > 5000


class Deaf(RmlMonitor):
    """Never says that no hope is left."""

    def _advance(self, event: Json) -> Verdict:
        verdict = super()._advance(event) if self._term is not None else Verdict.FALSE
        return verdict if verdict is Verdict.TRUE else Verdict.UNKNOWN


@pytest.mark.parametrize("semantics", [STRICT, PROJECTED])
def test_a_text_that_never_says_that_hope_is_lost_is_found(
    monkeypatch: pytest.MonkeyPatch, semantics: Semantics
) -> None:
    text = backend("rml").translate(SUBJECTS["sand 4"].tree, semantics).text
    plant(monkeypatch, Odd(reader=lambda _text: Deaf(rules(text))))
    row = one("sand 4", semantics)
    assert 0 < (row.differing or 0) < (row.walks or 0)
