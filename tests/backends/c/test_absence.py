"""Monitors in C of trees with absent events."""

import json
import re
from collections import Counter
from itertools import islice
from pathlib import Path
from random import Random

import pytest

from backends.c import CBackend
from backends.c.library import CMonitor, compile_c, compiler
from rvaft import RVAFT, NotExpressible, Semantics, TooLarge, Verdict, dumps, loads, monitor
from rvaft.monitors import Repetition
from rvaft.semantics import Reference
from tests.backends.c.programs import BACKEND, SANITIZERS, SCATTERED, compile_strictly, program, status
from tests.backends.c.test_c import ANALYSED, KEY, PIECES, analysis, needs_frama_c
from tests.cli.runs import run
from tests.engine.checking import small_valid_trees
from tests.engine.dense import SHAPES, dense_trace, dense_tree, living_trace
from tests.tables import sampled

pytestmark = pytest.mark.skipif(compiler() is None, reason="needs a C compiler")
ABSENT = [name for name in SHAPES if "absen" in name]
EVENT = "event e(n, x) = { event: n, x: x };"
LOST = f'time t as s; {EVENT} lost fault on e("beat", R) without e("beat", R) for 2 s after;'
NEW = f'time t as s late 1 s; {EVENT} new on e("login", U) without e("login", U) for 5 s before;'
SKIPPED = f'{EVENT} top sand a b without e("c", Q) when Q != U; a on e("a", U); b on e("b", U);'
HIGHER = f'{EVENT} top or a; a on e("a", X) without e("c", Q) when Q > X before;'


def written(tree: RVAFT, semantics: Semantics, backend: CBackend = BACKEND) -> str | None:
    try:
        return backend.translate(tree, semantics).text
    except (NotExpressible, TooLarge):
        return None


@pytest.mark.parametrize("seed", [0, *(pytest.param(seed, marks=pytest.mark.slow) for seed in range(1, 6))])
@pytest.mark.parametrize("name", sampled(ABSENT, 4))
def test_verdicts_are_those_of_the_definition(name: str, seed: int) -> None:
    random, shape, seen = Random(f"C {name} {seed}"), SHAPES[name], Counter[Verdict]()
    absent = (tree for tree in small_valid_trees(lambda: dense_tree(random, shape)) if tree.absences)
    drawn = ((tree, random.choice([*Semantics, SCATTERED])) for tree in absent)
    texts = ((*one, text) for one in drawn if (text := written(*one)) is not None)
    for tree, semantics, text in islice(texts, 60 if seed else 15):
        start = CMonitor(text)
        for _ in range(5):
            trace = [*living_trace(random, tree, name, semantics, 6), *dense_trace(random, shape, 4)]
            wanted = [*Reference(tree, semantics).run(trace)]
            half, compiled = len(trace) // 2, start.fork()
            found = [*map(compiled.step, trace[:half])]
            compiled = compiled.fork()
            found += map(compiled.step, trace[half:])
            assert found == wanted, f"{semantics}\n{dumps(tree)}\n{json.dumps(trace)}"
            seen[found[-1]] += 1
    assert min(seen[Verdict.TRUE], seen[Verdict.UNKNOWN]) > 4


@pytest.mark.ci
@pytest.mark.parametrize("seed", [0, *(pytest.param(seed, marks=pytest.mark.slow) for seed in range(1, 4))])
@pytest.mark.parametrize("name", ["absent events", "absent values"])
def test_detections_with_sanitizers(name: str, seed: int, tmp_path: Path) -> None:
    random, shape, left = Random(f"again {name} {seed}"), SHAPES[name], 12 if seed else 3
    for tree in small_valid_trees(lambda: dense_tree(random, shape)):
        trace = dense_trace(random, shape, 120)
        watching = Repetition(monitor(tree, semantics=SCATTERED))
        wanted = [place for place, event in enumerate(trace, 1) if watching.step(event) is Verdict.TRUE]
        text = written(tree, SCATTERED) if tree.absences and len(wanted) > 2 else None
        if text is None:
            continue
        options = (*SANITIZERS, "-DRVAFT_MAIN=1", "-DRVAFT_PLACES=1", "-DRVAFT_CAPACITY=2048")
        compile_c(text, tmp_path / "monitor", options)
        data = b"\n".join(json.dumps(one).encode() for one in trace)
        code, out, error = status(tmp_path / "monitor", data, "--repeat", "--detections")
        assert code == 1, error
        assert [json.loads(line)["event"] for line in out.splitlines()] == wanted, dumps(tree)
        left -= 1
        if not left:
            return


@pytest.mark.parametrize("text", sampled([NEW, SKIPPED, HIGHER], 3))
def test_each_key_has_its_own_past(text: str, tmp_path: Path) -> None:
    random, tree, keys = Random(text), loads(text), ("a", 1)
    made = BACKEND.keyed([(("key",), ("key",))]).translate(tree, SCATTERED).text
    options = (*SANITIZERS, "-DRVAFT_PLACES=1", "-DRVAFT_CAPACITY=64")
    compile_c(made + PIECES, tmp_path / "monitor", options)
    names = ("login",) if "login" in text else ("a", "b", "c")
    events = [
        {"event": random.choice(names), "x": random.choice((1, 2, 3)), "key": random.choice(keys), "t": number // 2}
        for number in range(200)
    ]
    wanted = []
    for key in keys:
        watching = Repetition(monitor(tree, semantics=SCATTERED))
        own = [place for place, event in enumerate(events, 1) if event["key"] == key]
        wanted += [place for place in own if watching.step(events[place - 1]) is Verdict.TRUE]
    code, out, error = status(tmp_path / "monitor", b"\n".join(json.dumps(one).encode() for one in events))
    assert code == 0, error
    found = [int(line.split()[-1]) for line in out.splitlines()]
    assert sorted(found) == sorted(wanted)
    assert len(found) > 2


CLOCK = """
#include <stdio.h>
int main(void) {
    static rvaft_monitor m;
    rvaft_event e = {0};
    rvaft_init(&m, 1);
    e.has_time = 1;
    e.field[0] = rvaft_text("beat");
    e.field[1] = integer(7);
    printf("%d", rvaft_step(&m, &e));
    printf(" %d", rvaft_pass_time(&m, INT64_C(2000000000)));
    e.time = INT64_C(2000000000);
    e.field[1] = integer(8);
    printf(" %d", rvaft_step(&m, &e));
    printf(" %d", rvaft_pass_time(&m, INT64_C(2000000001)));
    printf(" %d", m.changed);
    rvaft_again(&m);
    printf(" %d", rvaft_finish(&m));
    printf(" %d", rvaft_step(&m, &e));
    printf(" %d", rvaft_finish(&m));
    printf(" %d\\n", m.changed);
    return 0;
}
"""


def test_passing_time_and_the_end(tmp_path: Path) -> None:
    text = BACKEND.translate(loads(LOST), SCATTERED).text
    assert [found.split("field[")[1][0] for found in re.findall(r"field\[\d\] is (?:event|x)", text)] == ["0", "1"]
    compile_c(text + CLOCK, tmp_path / "clock", (*SANITIZERS, "-DRVAFT_JSON=0"))
    assert status(tmp_path / "clock", b"") == (0, "0 0 0 1 1 0 0 1 1\n", "")


@pytest.mark.parametrize("options", sampled([((),), (("--repeat",),), (("--detections", "--repeat"),)], 3))
@pytest.mark.parametrize("last", sampled(["3", "3.5"], 2))
def test_a_complete_log(last: str, options: tuple[str, ...], folder: Path, tmp_path: Path) -> None:
    (file := tmp_path / "lost.rvaft").write_text(f"semantics scattered; {LOST}", encoding="utf-8")
    lines = [f'{{"event": "beat", "x": {x}, "t": {t}}}' for x, t in ((1, "0"), (2, "1"), (1, last))]
    (log := tmp_path / "log.jsonl").write_text("\n".join(lines), encoding="utf-8")
    ours = run("monitor", str(file), str(log), "--format", "jsonl", "--complete", *options)
    known = ("event", "verdict", "line", "passed", "detection")
    wanted = [{name: one[name] for name in known if name in one} for one in map(json.loads, ours.stdout.splitlines())]
    code, out, error = status(program(LOST, folder), log.read_bytes(), "--complete", *options)
    assert ([json.loads(line) for line in out.splitlines()], error) == (wanted, "")
    assert code == ours.exit_code == 1


@pytest.mark.slow
@needs_frama_c
@pytest.mark.parametrize("text", [LOST, NEW, SKIPPED, HIGHER])
def test_no_run_time_errors_by_eva(text: str, tmp_path: Path) -> None:
    options = ("-cpp-extra-args=-DRVAFT_JSON=0 -DRVAFT_CAPACITY=4", "-eva-precision", "1")
    found = analysis(BACKEND.translate(loads(text), SCATTERED).text + ANALYSED, tmp_path / "monitor.c", *options)
    assert "  0 alarms generated by the analysis" in found, found[-2000:]


@pytest.mark.parametrize("text", sampled([LOST, NEW, SKIPPED, HIGHER], 4))
def test_sizes_and_warnings(text: str, tmp_path: Path) -> None:
    tree = loads(text)
    for semantics in Semantics:
        made = BACKEND.translate(tree, semantics).text
        compile_strictly(made, tmp_path, "-DRVAFT_PLACES=1", "-DRVAFT_MAIN=1")
        found = re.search(r"sizeof\(rvaft_monitor\) is (\d+) bytes", made)
        assert found is not None
        assert int(found[1]) == CMonitor(made).size
    if text is not LOST:
        keyed = BACKEND.keyed(KEY).translate(tree, SCATTERED).text
        compile_strictly(keyed, tmp_path, "-DRVAFT_PLACES=1")


def test_what_is_broken_or_too_old_leaves_room(folder: Path) -> None:
    new, skipped = program(NEW, folder), program(SKIPPED, folder)
    log = [{"event": "login", "x": f"user {number}", "t": number} for number in range(5_000)]
    code, out, error = status(new, b"\n".join(json.dumps(one).encode() for one in log), "--repeat", "--detections")
    assert (code, error, out.count("\n")) == (1, "", 5_000)
    log = [event for number in range(2_000) for event in ({"event": "a", "x": number}, {"event": "c", "x": -1})]
    log += [{"event": "a", "x": "u"}, {"event": "c", "x": "u"}, {"event": "b", "x": "u"}]
    code, out, error = status(skipped, b"\n".join(json.dumps(one).encode() for one in log), "--detections")
    assert (code, error, json.loads(out)["event"]) == (1, "", len(log))


@pytest.mark.parametrize(
    ("text", "keyed", "why"),
    [
        (LOST, True, "for D after"),
        (f'{EVENT} top sand a b; a on e("a", _); b on e("b", _) without e("a", 1) before;', False, "earlier event"),
        (
            f'time t as s; {EVENT} top and a b without e("c", 1) for 1 s before; a on e("a", _); b on e("b", _);',
            False,
            "late 0 s",
        ),
    ],
)
def test_what_is_refused(text: str, keyed: bool, why: str) -> None:
    backend = BACKEND.keyed(KEY) if keyed else BACKEND
    with pytest.raises(NotExpressible, match=f"rvaft does not write this tree in c under scattered: .*{why}"):
        backend.translate(loads(text), SCATTERED)


def test_a_native_monitor_does_not_explain_absence(tmp_path: Path) -> None:
    (tree := tmp_path / "lost.rvaft").write_text(f"semantics scattered; {LOST}", encoding="utf-8")
    (log := tmp_path / "log.jsonl").write_text('{"event": "beat", "x": 1, "t": 1}\n', encoding="utf-8")
    result = run("monitor", str(tree), str(log), "--native")
    assert result.exit_code == 2
    assert "--native does not say which events were absent: omit --native" in result.stderr
