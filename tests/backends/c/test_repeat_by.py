"""Repetition by a variable in C, against one reference for each of its values (definition, 4.9)."""

import json
import re
from collections.abc import Mapping, Sequence
from itertools import islice
from pathlib import Path
from random import Random
from typing import Any, Final

import pytest

from backends.c.library import CMonitor, compile_c, fast_compiler
from rvaft import NotExpressible, OptionError, Semantics, TooLarge, dumps, loads
from tests.backends.c.programs import BACKEND, SANITIZERS, SCATTERED, compile_strictly, status
from tests.backends.c.test_c import KEY, PIECES
from tests.cli.runs import run
from tests.engine.test_repeat_by import detections, events_of, trees
from tests.tables import sampled

BY: Final = BACKEND.repeating("U")
EVENTS: Final = "semantics scattered; event e(k, u) = { k: k, u: u }; event f(k, u, v) = { k: k, w: u, v: v };"
UNIT: Final = f'{EVENTS} top sand a b; a on e("a", U); b on f("b", U, _);'
WINDOW: Final = f"time t as s late 2 s; {UNIT.replace('a b;', 'a b within 4 s;')}"
PAIR: Final = f'{EVENTS} top sand a b; a on f("a", U, X); b on f("b", U, X);'
SHARED: Final = f'{EVENTS} top and a b; a or x y; b or y z; x on e("a", U); y on f("b", U, _); z on e("c", U);'
SILENT: Final = f'{EVENTS} time t as s; top on f("a", U, X) without f("b", U, X) for 2 s after;'
LOST: Final = f'{EVENTS} time t as s; top on e("a", U) without e("a", U) for 2 s after;'
ALONE: Final = f'{EVENTS} top or a b; a on e("a", U); b on f("b", U, _);'
TEXTS: Final = {"unit": UNIT, "window": WINDOW, "pair": PAIR, "shared": SHARED, "lost": SILENT, "alone": ALONE}
FAULTS: Final = {
    "all restart": (r"#elif !RVAFT_BY\n    begin", "#else\n    begin"),
    "none restarts": (r"    restart_detected\(m, s, e, detected\);|    restart\(m, &?\w.*;", "    (void)0;"),
    "what waited goes on": (r"    restart\(m, s, &value\);", ""),
    "one detection at an event": (r"\(detected\[pattern\] = 1, some = 1\)", "return 1"),
}


def found_by(text: str, events: Sequence[Mapping[str, Any]], folder: Path, *options: str) -> list[int]:
    """The numbers of the events at which a program with `--repeat` detects."""
    made = (*options, "-DRVAFT_MAIN=1", "-DRVAFT_PLACES=1", "-DRVAFT_CAPACITY=4096")
    compile_c(text, folder / "monitor", made, command=() if options else fast_compiler())
    data = b"\n".join(json.dumps(one).encode() for one in events)
    code, out, error = status(folder / "monitor", data, "--repeat", "--detections")
    assert code < 2, error
    return [json.loads(line)["event"] for line in out.splitlines()]


@pytest.mark.parametrize("seed", [0, *(pytest.param(seed, marks=pytest.mark.slow) for seed in range(1, 9))])
def test_only_the_detected_value_starts_afresh(seed: int, tmp_path: Path) -> None:
    random, detected = Random(f"C repeat by {seed}"), 0
    for tree in islice(trees(random, 200), 60 if seed else 12):
        try:
            text = BY.translate(tree, SCATTERED).text
        except (NotExpressible, TooLarge):
            continue
        events = events_of(random, 60)
        wanted = [place for place, one in enumerate(detections(tree, events), 1) if one]
        found = found_by(text, events, tmp_path, *(SANITIZERS if seed else ()))
        assert found == wanted, f"{dumps(tree)}\n{json.dumps(events)}"
        detected += len(wanted)
    assert detected > 20


@pytest.mark.parametrize("name", sampled(TEXTS, 6))
def test_sizes_warnings_and_keys(name: str, tmp_path: Path) -> None:
    tree, random = loads(TEXTS[name]), Random(name)
    made = BY.translate(tree, SCATTERED).text
    compile_strictly(made, tmp_path, "-DRVAFT_PLACES=1", "-DRVAFT_MAIN=1")
    size = re.search(r"sizeof\(rvaft_monitor\) is (\d+) bytes", made)
    assert size is not None
    assert int(size[1]) == CMonitor(made).size
    events = [one | {"key": random.choice(("a", 1))} for one in events_of(random, 120)]
    wanted = [place for place, one in enumerate(detections(tree, events), 1) if one]
    assert found_by(made, events, tmp_path, *SANITIZERS) == wanted
    assert wanted
    if not tree.absences:
        compile_c(
            BY.keyed(KEY[:1]).translate(tree, SCATTERED).text + PIECES,
            tmp_path / "keyed",
            (*SANITIZERS, "-DRVAFT_PLACES=1"),
        )
        code, out, error = status(tmp_path / "keyed", b"\n".join(json.dumps(one).encode() for one in events))
        assert code == 0, error
        apart = list[int]()
        for key in ("a", 1):
            own = [place for place, one in enumerate(events, 1) if one["key"] == key]
            every = detections(tree, [events[place - 1] for place in own])
            apart += [place for place, one in zip(own, every, strict=True) if one]
        assert sorted(int(line.split()[-1]) for line in out.splitlines()) == sorted(apart)


@pytest.mark.parametrize("name", FAULTS)
def test_a_fault_is_found(name: str, tmp_path: Path) -> None:
    old, new = FAULTS[name]
    for text in TEXTS.values():
        made = re.sub(old, new, BY.translate(loads(text), SCATTERED).text)
        events = events_of(Random(7), 200)
        wanted = [place for place, one in enumerate(detections(loads(text), events), 1) if one]
        if found_by(made, events, tmp_path) != wanted:
            return
    pytest.fail("no difference")


@pytest.mark.parametrize("text", sampled([UNIT, PAIR, SHARED], 3))
def test_what_started_afresh_leaves_room(text: str, tmp_path: Path) -> None:
    compile_c(
        BY.translate(loads(text), SCATTERED).text,
        tmp_path / "monitor",
        (*SANITIZERS, "-DRVAFT_MAIN=1", "-DRVAFT_CAPACITY=64"),
    )
    log = [{"k": k, "u": f"u{n}", "w": f"u{n}", "v": n} for n in range(2_000) for k in "ab"]
    code, out, error = status(
        tmp_path / "monitor", b"\n".join(json.dumps(one).encode() for one in log), "--repeat", "--detections"
    )
    assert (code, error, out.count("\n")) == (1, "", 2_000)


CLOCK = """
#include <stdio.h>
int main(void) {
    static rvaft_monitor m;
    rvaft_event e = {0};
    int i;
    rvaft_init(&m, 1);
    e.has_time = 1;
    e.field[0] = rvaft_text("a");
    for (i = 0; i < 2; i++) {
        e.time = i * INT64_C(1000000000);
        e.field[1] = integer(i);
        printf("%d ", rvaft_step(&m, &e));
    }
    for (i = 20; i < 35; i += 5) {
        printf("%d ", rvaft_pass_time(&m, i * INT64_C(100000000)));
        rvaft_again(&m);
    }
    printf("%d\\n", rvaft_finish(&m));
    return 0;
}
"""


def test_passing_time_decides_for_each_value(tmp_path: Path) -> None:
    text = BY.translate(loads(LOST), SCATTERED).text
    assert re.findall(r"field\[(\d)\] is (?:k|u)", text) == ["0", "1"]
    compile_c(text + CLOCK, tmp_path / "clock", (*SANITIZERS, "-DRVAFT_JSON=0"))
    assert status(tmp_path / "clock", b"") == (0, "0 0 0 1 0 1\n", "")


def test_a_tree_says_how_it_is_repeated(tmp_path: Path) -> None:
    (file := tmp_path / "tree.rvaft").write_text(f"repeat by U; {UNIT}", encoding="utf-8")
    events = events_of(Random(3), 60)
    (log := tmp_path / "log.jsonl").write_text("\n".join(map(json.dumps, events)), encoding="utf-8")
    wanted = [place for place, one in enumerate(detections(loads(UNIT), events), 1) if one]
    assert len(wanted) > 3
    assert found_by(BACKEND.translate(loads(file.read_text()), SCATTERED).text, events, tmp_path) == wanted
    for semantics, code in ((SCATTERED, 1), (Semantics.CONSECUTIVE, 2)):
        built = run("build", file, "--semantics", semantics, "-o", tmp_path / "built")
        assert built.exit_code == 0, built.stderr
        assert status(tmp_path / "built", log.read_bytes(), "--repeat", "--detections")[0] == code
        assert status(tmp_path / "built", log.read_bytes(), "--detections")[0] < 2
    found = run("monitor", file, log, "--repeat", "--native", "--format", "jsonl", "--detections")
    assert [json.loads(line)["event"] for line in found.stdout.splitlines()] == wanted
    assert "`repeat by U;`" in run("monitor", file, log, "--repeat", "--backend", "c").stderr


@pytest.mark.parametrize(
    ("by", "semantics", "why"),
    [("X", SCATTERED, "the event of b does not bind it"), ("U", Semantics.STRICT, "needs the semantics scattered")],
)
def test_what_cannot_be_repeated_is_refused(by: str, semantics: Semantics, why: str) -> None:
    tree = loads(f'{EVENTS} top sand a b; a on f("a", U, X); b on e("b", U);')
    with pytest.raises(OptionError, match=why):
        BACKEND.repeating(by).translate(tree, semantics)
