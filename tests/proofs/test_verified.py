"""The verified monitor against the reference, the engine, and wrong input."""

import json
import math
import os
import subprocess
from collections.abc import Callable, Sequence
from dataclasses import replace
from itertools import islice
from pathlib import Path
from random import Random
from typing import Any

import pytest
from click.testing import CliRunner

from backends.conformance import examples
from cross_check.campaign import catalogue
from cross_check.generate.traces import random_trace
from cross_check.generate.trees import Shape, random_tree
from cross_check.judges import verified_of
from cross_check.participants import ENGINE, Absent, Outside, Participant, engine_of
from cross_check.results import Job, Status
from cross_check.traces import CATALOGUE, trials
from rvaft import RVAFT, NotExpressible, Semantics, Verdict, loads, monitor
from rvaft.cli import main
from rvaft.core.restriction import restrict
from rvaft.engine.monitor import Engine
from rvaft.export.tree_json import json_text
from rvaft.model.guards import UNDEFINED, Operation, Operator, value
from rvaft.model.nodes import Kind, Node, Side, Without
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


@pytest.mark.ci
@pytest.mark.parametrize(("number", "semantics"), sampled(((n, s) for n in range(12) for s in Semantics), 23, ci=7))
def test_the_trees_of_the_conformance_suite_and_of_the_catalogue(number: int, semantics: Semantics) -> None:
    compared_events = detected = 0
    entries: list[tuple[RVAFT, int | None, Kind | None]] = [(one.tree, None, None) for one in examples()]
    entries += [(entry.tree, entry.branch, entry.kind) for entry in catalogue()]
    for tree, branch, kind in islice(entries, number, None, 12):
        first = Reference(tree, semantics, branch=branch, kind=kind)
        part, job = restrict(tree, branch=branch, kind=kind), Job("tree", semantics, branch, kind)
        known = engine_of(part, semantics)
        assert isinstance(known, Participant)
        traces = list(map(list, islice(trials(part, job, CATALOGUE, [known], words=True), 30)))
        found = verdicts(tree, semantics, traces, branch=branch, kind=kind)
        for trace, got in zip(traces, found or (), strict=found is not None):
            assert got == tuple(first.fork().run(trace)), trace
            compared_events += len(trace)
            detected += Verdict.TRUE in got
    assert compared_events > 500
    assert detected > 20


@pytest.mark.ci
@pytest.mark.parametrize("seed", sampled(range(4), 4))
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


@pytest.mark.parametrize(
    "text",
    [
        "time t as s late 2 s; top and x c within 4 s; x sand a b;",
        'time t as s late 2 s; event e(n) = { event: n }; top sand a b without e("z") for 3 s before;',
        'time t as s; event e(n) = { event: n }; g or a c without e("z") for 1 s after without e("b") for 2 s before;',
    ],
)
def test_repetition_is_that_of_the_engine(tmp_path: Path, text: str) -> None:
    """Clause: after a repetition, events before the last detection can still break a `without`."""
    tree, random = loads(text), Random("repetition")
    seen = 0
    for semantics in Semantics:
        events = [{"event": random.choice("abcz"), "t": n + random.choice((0, 0, -3))} for n in range(200)]
        done = run(tmp_path, tree, "--semantics", semantics, "--repeat", given=lines(events))
        engine = monitor(tree, semantics=semantics, repeat=True)
        expected = [str(engine.step(event).value) for event in events]
        assert [json.loads(line)["verdict"] for line in done.stdout.splitlines()] == expected
        seen += expected.count("true")
    assert seen > 10


def test_the_end_of_the_trace_decides(tmp_path: Path) -> None:
    """Clause: after the end of the trace every `for D after` of a match is decided."""
    random, decided = Random("end"), 0
    while decided < 20:
        tree = random_tree(random, ABSENT)
        if not any(clause.side is Side.AFTER for node in tree.nodes.values() for clause in node.without):
            continue
        for semantics in Semantics:
            traces = [random_trace(random, tree, max_length=8) for _ in range(20)]
            options = ("--traces", "--complete", "--semantics", semantics)
            done = run(tmp_path, tree, *options, given=lines(traces))
            if "strptime" in done.stderr:
                continue
            assert not done.stderr
            expected = []
            for trace in traces:
                reference = Reference(tree, semantics)
                list(reference.run(trace))
                before = reference.verdict
                expected.append(reference.finish())
                decided += before is not expected[-1]
            signs = {Verdict.TRUE: "T", Verdict.FALSE: "F", Verdict.UNKNOWN: "?"}
            assert [line[-1] for line in done.stdout.splitlines()] == [signs[verdict] for verdict in expected]


def test_a_complete_log_has_a_line_for_its_end(tmp_path: Path) -> None:
    text = "time t as s; event beat(r) = { beat: r }; lost on beat(R) without beat(R) for 2 s after;"
    tree, given = loads(text), lines([{"beat": 1, "t": 0}, {"beat": 1, "t": 1}])
    for options in ([], ["--repeat"]):
        done = run(tmp_path, tree, "--semantics", "scattered", "--complete", *options, given=given)
        *_, second, last = map(json.loads, done.stdout.splitlines())
        assert second == {"event": 2, "verdict": "unknown"}
        assert last == {"event": 2, "verdict": "true", "passed": "end of the log"}
        assert done.returncode == 1


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
        ('{"event": "a", "n": {"é": 1, "n": 2, "\\u00e9": 3}}', 'column 39: the key "\\u00e9" is repeated'),
        ('{"event": "\\ud800"}', "column 12: a lone surrogate"),
        ('{"event": "\\ud800\\ud800\\udc00"}', "column 12: a lone surrogate"),
        ('{"event": "\\udc00x"}', "column 12: a lone surrogate"),
        (f'{{"n": -{"1" * 4301}}}', "column 7: a number of more than 4300 digits"),
    ],
)
def test_a_log_that_is_no_json_is_an_error(tmp_path: Path, log: str, message: str) -> None:
    done = run(tmp_path, loads("top and a b;"), given=f'{{"event": "b"}}\n{log}\n')
    assert done.returncode == 2
    assert "<stdin>:2:" in done.stderr
    assert message in done.stderr
    assert done.stdout == '{"event": 1, "verdict": "unknown"}\n'


def _node(**fields: Any) -> dict[str, Any]:
    """The nodes of `top and a b;` with fields of b changed."""
    *others, b = json.loads(json_text(loads("top and a b;")))["nodes"]
    return {"nodes": [*others, b | fields]}


def _absent(**fields: Any) -> dict[str, Any]:
    """The nodes of `top and a b;` with an absent event at b, and fields of that changed."""
    own = {"on": {"event": "e", "arguments": []}, "side": "during", "duration": None, "condition": None}
    return _typed({"any": True}) | _node(without=[own | fields])


def _typed(pattern: Any, arguments: Sequence[Any] = ()) -> dict[str, Any]:
    event = {"name": "e", "parameters": [], "pattern": pattern}
    return {"events": [event], **_node(on={"event": "e", "arguments": arguments})}


@pytest.mark.parametrize(
    ("changed", "message"),
    [
        ({"version": 3}, "not a tree in JSON"),
        (_absent(duration=1), "node b: without: `during` with a duration is not supported"),
        (_absent(side="after"), "node b: without: `after` without a duration is not supported"),
        (_absent(side="inside"), "node b: without: `inside` without a duration is not supported"),
        (_absent(condition={"variable": "X"}), "tree.json: the tree is not well formed"),
        (_node(distinct=["X"]), "node b: distinct: X does not stand in `on`"),
        (_node(gate="and", children=["a"], each=["X"]), "node b: each: only a leaf has values for each event"),
        ({"root": "nobody"}, "unknown node nobody"),
        ({"causality": "sideways"}, "unknown causality sideways"),
        ({"time": {"field": ["t"], "format": "days", "late": None}}, "the time format days is not supported"),
        ({"nodes": 1}, "nodes: a list was expected"),
        ({"causality": 1}, "causality: a text was expected"),
        (_node(times=0), "node b: times: 0 is less than 1"),
        (_node(times="2"), "node b: times: an integer was expected"),
        (_node(gate="xor"), "node b: the gate xor is not supported"),
        (_node(gate="and"), "node b: children: a leaf has none, a gate has some"),
        (_node(gate="and", children=["top"]), "node b: children: there is a cycle"),
        (_node(gate="and", children=["c"]), "node b: children: unknown node c"),
        (_node(gate="and", children=["a", "a"]), "node b: children: a child stands twice"),
        (_node(gate="and", children=["a"], times=2), "node b: times: only a leaf"),
        (_node(gate="vot", children=["a"], threshold=2), "node b: threshold: 2 of 1 children"),
        (_node(name="a"), "two nodes are named a"),
        (_node(on={"event": "e", "arguments": []}), "node b: on: unknown event type e"),
        (_node(condition={"literal": False}), "tree.json: no feasible scenario"),
        (_typed({"variable": "X"}), "node b: on: event e: pattern: the pattern names X"),
        (_typed({"any": None}, arguments=[{"any": None}]), "node b: on: event e: 1 arguments for 0 parameters"),
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
        (["--choose", "top=a"], "--choose takes a JSON object"),
        (["--choose", '{"top": ["a"]}'], "--choose takes a JSON object"),
        (["--choose", '{"top": "a", "top": "b"}'], 'the key "top" is repeated'),
        (["--choose", "{}", "--choose", "{}"], "--choose is given twice"),
        (["--choose", '{"nobody": "a"}'], "no node nobody in the tree"),
        (["--choose", '{"top": "a"}'], "the node top is no `or`"),
        (["--choose", '{"a": "b"}'], "the node a is no `or`"),
        (["--kind", "fault"], "no branch has the kind fault"),
        (["--kind", "other"], "unknown kind other"),
        (["--complete", "--certify", "text.json"], "--complete and --certify exclude each other"),
        (["--repeat", "--certify", "text.json"], "--repeat and --certify exclude each other"),
        (["--traces", "--certify", "text.json"], "--traces and --certify exclude each other"),
        (["log.jsonl", "--certify", "text.json"], "with --certify no log is read"),
        (["--limit", "9"], "--limit bounds the comparison of --certify"),
        ([str(tmp_path)], "a folder, not a file"),
        ([str(tmp_path / "nothing.jsonl")], "nothing.jsonl: No such file"),
    ):
        done = run(tmp_path, tree, *options)
        assert done.returncode == 2
        assert message in done.stderr


def test_choices(tmp_path: Path) -> None:
    """Names may have any characters; what selects no scenario is an error."""
    tree, events = loads('top or x b; x or "c=d" "e é";'), lines([{"event": "b"}, {"event": "c=d"}, {"event": "e é"}])
    expected: list[tuple[dict[str, str], str]] = [
        ({"top": "b"}, "ttt"),
        ({"top": "x", "x": "c=d"}, "utt"),
        ({"x": "e é", "top": "x"}, "uut"),
        ({"top": "x"}, "no feasible scenario"),
        ({}, "no feasible scenario"),
        ({"top": "c=d"}, "the node top has no child c=d; its children are x, b"),
        ({"x": "top"}, "the node x has no child top"),
    ]
    for choices, wanted in expected:
        done = run(tmp_path, tree, "--semantics", "scattered", "--choose", json.dumps(choices), given=events)
        found = "".join(json.loads(line)["verdict"][0] for line in done.stdout.splitlines())
        if set(wanted) <= {*"tu"}:
            assert (found, done.returncode) == (wanted, 1)
        else:
            assert (found, done.returncode) == ("", 2)
            assert wanted in done.stderr


def test_a_file_that_is_no_tree(tmp_path: Path) -> None:
    (file := tmp_path / "tree.rvaft").write_text("top and a b;", encoding="utf-8")
    piped = json_text(loads("top and a b;"))
    for name, given, message in (
        (str(file), "", f"{file}: byte 1: not JSON; write one by: rvaft show TREE --format json -o TREE.json"),
        (str(tmp_path), "", f"{tmp_path}: a folder, not a file"),
        ("/dev/stdin", piped[:-9], "/dev/stdin: byte"),
        ("/dev/stdin", piped, ""),
    ):
        done = subprocess.run(
            [PROGRAM, name, os.devnull], input=given, capture_output=True, encoding="utf-8", timeout=60, check=False
        )
        assert message in done.stderr
        assert done.returncode == (2 if message else 0)


def test_traces_of_python_values(tmp_path: Path) -> None:
    """Lone surrogates of Python strings are read with --traces; what is no event is refused with its place."""
    tree = loads("event e(n) = { n: n }; top and a b; a on e(X); b on e(Y) when X != Y;")
    given = lines([[{"n": "\ud800"}, {"n": "\udc00"}], [{"n": "\ud800"}, {"n": "\ud800"}], [{"n": 1}, 2]])
    done = run(tmp_path, tree, "--traces", "--semantics", "scattered", given=given)
    assert done.stdout == "?T\n??\n"
    assert "<stdin>:3: event 2: an event is a JSON object" in done.stderr
    assert done.returncode == 2


def test_numbers_with_many_zeros(tmp_path: Path) -> None:
    """Zeros before the first digit do not count against the size of a number."""
    tree = loads("event e(n) = { n: n }; top and a; a on e(X) when number(X) == 0.1 or number(X) == 0;")
    zeros = "0" * 500
    small, large = (f"0.{zeros}1e{exponent}" for exponent in (500, 900))
    rows = [(small, "T"), (f"1{zeros}e-501", "T"), (large, "?"), (f"0.{zeros}1", "T"), ("1e-401", "T")]
    numbers = [row for row, _ in rows] + [f'"{row}"' for row, _ in rows]
    given = "".join(f'[{{"n": {number}}}]\n' for number in numbers)
    done = run(tmp_path, tree, "--traces", "--semantics", "scattered", given=given)
    assert done.stdout.split() == [sign for _, sign in rows] * 2


def test_times_of_ros_are_integers_of_any_size(tmp_path: Path) -> None:
    """Clause: `ros` has two integers; only a number of units has a bound."""
    tree = loads("time t as ros; top and a b within 2 s;")
    rows = []
    for one, other in (
        ((10**31, 0), (10**31 + 2, 0)),
        ((10**31, 0), (10**31 + 2, 1)),
        ((0, 10**40), (-1, 10**40)),
        ((1, -(10**31)), (1.0, -(10**31))),
    ):
        rows.append([{"event": n, "t": {"sec": s, "nanosec": ns}} for n, (s, ns) in (("a", one), ("b", other))])
    done = run(tmp_path, tree, "--traces", "--semantics", "scattered", given=lines(rows))
    whole = Reference(tree, Semantics.SCATTERED)
    expected = ["".join("T" if v is Verdict.TRUE else "?" for v in whole.fork().run(row)) for row in rows]
    assert done.stdout.split() == expected == ["?T", "??", "?T", "??"]


def test_values_that_json_does_not_have(tmp_path: Path) -> None:
    """Clause: NaN and infinities are undefined, and match a parameter that stands once."""
    tree = loads("event e(n, v) = { n: n, v: v }; top and a b; a on e(1, X); b on e(2, Y) when Y != 3;")
    for one, expected in ((math.nan, "??"), (math.inf, "??"), (4, "?T"), (1e308 * 10, "??"), ([math.nan], "??")):
        given = json.dumps([{"n": 1, "v": math.nan}, {"n": 2, "v": one}])
        done = run(tmp_path, tree, "--traces", "--semantics", "scattered", given=f"{given}\n")
        assert done.stdout == f"{expected}\n", one


NUMBERS = (0.1, -2.5, 3, 2**53 + 1, -(10**30), 1e22, 5e-324, 1.7976931348623157e308, 7.0, 1 / 3, 0, -0.0, 123456.789)


@pytest.mark.parametrize("sign", sampled(["+", "-", "*", "/", "<", "<=", "==", "min", "max"], 4))
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


def _clauses(change: Callable[[Without], Without]) -> Callable[[Node], Node]:
    return lambda node: replace(node, without=tuple(map(change, node.without)))


def _elsewhere(one: Side, other: Side) -> Callable[[Node], Node]:
    return _clauses(lambda clause: replace(clause, side=other) if clause.side is one else clause)


COUNTED = Shape(max_nodes=6, variables=1, typed_events=0.9, counted=0.7, absences=0)
ABSENT = Shape(max_nodes=5, absences=1, times=0.6)
FAULTS: dict[str, tuple[Shape, Callable[[Node], Node]]] = {
    "all values are those of the tree": (COUNTED, lambda node: replace(node, distinct=(), each=())),
    "distinct as each": (COUNTED, lambda node: replace(node, distinct=(), each=node.own_values)),
    "each as distinct": (COUNTED, lambda node: replace(node, distinct=node.own_values, each=())),
    "no absent events": (ABSENT, lambda node: replace(node, without=())),
    "absent events without guards": (ABSENT, _clauses(lambda clause: replace(clause, when=None))),
    "during as before": (ABSENT, _elsewhere(Side.DURING, Side.BEFORE)),
    "after as before": (ABSENT, _elsewhere(Side.AFTER, Side.BEFORE)),
    "before as after": (
        ABSENT,
        _clauses(lambda one: replace(one, side=Side.AFTER) if one.side is Side.BEFORE and one.duration else one),
    ),
    "a longer duration": (
        ABSENT,
        _clauses(lambda one: one if one.duration is None else replace(one, duration=one.duration + 10**9)),
    ),
}
"""Planted faults: the shape of random trees, and what the fault makes of a node."""


@pytest.mark.ci
@pytest.mark.parametrize("mistake", sampled(((mistake,) for mistake in FAULTS), 4))
def test_random_trees_and_planted_faults(mistake: str) -> None:
    """It has the verdicts of the reference for a tree, and others for the tree with the fault."""
    shape, fault = FAULTS[mistake]
    random, trees, differing = Random(mistake), 0, 0
    while trees < 8:
        tree = random_tree(random, shape)
        wrong = tree.changed(nodes=map(fault, tree.nodes.values()))
        if wrong == tree:
            continue
        for semantics in random.sample([*Semantics], 2):
            traces = [random_trace(random, tree, max_length=8) for _ in range(40)]
            right = verdicts(tree, semantics, traces)
            if right is not None:
                first = Reference(tree, semantics)
                assert right == [tuple(first.fork().run(trace)) for trace in traces]
                trees += 1
                differing += verdicts(wrong, semantics, traces) != right
    assert differing > 0


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
