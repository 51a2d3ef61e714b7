"""One comparison: what is said of whom, and that nothing counts as agreement which is none."""

from collections.abc import Callable, Hashable, Sequence
from pathlib import Path

import pytest

from cross_check import cross_check
from cross_check.comparison import Comparison, Enlist, Roster
from cross_check.participants import (
    Absent,
    Answer,
    Handwritten,
    Outside,
    Participant,
    faithful_backends,
    observed_by,
    reference_of,
)
from cross_check.results import Job, Result, Status, exit_status
from cross_check.traces import Effort
from rvaft import loads
from rvaft.backend import Metrics, Observed, Specification
from rvaft.errors import NotExpressible, RvaftError, TooLarge, ToolMissing
from rvaft.model.patterns import Literal, ObjectPattern
from rvaft.model.values import Json
from rvaft.model.verdict import Semantics, Verdict
from rvaft.monitors import Monitor
from rvaft.semantics import Reference

TREE = loads("toplevel r; r sand a b; a; b;")
EFFORT = Effort()
JOB = Job("tree", Semantics.STRICT)
TEXT = Specification("text", "language", Metrics(3, states=4), lambda _: Reference(TREE, Semantics.STRICT))


class Spoiled(Monitor):
    """The reference, but for what happens at one event."""

    def __init__(self, at: Callable[[Json], bool], spoil: Callable[[Verdict], Verdict]) -> None:
        super().__init__()
        self.inner = Reference(TREE, Semantics.STRICT)
        self.at = at
        self.spoil = spoil

    @property
    def state(self) -> Hashable:
        return self.inner.state, self.verdict

    def fork(self) -> "Spoiled":
        twin = super().fork()
        twin.inner = self.inner.fork()
        return twin

    def _advance(self, event: Json) -> Verdict:
        verdict = self.inner.step(event)
        return self.spoil(verdict) if self.at(event) else verdict


def compare(*others: tuple[str, Enlist], effort: Effort = EFFORT) -> dict[str, Result]:
    candidates = [("reference", lambda: reference_of(TREE, JOB.semantics)), *others]
    return {result.participant: result for result in Comparison(TREE, JOB, effort).run(candidates)}


def same(observed: tuple[Observed, ...] | None = observed_by(TREE)) -> Enlist:
    return lambda: Participant("same", lambda: Reference(TREE, Semantics.STRICT), TEXT, observed)


def fail(error: RvaftError) -> Enlist:
    return lambda: Absent(error)


def raising(_verdict: Verdict) -> Verdict:
    raise TooLarge("partial matches", limit=7)


def test_proved_with_the_sizes_of_the_text() -> None:
    found = compare(("same", same()))
    assert found["reference"].status is Status.BASELINE
    assert (found["same"].status, found["same"].text) == (Status.PROVED, "proved")
    assert (found["same"].symbols, found["same"].states) == (3, 4)
    assert found["same"].verdicts > 0


def test_without_knowing_what_it_asks_it_is_only_tested() -> None:
    found = compare(("same", same(None)))
    assert found["same"].status is Status.TESTED
    assert found["same"].text.endswith("(what it observes is not known)")


READ = 'event read(v) = { event: "read", value: v };\n'


def test_a_shared_variable_is_only_tested() -> None:
    tied = loads(f"{READ} top sand a b; a on read(V); b on read(V);")
    for result in cross_check(tied, "strict", "projected")[1:5]:
        assert result.status is Status.TESTED
        assert result.why == "variables tie events together"


@pytest.mark.parametrize("guard", ["a on read(V) when V > 3", "a on read(V)", 'a on read(V) when V == "x" or V <= 2'])
def test_a_variable_of_one_event_ties_nothing(guard: str) -> None:
    for result in cross_check(loads(f"{READ} top sand b a; {guard}; b;")):
        assert result.status in (Status.BASELINE, Status.PROVED), result


def test_what_forgets_a_guard_on_such_a_variable_differs(tmp_path: Path) -> None:
    (tmp_path / "other.rvaft").write_text(f"{READ} top sand b a; a on read(V) when V >= 3; b;")
    results = cross_check(
        loads(f"{READ} top sand b a; a on read(V) when V > 3; b;"), against=[str(tmp_path / "other.rvaft")]
    )
    assert [result.status for result in results] == [Status.BASELINE, Status.DIFFERS] * 3
    assert [result.difference.trace[-1]["value"] for result in results if result.difference] == [3, 3, 3]


def test_a_backend_that_is_only_emitted(monkeypatch: pytest.MonkeyPatch) -> None:
    assert "rml-prolog" not in faithful_backends()
    (_, _, named) = cross_check(loads("top and a b;"), "strict", backends=["rml-prolog"])
    assert named.text.startswith("could not run: rml-prolog is only emitted: nothing here runs its texts")
    (_, part, _, _, _) = cross_check(loads("top or a b; a fault; b attack;"), "strict", kind="fault", name="mine")
    assert part.job.title == "mine faults"


def test_a_proof_asked_for_no_states_is_no_proof() -> None:
    found = compare(("same", same()), effort=Effort(states=0))
    assert found["same"].status is Status.TESTED


@pytest.mark.parametrize(
    ("error", "status", "text"),
    [
        (
            NotExpressible("no gates", backend="x", semantics="strict"),
            Status.NOT_EXPRESSIBLE,
            "not expressible: no gates",
        ),
        (TooLarge("states", limit=5), Status.TOO_LARGE, "too large: states (limit 5)"),
        (
            ToolMissing("spot", remedy="install it"),
            Status.TOOL_MISSING,
            "tool missing: spot is not installed: install it",
        ),
        (RvaftError("oh no"), Status.COULD_NOT_RUN, "could not run: oh no"),
    ],
)
def test_who_is_absent_is_named_and_does_not_agree(error: RvaftError, status: Status, text: str) -> None:
    found = compare(("failed", fail(error)), ("same", same()))
    assert (found["failed"].status, found["failed"].text) == (status, text)
    assert not found["failed"].status.agrees
    assert found["same"].status is Status.PROVED


def test_alone_nobody_agrees() -> None:
    found = compare(("failed", fail(TooLarge("states", limit=5))))
    assert found["reference"].status is Status.COULD_NOT_RUN
    assert exit_status(found.values()) == 2


def test_without_the_reference_the_next_one_is_the_baseline() -> None:
    absent: Enlist = lambda: Absent(TooLarge("scenarios", limit=1))  # noqa: E731
    rows = Comparison(TREE, JOB, Effort()).run([("reference", absent), ("same", same()), ("again", same())])
    assert [row.status for row in rows] == [Status.TOO_LARGE, Status.BASELINE, Status.PROVED]


@pytest.mark.parametrize("observed", [observed_by(TREE), None], ids=["proof", "test"])
def test_a_difference_comes_with_the_shortest_trace(observed: tuple[Observed, ...] | None) -> None:
    spoiled = Spoiled(
        lambda event: event == {"event": "b"}, lambda verdict: Verdict.UNKNOWN if verdict is Verdict.TRUE else verdict
    )
    found = compare(("spoiled", lambda: Participant("spoiled", spoiled.fork, observed=observed)))["spoiled"]
    assert found.status is Status.DIFFERS
    assert found.difference is not None
    assert found.difference.trace == ({"event": "a"}, {"event": "b"})
    assert found.difference.expected == (Verdict.UNKNOWN, Verdict.TRUE)
    assert found.difference.got == (Verdict.UNKNOWN, Verdict.UNKNOWN)
    assert exit_status([found]) == 1


def test_what_is_proved_is_run_again_and_a_lie_about_what_is_asked_is_found() -> None:
    """Who looks at more than it says is caught by the traces that everybody runs, though its proof went through."""
    noisy = Spoiled(lambda event: "noise" in event, lambda _: Verdict.UNKNOWN)
    for effort, status in ((Effort(traces=400), Status.DIFFERS), (Effort(recheck=False), Status.PROVED)):
        found = compare(
            ("noisy", lambda: Participant("noisy", noisy.fork, observed=observed_by(TREE))),
            ("same", same()),
            effort=effort,
        )
        assert found["noisy"].status is status


@pytest.mark.parametrize("observed", [observed_by(TREE), None], ids=["proof", "test"])
def test_who_raises_could_not_run(observed: tuple[Observed, ...] | None) -> None:
    broken = Spoiled(lambda event: event == {"event": "b"}, raising)
    found = compare(("broken", lambda: Participant("broken", broken.fork, observed=observed)), ("same", same()))
    assert found["broken"].text == "too large: partial matches (limit 7)"
    assert found["same"].status is Status.PROVED


# -- programs of others -----------------------------------------------------------------------------------------


def outside(answer: Callable[[list[Verdict]], Answer]) -> Enlist:
    def answers(traces: Sequence[Sequence[Json]]) -> list[Answer]:
        return [answer(list(Reference(TREE, Semantics.STRICT).run(trace))) for trace in traces]

    return lambda: Outside("other", answers, TEXT)


def wrong(verdicts: list[Verdict]) -> list[Verdict]:
    return [Verdict.UNKNOWN if verdict is Verdict.TRUE else verdict for verdict in verdicts]


def test_a_program_of_others_is_tested_also_where_all_is_proved() -> None:
    found = compare(("same", same()), ("other", outside(lambda verdicts: Answer(tuple(verdicts)))))
    assert found["same"].status is Status.PROVED
    assert found["other"].status is Status.TESTED
    assert found["other"].traces > 20
    assert found["other"].masked == 0


def test_a_known_deviation_is_masked_and_counted_only_where_it_shows() -> None:
    masked = outside(lambda verdicts: Answer(tuple(wrong(verdicts)), deviations=("tolerance",)))
    found = compare(("same", same()), ("other", masked))["other"]
    assert found.status is Status.TESTED
    assert found.masked > 0
    assert f", {found.masked} masked (tolerance)" in found.text
    assert compare(("other", outside(lambda v: Answer(tuple(v), deviations=("tolerance",)))))["other"].masked == 0


def test_a_deviation_that_is_not_known_is_a_difference() -> None:
    found = compare(("same", same()), ("other", outside(lambda verdicts: Answer(tuple(wrong(verdicts))))))["other"]
    assert found.status is Status.DIFFERS
    assert found.difference is not None
    assert found.difference.expected[-1] is Verdict.TRUE


def test_an_exception_of_a_program_is_no_agreement() -> None:
    found = compare(("same", same()), ("other", outside(lambda _: Answer(error="type_error"))))["other"]
    assert found.text == "could not run: type_error"


# -- exit status ------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("statuses", "expected", "strict"),
    [
        ([Status.BASELINE, Status.PROVED, Status.TESTED], 0, 0),
        ([Status.BASELINE, Status.DIFFERS], 1, 1),
        ([Status.BASELINE, Status.PROVED, Status.NOT_EXPRESSIBLE], 0, 2),
        ([Status.BASELINE, Status.PROVED, Status.TOO_LARGE], 0, 2),
        ([Status.BASELINE, Status.PROVED, Status.TIMEOUT], 0, 2),
        ([Status.BASELINE, Status.TIMEOUT], 2, 2),
        ([Status.BASELINE], 2, 2),
        ([Status.DIFFERS, Status.TOOL_MISSING], 2, 2),
        ([Status.DIFFERS, Status.COULD_NOT_RUN], 2, 2),
    ],
)
def test_exit_status(statuses: list[Status], expected: int, strict: int) -> None:
    results = [Result(JOB, str(status), status) for status in statuses]
    assert exit_status(results) == expected
    assert exit_status(results, failing=(Status.NOT_EXPRESSIBLE, Status.TOO_LARGE, Status.TIMEOUT)) == strict


def test_literals_of_the_observed_tree() -> None:
    assert {Observed(ObjectPattern((("event", Literal(name)),))) for name in "ab"} <= set(observed_by(TREE))


# -- what once went wrong ---------------------------------------------------------------------------------------


@pytest.mark.parametrize("recheck", [True, False])
def test_when_the_first_fails_nobody_is_proved(recheck: bool) -> None:
    broken = Spoiled(lambda event: event == {"event": "a"}, raising)
    odd = Spoiled(lambda event: event == {"event": "b"}, lambda _: Verdict.UNKNOWN)
    first: Enlist = lambda: Participant("first", broken.fork, observed=observed_by(TREE))  # noqa: E731
    other: Enlist = lambda: Participant("odd", odd.fork, observed=observed_by(TREE))  # noqa: E731
    rows = Comparison(TREE, JOB, Effort(recheck=recheck)).run([("first", first), ("odd", other), ("same", same())])
    assert [row.status for row in rows] == [Status.TOO_LARGE, Status.BASELINE, Status.DIFFERS]


def test_any_exception_is_could_not_run() -> None:
    def crash(_: Verdict) -> Verdict:
        raise KeyError("x")

    def never() -> Participant:
        raise ZeroDivisionError("no")

    broken = Spoiled(lambda event: event == {"event": "b"}, crash)
    for observed in (observed_by(TREE), None):
        step: Enlist = lambda observed=observed: Participant("broken", broken.fork, observed=observed)  # type: ignore[misc]  # noqa: E731
        found = compare(("never", never), ("broken", step), ("same", same()))
        assert found["never"].text == "could not run: ZeroDivisionError: no"
        assert found["broken"].text == "could not run: KeyError: 'x'"
        assert found["same"].status is Status.PROVED


def test_without_a_trace_nothing_is_tested() -> None:
    found = compare(("same", same(None)), effort=Effort(words=0, traces=0))
    assert found["same"].text == "could not run: there was no trace to try"
    assert exit_status(found.values()) == 2


def test_a_program_that_takes_too_long_is_a_timeout() -> None:
    found = compare(("same", same()), ("other", outside(lambda _: Answer(error="timeout: 1 s", expired=True))))
    assert found["other"].status is Status.TIMEOUT


def test_when_everything_is_masked_nothing_agrees() -> None:
    found = compare(("same", same()), ("other", outside(lambda _: Answer(error="type_error", deviations=("guards",)))))
    assert found["other"].text == "could not run: all traces are masked: guards"


def test_guards_that_differ_in_1_and_1_0_are_two_questions() -> None:
    """Arithmetic tells an integer from the equal double where doubles end."""
    event = 'event ev(x) = { event: "ev", x: x };'
    both = f"{event} ignore ev(V) when V * 1.0 > 5; ignore ev(V) when V * 1 > 5; top sand a b; a on ev(_); b on ev(_);"
    trace: list[Json] = [{"event": "ev", "x": 10**400}, {"event": "ev", "x": 0}]
    tree = loads(both)
    for _, enlist in Roster().candidates(tree, Job("both", Semantics.PROJECTED)):
        made = enlist()
        if isinstance(made, Participant):
            assert [str(verdict) for verdict in made.start().run(trace)] == ["unknown", "unknown"], made.name


def test_participants_of_one_name_are_told_apart() -> None:
    chain = loads("toplevel t; t sand a b c;")
    texts = (
        Handwritten("reference", "rvaft", "toplevel t; t sand b a c;"),
        Handwritten("reference", "rvaft", "toplevel t; t sand a c b;"),
        Handwritten("same", "rvaft", "toplevel t; t sand a b c;"),
    )
    job = Job("chain", Semantics.STRICT)
    results = Comparison(chain, job, Effort()).run(Roster(against=texts).candidates(chain, job))
    assert [(one.participant, one.status) for one in results] == [
        ("reference", Status.BASELINE),
        ("reference (2)", Status.DIFFERS),
        ("reference (3)", Status.DIFFERS),
        ("same", Status.PROVED),
    ]
