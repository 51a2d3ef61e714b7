"""`rvaft monitor --native`."""

import gzip
import json
from itertools import product
from pathlib import Path
from random import Random

import pytest
from click.testing import Result

from backends.c.library import compiler
from backends.c.log import NativeLog, _functions
from cross_check.generate.traces import detecting
from rvaft import Semantics, loads
from rvaft.cli.native_run import NativeRun
from tests.backends.c.programs import TIED, WINDOW
from tests.cli.runs import TREES, run, started, written
from tests.tables import sampled

pytestmark = pytest.mark.skipif(compiler() is None, reason="needs a C compiler")


@pytest.mark.parametrize(
    "text",
    [TIED, *(pytest.param(one, marks=pytest.mark.ci) for one in (WINDOW, "top or p q; p sand a b; q sand c a fault;"))],
)
@pytest.mark.parametrize("options", [(), ("--repeat",), ("--detections",)])
def test_native_monitoring_explains_as_the_engine_does(
    text: str, options: tuple[str, ...], folder: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("XDG_CACHE_HOME", str(folder))
    random, tree, detections = Random(text), loads(text), 0
    file = tmp_path / "tree.rvaft"
    file.write_text(text, encoding="utf-8")
    for semantics in Semantics:
        log = tmp_path / "log.jsonl"
        trace = [event for _ in range(4) for event in detecting(random, tree, semantics)]
        log.write_text("\n\r\n".join(json.dumps(event) for event in trace), encoding="utf-8")
        call = ("monitor", str(file), str(log), "--format", "jsonl", "--semantics", semantics, *options)
        wanted, found = run(*call), run(*call, "--native")
        records = [json.loads(line) for line in wanted.stdout.splitlines()]
        detections += sum("matched" in record for record in records)
        kept = [{name: value for name, value in record.items() if name != "expected"} for record in records]
        assert [json.loads(line) for line in found.stdout.splitlines()] == kept
        assert (found.exit_code, found.stderr) == (wanted.exit_code, "")
    assert detections >= 4


def test_native_monitoring_of_many_detections(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Blocks of output end within lines."""
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    file, log = tmp_path / "tree.rvaft", tmp_path / "log.jsonl"
    file.write_text("top sand a b;", encoding="utf-8")
    log.write_text('{"event": "a"}\n{"event": "b"}\n{"event": "c"}\n' * 3_000, encoding="utf-8")
    call = ("monitor", str(file), str(log), "--format", "jsonl", "--semantics", "scattered", "--repeat")
    assert run(*call, "--native").stdout == run(*call).stdout


def test_native_monitoring_of_several_logs_with_unusual_numbers(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Values that a strict decoder of JSON refuses, and numbers with more digits than a double."""
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    file = tmp_path / "tree.rvaft"
    file.write_text(
        'time ts as s; event e(n, v) = { event: n, v: v }; top sand a b; a on e("a", X); b on e("b", Y) when Y != X;',
        encoding="utf-8",
    )
    logs = [tmp_path / f"{name}.jsonl" for name in "pqr"]
    for log, ending in zip(logs, (b'"other": NaN', b'"ts": 1772438400.1234567891, "other": 1e999', b""), strict=True):
        lines = [b'{"event": "a", "v": 9007199254740993}', b'{"event": "b", "v": 9007199254740994, %s}' % ending]
        log.write_bytes(b"\xef\xbb\xbf" + b"\n".join(lines[: 2 if ending else 1]) + b"\n")
    call = ("monitor", str(file), *map(str, logs), "--format", "jsonl", "--semantics", "scattered", "--repeat")
    found = run(*call, "--native")
    assert found.stdout == run(*call).stdout
    assert found.stdout.count('"matched"') == 2
    assert '"time": 1772438400.123456' in found.stdout


def test_native_monitoring_needs_a_compiler(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    monkeypatch.setenv("PATH", "")
    monkeypatch.delenv("CC", raising=False)
    monkeypatch.setattr("backends.c.library.find_spec", lambda _: None)
    log = tmp_path / "log.jsonl"
    log.touch()
    for call in (("monitor", str(log), "--native", "--format", "jsonl"), ("build", "-o", str(tmp_path / "made"))):
        found = run(call[0], str(TREES / "gates" / "sand.rvaft"), *call[1:])
        assert found.exit_code == 2
        assert "a C compiler is not installed: install gcc or clang, or pip install" in found.stderr
    assert not (tmp_path / "made").exists()


JOINED = """time ts as s; event e(k, u) = { k: k, user: u };
top or p q; p sand a b within 9 s fault; q sand b c when U != 2;
a on e("a", U); b on e("b", U); c on e("c", U) times 2;"""
KEYS = ("x", "é", 1, 1.0, True, None, [1, {"a": None}], {"id": 2}, 10**30, 1e30, 2.5)


def keyed_log(random: Random, count: int) -> bytes:
    """Events of keys of all types, some without a key, in lines of all kinds. No two matches end at one event."""
    lines = [b"\xef\xbb\xbf"]
    for user in range(count):
        keys = {} if random.random() < 0.1 else {"key": random.choice(KEYS if random.random() < 0.5 else KEYS[:3])}
        keys |= random.choice([{}, {"robot": {"id": 1}}, {"robot.id": 1, "robot": None}])
        for name in random.sample("abccd", 5):
            time = len(lines) + random.choice((0, 0, 0, -2))
            text = json.dumps({"k": name, "user": user, "ts": time, **keys}, ensure_ascii=random.random() < 0.5)
            lines.append(text.encode() + random.choice([b"\n", b"\r\n \n"]))
    return b"".join(lines).rstrip(b"\r\n ")


@pytest.mark.parametrize("keys", [(), ("--key", "key"), ("--key", "robot.id", "--key", "key")])
@pytest.mark.parametrize(
    "options",
    [
        (),
        pytest.param(("--repeat", "--explain"), marks=pytest.mark.ci),
        pytest.param(("--repeat", "--cooldown", "3 s"), marks=pytest.mark.ci),
        ("--repeat", "--format", "jsonl", "--strict-json"),
        pytest.param(("--repeat", "--template", "{event} {line} {key} {a} {U}"), marks=pytest.mark.ci),
        ("--repeat-by", "U"),
    ],
)
@pytest.mark.parametrize("given", ["file", "stream", pytest.param("compressed", marks=pytest.mark.ci)])
def test_native_output_is_that_of_the_engine(
    given: str, options: tuple[str, ...], keys: tuple[str, ...], folder: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("XDG_CACHE_HOME", str(folder))
    (tree := folder / "joined.rvaft").write_text(JOINED, encoding="utf-8")
    data = keyed_log(Random(str((given, options, keys))), 60)
    log = folder / f"log.jsonl{'.gz' if given == 'compressed' else ''}"
    log.write_bytes(gzip.compress(data) if given == "compressed" else data)
    call = ("monitor", tree, "-" if given == "stream" else log, "--semantics", "scattered", *keys, *options)
    wanted, found = (run(*call, *more, data=data if given == "stream" else None) for more in ((), ("--native",)))
    assert (found.stdout, found.stderr, found.exit_code) == (wanted.stdout, wanted.stderr, wanted.exit_code)
    assert found.exit_code == 1
    assert not keys or "without the field" in found.stderr


@pytest.mark.parametrize(
    ("declared", "top"),
    [
        ('event a(x) = { e: "a", x: x };', 'a on a(X) when lower(X) == "u"'),
        ('event a(x) = { e: "a", x: [..., x, ...] };', "a on a(X)"),
        ('event a(x) = { e: "a", x: x }; time t as "%Y-%m-%d";', "a on a(X) within 2 d"),
    ],
)
def test_what_c_refuses_is_refused(declared: str, top: str, tmp_path: Path) -> None:
    within = " within 2 d" if "within" in top else ""
    text = f'{declared} event b(x) = {{ e: "b", x: x }}; top sand a b{within}; {top.removesuffix(within)}; b on b(X);'
    tree = written(tmp_path / "t.rvaft", f"semantics scattered; {text}")
    result = run("monitor", tree, written(tmp_path / "log.jsonl", '{"e": "a"}\n'), "--native")
    assert result.exit_code == 2
    assert "rvaft does not write this tree in c" in result.stderr
    assert result.stderr.rstrip().endswith("omit --native")


@pytest.mark.parametrize("semantics", Semantics)
@pytest.mark.parametrize("text", ["top sand a b;", JOINED])
def test_the_engine_monitors_where_it_does_not_join(
    text: str, semantics: Semantics, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    (tree := tmp_path / "tree.rvaft").write_text(text, encoding="utf-8")
    (log := tmp_path / "log.jsonl").write_bytes(keyed_log(Random(1), 10))
    call = ("monitor", tree, log, "--semantics", semantics, "--key", "key")
    _functions.cache_clear()  # a library that is loaded needs no cache
    assert run(*call, "--native").output == run(*call).output
    joined = text == JOINED and semantics is Semantics.SCATTERED
    assert (tmp_path / "rvaft" / "native").exists() == joined


def test_native_output_of_a_stream_comes_as_its_events_come(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    (tree := tmp_path / "tree.rvaft").write_text(JOINED, encoding="utf-8")
    with started("monitor", tree, "--semantics", "scattered", "--native", "--repeat") as running:
        for time in (1, 2):
            for name in "ab":
                print(json.dumps({"k": name, "user": time, "ts": time}), file=running.stdin)
            assert running.stdout.readline() == f"event {2 * time}: true (detection {time})\n"
            assert "branch 1: fault" in "".join(running.stdout.readline() for _ in range(4))


TEXTS = 'event e(u) = { k: "e", u: u }; top sand a b; a on e(U); b on e(U);'
PRODUCT = "event e(u) = { u: u }; top and x y when U * V == 4; x on e(U); y on e(V);"
ONE_KEY = ("--key", "n", "--max-keys", "1")


@pytest.mark.parametrize(
    ("text", "lines", "wrong"),
    [
        (TIED, [f'{{"k": 1, "u": {number}}}' for number in range(1, 5)], "partial matches or texts of the"),
        (TIED, ['{"k": 1, "u": 1, "n": "x"}', '{"k": 1, "u": 2, "n": "y"}'], "different values of n"),
        (TIED, ['{"k": 1, "u": 1}', '{"k": 1, "u": nope}'], "log.jsonl:2: not JSON"),
        (TEXTS, ['{"k": "e", "u": 1}', '{"k": "f", "u": 1, "u": 1}'], 'log.jsonl:2: the key "u" is repeated'),
        (PRODUCT, ['{"u": 4294967296}'] * 2, "bits of a number or a time in the native monitor (limit 64)"),
    ],
)
def test_without_a_verdict_there_is_an_error(
    text: str, lines: list[str], wrong: str, folder: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    options = ONE_KEY if wrong.endswith(" n") else ()
    monkeypatch.setenv("XDG_CACHE_HOME", str(folder))
    monkeypatch.setattr("backends.c.log.CAPACITY", 3)
    (tree := folder / "tree.rvaft").write_text(text, encoding="utf-8")
    (log := folder / "log.jsonl").write_text("\n".join([*lines, '{"k": 2, "u": 1}']), encoding="utf-8")
    found = run("monitor", tree, log, "--semantics", "scattered", "--native", *options)
    assert found.exit_code == 2
    assert wrong in found.stderr
    assert "verdict" not in found.stdout


LARGE = json.dumps({"k": 1, "u": "x" * 70_000 + "\n"})
"""An event with more text than a native monitor has room for."""


@pytest.mark.parametrize(
    "line",
    [
        *('{"k": 1, "u": nope}', '{"k": 1, "u": 1, "u": 1}', '{"k": 1, "u": {"a": 1, "a": 1}}', "[1]", "1", '{"k": 1'),
        *('{"k": 1, "u": "\\ud800"}', '{"k": 1, "u": "\x01"}', f'{{"k": {"[" * 600}{"]" * 600}}}'),
    ],
)
def test_a_malformed_line_has_the_message_of_the_reader(
    line: str, folder: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("XDG_CACHE_HOME", str(folder))
    (tree := folder / "tied.rvaft").write_text(TIED, encoding="utf-8")
    (log := folder / "wrong.jsonl").write_text(f'{{"k": 1, "u": 1}}\n\n{line}\n{{"k": 2, "u": 1}}\n', encoding="utf-8")
    call, data = ("monitor", tree, "--semantics", "scattered"), log.read_bytes()
    wanted = run(*call, log)
    assert wanted.exit_code == 2
    assert f"{log}:3: " in wanted.stderr
    for options in ((), ("--format", "jsonl")):
        found = run(*call, log, "--native", *options)
        assert (found.exit_code, found.stderr) == (2, wanted.stderr)
    assert run(*call, "--native", data=data).stderr == run(*call, data=data).stderr


def test_a_line_that_is_too_large_is_named(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("XDG_CACHE_HOME", str(folder))
    (tree := folder / "tied.rvaft").write_text(TIED, encoding="utf-8")
    (log := folder / "large.jsonl").write_text(f"{LARGE}\n", encoding="utf-8")
    for options in ((), ("--format", "jsonl")):
        found = run("monitor", tree, log, "--semantics", "scattered", "--native", *options)
        assert found.exit_code == 2
        assert f"{log}:1: " in found.stderr


@pytest.mark.parametrize(
    ("last", "error"), [(2, "the engine has no match at event 2"), (3, "event 3 is no detection of the engine")]
)
@pytest.mark.parametrize("given", ["file", "stream"])
def test_the_engine_checks_each_match(
    given: str, last: int, error: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A monitor in C that names other events is an error."""
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    places = [(1, 1, 0), (last, last, 17 * (last - 1))]
    monkeypatch.setattr(NativeLog, "read", lambda _, __, ended: iter([] if ended else [places]))
    monkeypatch.setattr(NativeLog, "read_file", lambda _, __: iter([places]))
    (tree := tmp_path / "tree.rvaft").write_text(TIED, encoding="utf-8")
    data = '{"k": 1, "u": 1}\n{"k": 2, "u": 2}\n{"j": 2, "u": 2}\n'
    (log := tmp_path / "log.jsonl").write_text(data, encoding="utf-8")
    where = (log,) if given == "file" else ("-",)
    found = run("monitor", tree, *where, "--semantics", "scattered", "--native", data=data)
    assert found.exit_code == 2
    assert f"the native monitor failed: {error}" in found.stderr


def test_memory_is_released_after_each_log(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """The memory of a monitor is mapped for its greatest size, so that a few of them would reach a limit."""
    status = Path("/proc/self/status")
    if not status.is_file() or compiler() is None:
        pytest.skip("needs Linux and a C compiler")
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    (tree := tmp_path / "tree.rvaft").write_text(WINDOW, encoding="utf-8")
    (log := tmp_path / "log.jsonl").write_text('{"event": "a", "user": 1}\n' * 3, encoding="utf-8")

    def mapped() -> int:
        text = status.read_text(encoding="ascii")
        return next(int(line.split()[1]) for line in text.splitlines() if line.startswith("VmSize"))

    sizes = []
    for _ in range(4):
        run("monitor", tree, log, "--semantics", "scattered", "--key", "user", "--native")
        sizes.append(mapped())
    assert sizes[-1] - sizes[0] < 100_000  # kilobytes


COUNTED = """time ts as s late 5 s; event e(k, u) = { k: k, user: u }; event f(k, n, u) = { kind: k, n: n, user: u };
ignore e("d", _);
top or p q r; p sand a b within 9 s fault; q and b c; r sand d1 d2;
a on e("a", U); b on e("b", U); c on f("c", N, U) when N > 3; d1 on e("d", _); d2 on e("e", "u1") times 2;"""
ODD = {
    "a late event": '{"k": "a", "user": "u1", "key": "x", "ts": 1}',
    "an undefined guard": '{"kind": "c", "user": "u1", "n": "7", "key": "x", "ts": 9000}',
    "no time": '{"k": "a", "user": "u1", "key": "x"}',
    "a number that is not finite": '{"k": "a", "user": "u1", "key": "x", "ts": 9000, "other": NaN}',
    "a key that is not finite": '{"k": "a", "user": "u1", "key": NaN, "ts": 9000}',
    "a malformed line": '{"k": "a", "user": "u1", "key": "x", "ts": 9000',
    "a repeated field": '{"k": "a", "k": "b", "user": "u1", "key": "x", "ts": 9000}',
    "many digits": '{"k": "a", "user": "u1", "key": 123456789012345678901234567890, "ts": 9000.1234567891}',
}


def counted_log(random: Random, count: int) -> list[str]:
    """Events in order of time: of the tree, misspelt, of other kinds, with few fields, of several keys."""
    lines, time = list[str](), 0.0
    for _ in range(count):
        time += random.choice((0, 0.25, 1, 2))
        event: dict[str, object] = random.choice(
            [
                {"k": random.choice("aaabbbdex"), "user": random.choice(["u1", "u2", 1, 1.0])},
                {"kind": random.choice(["c", "C", "other"]), "n": random.choice((2, 3.5, 4)), "user": "u1"},
                {"k": random.choice(["a ", "/b", "B", "é" * 300, f"n{random.randrange(9)}"]), "user": "u1"},
                {"k": random.choice("ab")},
                {"unknown": 1, "k": None},
            ]
        )
        event = {**event, "ts": time, **random.choice([{"key": "x"}, {"key": "y"}, {"key": 1}, {"key": 1.0}, {}])}
        lines.append(json.dumps(event, ensure_ascii=random.random() < 0.5) + random.choice(["", "", "\n \r"]))
    return lines


def told(result: Result) -> tuple[list[str], str, int]:
    """The output without the matches, of which several may end at one event."""
    lines = (line for line in result.stdout.splitlines() if not line.startswith("  "))
    return [line.partition(', "branch"')[0] for line in lines], result.stderr, result.exit_code


@pytest.mark.parametrize(
    ("keys", "options"),
    sampled(
        [
            *product(
                [(), ("--key", "key"), ("--key", "key", "--key", "user")],
                [(), ("--repeat",), ("--repeat", "--cooldown", "3 s")],
            ),
            (("--key", "key"), ("--repeat", "--format", "jsonl", "--detections")),
        ],
        4,
    ),
)
def test_a_program_that_reads_a_log_alone_counts_as_the_engine_does(
    keys: tuple[str, ...], options: tuple[str, ...], folder: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("XDG_CACHE_HOME", str(folder))
    (tree := folder / "counted.rvaft").write_text(COUNTED, encoding="utf-8")
    random, logs, detections = Random(str((options, keys))), [folder / "p.jsonl", folder / "q.jsonl"], 0
    for size in (0, 1, 30, 400):
        for log in logs:
            log.write_bytes(b"\xef\xbb\xbf" + "\n".join(counted_log(random, size)).encode())
        for given in (logs[:1], logs):
            call = ("monitor", tree, *given, "--semantics", "scattered", *keys, *options)
            wanted = run(*call)
            with monkeypatch.context() as alone:
                alone.setattr(NativeRun, "trace", None)  # the events are not read by the engine, too
                found = run(*call, "--native")
            assert told(found) == told(wanted)
            detections += wanted.exit_code
    assert detections >= 2


@pytest.mark.parametrize("odd", ODD)
@pytest.mark.parametrize("keys", [(), ("--key", "key")])
def test_what_a_program_may_read_otherwise_is_read_by_the_engine(
    keys: tuple[str, ...], odd: str, folder: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("XDG_CACHE_HOME", str(folder))
    (tree := folder / "counted.rvaft").write_text(COUNTED, encoding="utf-8")
    lines = counted_log(Random(odd), 300)
    lines.insert(250, ODD[odd])
    (log := folder / "odd.jsonl").write_text("\n".join(lines), encoding="utf-8")
    call = ("monitor", tree, log, "--semantics", "scattered", "--repeat", *keys)
    wanted, found = run(*call), run(*call, "--native")
    assert told(found) == told(wanted)


@pytest.mark.parametrize("times", [(), (3, 2), (3, "4"), (1, 2.5), (True, 2), (None, 1)])
def test_times_that_no_tree_declares(times: tuple[object, ...], folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("XDG_CACHE_HOME", str(folder))
    (tree := folder / "plain.rvaft").write_text(
        'event e(k, u) = {event: k, u: u}; top sand a b; a on e("a", U); b on e("b", U);', encoding="utf-8"
    )
    events = [{"event": "a", "u": 1, **({"time": one} if times else {})} for one in times or (0, 0)]
    (log := folder / "plain.jsonl").write_text("\n".join(map(json.dumps, events)), encoding="utf-8")
    call = ("monitor", tree, log, "--semantics", "scattered")
    wanted, found = run(*call), run(*call, "--native")
    assert told(found) == told(wanted)


def test_lines_longer_than_the_buffer(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("XDG_CACHE_HOME", str(folder))
    (tree := folder / "plain.rvaft").write_text(
        'event e(k, u) = {event: k, u: u}; top sand a b; a on e("a", U); b on e("b", U);', encoding="utf-8"
    )
    long = "x" * (3 << 18)
    events = [{"event": "a", "u": long}, {"event": "c"}, {"event": "b", "u": long[1:]}, {"event": "b", "u": long}]
    (log := folder / "long.jsonl").write_text("\n".join(map(json.dumps, events)), encoding="utf-8")
    call = ("monitor", tree, log, "--semantics", "scattered")
    wanted, found = run(*call), run(*call, "--native")
    assert told(found) == told(wanted)
    assert found.exit_code == 1


BURSTS = """time ts as s late LATE; event e(k, u) = { k: k, user: u }; semantics scattered;
top sand x p within 5 s fault; x on e("x", U) times 2; p and y z; y on e("y", U); z on e("z", U);"""
SHARED_USER = """time ts as s late LATE; event e(k, u) = { k: k, user: u }; semantics scattered;
top sand x y z within 5 s; x on e("x", U); y on e("y", V) when V != U; z on e("z", U);"""
REMEDIES = "--max-keys N keeps more", "a greater --max-keys, or a run without --native, may keep more"


def rotating_log(random: Random, count: int, *, early: bool) -> list[str]:
    """Keys that come for a short time, of which some detect; some events come late."""
    lines = list[str]()
    for number in range(count):
        key, whole = f"k{number // 6}", number // 6 % 10 == 0
        name = "xxyzxy"[number % 6] if whole else random.choice("xxxyw")
        time = number / 4 - (random.choice((0, 0, 1.5)) if early else 0)
        lines.append(json.dumps({"k": name, "user": 1, "ts": time, "key": key}))
        if early and number % 100 == 99:
            lines.append(json.dumps({"k": "x", "user": 1, "ts": time - 40, "key": f"k{number // 6 - 30}"}))
    return lines


@pytest.mark.parametrize("early", [False, True])
@pytest.mark.parametrize("late", ["0 s", "2 s"])
def test_keys_are_forgotten_as_by_the_engine(
    late: str, early: bool, folder: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Detections and warnings, of a file and of a stream; a report needs all keys."""
    monkeypatch.setenv("XDG_CACHE_HOME", str(folder))
    (tree := folder / "bursts.rvaft").write_text(BURSTS.replace("LATE", late), encoding="utf-8")
    (log := folder / "rotating.jsonl").write_text(
        "\n".join(rotating_log(Random(late), 3_000, early=early)), encoding="utf-8"
    )
    call = ("monitor", tree, "--key", "key", "--max-keys", "80", "--repeat")

    def shown(result: Result) -> tuple[list[str], list[str], int]:
        found, errors, code = told(result)
        about = [line for line in errors.splitlines() if "were forgotten" in line or "begin with" in line]
        return [line for line in found if line.startswith("event ")], about, code

    wanted = shown(run(*call, log))
    assert wanted[2] == 1
    assert any("begin with an event earlier" in line for line in wanted[1]) is early
    expected = wanted[0], [line.replace(*REMEDIES) for line in wanted[1]], 1
    assert shown(run(*call, log, "--native")) == expected
    found = shown(run(*call, "-", "--native", data=log.read_bytes()))
    assert [line.replace("<stdin>", "") for line in found[0]] == expected[0]
    assert found[1:] == expected[1:]
    report = run(*call, log, "--native", "--report", folder / "report.html")
    assert report.exit_code == 2


def test_keys_of_joins_are_forgotten(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """The engine needs room for all keys to detect the same."""
    monkeypatch.setenv("XDG_CACHE_HOME", str(folder))
    (tree := folder / "joins.rvaft").write_text(SHARED_USER.replace("LATE", "2 s"), encoding="utf-8")
    random, lines = Random(3), list[str]()
    for number in range(3_000):
        user = 2 if (name := "xyzw"[number % 4]) == "y" or random.random() < 0.3 else 1
        lines.append(json.dumps({"k": name, "user": user, "ts": number / 4, "key": f"k{number // 4}"}))
    (log := folder / "joins.jsonl").write_text("\n".join(lines), encoding="utf-8")
    call = ("monitor", tree, log, "--key", "key", "--detections", "--format", "jsonl")
    wanted, few = run(*call), run(*call, "--max-keys", "700", "--native")
    assert few.stdout == wanted.stdout
    assert wanted.stdout.count("\n") > 300


def test_without_room_for_keys_the_option_is_named(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Windows that last, and times that a tree does not bound."""
    monkeypatch.setenv("XDG_CACHE_HOME", str(folder))
    for text in (BURSTS.replace("LATE", "9999 s"), BURSTS.replace(" late LATE", "")):
        (tree := folder / "lasting.rvaft").write_text(text, encoding="utf-8")
        (log := folder / "rotating.jsonl").write_text("\n".join(rotating_log(Random(1), 900, early=False)))
        for where in (log, "-"):
            data = log.read_bytes() if where == "-" else None
            found = run("monitor", tree, where, "--key", "key", "--max-keys", "80", "--native", data=data)
            assert found.exit_code == 2
            assert "too large: different values of" in found.stderr
            assert "(limit 80); raise it with --max-keys N" in found.stderr
            assert "were forgotten" not in found.stderr
