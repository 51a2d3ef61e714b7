"""Programs of `rvaft build` beside `orjson.loads`: processor time, as a ratio within one run.

`pytest tests/benchmarks/test_native.py -s -m slow` prints the table.
"""

import json
import subprocess
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from random import Random
from resource import RUSAGE_CHILDREN, getrusage

import orjson
import pytest

from backends.c.library import CAPACITY, build_program, compiler
from rvaft import Semantics, load, loads, translate
from tests.benchmarks.conftest import Ratios
from tests.benchmarks.logs import SSHD_TREE, TREE, attacks, inspections, sshd, telemetry
from tests.cli.runs import COMMAND

pytestmark = [
    pytest.mark.benchmark,
    pytest.mark.slow,
    pytest.mark.skipif(compiler() is None, reason="needs a C compiler"),
]
EVENTS = 300_000
USERS = "time ts as s late 0 s; event e(k, u) = { event: k, user: u }; top TOP;" + "".join(
    f' {k} on e("{k}", U);' for k in "wxyz"
)


def logins(file: Path, users: int = 500) -> None:
    """Four types of events of some users, 100 events a second."""
    random = Random(1)

    def lines() -> Iterator[str]:
        for number in range(EVENTS):
            event = {"event": random.choice("wxyz"), "user": f"user{random.randrange(users)}", "ts": number / 100}
            yield json.dumps({**event, "host": "h1", "path": "/usr/bin/ls"}) + "\n"

    with file.open("w", encoding="utf-8") as out:
        out.writelines(lines())


PAPER = TREE.read_text(encoding="utf-8")
CASES: dict[str, tuple[Callable[[Path], object], str, tuple[str, ...], float]] = {
    "telemetry": (lambda file: telemetry(file, EVENTS), PAPER, (), 0.35),
    "all relevant": (lambda file: inspections(file, EVENTS), PAPER, ("--repeat",), 0.6),
    "30,000 detections": (attacks, PAPER, ("--repeat",), 1.0),
    "a join in 1 s": (logins, USERS.replace("TOP", "sand w x y z within 1 s"), ("--repeat",), 0.7),
    "a join in 40 s": (logins, USERS.replace("TOP", "sand w x y z within 40 s"), ("--repeat",), 0.7),
    "an AND of four": (logins, USERS.replace("TOP", "and w x y z within 40 s"), ("--repeat",), 0.85),
}
"""For each log: how it is made, the tree, options, and the most time as a multiple of `orjson.loads`."""


def decoding(log: Path) -> float:
    start = time.process_time()
    with log.open("rb") as lines:
        for line in lines:
            orjson.loads(line)
    return time.process_time() - start


def running(*command: Path | str) -> float:
    before = getrusage(RUSAGE_CHILDREN)  # in microseconds, where os.times() counts hundredths of a second
    subprocess.run(command, stdout=subprocess.DEVNULL, check=False)
    after = getrusage(RUSAGE_CHILDREN)
    return after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime


@pytest.mark.parametrize("case", CASES)
def test_programs_beside_decoding(
    case: str, tmp_path: Path, capsys: pytest.CaptureFixture[str], ratios: Ratios
) -> None:
    make, text, options, most = CASES[case]
    log, program = tmp_path / "log.jsonl", tmp_path / "monitor"
    make(log)
    tree = load(TREE) if text is PAPER else loads(text)
    build_program(translate(tree, "c", semantics=Semantics.SCATTERED).text, program, CAPACITY)
    found = subprocess.run([program, *options, "--detections", log], capture_output=True, check=False).stdout
    times = [(running(program, *options, log), decoding(log)) for _ in range(3)]
    ratio = min(one for one, _ in times) / min(other for _, other in times)
    ratios.add(f"native: {case}", "orjson.loads", ratio, most)
    with capsys.disabled():
        print(f"\n{case:20} {ratio:5.2f} times orjson.loads, {found.count(b'verdict'):6} detections")
    assert ratio < most


FAILED = """time ts as s late 0 s; event e(k, u) = { event: k, user: u };
top and failed within 60 s; failed on e("w", U) times 5;"""


def test_keys_beside_decoding(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str], ratios: Ratios
) -> None:
    """`rvaft monitor --native --key`: 4,237 users, one monitor each, with the summary."""
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    (tree := tmp_path / "tree.rvaft").write_text(FAILED, encoding="utf-8")
    logins(log := tmp_path / "log.jsonl", users=4_237)
    call = [
        *COMMAND,
        "monitor",
        str(tree),
        str(log),
        "--semantics",
        "scattered",
        "--key",
        "user",
        "--repeat",
        "--native",
    ]
    subprocess.run(call, stdout=subprocess.DEVNULL, check=False)  # compiles
    seconds = min(running(*call) for _ in range(3))
    ratio = seconds / min(decoding(log) for _ in range(3))
    ratios.add("native: keys", "orjson.loads", ratio, 8)
    with capsys.disabled():
        print(f"\n{'keys':20} {ratio:5.2f} times orjson.loads, {EVENTS / seconds:,.0f} events a second")
    assert ratio < 8


ROTATING = 'time ts as s late LATE s; event e(k) = { event: k }; top sand f ok within 60 s; f on e("f") times 3; ok;'
KEYS = 1_000_000


@pytest.mark.parametrize("late", [0, 5])
def test_a_million_keys_that_rotate(
    late: int, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str], ratios: Ratios
) -> None:
    """`--native --key` in the room for 20,000: one address in 10,000 fails three times, and then succeeds."""
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    (tree := tmp_path / "tree.rvaft").write_text(ROTATING.replace("LATE", str(late)), encoding="utf-8")
    with (log := tmp_path / "log.jsonl").open("w", encoding="utf-8") as out:
        for number in range(KEYS):
            for name in ("f", "f", "f", "ok") if number % 10_000 == 0 else ("f",):
                out.write(json.dumps({"event": name, "ip": f"a{number}", "ts": number / 100}) + "\n")
    call = [*COMMAND, "monitor", str(tree), str(log), "--semantics", "scattered", "--key", "ip", "--max-keys", "20000"]
    call += ["--repeat", "--native"]
    done = subprocess.run(call, capture_output=True, text=True, check=False)
    assert f"\ndetections: {KEYS // 10_000}\n" in done.stdout
    assert "whose windows had passed were forgotten" in done.stderr
    ratio = running(*call) / decoding(log)
    ratios.add(f"native: a million keys, late {late} s", "orjson.loads", ratio, 6)
    with capsys.disabled():
        print(f"\n{'a million keys':20} {ratio:5.2f} times orjson.loads")
    assert ratio < 6


def test_logins_beside_decoding(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str], ratios: Ratios
) -> None:
    """Five failures of an address, then a success, of 4,000 addresses: the command without its start."""
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    (tree := tmp_path / "tree.rvaft").write_text(SSHD_TREE, encoding="utf-8")
    known = sshd(log := tmp_path / "log.jsonl")
    (empty := tmp_path / "empty.jsonl").touch()
    call = (*COMMAND, "monitor", str(tree), "--key", "ip", "--repeat", "--native")
    found = subprocess.run([*call, str(log)], capture_output=True, text=True, check=False).stdout  # compiles
    assert f"\ndetections: {known.total()}\n" in found
    monkeypatch.delenv("PYTHONDONTWRITEBYTECODE", raising=False)  # as where rvaft is installed
    monkeypatch.setenv("PYTHONPYCACHEPREFIX", str(tmp_path / "bytecode"))
    running(*call, empty)
    rounds = [(running(*call, log), running(*call, empty), decoding(log)) for _ in range(3)]
    whole, start, decoded = (min(times) for times in zip(*rounds, strict=True))
    ratios.add("native: keys of sshd", "orjson.loads", (whole - start) / decoded, 1.5)
    ratios.add("native: keys of sshd, with the start", "orjson.loads", whole / decoded, 1.7)
    with capsys.disabled():
        print(f"\n{'keys of sshd':20} {(whole - start) / decoded:5.2f}, with the start {whole / decoded:5.2f}")
    assert (whole - start) / decoded < 1.5
    assert whole / decoded < 1.7


def test_text_output_is_not_slower_than_the_engine(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str], ratios: Ratios
) -> None:
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    telemetry(log := tmp_path / "log.jsonl", EVENTS)
    call = (*COMMAND, "monitor", str(TREE), str(log), "--semantics", "scattered")
    running(*call, "--native")  # compiles
    rounds = [(running(*call, "--native"), running(*call), decoding(log)) for _ in range(3)]
    native, engine, decoded = (min(times) for times in zip(*rounds, strict=True))
    ratios.add("native: telemetry as text", "the engine", native / engine, 1.0)
    with capsys.disabled():
        print(f"\n{'telemetry as text':20} {native / decoded:5.2f}, the engine {engine / decoded:5.2f}")
    assert native <= engine


def choices(number: int) -> tuple[str, list[str]]:
    """An AND of choices of two leaves, and their events."""
    names = [f"o{one}" for one in range(number)]
    gates = "".join(f" {name} or {name}a {name}b;" for name in names)
    top = f"top and all never within 1 h; never; all and {' '.join(names)};"
    return f"{top}{gates}", [f"{name}{leaf}" for name in names for leaf in "ab"]


def counted(number: int, window: str) -> tuple[str, list[str]]:
    return f'event e(n, u) = {{ event: n, user: u }}; top and f{window}; f on e("f", U) times {number};', ["f"]


def votes(number: int) -> tuple[str, list[str]]:
    """A third of some leaves, and their events."""
    names = [f"v{one}" for one in range(number)]
    return f"top and some never within 1 h; never; some {max(2, number // 3)}of{number} {' '.join(names)};", names


VOTES = [f"o{one}" for one in range(8)]
GROWING: dict[str, tuple[list[tuple[str, list[str]]], float]] = {
    "AND of 5, 10, 20, 40 choices": ([choices(one) for one in (5, 10, 20, 40)], 5),
    "3 of 8": (
        [(f"top and {' '.join(VOTES)} within 1 h;", VOTES), (f"top 3of8 {' '.join(VOTES)} within 1 h;", VOTES)],
        2,
    ),
    "a third of 5, 10, 20, 40": ([votes(one) for one in (5, 10, 20, 40)], 8),
    "times 5, 50, 500": ([counted(one, "") for one in (5, 50, 500)], 3.5),
    "times 5, 50, 500 in 1 h": ([counted(one, " within 1 h") for one in (5, 50, 500)], 3.5),
}
"""Trees of which each is larger than the one before, and the most time of the last as a multiple of the first."""


LATE = {"in order": (" late 0 s", 0), "disorder": (" late 5 s", 5), "no late": ("", 5)}
"""What a tree says of late events, and by how many seconds times may decrease."""


@pytest.mark.parametrize("places", [False, True], ids=["verdicts", "places"])
@pytest.mark.parametrize("order", LATE)
@pytest.mark.parametrize("case", GROWING)
def test_time_for_an_event_of_larger_trees(
    case: str, order: str, *, places: bool, tmp_path: Path, capsys: pytest.CaptureFixture[str], ratios: Ratios
) -> None:
    """A unit keeps one match of a node, or those that lie in no other: 40 choices of two have a million million."""
    trees, most = GROWING[case]
    late, disorder = LATE[order]
    seconds, log, program = [], tmp_path / "log.jsonl", tmp_path / "monitor"
    for text, names in trees:
        random = Random(1)
        lines = (
            {
                "event": random.choice(names),
                "user": f"u{random.randrange(1000)}",
                "ts": number - random.randrange(1 + disorder),
            }
            for number in range(EVENTS)
        )
        log.write_text("".join(json.dumps(line) + "\n" for line in lines), encoding="utf-8")
        written = translate(loads(f"time ts as s{late}; {text}"), "c", semantics=Semantics.SCATTERED)
        build_program(written.text, program, 2 * CAPACITY, places=places)
        call = (program, "--detections", "--repeat", log)
        assert subprocess.run(call, capture_output=True, check=False).stderr == b""
        seconds.append(min(running(*call) for _ in range(3)))
    name = f"native: {case}, {order}{', with places' if places else ''}"
    ratios.add(name, "the smallest", seconds[-1] / seconds[0], most)
    with capsys.disabled():
        print(f"\n{case:30} {order:9} {', '.join(f'{one / EVENTS * 1e6:.2f}' for one in seconds)} µs an event")
    assert seconds[-1] / seconds[0] < most
