"""`rvaft cross-check`."""

import csv
import importlib
import json
import os
import re
import shutil
import signal
import time
from importlib.util import find_spec
from itertools import islice
from pathlib import Path
from typing import Any
from xml.etree import ElementTree as ET

import pytest
from click.testing import Result

from backends.c import library
from backends.c.library import compile_c
from cross_check.campaign import catalogue
from rvaft import load, translate
from rvaft.support.confinement import can_confine
from tests.backends.texts import needs_compiler
from tests.cli.runs import PRUNED, children, run, soon, started, written
from tests.tables import rows, sampled

HAS_SPOT = find_spec("spot") is not None
SAND = "toplevel r; r sand a b; a; b;"
AND = "toplevel r; r and a b; a; b;"
RML = ("--backends", "rml")
"""Who also takes part where it is about somebody else."""
needs_spot = [pytest.mark.spot, pytest.mark.skipif(not HAS_SPOT, reason="needs Spot")]


@pytest.fixture
def sand(tmp_path: Path) -> Path:
    return written(tmp_path / "sand.rvaft", SAND)


def compared(folder: Path, *args: object) -> tuple[Result, list[dict[str, Any]]]:
    """A run, and its results as the report in JSON has them."""
    result = run("cross-check", *args, "--json", folder / "out.json")
    return result, json.loads((folder / "out.json").read_text())["results"]


@pytest.mark.ci
@pytest.mark.spot
@pytest.mark.skipif(not HAS_SPOT, reason="needs Spot")
def test_what_is_proved(sand: Path, tmp_path: Path) -> None:
    result, found = compared(tmp_path, sand)
    assert result.exit_code == 0, result.output
    assert "no disagreement" in result.stdout
    assert "ON TREES WITH" not in result.stdout
    assert "ON TREES WITH" in run("cross-check", "--random", 12, "--traces", 1, "--backends", "rml").stdout
    names = ("reference", "engine", "rml", "ltlf", "automaton")
    proving = [one for one in found if one["participant"] in names]  # the others tell detections alone
    assert {(one["participant"], one["semantics"]): one["status"] for one in proving} == {
        (name, semantics): "baseline" if name == "reference" else "proved"
        for name in names
        for semantics in ("strict", "projected", "consecutive", "scattered")
    }


@needs_compiler
@pytest.mark.parametrize("at_once", [True, False])
def test_how_many_texts_in_c_a_run_without_arguments_compiles(
    at_once: bool, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """All, if that takes milliseconds; otherwise that of one comparison in 13, and a line says so."""
    compiled = list[str]()

    def compiling(text: str, *given: Any, **options: Any) -> None:
        compiled.append(text)
        compile_c(text, *given, **options)

    module = importlib.import_module("cross_check.commands.cross_check")
    monkeypatch.setattr(module, "catalogue", lambda: islice(catalogue(), 10))
    monkeypatch.setattr(module, "faithful_backends", lambda: ("c", "rml"))
    monkeypatch.setattr(module, "compiles_at_once", lambda: at_once)
    monkeypatch.setattr(library, "compile_c", compiling)
    library._library.cache_clear()
    result, found = compared(tmp_path, "--jobs", "1")
    assert result.exit_code == 0, result.output
    semantics = [one["semantics"] for one in found if one["participant"] == "reference"]
    assert semantics == ["projected", "consecutive", "scattered", "strict"] * 2 + ["projected", "consecutive"]
    assert [one["participant"] for one in found].count("c") == (10 if at_once else 1)
    assert 0 < len(compiled) <= (10 if at_once else 1)
    assert ("c takes part in one of 13 comparisons" in result.stderr) is not at_once
    _, found = compared(tmp_path, "--jobs", "1", "--semantics", "strict,scattered", "--backends", "c")
    assert [one["participant"] for one in found].count("c") == 20


def test_what_is_only_tested_and_what_is_refused(tmp_path: Path) -> None:
    result, found = compared(tmp_path, PRUNED, "--semantics", "projected,scattered", "--backends", "rml")
    assert result.exit_code == 0, result.output
    statuses = {(one["participant"], one["semantics"]): one["result"] for one in found}
    assert re.fullmatch(r"tested: \d+ traces up to length \d+ \(variables .*\)", statuses["engine", "projected"])
    assert statuses["rml", "scattered"].startswith("not expressible: ")
    assert "proved" not in set(statuses.values())
    options = ("--semantics", "scattered", "--backends", "rml", "--traces", "2", "--fail-on-not-expressible")
    assert run("cross-check", PRUNED, *options).exit_code == 2


def test_traces_without_a_detection_are_vacuous_and_no_agreement(sand: Path, tmp_path: Path) -> None:
    junit = tmp_path / "out.xml"
    short = ("--semantics", "strict,scattered", *RML, "--length", 1)  # too short for a detection
    result, found = compared(tmp_path, sand, *short, "--states", 0, "--junit", junit)
    assert result.exit_code == 2
    assert "0 verdicts, 0 proofs, " in result.stdout
    assert "4 vacuous results; nothing was detected, so nothing was compared" in result.stdout
    assert {one["status"] for one in found} == {"baseline", "vacuous"}
    assert {one["verdicts"] > 0 for one in found} == {True}
    assert json.loads((tmp_path / "out.json").read_text())["totals"]["vacuous"] == 4
    skipped = [str(one.get("message")) for one in ET.parse(junit).iter("skipped")]
    assert [message.partition(" in ")[0] for message in skipped] == ["vacuous: nothing was detected"] * 4
    assert "no disagreement" in run("cross-check", sand, *short).stdout  # all is proved


@pytest.mark.ci
def test_random_trees_may_be_vacuous_unless_it_is_refused() -> None:
    drawn = ("cross-check", "--random", 8, "--max-nodes", 4, *RML)
    result = run(*drawn)
    assert (result.exit_code, "vacuous results; no disagreement" in result.stdout) == (0, True)
    assert re.search(r"engine +\d+ +vacuous: nothing was detected in any trace", result.stdout)
    assert run(*drawn, "--fail-on-vacuous").exit_code == 2


def test_a_shared_variable_that_a_guard_refuses_proves_nothing(tmp_path: Path) -> None:
    """Values that no guard admits are forgotten at once; that is no proof for those that it admits."""
    declared = "event seen(what) = { event: what }; event read(value) = { value: value };"
    guards = ("r sand a b; a on seen(V); b on read(V) when V >= 0 and V <= 1;", "r sand a b when V + 1 > 1;")
    for text in (guards[0], f"{guards[1]} a on seen(V); b on read(V);"):
        tree = written(tmp_path / "tree.rvaft", f"{declared} toplevel r; {text}")
        _, found = compared(tmp_path, tree, "--semantics", "consecutive,scattered", *RML, "--traces", 20)
        assert {one["status"] for one in found if one["participant"] == "engine"} == {"tested"}


@pytest.mark.parametrize("suffix", sampled([".rml", ".ltlf", ".hoa", ".rvaft"], 4))
def test_another_specification_of_the_same_tree_is_proved_equal(sand: Path, tmp_path: Path, suffix: str) -> None:
    name = {".rml": "rml", ".ltlf": "ltlf", ".hoa": "automaton", ".rvaft": None}[suffix]
    if name in ("ltlf", "automaton") and not HAS_SPOT:
        pytest.skip("needs Spot")
    text = SAND if name is None else translate(load(sand), name).text
    one, two = (written(tmp_path / f"{number}{suffix}", text) for number in ("one", "two"))
    result = run("cross-check", sand, *RML, "--against", one, two)  # what follows is sorted by its name
    assert result.exit_code == 0, result.output
    assert re.search(rf"one{suffix}\s.*\bproved", result.stdout)
    assert f"two{suffix}" in result.stdout
    if name == "rml":
        assert (
            run("cross-check", sand, *RML, "--against", f"rml:{written(tmp_path / 'named.txt', text)}").exit_code == 0
        )


LATE = "late matches {'late':true}; ok not matches {'late':true};"


@pytest.mark.parametrize(
    ("main", "trace", "got"),
    [
        # both operands of the conjunction read every event, so the first `a` leaves nothing of the second one
        ("(a all) /\\ (b all)", [{"event": "a"}], "false"),
        # the letters are those of the file too: here only an event with both fields tells it from the tree
        ("(a /\\ ok) b all", [{"late": True, "event": "a"}], "false"),
    ],
)
def test_a_text_that_means_something_else_gives_a_shortest_trace(
    main: str, trace: list[dict[str, Any]], got: str, sand: Path, tmp_path: Path
) -> None:
    text = f"a matches {{'event':'a'}}; b matches {{'event':'b'}}; {LATE if 'ok' in main else ''}\nMain = {main};\n"
    wrong = written(tmp_path / "wrong.rml", text)
    result, found = compared(tmp_path, sand, *RML, "--against", wrong, "--semantics", "strict")
    assert result.exit_code == 1
    assert f"{wrong} differs from reference" in result.stdout
    (difference,) = [one["difference"] for one in found if one["status"] == "differs"]
    assert difference == {"trace": trace, "baseline": "reference", "expected": ["unknown"], "got": [got]}


def test_another_tree(sand: Path, tmp_path: Path) -> None:
    other = written(tmp_path / "and.rvaft", AND)
    result = run("cross-check", sand, *RML, "--against", other, "--semantics", "all")
    assert result.exit_code == 1
    assert result.stdout.count("differs from reference") == 4
    (tmp_path / "sub").mkdir()
    written(tmp_path / "sub" / "part.rvaft", "b;")  # it is read with what it imports
    main = written(tmp_path / "sub" / "main.rvaft", 'import "part.rvaft"; toplevel r; r sand a b; a;')
    assert run("cross-check", sand, *RML, "--against", main).exit_code == 0


@pytest.mark.parametrize(
    "name", ["x.rml", pytest.param("x.hoa", marks=needs_spot), pytest.param("x.ltlf", marks=needs_spot)]
)
def test_a_text_that_cannot_be_compared_does_not_stop_the_others(sand: Path, tmp_path: Path, name: str) -> None:
    hoa = (
        'HOA: v1\nStates: 1\nStart: 0\nAP: 1 "elsewhere"\nacc-name: Buchi\nAcceptance: 1 '
        "Inf(0)\n--BODY--\nState: 0 {0}\n[0] 0\n--END--\n"
    )
    odd = written(tmp_path / name, {"x.hoa": hoa, "x.ltlf": "F elsewhere", "x.rml": "Main = ;"}[name])
    good = written(tmp_path / "good.rml", translate(load(sand), "rml").text)
    other = written(tmp_path / "and.rvaft", AND)
    texts = [word for file in (tmp_path / "absent.rml", odd, good, other) for word in ("--against", file)]
    result = run("cross-check", sand, *RML, *texts)
    assert result.exit_code == 2, result.output
    assert "absent.rml" in result.stderr
    assert re.search(r"good.rml\s.*proved", result.stdout)
    assert f"{other} differs from reference" in result.stdout
    if name == "x.rml":
        assert "x.rml:1:" in result.stderr
    else:  # an atom that the tree does not know
        assert re.search(rf"{name}\s.*could not run: .*elsewhere", result.stdout)
    result = run("cross-check", sand, "--against", written(tmp_path / "property.txt", "x"))
    assert result.exit_code == 2
    assert "LANG:property.txt" in result.stderr


ELASTIC = '''[metadata]
maturity = "production"

[rule]
name = "Login and copy"
type = "eql"
language = "eql"
query = """
sequence by user with maxspan=10m
  [any where event == "login"]
  [any where event == "copy"]
"""
'''
LOGIN_COPY = (
    'event e(what, u) = { event: what, user: u }; time "@timestamp" as iso8601; '
    'top sand a b within 10 min; a on e("login", U); b on e("copy", U);'
)


@pytest.mark.parametrize(("old", "new", "status", "message"), rows(__file__, "elastic_rules.txt"))
def test_a_rule_of_elastic(old: str, new: str, status: int, message: str, tmp_path: Path) -> None:
    assert old in ELASTIC
    rule = written(tmp_path / "rule.toml", ELASTIC.replace(old, new))
    tree, few = written(tmp_path / "t.rvaft", LOGIN_COPY), ("--traces", 50, "--jobs", 1)
    result = run("cross-check", tree, "--against", rule, "--semantics", "scattered", *few)
    assert result.exit_code == status, result.output
    assert result.exception is None or isinstance(result.exception, SystemExit)
    assert message in result.output


@pytest.mark.parametrize(("tree", "text", "status", "said"), sampled(rows(__file__, "against.txt"), 4))
def test_a_text_of_a_person(
    tree: str, text: tuple[str, str], status: int, said: dict[str, bool], tmp_path: Path
) -> None:
    name, content = text
    if name.endswith(".eql"):
        pytest.importorskip("eql", reason="the extra eql is not installed")
    if name.endswith(".yml"):
        pytest.importorskip("sigma.backends.sqlite", reason="the extra sigma is not installed")
    rule, options = written(tmp_path / name, content), ("--traces", 100, "--jobs", 1)
    result = run("cross-check", written(tmp_path / "t.rvaft", tree), "--against", rule, *options)
    assert result.exit_code == status, result.output
    assert {one: one in result.output for one in said} == said
    assert "?          ?\n\n" not in result.output


def test_an_own_translation_agrees_where_the_tree_assumes(tmp_path: Path) -> None:
    for module in ("sigma", "yaml", "sigma.backends.sqlite"):
        pytest.importorskip(module, reason="the extra sigma is not installed")
    tree, own = "docs/first/ssh_guessing.rvaft", tmp_path / "own.yml"
    assert run("emit", tree, "--to", "sigma", "-o", own).exit_code == 0
    result = run("cross-check", tree, "--against", own, "--traces", 60, "--jobs", 1)
    assert result.exit_code == 0, result.output
    assert "assumes types, present, case" in result.stdout


def test_a_constant_that_a_program_in_c_excludes_is_tried(tmp_path: Path) -> None:
    if not (can_confine() and shutil.which("cc")):
        pytest.skip("needs a C compiler, and Landlock with seccomp")
    tree = written(
        tmp_path / "t.rvaft",
        'event a(x) = { e: "a", x: x }; event b(x) = { e: "b", x: x }; semantics scattered; '
        "top sand p q; p on a(X); q on b(X);",
    )
    text = translate(load(tree), "c", semantics="scattered").text
    old = "E(1).tag != RVAFT_ABSENT)"
    assert old in text
    wrong = written(tmp_path / "wrong.c", text.replace(old, f'{old[:-1]} && !is_text(&E(1), "zzz", 3))'))
    result = run("cross-check", tree, "--against", wrong, "--run-c", "--traces", 200, "--jobs", 1)
    assert result.exit_code == 1, result.output
    assert '"x": "zzz"' in result.stdout


@pytest.mark.spot
@pytest.mark.skipif(not HAS_SPOT, reason="needs Spot")
def test_an_atom_without_header_is_the_event_of_that_node(tmp_path: Path) -> None:
    text = 'event seen(what) = {"saw": what};\ntoplevel r; r sand a b; a on seen(1); b on seen(2);'
    good = written(tmp_path / "good.ltlf", "F(a & X[!] F b)")
    tree = written(tmp_path / "tree.rvaft", text)
    result = run("cross-check", tree, *RML, "--against", good, "--semantics", "scattered")
    assert result.exit_code == 0, result.output
    assert re.search(r"good.ltlf\s.*proved", result.stdout)


def test_reports(sand: Path, tmp_path: Path) -> None:
    wrong = written(tmp_path / "wrong.rvaft", AND)
    files = {form: tmp_path / f"out.{form}" for form in ("json", "csv", "junit", "markdown")}
    options = [option for form, file in files.items() for option in (f"--{form}", file)]
    assert run("cross-check", sand, "--against", wrong, *options).exit_code == 1
    rows = list(csv.DictReader(files["csv"].read_text().splitlines()))
    columns = "tree semantics participant exit_status seconds symbols states verdicts result"
    assert list(rows[0]) == columns.split()
    assert [(row["participant"], row["exit_status"]) for row in rows] == [("reference", "ok"), (str(wrong), "ok")]
    assert rows[1]["result"].startswith("differs after ")
    (failure,) = ET.parse(files["junit"]).getroot().iter("failure")
    assert '{"event": "b"}' in str(failure.text)
    assert "1 disagreement" in files["markdown"].read_text()
    assert json.loads(files["json"].read_text())["totals"]["disagreements"] == 1


def test_a_report_that_cannot_be_written_is_an_error_and_the_others_are_not_lost(tmp_path: Path) -> None:
    tree = written(tmp_path / "bad\udcff.rvaft", "toplevel a;a or b;")  # a name that is no text
    result = run("cross-check", tree, *RML, "--csv", tmp_path / "no" / "out.csv")
    assert result.exit_code == 2
    assert "no/out.csv" in result.stderr
    assert "cannot write to a folder" in run("cross-check", tree, *RML, "--json", tmp_path).stderr
    files = ("--json", "/dev/full", "--csv", tmp_path / "out.csv")
    assert run("cross-check", tree, *RML, *files).exit_code == 2
    assert "bad" in (tmp_path / "out.csv").read_text()


def test_a_disagreement_is_shrunk_saved_and_replayed(tmp_path: Path) -> None:
    tree = written(tmp_path / "tree.rvaft", "toplevel r; r or x y; x 2of3 s b c; s sand a d; y and e f;")
    options = ("--backends", "rml-paper", "--semantics", "strict", "--save-bogus", tmp_path / "bogus")
    assert run("cross-check", tree, *options).exit_code == 1
    (case,) = [path for path in (tmp_path / "bogus").iterdir() if path.is_dir()]
    assert len(load(case / "tree.rvaft").nodes) <= 5
    again, found = compared(tmp_path, "--replay", tmp_path / "bogus")
    assert again.exit_code == 1
    assert case.name in again.stdout
    assert [one["status"] for one in found if one["participant"] == "rml-paper"] == ["differs"]
    healthy = run("cross-check", "--replay", case, "--backends", "rml")
    assert healthy.exit_code == 0, healthy.output


def test_a_text_that_differs_is_kept_with_its_case_and_replayed(tmp_path: Path) -> None:
    tree = written(tmp_path / "tree.rvaft", "toplevel r; r sand a b;")  # undeclared leaves and all
    wrong = written(tmp_path / ("wrong.ltlf" if HAS_SPOT else "wrong.rvaft"), "F b & F a" if HAS_SPOT else AND)
    options = ("--semantics", "scattered", "--save-bogus", tmp_path / "bogus")
    result = run("cross-check", tree, "--against", wrong, *options)
    assert (result.exit_code, result.stderr) == (1, "")
    wrong.unlink()
    again = run("cross-check", "--replay", tmp_path / "bogus")
    assert again.exit_code == 1, again.output
    assert "wrong." in again.stdout


def test_a_campaign_is_reproducible_and_another_seed_makes_other_trees(tmp_path: Path) -> None:
    found = []
    for seed, jobs in ((3, 1), (3, 2), (4, 1)):
        options = ("--random", 6, "--max-nodes", 6, "--traces", 4, "--backends", "rml")
        result, results = compared(tmp_path, *options, "--seed", seed, "--jobs", jobs)
        assert result.exit_code == 0, result.output
        found.append([{**one, "seconds": 0} for one in results])
    assert found[0] == found[1]
    assert len({one["tree"] for one in found[0]}) == 6
    assert [one["symbols"] for one in found[0]] != [one["symbols"] for one in found[2]]


@pytest.mark.ci
def test_a_short_timeout_is_said_and_no_agreement(sand: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("backends.ltlf.LtlfBackend.translate", lambda *_, **__: time.sleep(60))
    options = ("--semantics", "strict", "--backends", "ltlf", "--timeout", "1", "--fail-on-timeout")
    result, found = compared(tmp_path, sand, *options[:-1])
    assert result.exit_code == 0, result.output
    statuses = {one["participant"]: one["status"] for one in found}
    assert statuses == {"reference": "baseline", "engine": "proved", "ltlf": "timeout"}
    assert run("cross-check", sand, *options).exit_code == 2
    result = run("cross-check", sand, "--timeout", "1e-9")
    assert result.exit_code == 2
    assert "nothing was compared" in result.stdout


def test_a_state_limit_turns_a_proof_into_a_test_and_a_broken_tree_stops_nothing(sand: Path, tmp_path: Path) -> None:
    broken = written(tmp_path / "broken.rvaft", "toplevel r; r and")
    result = run("cross-check", broken, sand, "--semantics", "strict", "--backends", "rml", "--states", "2")
    assert result.exit_code == 2
    assert "broken.rvaft:1:" in result.stderr
    assert re.search(r"rml\s.*tested: \d+ traces up to length \d+ \(state limit 2 reached\)", result.stdout)


@pytest.mark.ci
def test_an_interrupted_run_ends_at_once_and_reports_what_it_has(tmp_path: Path) -> None:
    leaves = " ".join(f"a{number}" for number in range(14))
    slow = written(tmp_path / "slow.rvaft", f"toplevel t; t and {leaves};")
    quick = written(tmp_path / "quick.rvaft", SAND)
    words = ["cross-check", quick, slow, "--semantics", "strict", "--backends", "automaton", "--jobs", 2]
    with started(*words, "--json", tmp_path / "out.json", start_new_session=True) as running:
        assert soon(lambda: len(children(running)) >= 2)
        time.sleep(0.5)
        begun = time.monotonic()
        os.killpg(running.pid, signal.SIGINT)
        output, errors = running.communicate(timeout=60)
        assert running.returncode == 130, output + errors
    assert time.monotonic() - begun < 20
    assert "interrupted after" in json.loads((tmp_path / "out.json").read_text())["note"]
    assert "Traceback" not in errors
