"""The verified monitor against the reference, the engine, and wrong input."""

import json
import math
from itertools import islice
from pathlib import Path
from random import Random
from typing import Any

import pytest
from click.testing import CliRunner

from backends.conformance import examples
from cross_check.campaign import catalogue
from cross_check.generate.traces import random_trace
from cross_check.generate.trees import random_tree
from cross_check.judges import verified_of
from cross_check.participants import ENGINE, Absent, Outside, Participant, engine_of
from cross_check.results import Job, Status
from cross_check.traces import CATALOGUE, trials
from rvaft import RVAFT, NotExpressible, Semantics, Verdict, loads, monitor
from rvaft.cli import main
from rvaft.core.branches import restrict
from rvaft.engine.monitor import Engine
from rvaft.model.guards import UNDEFINED, Operation, Operator, value
from rvaft.model.nodes import Kind
from rvaft.model.patterns import Variable
from rvaft.semantics import Reference
from tests.faults.test_wrong_trees import compared
from tests.faults.wrong_trees import MISTAKES
from tests.proofs.verified import PROGRAM, built, lines, run
from tests.semantics.cases import CASES, Case
from tests.tables import sampled

pytestmark = built

UNSUPPORTED = ("strptime",)


def verified(
    tree: RVAFT, semantics: Semantics, *, branch: int | None = None, kind: Kind | None = None
) -> Outside | Absent:
    return verified_of(tree, semantics, PROGRAM, branch=branch, kind=kind, timeout=60)


def verdicts(
    tree: RVAFT, semantics: Semantics, traces: list[list[Any]], **part: Any
) -> list[tuple[Verdict, ...] | None] | None:
    """The verdicts on traces, or None where the program refuses the tree for a reason that its page gives."""
    match verified(tree, semantics, **part):
        case Absent(error):
            assert isinstance(error, NotExpressible), error
            assert any(reason in str(error) for reason in UNSUPPORTED), error
            return None
        case Outside(answers=answers):
            return [answer.verdicts for answer in answers(traces)]


@pytest.mark.parametrize("case", sampled(((case,) for case in CASES), 4))
def test_the_rows_of_the_definition(case: Case) -> None:
    kind = None if case.kind is None else Kind(case.kind)
    semantics = Semantics(case.semantics)
    found = verdicts(loads(case.tree), semantics, [case.events], branch=case.branch, kind=kind)
    assert found is None or found == [tuple(map(Verdict, case.values))]


@pytest.mark.parametrize(("number", "semantics"), sampled(((n, s) for n in range(12) for s in Semantics), 9))
def test_the_trees_of_the_conformance_suite_and_of_the_catalogue(number: int, semantics: Semantics) -> None:
    compared_events = detected = 0
    entries: list[tuple[RVAFT, int | None, Kind | None]] = [(one.tree, None, None) for one in examples()]
    entries += [(entry.tree, entry.branch, entry.kind) for entry in catalogue()]
    for tree, branch, kind in islice(entries, number, None, 12):
        first = Reference(tree, semantics, branch=branch, kind=kind)
        part, job = restrict(tree, branch=branch, kind=kind), Job("tree", semantics, branch, kind)
        known = engine_of(part, semantics)
        assert isinstance(known, Participant)
        traces = list(map(list, islice(trials(part, job, CATALOGUE, [known], words=True), 60)))
        found = verdicts(tree, semantics, traces, branch=branch, kind=kind)
        for trace, got in zip(traces, found or (), strict=found is not None):
            assert got == tuple(first.fork().run(trace)), trace
            compared_events += len(trace)
            detected += Verdict.TRUE in got
    assert compared_events > 500
    assert detected > 20


@pytest.mark.parametrize("seed", sampled(((seed,) for seed in range(4)), 4))
def test_the_cross_checker_counts_it_as_a_participant(seed: int) -> None:
    command = ["cross-check", "--random", "12", "--seed", str(seed), "--backends", "ltlf", "--traces", "30"]
    done = CliRunner().invoke(main, [*command, "--states", "0", "--jobs", "1", "--verified", str(PROGRAM)])
    assert done.exit_code == 0, done.output
    assert "verified" in done.output
    assert "no disagreement" in done.output


def test_without_the_program_it_is_missing() -> None:
    found = verified_of(loads("top and a b;"), Semantics.STRICT, Path("/nowhere"), branch=None, kind=None, timeout=1)
    assert isinstance(found, Absent)
    assert found.status is Status.TOOL_MISSING


def test_repetition_is_that_of_the_engine(tmp_path: Path) -> None:
    text = "time t as s late 2 s; top and x c within 4 s; x sand a b;"
    tree, random = loads(text), Random("repetition")
    seen = 0
    for semantics in Semantics:
        events = [{"event": random.choice("abcz"), "t": n + random.choice((0, 0, -3))} for n in range(200)]
        done = run(tmp_path, tree, "--semantics", semantics, "--repeat", given=lines(events))
        engine = monitor(tree, semantics=semantics, repeat=True)
        expected = [str(engine.step(event).value) for event in events]
        assert [json.loads(line)["verdict"] for line in done.stdout.splitlines()] == expected
        seen += expected.count("true")
    assert seen > 20


@pytest.mark.parametrize("mistake", sampled(((mistake,) for mistake in sorted(MISTAKES)), 4))
def test_it_sees_the_planted_faults_that_the_reference_sees(mistake: str) -> None:
    """On the trace with which the reference finds the fault, it gives the verdicts of the reference."""
    for entry in catalogue():
        right = restrict(entry.tree, branch=entry.branch, kind=entry.kind)
        wrong = MISTAKES[mistake](right)
        for semantics in Semantics if wrong != right else ():
            result = compared(entry, semantics, ENGINE, wrong)
            if result.status is not Status.DIFFERS:
                continue
            assert result.difference is not None
            trace = list(result.difference.trace)
            found = verdicts(entry.tree, semantics, [trace], branch=entry.branch, kind=entry.kind)
            if found is None:
                continue
            assert found == [tuple(Reference(entry.tree, semantics, branch=entry.branch, kind=entry.kind).run(trace))]
            assert found != [tuple(Engine(wrong, semantics).run(trace))]
            return
    pytest.fail("no verdict differs")


@pytest.mark.parametrize(
    ("log", "message"),
    [
        ('{"event": "a"', "column 14"),
        ("[1]", "an event is a JSON object"),
        ('{"event": "\\x"}', "unknown escape"),
        ('{"event": 01}', "column"),
        ('{"event": "a"} x', "text follows the value"),
        ("{" * 600, "column"),
        ("[" * 600, "nested too deeply"),
    ],
)
def test_a_log_that_is_no_json_is_an_error(tmp_path: Path, log: str, message: str) -> None:
    done = run(tmp_path, loads("top and a b;"), given=f'{{"event": "b"}}\n{log}\n')
    assert done.returncode == 2
    assert "<stdin>:2:" in done.stderr
    assert message in done.stderr
    assert done.stdout == '{"event": 1, "verdict": "unknown"}\n'


@pytest.mark.parametrize(
    ("changed", "message"),
    [
        ({"version": 2}, "not a tree in JSON"),
        ({"root": "nobody"}, "unknown node nobody"),
        ({"causality": "sideways"}, "unknown causality sideways"),
        ({"time": {"field": ["t"], "format": "days", "late": None}}, "the time format days is not supported"),
        ({"nodes": 1}, "a list was expected"),
    ],
)
def test_a_tree_that_it_does_not_know_is_refused(tmp_path: Path, changed: dict[str, Any], message: str) -> None:
    done = run(tmp_path, loads("top and a b;"), changed=changed)
    assert done.returncode == 2
    assert message in done.stderr


def test_options_that_are_wrong(tmp_path: Path) -> None:
    tree = loads("top and a b;")
    for options, message in (
        (["--semantics", "loose"], "unknown semantics loose"),
        (["--kind"], "unknown or incomplete option --kind"),
        (["--choose", "top=nobody"], "no node nobody below the root"),
        ([str(tmp_path / "nothing.jsonl")], "nothing.jsonl: No such file"),
    ):
        done = run(tmp_path, tree, *options)
        assert done.returncode == 2
        assert message in done.stderr


def test_values_that_json_does_not_have(tmp_path: Path) -> None:
    """Clause: NaN and infinities are undefined, and match a parameter that stands once."""
    tree = loads("event e(n, v) = { n: n, v: v }; top and a b; a on e(1, X); b on e(2, Y) when Y != 3;")
    for one, expected in ((math.nan, "??"), (math.inf, "??"), (4, "?T"), (1e308 * 10, "??"), ([math.nan], "??")):
        given = json.dumps([{"n": 1, "v": math.nan}, {"n": 2, "v": one}])
        done = run(tmp_path, tree, "--traces", "--semantics", "scattered", given=f"{given}\n")
        assert done.stdout == f"{expected}\n", one


NUMBERS = (0.1, -2.5, 3, 2**53 + 1, -(10**30), 1e22, 5e-324, 1.7976931348623157e308, 7.0, 1 / 3, 0, -0.0, 123456.789)


@pytest.mark.parametrize("sign", ["+", "-", "*", "/", "<", "<=", "==", "min", "max"])
def test_arithmetic_is_that_of_the_definition(tmp_path: Path, sign: str) -> None:
    """Doubles by Coq's floating-point numbers: results as Python has them, written back as guards."""
    guard = Operation(Operator(sign), (Variable("X"), Variable("Y")))
    tree = loads(
        f"event e(x, y, z) = {{ x: x, y: y, z: z }}; top and a; a on e(X, Y, Z) when "
        f"{f'{sign}(X, Y)' if sign.isalpha() else f'(X {sign} Y)'} == Z;"
    )
    events, expected = [], ""
    for left in NUMBERS:
        for right in NUMBERS:
            result = value(guard, {"X": left, "Y": right})
            for other in (result, 1, True):
                events.append({"x": left, "y": right, "z": None if other is UNDEFINED else other})
                same = (
                    result is not UNDEFINED
                    and type(other) is not type(UNDEFINED)
                    and (isinstance(result, bool) == isinstance(other, bool) and result == other)
                )
                expected += "T" if same else "?"
    given = "".join(f"[{json.dumps(event)}]\n" for event in events)
    done = run(tmp_path, tree, "--traces", "--semantics", "scattered", given=given)
    assert done.stdout.replace("\n", "") == expected
    assert expected.count("T") > 100


@pytest.mark.slow
@pytest.mark.parametrize("seed", range(20))
def test_random_trees(seed: int) -> None:

    count = 0
    for number in range(50):
        random = Random(f"{seed} {number}")
        tree = random_tree(random)
        for semantics in Semantics:
            traces = [random_trace(random, tree, max_length=10) for _ in range(20)]
            first = Reference(tree, semantics)
            found = verdicts(tree, semantics, traces)
            for trace, got in zip(traces, found or (), strict=found is not None):
                assert got == tuple(first.fork().run(trace)), (seed, number, semantics)
                count += 1
    assert count > 2_000
