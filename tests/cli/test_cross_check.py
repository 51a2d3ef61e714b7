"""`rvaft cross-check`."""

import csv
import json
import os
import re
import signal
import subprocess
import time
from importlib.util import find_spec
from pathlib import Path
from typing import NoReturn
from xml.etree import ElementTree as ET

import pytest

from backends.ltlf import LtlfBackend
from rvaft import RVAFT, load, translate
from tests.cli.runs import COMMAND, PRUNED, failed, run

HAS_SPOT = find_spec("spot") is not None
SAND = "toplevel r; r sand a b; a; b;"
AND = "toplevel r; r and a b; a; b;"


@pytest.fixture
def sand(tmp_path: Path) -> Path:
    tree = tmp_path / "sand.rvaft"
    tree.write_text(SAND)
    return tree


def written(folder: Path, name: str, text: str) -> Path:
    file = folder / name
    file.write_text(text)
    return file


def results(file: Path) -> list[dict[str, object]]:
    found: list[dict[str, object]] = json.loads(file.read_text())["results"]
    return found


@pytest.mark.spot
def test_a_tree_is_proved_under_every_semantics(sand: Path, tmp_path: Path) -> None:
    pytest.importorskip("spot")
    result = run("cross-check", sand, "--json", tmp_path / "out.json")
    assert result.exit_code == 0, result.output
    assert "no disagreement" in result.stdout
    found = {(one["participant"], one["semantics"]): one["status"] for one in results(tmp_path / "out.json")}
    others = ("engine", "rml", "ltlf", "automaton")
    semantics = ("strict", "projected", "scattered")
    assert found == {
        **{("reference", s): "baseline" for s in semantics},
        **{(name, s): "proved" for name in others for s in semantics},
    }


@pytest.mark.spot
def test_a_tree_with_variables_is_tested_and_never_said_to_be_proved(tmp_path: Path) -> None:
    pytest.importorskip("spot")
    result = run("cross-check", PRUNED, "--semantics", "projected,scattered", "--json", tmp_path / "out.json")
    assert result.exit_code == 0, result.output
    statuses = {(one["participant"], one["semantics"]): one["result"] for one in results(tmp_path / "out.json")}
    assert re.fullmatch(r"tested: \d+ traces up to length \d+ \(variables .*\)", str(statuses["engine", "projected"]))
    assert str(statuses["rml", "scattered"]).startswith("not expressible: ")
    assert "proved" not in {str(result) for result in statuses.values()}


def test_a_refusal_fails_the_run_only_on_demand() -> None:
    options = ("--semantics", "scattered", "--backends", "rml", "--traces", "2")
    assert run("cross-check", PRUNED, *options).exit_code == 0
    assert run("cross-check", PRUNED, *options, "--fail-on-not-expressible").exit_code == 2


@pytest.mark.parametrize("suffix", [".rml", ".ltlf", ".hoa", ".rvaft"])
def test_another_specification_of_the_same_tree_is_proved_equal(sand: Path, tmp_path: Path, suffix: str) -> None:
    name = {".rml": "rml", ".ltlf": "ltlf", ".hoa": "automaton", ".rvaft": None}[suffix]
    if name in ("ltlf", "automaton"):
        pytest.importorskip("spot")
    text = SAND if name is None else translate(load(sand), name).text
    result = run("cross-check", sand, "--against", written(tmp_path, f"other{suffix}", text))
    assert result.exit_code == 0, result.output
    assert re.search(rf"other{suffix}\s.*\bproved", result.stdout)


def test_a_handwritten_text_that_means_something_else_gives_a_shortest_trace(sand: Path, tmp_path: Path) -> None:
    wrong = written(
        tmp_path, "wrong.rml", "a matches {'event':'a'}; b matches {'event':'b'};\nMain = (a all) /\\ (b all);\n"
    )
    result = run("cross-check", sand, "--against", wrong, "--semantics", "strict", "--json", tmp_path / "out.json")
    assert result.exit_code == 1
    assert f"{wrong} differs from reference" in result.stdout
    (found,) = [one["difference"] for one in results(tmp_path / "out.json") if one["status"] == "differs"]
    # both operands of the conjunction read every event, so the first `a` leaves nothing of the second one
    assert found == {
        "trace": [{"event": "a"}],
        "baseline": "reference",
        "expected": ["unknown"],
        "got": ["false"],
    }


def test_a_text_that_looks_at_another_field_is_not_proved(sand: Path, tmp_path: Path) -> None:
    """The letters are those of the file too: here only an event with both fields tells it from the tree."""
    text = (
        "a matches {'event':'a'}; b matches {'event':'b'}; late matches {'late':true}; ok not matches {'late':true};\n"
    )
    odd = written(tmp_path, "odd.rml", f"{text}Main = (a /\\ ok) b all;\n")
    result = run("cross-check", sand, "--against", odd, "--semantics", "strict")
    assert result.exit_code == 1, result.output
    assert '"late": true' in result.stdout


def test_two_trees(sand: Path, tmp_path: Path) -> None:
    other = written(tmp_path, "and.rvaft", AND)
    result = run("cross-check", sand, "--against", other, "--semantics", "all")
    assert result.exit_code == 1
    assert result.stdout.count("differs from reference") == 3


def test_files_behind_against_are_sorted_by_their_names(sand: Path, tmp_path: Path) -> None:
    texts = [written(tmp_path, name, translate(load(sand), "rml").text) for name in ("one.rml", "two.rml")]
    result = run("cross-check", sand, "--against", *texts)
    assert result.exit_code == 0, result.output
    assert "one.rml" in result.stdout
    assert "two.rml" in result.stdout


# -- reports ----------------------------------------------------------------------------------------------------


def test_reports(sand: Path, tmp_path: Path) -> None:
    wrong = written(tmp_path, "wrong.rvaft", AND)
    files = {form: tmp_path / f"out.{form}" for form in ("json", "csv", "junit", "markdown")}
    options = [option for form, file in files.items() for option in (f"--{form}", file)]
    assert run("cross-check", sand, "--against", wrong, *options).exit_code == 1
    rows = list(csv.DictReader(files["csv"].read_text().splitlines()))
    assert list(rows[0]) == [
        *("tree", "semantics", "participant", "exit_status", "seconds", "symbols", "states", "verdicts", "result")
    ]
    assert [(row["participant"], row["exit_status"]) for row in rows] == [("reference", "ok"), (str(wrong), "ok")]
    assert rows[1]["result"].startswith("differs after ")
    suites = ET.parse(files["junit"]).getroot()
    assert [case.get("name") for case in suites.iter("testcase")] == ["reference", str(wrong)]
    (failure,) = suites.iter("failure")
    assert '{"event": "b"}' in str(failure.text)
    assert "1 disagreement" in files["markdown"].read_text()
    assert json.loads(files["json"].read_text())["totals"]["disagreements"] == 1


def test_a_report_that_cannot_be_written_is_an_error(sand: Path, tmp_path: Path) -> None:
    result = run("cross-check", sand, "--backends", "rml", "--csv", tmp_path / "no" / "out.csv")
    assert result.exit_code == 2
    assert "no/out.csv" in result.stderr


# -- saved cases ------------------------------------------------------------------------------------------------


def test_a_disagreement_is_shrunk_saved_and_replayed(tmp_path: Path) -> None:
    tree = written(
        tmp_path, "tree.rvaft", "toplevel r; r or x y; x 2of3 s b c; s sand a d; a; b; c; d; y and e f; e; f;"
    )
    options = ("--backends", "rml-paper", "--semantics", "strict", "--save-bogus", tmp_path / "bogus")
    result = run("cross-check", tree, *options)
    assert result.exit_code == 1
    (case,) = [path for path in (tmp_path / "bogus").iterdir() if path.is_dir()]
    small = load(case / "tree.rvaft")
    assert len(small.nodes) <= 5
    again = run("cross-check", "--replay", tmp_path / "bogus", "--json", tmp_path / "out.json")
    assert again.exit_code == 1
    assert case.name in again.stdout
    assert [one["status"] for one in results(tmp_path / "out.json") if one["participant"] == "rml-paper"] == ["differs"]
    healthy = run("cross-check", "--replay", case, "--backends", "rml")
    assert healthy.exit_code == 0, healthy.output


# -- random campaigns -------------------------------------------------------------------------------------------


def test_a_campaign_is_reproducible(tmp_path: Path) -> None:
    found = []
    for jobs in (1, 2):
        options = ("--random", 6, "--seed", 3, "--max-nodes", 6, "--traces", 4, "--backends", "rml", "--jobs", jobs)
        result = run("cross-check", *options, "--json", tmp_path / f"{jobs}.json")
        assert result.exit_code == 0, result.output
        found.append([{**one, "seconds": 0} for one in results(tmp_path / f"{jobs}.json")])
    assert found[0] == found[1]
    assert len({one["tree"] for one in found[0]}) == 6


def test_another_seed_makes_other_trees(tmp_path: Path) -> None:
    sizes = []
    for seed in (1, 2):
        options = ("--random", 5, "--seed", seed, "--traces", 1, "--backends", "rml", "--json", tmp_path / "out.json")
        assert run("cross-check", *options).exit_code == 0
        sizes.append([one["symbols"] for one in results(tmp_path / "out.json") if one["participant"] == "rml"])
    assert sizes[0] != sizes[1]


def test_a_short_timeout_is_said_and_no_agreement(sand: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    class Endless(LtlfBackend):
        def translate(self, tree: RVAFT, *_: object, **__: object) -> NoReturn:  # noqa: ARG002
            while True:
                pass

    monkeypatch.setattr("backends.ltlf.LtlfBackend", Endless)
    options = ("--semantics", "strict", "--backends", "ltlf", "--timeout", "3", "--json", tmp_path / "out.json")
    result = run("cross-check", sand, *options)
    assert result.exit_code == 0, result.output
    statuses = {one["participant"]: one["status"] for one in results(tmp_path / "out.json")}
    assert statuses == {"reference": "baseline", "engine": "proved", "ltlf": "timeout"}
    assert run("cross-check", sand, *options, "--fail-on-timeout").exit_code == 2


def test_a_state_limit_turns_a_proof_into_a_test(sand: Path) -> None:
    result = run("cross-check", sand, "--semantics", "strict", "--backends", "rml", "--states", "2")
    assert result.exit_code == 0
    assert re.search(r"rml\s.*tested: \d+ traces up to length \d+ \(state limit 2 reached\)", result.stdout)


# -- wrong input ------------------------------------------------------------------------------------------------


def test_what_cannot_be_read_is_reported_and_the_rest_still_runs(sand: Path, tmp_path: Path) -> None:
    good = written(tmp_path, "good.rml", translate(load(sand), "rml").text)
    bad = written(tmp_path, "bad.rml", "Main = ;")
    result = run("cross-check", sand, "--against", tmp_path / "absent.rml", "--against", bad, "--against", good)
    assert result.exit_code == 2
    assert "absent.rml" in result.stderr
    assert "bad.rml:1:" in result.stderr
    assert re.search(r"good.rml\s.*proved", result.stdout)


def test_a_tree_that_cannot_be_read_does_not_stop_the_others(sand: Path, tmp_path: Path) -> None:
    broken = written(tmp_path, "broken.rvaft", "toplevel r; r and")
    result = run("cross-check", broken, sand, "--backends", "rml")
    assert result.exit_code == 2
    assert "broken.rvaft:1:" in result.stderr
    assert "sand.rvaft" in result.stdout


@pytest.mark.parametrize(
    ("arguments", "part"),
    [
        (["--jobs", "0"], "--jobs"),
        (["--seed", "x"], "--seed"),
        (["--random", "0"], "--random"),
        (["--random", "2", "TREE"], "bring their own trees"),
        (["--against", "x.rml"], "--against needs a TREE"),
        (["--semantics", "lax"], "lax"),
        (["--backends", "nusmv"], "unknown backend nusmv"),
        (["TREE", "--backends", "hoa"], "did you mean automaton"),
        (["TREE", "--branch", "1", "--kind", "fault"], "exclude each other"),
        (["--branch", "1"], "need a TREE"),
        (["--replay", "nowhere"], "nowhere"),
        (["--timeout", "0"], "--timeout"),
    ],
)
def test_wrong_usage(arguments: list[str], part: str, sand: Path) -> None:
    failed(run("cross-check", *(str(sand) if argument == "TREE" else argument for argument in arguments)), part)


def test_a_language_that_nobody_can_tell(sand: Path, tmp_path: Path) -> None:
    result = run("cross-check", sand, "--against", written(tmp_path, "property.txt", "x"))
    assert result.exit_code == 2
    assert "LANG:property.txt" in result.stderr


def test_a_named_language(sand: Path, tmp_path: Path) -> None:
    file = written(tmp_path, "property.txt", translate(load(sand), "rml").text)
    assert run("cross-check", sand, "--against", f"rml:{file}").exit_code == 0


@pytest.mark.spot
@pytest.mark.parametrize("name", ["x.hoa", "x.ltlf"])
def test_an_atom_that_the_tree_does_not_know(sand: Path, tmp_path: Path, name: str) -> None:
    pytest.importorskip("spot")
    hoa = 'HOA: v1\nStates: 1\nStart: 0\nAP: 1 "elsewhere"\nacc-name: Buchi\nAcceptance: 1 Inf(0)\n--BODY--\nState: 0 {0}\n[0] 0\n--END--\n'
    result = run("cross-check", sand, "--against", written(tmp_path, name, hoa if name == "x.hoa" else "F elsewhere"))
    assert result.exit_code == 2, result.output
    assert "elsewhere" in result.output


@pytest.mark.spot
def test_an_atom_without_header_is_the_event_of_that_node(tmp_path: Path) -> None:
    pytest.importorskip("spot")
    tree = written(
        tmp_path, "tree.rvaft", 'event seen(what) = {"saw": what};\ntoplevel r; r sand a b; a on seen(1); b on seen(2);'
    )
    good = written(tmp_path, "good.ltlf", "F(a & X[!] F b)")
    result = run("cross-check", tree, "--against", good, "--semantics", "scattered")
    assert result.exit_code == 0, result.output
    assert re.search(r"good.ltlf\s.*proved", result.stdout)


def test_a_text_that_differs_is_kept_with_its_case_and_replayed(tmp_path: Path) -> None:
    tree = written(tmp_path, "tree.rvaft", "toplevel r; r sand a b;")  # undeclared leaves and all
    wrong = written(tmp_path, "wrong.ltlf" if HAS_SPOT else "wrong.rvaft", "F b & F a" if HAS_SPOT else AND)
    options = ("--semantics", "scattered", "--save-bogus", tmp_path / "bogus")
    result = run("cross-check", tree, "--against", wrong, *options)
    assert (result.exit_code, result.stderr) == (1, "")
    wrong.unlink()
    again = run("cross-check", "--replay", tmp_path / "bogus")
    assert again.exit_code == 1, again.output
    assert "wrong." in again.stdout


def test_another_tree_is_read_with_what_it_imports(sand: Path, tmp_path: Path) -> None:
    (tmp_path / "sub").mkdir()
    written(tmp_path / "sub", "part.rvaft", "b;")
    main = written(tmp_path / "sub", "main.rvaft", 'import "part.rvaft"; toplevel r; r sand a b; a;')
    assert run("cross-check", sand, "--against", main).exit_code == 0


def test_a_text_with_an_unknown_atom_does_not_stop_the_others(sand: Path, tmp_path: Path) -> None:
    pytest.importorskip("spot")
    odd = written(tmp_path, "odd.ltlf", "F elsewhere")
    other = written(tmp_path, "and.rvaft", AND)
    result = run("cross-check", sand, "--against", odd, "--against", other)
    assert result.exit_code == 2
    assert f"{other} differs from reference" in result.stdout
    assert re.search(r"odd.ltlf\s.*could not run: .*elsewhere", result.stdout)


def test_nothing_compared_is_no_agreement(sand: Path) -> None:
    result = run("cross-check", sand, "--timeout", "1e-9")
    assert result.exit_code == 2
    assert "nothing was compared" in result.stdout


def test_names_that_are_no_text(tmp_path: Path) -> None:
    tree = written(tmp_path, "bad\udcff.rvaft", SAND)
    result = run("cross-check", tree, "--backends", "rml", "--csv", tmp_path / "out.csv")
    assert result.exit_code == 0, result.output
    assert "bad" in (tmp_path / "out.csv").read_text()


def test_one_report_that_cannot_be_written_does_not_lose_the_others(sand: Path, tmp_path: Path) -> None:
    (tmp_path / "folder").mkdir()
    result = run(
        "cross-check", sand, "--backends", "rml", "--json", tmp_path / "folder", "--markdown", tmp_path / "out.md"
    )
    assert result.exit_code == 2
    assert (tmp_path / "out.md").exists()


@pytest.mark.parametrize("jobs", [1, 2])
def test_an_interrupted_run_ends_at_once_and_reports_what_it_has(tmp_path: Path, jobs: int) -> None:
    leaves = " ".join(f"a{number}" for number in range(14))
    slow = written(tmp_path, "slow.rvaft", f"toplevel t; t and {leaves};")
    quick = written(tmp_path, "quick.rvaft", SAND)
    command = [*COMMAND, "cross-check", quick, slow, "--semantics", "strict", "--jobs", jobs]
    running = subprocess.Popen(
        [*map(str, command), "--backends", "automaton", "--json", str(tmp_path / "out.json")],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        start_new_session=True,
    )
    time.sleep(4)
    started = time.monotonic()
    os.killpg(running.pid, signal.SIGINT)
    output, errors = running.communicate(timeout=60)
    assert running.returncode == 130, output + errors
    assert time.monotonic() - started < 20
    found = json.loads((tmp_path / "out.json").read_text())
    assert "interrupted after" in found["note"]
    assert "Traceback" not in errors
