"""One comparison: what is said of whom, and that nothing counts as agreement which is none."""

import time
from collections.abc import Callable, Hashable, Sequence
from pathlib import Path
from typing import Any, Final

import pytest

from cross_check import cross_check
from cross_check.comparison import Comparison, Enlist, Roster
from cross_check.participants import (
    Absent,
    Answer,
    Handwritten,
    Outside,
    Participant,
    observed_by,
    reference_of,
)
from cross_check.results import Difference, Job, Result, Status, difference_lines, exit_status
from cross_check.traces import Effort
from rvaft import (
    Metrics,
    Monitor,
    NotExpressible,
    RvaftError,
    Semantics,
    Specification,
    TooLarge,
    ToolMissing,
    Verdict,
    loads,
)
from rvaft.backend import Observed
from rvaft.errors import unwritten
from rvaft.model.values import Json
from rvaft.semantics import Reference
from rvaft.support.budget import Expired, within
from tests.cli.runs import run

TREE = loads("toplevel r; r sand a b; a; b;")
OBSERVED = observed_by(TREE)
JOB = Job("tree", Semantics.STRICT)
TEXT = Specification("text", "language", Metrics(3, states=4), lambda _: Reference(TREE, Semantics.STRICT))
UNKNOWN, TRUE = Verdict.UNKNOWN, Verdict.TRUE


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


def compare(effort: Effort | None = None, **others: Enlist) -> dict[str, Result]:
    candidates = {"reference": lambda: reference_of(TREE, JOB.semantics), **others}
    return {one.participant: one for one in Comparison(TREE, JOB, effort or Effort()).run(candidates.items())}


def same(observed: tuple[Observed, ...] | None = OBSERVED) -> Enlist:
    return lambda: Participant("same", lambda: Reference(TREE, Semantics.STRICT), TEXT, observed)


def spoiled(
    spoil: Callable[[Verdict], Verdict], observed: tuple[Observed, ...] | None = OBSERVED, at: str = "b"
) -> Enlist:
    monitor = Spoiled(lambda event: event == {"event": at} or at in event, spoil)
    return lambda: Participant("spoiled", monitor.fork, observed=observed)


def wrong(verdict: Verdict) -> Verdict:
    return UNKNOWN if verdict is TRUE else verdict


def raising(_verdict: Verdict) -> Verdict:
    raise TooLarge("partial matches", limit=7)


def crashing(_verdict: Verdict) -> Verdict:
    raise KeyError("x")


def never() -> Participant:
    raise ZeroDivisionError("no")


def outside(answer: Callable[[tuple[Verdict, ...]], Answer]) -> Enlist:
    def answers(traces: Sequence[Sequence[Json]]) -> list[Answer]:
        return [answer(tuple(Reference(TREE, Semantics.STRICT).run(trace))) for trace in traces]

    return lambda: Outside("other", answers, TEXT)


def failing(**said: Any) -> Enlist:
    return outside(lambda _: Answer(**said))


def absent(error: RvaftError) -> Enlist:
    return lambda: Absent(error)


NO_GATES = NotExpressible(unwritten("no gates"), backend="x", semantics="strict")
TOLERANT = outside(lambda v: Answer(tuple(map(wrong, v)), deviations=("tolerance",)))
ENDS: Final[dict[str, tuple[Enlist, str]]] = {
    # who takes part, and what is said of it: how that begins is the status; `~` is what is counted
    "proved": (same(), "proved"),
    "not observed": (same(None), "tested~(its observed patterns are unknown)"),
    "no language": (absent(NO_GATES), "not expressible~: no gates"),
    "large": (absent(TooLarge("states", limit=5)), "too large~: states (limit 5)"),
    "no tool": (absent(ToolMissing("spot", remedy="install it")), "tool missing~: spot is not installed: install it"),
    "any error": (absent(RvaftError("oh no")), "could not run~: oh no"),
    "not made": (never, "could not run~: ZeroDivisionError: no"),
    "raises": (spoiled(raising), "too large~: partial matches (limit 7)"),
    "raises in tests": (spoiled(raising, None), "too large~: partial matches (limit 7)"),
    "crashes": (spoiled(crashing), "could not run~: KeyError: 'x'"),
    "crashes in tests": (spoiled(crashing, None), "could not run~: KeyError: 'x'"),
    "differs": (spoiled(wrong), "differs~ after 2 events"),
    "differs in tests": (spoiled(wrong, None), "differs~ after 2 events"),
    # programs of others are tested, also where all is proved
    "other": (outside(Answer), "tested~(its states are unknown)"),
    "other that fails": (failing(error="type_error"), "could not run~: type_error"),
    "other that is late": (failing(error="timeout: 1 s", expired=True), "timeout~: timeout: 1 s"),
    "other that differs": (outside(lambda v: Answer(tuple(map(wrong, v)))), "differs~ after 2 events"),
    "other with a known deviation": (TOLERANT, "vacuous~ masked (tolerance)"),
    "other that masks all": (failing(error="x", deviations=("g",)), "could not run~: all traces are masked: g"),
}


@pytest.mark.parametrize(("enlist", "said"), ENDS.values(), ids=ENDS)
def test_how_it_ends(enlist: Enlist, said: str) -> None:
    word, _, text = said.partition("~")
    status = Status(word)
    found = compare(one=enlist, same=same())
    one, agreeing = found["one"], found["same"]
    assert found["reference"].status is Status.BASELINE
    assert (agreeing.status, agreeing.symbols, agreeing.states) == (Status.PROVED, 3, 4)
    assert agreeing.verdicts > 0
    assert (one.status, bool(one.masked)) == (status, "masked" in text)
    assert one.text.endswith(text)
    if status is Status.DIFFERS:
        expected = Difference(({"event": "a"}, {"event": "b"}), "reference", (UNKNOWN, TRUE), (UNKNOWN, UNKNOWN))
        assert one.difference == expected
        assert exit_status([one]) == 1


def test_a_deviation_is_counted_only_where_it_shows() -> None:
    other = compare(other=outside(lambda verdicts: Answer(verdicts, deviations=("tolerance",))))["other"]
    assert (other.masked, other.traces > 20) == (0, True)


def test_with_too_little_effort_nothing_is_proved_or_tested_and_alone_nobody_agrees() -> None:
    found = compare(Effort(states=0, words=0, traces=7), same=same())
    assert (found["same"].status, found["same"].traces) == (Status.TESTED, 7)
    found = compare(Effort(words=0, traces=0), same=same(None))
    assert (found["same"].text, exit_status(found.values())) == ("could not run: there is no trace to test", 2)
    found = compare(failed=absent(TooLarge("states", limit=5)))
    assert (found["reference"].status, exit_status(found.values())) == (Status.COULD_NOT_RUN, 2)


def test_what_is_proved_is_run_again_and_a_lie_about_what_is_asked_is_found() -> None:
    """Who looks at more than it says is caught by the traces that everybody runs, though its proof went through."""
    for effort, status in ((Effort(traces=400), Status.DIFFERS), (Effort(recheck=False), Status.PROVED)):
        assert compare(effort, noisy=spoiled(lambda _: UNKNOWN, at="noise"), same=same())["noisy"].status is status


def test_time_is_limited() -> None:
    def spin() -> Participant:
        while True:
            pass

    found = compare(Effort(seconds=0.5, traces=2, words=20), slow=spin, same=same())
    assert found["slow"].text == "timeout: no result within the time limit"
    assert found["same"].status is Status.PROVED
    with pytest.raises(Expired), within(0.05):
        spin()
    with within(None):
        time.sleep(0.06)  # the clock that ran before is stopped


@pytest.mark.parametrize(
    ("reference", "said"),
    [
        # what the first asks is not known; it is absent; it fails: nobody is proved against it
        (same(None), "baseline, tested, tested"),
        (absent(TooLarge("scenarios", limit=1)), "too large, baseline, proved"),
        (spoiled(raising, at="a"), "too large, baseline, tested"),
    ],
)
@pytest.mark.parametrize("recheck", [True, False])
def test_without_the_first_the_next_one_is_the_baseline(reference: Enlist, said: str, recheck: bool) -> None:
    found = compare(Effort(recheck=recheck), reference=reference, one=same(), two=same())
    assert [one.status for one in found.values()] == said.split(", ")
    if said.startswith("too large"):
        odd = compare(Effort(recheck=recheck), reference=reference, odd=spoiled(lambda _: UNKNOWN), two=same())
        assert [one.status for one in odd.values()] == [Status.TOO_LARGE, Status.BASELINE, Status.DIFFERS]


READ = 'event read(v) = { event: "read", value: v };\n'


@pytest.mark.parametrize("guard", ["a on read(V) when V > 3", "a on read(V)", 'a on read(V) when V == "x" or V <= 2'])
def test_a_variable_of_one_event_ties_nothing_and_a_shared_one_is_only_tested(guard: str) -> None:
    for result in cross_check(
        loads(f"{READ} top sand b a; {guard}; b;"), "projected", backends=["automaton", "ltlf", "rml"]
    ):
        assert result.status in (Status.BASELINE, Status.PROVED), result
    for result in cross_check(loads(f"{READ} top sand b a; {guard}; b on read(V);"), "projected", backends=["rml"])[1:]:
        assert (result.status, result.why) == (Status.TESTED, "variables may tie events together")


@pytest.mark.parametrize(
    ("text", "why"),
    [
        ("time t as s; top sand a b within 5 s;", "times tie events together"),
        ("time t as s late 5 s; top sand a b;", "times tie events together"),
        ("time t as s; top sand a b g; g when at(a) == at(b);", "times tie events together"),
        ("time t as s; top sand a b;", ""),
        (f"{READ} top sand a b; a on read(V) times 2;", "variables may tie events together"),
        (f"{READ} top sand a b; a on read(_) times 2;", ""),
    ],
)
def test_what_ties_events_together_is_tested_and_not_proved(text: str, why: str) -> None:
    _, engine, *_ = cross_check(loads(text), "scattered", backends=["rml"])
    assert (engine.status, engine.why) == (Status.TESTED if why else Status.PROVED, why)


@pytest.mark.parametrize("side", ["before", "after"])
def test_times_of_absence_are_tested_and_not_proved(side: str) -> None:
    tree = loads(f'{READ} time t as s; top and a; a without read("c") for 2 s {side};')
    _, engine, *_ = cross_check(tree, "strict", backends=["c"])
    assert (engine.status, engine.why) == (Status.TESTED, "times tie events together")


def test_what_is_absent_is_asked_about() -> None:
    tree = loads(f'{READ} top sand a b without read("c");')
    assert any(one.fits({"event": "read", "value": "c"}) for one in observed_by(tree))


def test_what_forgets_a_guard_on_such_a_variable_differs(tmp_path: Path) -> None:
    (tmp_path / "other.rvaft").write_text(f"{READ} top sand b a; a on read(V) when V >= 3; b;")
    tree = loads(f"{READ} top sand b a; a on read(V) when V > 3; b;")
    results = cross_check(tree, against=[str(tmp_path / "other.rvaft")])
    assert [result.status for result in results] == [Status.BASELINE, Status.DIFFERS] * 4
    assert [result.difference.trace[-1]["value"] for result in results if result.difference] == [3, 3, 3, 3]


def test_a_part_has_the_name_that_is_given() -> None:
    (_, part, *_) = cross_check(loads("top or a b; a fault; b attack;"), "strict", kind="fault", name="mine")
    assert part.job.title == "mine faults"


def test_guards_that_differ_in_1_and_1_0_are_two_questions() -> None:
    """Arithmetic tells an integer from the equal double where doubles end."""
    event = 'event ev(x) = { event: "ev", x: x };'
    both = f"{event} ignore ev(V) when V * 1.0 > 5; ignore ev(V) when V * 1 > 5; top sand a b; a on ev(_); b on ev(_);"
    trace: list[Json] = [{"event": "ev", "x": 10**400}, {"event": "ev", "x": 0}]
    for _, enlist in Roster().candidates(loads(both), Job("both", Semantics.PROJECTED)):
        made = enlist()
        if isinstance(made, Participant) and not (made.left_open and made.left_open(trace)):
            assert [str(verdict) for verdict in made.start().run(trace)] == ["unknown", "unknown"], made.name


def test_participants_of_one_name_are_told_apart() -> None:
    chain, job = loads("toplevel t; t sand a b c;"), Job("chain", Semantics.STRICT)
    orders = {"b a c": "reference", "a c b": "reference", "a b c": "same"}
    texts = tuple(Handwritten(name, "rvaft", f"toplevel t; t sand {order};") for order, name in orders.items())
    results = Comparison(chain, job, Effort()).run(Roster(against=texts).candidates(chain, job))
    said = {"reference": "baseline", "reference (2)": "differs", "reference (3)": "differs", "same": "proved"}
    assert {one.participant: one.status for one in results} == said


EXITS: Final = {
    # of a run, and of one that fails on what is not expressible, too large or late
    "baseline, proved, tested": (0, 0),
    "baseline, differs": (1, 1),
    **{f"baseline, proved, {said}": (0, 2) for said in ("not expressible", "too large", "timeout")},
    **dict.fromkeys(["baseline, timeout", "baseline", "differs, tool missing", "differs, could not run"], (2, 2)),
}


@pytest.mark.parametrize(("statuses", "expected"), EXITS.items())
def test_exit_status(statuses: str, expected: tuple[int, int]) -> None:
    results = [Result(JOB, status, Status(status)) for status in statuses.split(", ")]
    strict = exit_status(results, failing=(Status.NOT_EXPRESSIBLE, Status.TOO_LARGE, Status.TIMEOUT))
    assert (exit_status(results), strict) == expected


class Slow(Reference):
    """The reference, too slow for traces with the event a twice."""

    def _advance(self, event: Json) -> Verdict:
        if event == {"event": "a"}:
            time.sleep(0.03)
        return super()._advance(event)


def test_what_the_time_limit_cuts_off_is_no_agreement() -> None:
    def slow() -> Participant:
        return Participant("slow", lambda: Slow(TREE, Semantics.STRICT), observed=None)

    effort = Effort(states=0, words=0, traces=400, seconds=1.0)
    started = time.perf_counter()
    candidates = [("reference", lambda: reference_of(TREE, Semantics.STRICT)), ("slow", slow)]
    results = Comparison(TREE, JOB, effort).run(candidates)
    assert time.perf_counter() - started < 10
    assert results[1].status is Status.TIMEOUT
    assert "within the time limit" in results[1].why
    assert exit_status(results) == 2


@pytest.mark.parametrize("times", [1, 8])
def test_steps_of_the_reference_and_not_seconds_end_a_comparison(times: int) -> None:
    """Costly traces are left out, the same on each machine, and their number is told."""
    tree = loads(f"semantics scattered; top sand b a; a times {times}; b;")
    job, effort = Job("tree", Semantics.SCATTERED), Effort(states=0, words=0, traces=40, work=10_000)
    found = [Comparison(tree, job, effort).run(Roster(("c",)).candidates(tree, job)) for _ in range(2)]
    assert [(one.status, one.text) for one in found[0]] == [(one.status, one.text) for one in found[1]]
    assert all("steps of the reference" in one.why for one in found[0] if one.status is Status.TESTED) is (times == 8)


def test_a_reference_without_a_trace_within_its_steps_is_too_large() -> None:
    tree = loads("semantics scattered; top and a b c;")
    job, effort = Job("tree", Semantics.SCATTERED), Effort(states=0, words=0, traces=9, work=1)
    other = Handwritten("other.rvaft", "rvaft", "semantics scattered; top and a c b;")
    results = Comparison(tree, job, effort).run(Roster(against=(other,)).candidates(tree, job))
    assert results[0].text == "too large: steps of the reference (limit 1)"
    assert exit_status(results) == 2


def test_a_signal_that_a_callback_swallows_is_repeated() -> None:
    class Unlucky:
        def __del__(self) -> None:
            time.sleep(0.3)  # the signal comes here, where exceptions are dropped

    def run() -> None:
        Unlucky()
        time.sleep(5)

    with pytest.raises(Expired), within(0.1):
        run()


@pytest.mark.parametrize(
    ("rule", "shown", "reason"),
    [
        ('sequence by user [any where kind == "x"] [any where kind == "y"]', '"at": "a"', "they agree if at of event"),
        (
            'sequence by user, at [any where kind == "x" and user : "*"] [any where kind == "y"]',
            '"time": "2026-01-01T00:00:00Z"',
            "they agree if user of event 1 is a text instead of",
        ),
    ],
)
def test_a_counterexample_has_ordinary_times_and_values_and_says_what_differs(
    rule: str, shown: str, reason: str, tmp_path: Path
) -> None:
    pytest.importorskip("eql", reason="the extra eql is not installed")
    tree = loads(
        "time time as iso8601; semantics scattered; event e(kind, user, at) = { kind: kind, user: user, at: at };"
        'top sand a b within 10 s; a on e("x", U, A); b on e("y", U, A);'
    )
    file = tmp_path / "rule.eql"
    file.write_text(f"// time time as iso8601\n{rule}\n", "utf-8")
    [_, found] = cross_check(tree, Semantics.SCATTERED, against=[str(file)])
    text = "\n".join(difference_lines(found))
    assert shown in text
    assert reason in text
    assert found.difference is not None
    assert all(event["time"].startswith("2026-01-01T00:00:0") for event in found.difference.trace)


@pytest.mark.parametrize("language", ["ltlf", "automaton", "rml", "mtl", "sql"])
def test_an_own_text_with_an_absent_event_is_read(language: str, tmp_path: Path) -> None:
    tree = tmp_path / "a.rvaft"
    tree.write_text(f'{READ} semantics scattered; top sand a b without read("c"); a on read(1); b on read(2);')
    text = tmp_path / f"a.{language}"
    assert run("emit", tree, "--to", language, "-o", text).exit_code == 0
    found = run("cross-check", tree, "--against", f"{language}:{text}", "--traces", "20")
    assert (found.exit_code, "no disagreement" in found.output) == (0, True), found.output
