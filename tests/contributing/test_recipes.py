"""Each recipe of CONTRIBUTING.md works where it should, is refused where it should be, and fails
where a step is left out.
"""

import json
from collections.abc import Callable
from pathlib import Path

import pytest

from rvaft import Semantics, all_backends
from rvaft.backend import backend
from rvaft.core.property import Condition
from tests.contributing.copies import Copy, Edit, Recipe, conformance
from tests.contributing.recipes import BACKEND, DEFINED, ESPER, GATE, OPERATOR, READER
from tests.tables import sampled

pytestmark = pytest.mark.ci
SAY = "event say(text) = { say: text }; "
LENGTH = f'{SAY}top sand a b; a on say("hello"); b on say(X) when length(X) == length("abc");'
AT = "event at(x: integer) = { x: x }; assume types, present; top sand a b; a on at(1); b on at(X) when "
INHIBIT = "top sand x d; x inhibit a b c; a; b; c; d;"

Made = Callable[..., Copy]


@pytest.fixture(name="made")
def made_(tmp_path: Path) -> Made:
    """Makes a copy of the project with a recipe carried out but for some steps."""

    def made(recipe: Recipe, *without: str) -> Copy:
        return Copy.made(tmp_path).follow(recipe, without=without)

    return made


def agrees(copy: Copy, tree: str, *backends: str) -> dict[tuple[str, str], str]:
    """The status of each participant under each semantics; the reference and the engine agree, and on something."""
    found = copy.rvaft(
        "cross-check", tree, "--backends", ",".join(backends), "--traces", "40", "--json", "results.json", "--jobs", "1"
    )
    assert found.returncode == 0, found.stdout + found.stderr
    results = json.loads((copy.path / "results.json").read_text("utf-8"))["results"]
    status = {(one["semantics"], one["participant"]): one["status"] for one in results}
    assert {status[semantics, "engine"] for semantics in Semantics} <= {"proved", "tested"}, found.stdout
    return status


def refused(copy: Copy, reason: str, tree: str, *names: str) -> None:
    """Backends refuse a tree with this reason under all their semantics."""
    found = copy.python(
        f"""
import rvaft
from rvaft.backend import backend
for name in {names!r}:
    for semantics in backend(name).semantics:
        try:
            print(name, rvaft.translate(rvaft.loads({tree!r}), name, semantics=semantics).text)
        except rvaft.NotExpressible as refusal:
            assert refusal.reason == {reason!r}, (name, refusal)
"""
    )
    assert (found.returncode, found.stdout) == (0, ""), found


@pytest.mark.slow
def test_an_operator_works_and_every_backend_refuses_it(made: Made) -> None:
    copy = made(OPERATOR)
    tree = copy.write("tree.rvaft", LENGTH)
    log = copy.write("log.jsonl", '{"say": "hello"}\n{"say": "no"}\n{"say": "yes"}\n{"say": 123}\n')
    checked, monitored = copy.rvaft("check", tree), copy.rvaft("monitor", tree, log)
    assert checked.returncode == 0, checked.stderr
    assert monitored.stdout.startswith("event 3: true"), monitored
    wrong = copy.write("wrong.rvaft", f'{SAY}top on say(X) when length(X) == "a";')
    assert "[contradictory-guards]" in copy.rvaft("check", wrong).stdout  # the table says that it gives a number
    faithful = [name for name in all_backends() if backend(name).faithful and backend(name).readable]
    status = agrees(copy, tree, *faithful)
    assert {found for (_, name), found in status.items() if name in faithful} == {"not expressible"}
    guarded = [name for name in all_backends() if Condition in backend(name).capabilities().constructs]
    refused(copy, "the backend writes no operator `length`", f"{SAY}top on say(X) when length(X);", *guarded)
    refused(copy, "guards (`when`) need `assume types;`", f"{SAY}top on say(X) when length(X);", "sigma")
    emitted = copy.rvaft("emit", tree, "--to", "eql", "--semantics", "scattered")
    assert emitted.stderr.endswith("the backend writes no operator `length` (at b)\n"), emitted
    report = copy.python(conformance("length", "automaton"))
    assert "8 times: the backend writes no operator `length`" in report.stdout, report


@pytest.mark.slow
def test_a_backend_that_lists_a_new_operator_is_held_to_it(made: Made) -> None:
    copy = made(OPERATOR)
    listed = "frozenset[Operator]] = EVERY_OPERATOR"
    copy.edit(Edit("backends/automaton/backend.py", listed, " | {Operator.LENGTH}"))
    report = copy.python(conformance("length", "automaton"))
    assert report.returncode == 0, report
    assert "no operator" not in report.stdout
    tree = copy.write("tree.rvaft", LENGTH)
    status = agrees(copy, tree, "automaton")
    assert {found for (_, name), found in status.items() if name == "automaton"} <= {"proved", "tested"}


@pytest.mark.slow
def test_every_language_writes_an_operator_that_others_define(made: Made) -> None:
    copy = made(DEFINED)
    faithful = [name for name in all_backends() if backend(name).faithful and backend(name).readable]
    tree = copy.write("tree.rvaft", f"{AT}between(X, 2, 5);")
    emitted = copy.rvaft("emit", tree, "--to", "eql", "--semantics", "scattered")
    assert "[any where x >= 2 and x <= 5]" in emitted.stdout, emitted
    status = agrees(copy, tree, *faithful)
    assert {name for (_, name), found in status.items() if found in ("proved", "tested")} >= {
        *("automaton", "c", "eql", "kql", "ltlf", "mtl", "rml", "sigma", "sql", "stix")
    }
    report = copy.python(conformance("between", "automaton", "c", "eql", "ltlf", "mtl", "rml", "sql", "stix"))
    assert report.returncode == 0, report
    empty = copy.write("empty.rvaft", f"{AT}between(X, 5, 2);")
    assert "[contradictory-guards]" in copy.rvaft("check", empty).stdout


@pytest.mark.parametrize(
    ("step", "program", "message"),
    sampled(
        [
            ("table", "import rvaft.api", "AssertionError: not in OPERATORS"),
            ("grammar", conformance("length", "automaton"), "length"),
            ("conformance", "import backends.conformance", "AssertionError: {<Operator.LENGTH"),
        ],
        2,
    ),
)
def test_a_step_of_the_operator_left_out(made: Made, step: str, program: str, message: str) -> None:
    found = made(OPERATOR, step).python(program)
    assert found.returncode == 1
    assert message in found.stderr, found.stderr


def test_an_operator_without_meaning_in_the_reference(made: Made) -> None:
    copy = made(OPERATOR, "reference")
    found = copy.rvaft("cross-check", copy.write("tree.rvaft", LENGTH), "--backends", "automaton", "--jobs", "1")
    assert found.returncode != 0
    assert "no disagreement" not in found.stdout, found.stdout


@pytest.mark.slow
def test_a_gate_works_in_every_language_that_has_its_parts(made: Made) -> None:
    copy = made(GATE)
    tree = copy.write("tree.rvaft", INHIBIT)
    log = copy.write("log.jsonl", "".join(f'{{"event": "{name}"}}\n' for name in "cabd"))
    checked, monitored = copy.rvaft("check", tree), copy.rvaft("monitor", tree, log)
    assert (checked.returncode, checked.stderr) == (0, "")
    assert monitored.stdout.startswith("event 4: true"), monitored
    drawing = copy.rvaft("show", tree, "--format", "svg")
    assert "INHIBIT" in drawing.stdout, drawing.stderr
    assert '"x" pand "c" "a" "b";' in copy.rvaft("show", tree, "--format", "galileo").stdout
    status = agrees(copy, tree, "automaton", "ltlf", "rml", "sql", "stix")
    assert {status["scattered", name] for name in ("automaton", "ltlf", "rml")} == {"proved"}
    assert status["strict", "stix"] == "not expressible"
    report = copy.python(conformance("inhibit", "automaton", "sql"))
    assert report.returncode == 0, report


def test_a_language_without_the_parts_of_a_gate_refuses_it(made: Made) -> None:
    copy = made(GATE)
    listed = "frozenset[type[Part]]] = GATES"
    copy.edit(Edit("backends/automaton/backend.py", listed, " - {Sequence}"))
    copy.edit(Edit("backends/automaton/backend.py", "from rvaft.core.property import ", "Sequence, "))
    refused(copy, "the backend writes no events in order (`sand`)", INHIBIT, "automaton")


@pytest.mark.parametrize(
    ("step", "program", "message"),
    sampled(
        [
            ("core", conformance("inhibit", "automaton"), "Expected code to be unreachable"),
            ("drawings", "import rvaft.export.layout", "AssertionError: every gate has"),
            ("grammar", conformance("inhibit", "automaton"), "inhibit"),
            ("reference", conformance("inhibit", "automaton"), "construct `inhibit`"),
            ("conformance", "import backends.conformance", "AssertionError: {<Gate.INHIBIT"),
        ],
        2,
    ),
)
def test_a_step_of_the_gate_left_out(made: Made, step: str, program: str, message: str) -> None:
    found = made(GATE, step).python(program)
    assert found.returncode == 1
    assert message in found.stderr, found.stderr


REFUSED = {
    "top and a b;": "no events in any order (`and`)",
    "top or a b;": "no choices (`or`)",
    "top 2of3 a b c;": "no votes (k-of-n)",
    "top pand a b;": "no parts that end in order (`pand`)",
    "top sand a b; a times 2;": "no counted events (`times`)",
    "time t as s; top sand a b within 5 s;": "no windows (`within`)",
    f"{SAY}top on say(X) when X != 1;": "no guards (`when`)",
    f"{SAY}top sand a b; a on say(X); b on say(X);": "no variables over several events: variable X",
    f"{SAY}top sand a b; a on say(1); b;": "no numbers",
    f"{SAY}top sand a b; a on say(null); b;": "no null",
}
"""What a writer of sequences refuses without a word of its own about it."""


@pytest.mark.slow
def test_a_backend_says_what_it_lists_and_refuses_the_rest(made: Made) -> None:
    assert ESPER.count("\n") <= 60
    copy = made(BACKEND)
    assert "esper" in copy.rvaft("backends").stdout
    tree = copy.write("tree.rvaft", f'{SAY}top sand a b c; a on say("x"); b; c on say(_);')
    found = copy.rvaft("emit", tree, "--to", "esper", "--semantics", "scattered")
    assert found.stdout.splitlines() == [
        'select * from pattern [every (Log(say = "x") -> Log(event = "b") -> Log(exists(say?)))]'
    ]
    found = copy.python(
        f"""
import rvaft
for tree, reason in {REFUSED!r}.items():
    try:
        print(rvaft.translate(rvaft.loads(tree), "esper", semantics="scattered").text)
    except rvaft.NotExpressible as refusal:
        assert refusal.reason.startswith(f"the backend writes {{reason}}"), refusal
    else:
        raise AssertionError(tree)
for semantics in ("strict", "projected", "consecutive"):
    try:
        rvaft.translate(rvaft.loads("top sand a b;"), "esper", semantics=semantics)
    except rvaft.NotExpressible:
        continue
    raise AssertionError(semantics)
"""
    )
    assert (found.returncode, found.stdout) == (0, ""), found
    report = copy.python(conformance("", "esper"))
    assert report.returncode == 0, report
    measured = copy.python(
        "import rvaft; print(rvaft.translate(rvaft.loads('top sand a b;'), 'esper', semantics='scattered').metrics)"
    )
    assert "subformulas=2" in measured.stdout


@pytest.mark.parametrize(
    ("wrong", "message"),
    [
        (("frozenset({Event, ", "All, "), "All is not in `says`"),
        (
            ("    default_limit: ClassVar[int] = 1_000\n", "    translate = None\n"),
            "must not override Backend.translate",
        ),
        (("    def write", "_nothing"), "with abstract method"),
        (("frozenset[Semantics]] = frozenset(", ") - frozenset("), "esper: 0 translations"),
    ],
)
def test_a_step_of_the_backend_left_out(made: Made, wrong: tuple[str, str], message: str) -> None:
    copy = made(BACKEND)
    copy.edit(Edit("backends/esper.py", *wrong))
    if "All, " in wrong:
        copy.edit(Edit("backends/esper.py", "from rvaft.core.property import ", "All, "))
    found = copy.python(conformance("", "esper"))
    assert found.returncode == 1
    assert message in found.stderr, found.stderr


def test_a_backend_that_is_not_registered(made: Made) -> None:
    copy = made(BACKEND, "registration")
    found = copy.rvaft("emit", copy.write("tree.rvaft", "top sand a b;"), "--to", "esper")
    assert found.returncode == 2
    assert "esper" in found.stderr


def test_a_reader(made: Made) -> None:
    copy = made(READER)
    tree = copy.write("tree.rvaft", f'{SAY}top sand a b; a on say("x y"); b;')
    log = copy.write("log.logfmt", 'say="x y" n=1\n\nevent=b n=2\n')
    found = copy.rvaft("monitor", tree, log)
    assert found.stdout.startswith("event 2 (line 3): true"), found
    named = copy.rvaft("monitor", tree, "-", "--input", "logfmt", stdin="say=x\nno field\n")
    assert named.returncode == 2
    assert "2: no line of logfmt: fields are written key=value" in named.stderr


@pytest.mark.parametrize("step", ["registration", "event"])
def test_a_step_of_the_reader_left_out(made: Made, step: str) -> None:
    copy = made(READER, *([step] if step in READER else []))
    if step == "event":
        copy.edit(Edit("rvaft/readers/logfmt.py", "    def ", "_"))
    log = copy.write("log.logfmt", "event=top\n")
    named = ["--input", "logfmt"] if step == "event" else []
    found = copy.rvaft("monitor", copy.write("tree.rvaft", "top; "), log, *named)
    assert found.returncode == 2
    assert ("log.logfmt:1" if step == "registration" else "LogfmtReader does not define event") in found.stderr, (
        found.stderr
    )
