"""What several processes read of one file is, to the last word, what one process reads."""

import json
import os
import signal
from itertools import product
from pathlib import Path

import pytest

from rvaft.readers import parallel_blocks
from rvaft.stream import sources
from tests.cli.runs import children, run, started, written
from tests.tables import sampled

TREE = """
event a(v) = { topic: "t", value: v };
event b(v) = { topic: "u", value: v };
time time as s;
toplevel r; r sand x y; x on a(V); y on b(V);
"""
GOOD = [
    {
        "topic": "tuxe"[number % 4],
        "value": number % 7,
        "time": number + 0.25,
        "who": f"{number % 5}",
        "n": "é" * (number % 60),
    }
    for number in range(400)
]
TEXT = "".join(f"{json.dumps(event, ensure_ascii=number % 3 == 0)}\n" for number, event in enumerate(GOOD)).encode()
HALF = TEXT[: TEXT.index(b'"value": 0, "time": 210.25')].rpartition(b"\n")[0] + b"\n"
LOGS = {
    "good": TEXT,
    "a mark, no last end, blank lines": b"\xef\xbb\xbf" + TEXT.replace(b"\n", b"\r\n \n", 30).removesuffix(b"\n"),
    "a long line": HALF + b'{"topic": "t", "value": "%s"}\n' % (b"x" * 9_000) + TEXT,
    "digits, no number, a key by its escape": HALF
    + b'{"topic": "t", "value": NaN, "time": 0.1234567890123456789}\n{"\\u0074opic": "t", "time": 3, "value": [{}]}\n'
    + TEXT,
    "a key twice": HALF + b'{"topic": "t", "topic": "u"}\n' + TEXT,
    "no JSON": HALF + b"{\n" + TEXT,
    "cut short": TEXT[:-9],
    "lines of no more than an end": HALF + b"\n" * 5_000 + TEXT,
    "one line without end": b" " * 9_000 + b"[",
}
OPTIONS = (
    "--semantics scattered --repeat",
    "--semantics projected --key who --per branch",
    "--semantics scattered --order-by n --window 3 --detections --format jsonl",
    "--semantics strict --format jsonl",
    "--semantics scattered --key who --key topic --order-by value --repeat --max-keys 9",
    "--semantics scattered --checkpoint KEPT --checkpoint-every 1000",
    "--semantics scattered --max-configurations 1",
)


@pytest.mark.parametrize(("name", "options"), sampled(product(LOGS, OPTIONS), 3))
def test_the_same_is_said(name: str, options: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(parallel_blocks, "STRETCH", 2_000)
    monkeypatch.setattr(sources, "STRETCH", 2_000)
    tree = written(tmp_path / "tree.rvaft", TREE)
    (tmp_path / "log.jsonl").write_bytes(LOGS[name])

    def said(jobs: int) -> tuple[object, ...]:
        words = [str(tmp_path / f"kept{jobs}") if word == "KEPT" else word for word in options.split()]
        done = run("monitor", tree, tmp_path / "log.jsonl", *words, "--jobs", jobs)
        again = run("monitor", tree, tmp_path / "log.jsonl", *words, "--jobs", jobs) if "KEPT" in options else done
        return done.exit_code, done.stdout, done.stderr, again.stdout, again.stderr

    assert said(2) == said(1)


def test_who_reads_is_killed_and_who_waits_is_told(tmp_path: Path) -> None:
    tree, log = written(tmp_path / "tree.rvaft", TREE), tmp_path / "log.jsonl"
    # times that rise, because a reader that is killed late leaves a warning about others
    log.write_bytes(b"".join(b'{"topic": "t", "value": 1, "time": %d}\n' % number for number in range(800_000)))
    with started("monitor", tree, log, "--semantics", "scattered", "--jobs", 2) as running:
        found: list[str] = []
        while not found and running.poll() is None:
            found = children(running)
        if not found:
            pytest.skip("the system does not tell of processes")
        os.kill(int(found[0]), signal.SIGKILL)
        _, said = running.communicate(timeout=30)
    assert running.returncode == 2
    [line] = said.splitlines()
    assert line.startswith(f"rvaft: error: {log}:")
    assert line.endswith("the process that read it was killed")
