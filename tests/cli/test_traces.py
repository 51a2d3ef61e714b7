"""`rvaft traces`: example logs that are what they are called, the same ones every time, whole or not there."""

import json
import os
from functools import cache
from pathlib import Path
from typing import Any

import pytest

from rvaft import Semantics, Verdict, load, monitor, translate
from rvaft.backend import backend
from rvaft.semantics import Reference
from tests.cli.runs import PRUNED, SAND, TREES, failed, process, run, written
from tests.tables import sampled
from tests.trees import shipped

MODES = ("detect", "near-miss", "random")


def events(text: str) -> list[dict[str, Any]]:
    return [json.loads(line) for line in text.splitlines()]


def texts(folder: Path) -> dict[str, str]:
    return {path.name: path.read_text(encoding="utf-8") for path in sorted(folder.iterdir())}


known = cache(load)


def verdict(tree: Path, text: str, semantics: str = "projected", **part: Any) -> Verdict:
    return [Verdict.UNKNOWN, *Reference(known(tree), semantics, **part).run(events(text))][-1]


@pytest.mark.parametrize("name", shipped.names())
@pytest.mark.parametrize("semantics", sampled(Semantics, 4))
def test_each_mode_writes_what_it_says(name: str, semantics: Semantics, tmp_path: Path) -> None:
    tree = TREES / f"{name}.rvaft"
    for mode in MODES:
        result = run("traces", tree, f"--{mode}", "--semantics", semantics, "-n", 2, "-o", tmp_path)
        assert (result.exit_code, result.output) == (0, "")
    logs = texts(tmp_path)
    assert set(logs) == {f"{mode}-{i}.jsonl" for mode in MODES for i in (1, 2)}
    for i in (1, 2) if (name, semantics) not in shipped.FOLLOWED else ():
        assert verdict(tree, logs[f"detect-{i}.jsonl"], semantics) is Verdict.TRUE
        assert verdict(tree, logs[f"near-miss-{i}.jsonl"], semantics) is not Verdict.TRUE


@pytest.mark.parametrize("options", [{}, {"branch": 2}, {"branch": 3}, {"kind": "attack"}, {"kind": "fault"}])
def test_standard_output_takes_one_detection(options: dict[str, Any]) -> None:
    words = [word for name, value in options.items() for word in (f"--{name}", value)]
    result = run("traces", PRUNED, *words)
    assert (result.exit_code, result.stderr) == (0, "")
    assert verdict(PRUNED, result.stdout, **options) is Verdict.TRUE
    assert run("traces", PRUNED, "--detect", *words, "-n", 1, "-o", "-").stdout == result.stdout
    assert run("monitor", PRUNED, *words, data=result.stdout).exit_code == 1


@pytest.mark.parametrize("mode", MODES)
def test_seeds_differ_and_more_traces_leave_the_first_ones_alone(mode: str, tmp_path: Path) -> None:
    for folder, words in {"few": ["-n", 3], "many": ["-n", 8], "other": ["-n", 3, "--seed", 1]}.items():
        assert run("traces", PRUNED, f"--{mode}", *words, "-o", tmp_path / folder).exit_code == 0
    few, many, other = (texts(tmp_path / folder) for folder in ("few", "many", "other"))
    assert few == {name: many[name] for name in few}
    assert len(set(many.values())) == len(many) == 8
    assert not set(few.values()) & set(other.values())
    if mode == "near-miss":
        hashed = {**os.environ, "PYTHONHASHSEED": "7"}  # the same in any process
        assert process("traces", PRUNED, f"--{mode}", "-n", 3, "-o", tmp_path / "again", env=hashed).returncode == 0
        assert texts(tmp_path / "again") == few
    assert run("traces", PRUNED, f"--{mode}", "--length", 4, "-n", 12, "-o", tmp_path / "short").exit_code == 0
    lengths = {len(events(text)) for text in texts(tmp_path / "short").values()}
    assert (max(lengths), min(lengths) > 0) == (4, True)


def test_files_of_the_same_name_are_replaced_and_others_stay(tmp_path: Path) -> None:
    written(tmp_path / "mine.jsonl", "{}\n")
    written(tmp_path / "detect-1.jsonl", "old")
    assert run("traces", SAND, "--semantics", "strict", "-n", 2, "-o", tmp_path).exit_code == 0
    word = "".join(f'{{"event": "{letter}"}}\n' for letter in "abc")  # the tree has but one trace
    assert texts(tmp_path) == {"detect-1.jsonl": word, "detect-2.jsonl": word, "mine.jsonl": "{}\n"}


def test_a_trace_is_none_of_those_before_where_there_are_others(tmp_path: Path) -> None:
    assert run("traces", TREES / "gates" / "or.rvaft", "--semantics", "strict", "-n", 3, "-o", tmp_path).exit_code == 0
    assert len(set(texts(tmp_path).values())) == 3


def test_a_folder_that_cannot_be_written_to(tmp_path: Path) -> None:
    (tmp_path / "full" / "detect-2.jsonl").mkdir(parents=True)
    failed(run("traces", SAND, "-o", tmp_path / "full"), "detect-2.jsonl", "cannot write")
    assert {path.name for path in (tmp_path / "full").iterdir()} == {"detect-1.jsonl", "detect-2.jsonl"}


def test_a_leaf_counted_too_often_is_refused_at_once(tmp_path: Path) -> None:
    tree = written(tmp_path / "counted.rvaft", "r sand a b; b times 10000;")
    for mode in ("detect", "near-miss"):
        failed(run("traces", tree, f"--{mode}"), "too large: times of a counted leaf in example traces (limit 1000)")
    assert run("traces", tree, "--random").exit_code == 0


def test_random_times_are_written_as_others_write_them(tmp_path: Path) -> None:
    tree = written(tmp_path / "timed.rvaft", "time t as ros; r and a b within 1 s;")
    said = "".join(run("traces", tree, "--random", "--seed", seed).stdout for seed in range(20))
    assert {event["t"]["nanosec"] < 10**9 for event in events(said) if "t" in event} == {True}


MAPPING = {"e": {"k": "user-account:user_id", "ts": "user-account:x_ts"}}


@pytest.mark.parametrize(("form", "mapping"), [("eql", None), ("sigma", None), ("stix", None), ("stix", MAPPING)])
@pytest.mark.parametrize("mode", ["detect", "near-miss"])
def test_logs_for_programs_of_a_language_are_what_they_are_called(
    form: str, mapping: dict[str, Any] | None, mode: str, tmp_path: Path
) -> None:
    """Its program, asked of the log by itself, detects what is to be detected and nothing else."""
    pytest.importorskip({"eql": "eql", "sigma": "sigma", "stix": "stix2matcher"}[form])
    tree = written(
        tmp_path / "t.rvaft",
        'event e(k, t) = { k: k, ts: t }; top sand a b within 20 s; time ts as s; a on e("a", _); b on e("b", _);',
    )
    given = () if mapping is None else ("--mapping", written(tmp_path / "mapping.json", json.dumps(mapping)))
    result = run("traces", tree, f"--{mode}", "--format", form, *given, "-o", tmp_path / "logs")
    assert (result.exit_code, result.output) == (0, "")
    text = translate(load(tree), form, semantics="scattered", mapping=mapping).text
    assert (mapping is None) or "user-account:user_id = 'a'" in text
    for log in (tmp_path / "logs").iterdir():
        if form == "stix":
            from stix2matcher.matcher import Pattern

            found = bool(Pattern(text, "2.1").match([json.loads(log.read_text(encoding="utf-8"))]))
        else:
            read = events(log.read_text(encoding="utf-8"))
            assert all({"eql": "@timestamp", "sigma": "timestamp"}[form] in event for event in read)
            found = [*backend(form).read(text).run(read)][-1] is Verdict.TRUE
        assert found is (mode == "detect")


def test_events_of_one_moment_are_a_microsecond_apart_in_a_log_that_needs_it() -> None:
    tree = TREES / "cloudtrail" / "takeover.rvaft"
    for mode, seed in (("detect", 1), ("near-miss", 3)):
        given = events(run("traces", tree, f"--{mode}", "--seed", seed, "--format", "eql").stdout)
        times = [event["@timestamp"] for event in given]
        assert (times, len({*times})) == (sorted(times), len(times))
        assert (Verdict.TRUE in monitor(load(tree)).run(given)) is (mode == "detect")


def test_a_log_for_a_language_is_about_what_it_can_say() -> None:
    failed(
        run("traces", SAND, "--format", "eql", "--semantics", "strict"), "--format eql requires the semantics scattered"
    )
    failed(run("traces", PRUNED, "--format", "stix"), "rvaft does not write this tree in stix")


def test_a_mapping_is_for_logs_that_have_objects(tmp_path: Path) -> None:
    mapping = written(tmp_path / "mapping.toml", "[a]\n")
    failed(run("traces", SAND, "--mapping", mapping), "--mapping is for --format stix")
    failed(run("traces", SAND, "--mapping", mapping, "--format", "eql"), "eql takes no mapping")
    failed(run("traces", SAND, "--mapping", mapping, "--format", "stix"), "the mapping of a lacks the field event")
