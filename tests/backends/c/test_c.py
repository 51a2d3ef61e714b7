"""Monitors in C: warnings, sanitizers, static analysis, and the program of `rvaft build`."""

import gc
import json
import re
import shutil
import struct
import subprocess
import sys
from collections.abc import Sequence
from importlib.util import find_spec
from itertools import product
from pathlib import Path
from random import Random
from weakref import ref

import pytest

from backends.c import CBackend
from backends.c.library import CMonitor, compile_c, compiler
from cross_check.generate.disturbances import disturbed
from cross_check.generate.traces import NoTraceFound, detecting, random_trace
from cross_check.generate.trees import Shape, random_tree
from rvaft import RVAFT, LanguageError, NotExpressible, Semantics, TooLarge, TraceError, load, loads, monitor
from rvaft.core.fields_to_read import TreeReads
from rvaft.errors import NoVerdict
from rvaft.model.values import Json
from rvaft.model.verdict import Verdict
from rvaft.monitors import Repetition
from rvaft.readers.json_lines import decode
from rvaft.semantics import Reference
from tests.backends.c.programs import (
    BACKEND,
    SANITIZERS,
    SCATTERED,
    TIED,
    WARNINGS,
    WINDOW,
    compile_strictly,
    program,
    status,
)
from tests.backends.texts import SHAPES
from tests.cli.runs import TREES, run
from tests.docs.examples import ROOT
from tests.tables import part_and_whole, sampled

pytestmark = pytest.mark.skipif(compiler() is None, reason="needs a C compiler")
KEY = [(("key",), ("key",)), (("a.b",), ("a", "b"))]
VARIED = (
    "top or a b;",
    TIED,
    WINDOW,
    "time ts as iso8601; top and a b c within 5 s;",
    "time t.stamp as ros; top pand p q; p and a b; q and c d when at(c) >= at(a) + 1 s;",
    """event e(v, w) = { v: v, l: [1, w] }; ignore e(X, _) when like(X, "*a?"); top 2of3 a b c;
    a on e(X, Y) when X + 1 > Y / 2 or startswith(Y, "z"); b on e(Y, X) when number(X) * 2.5 != min(Y, 3); c;""",
)


def trees() -> list[RVAFT]:
    shipped = [load(file) for file in (TREES / "remote_inspection" / "pruned.rvaft", TREES / "gates" / "vot.rvaft")]
    return [*map(loads, VARIED), *shipped]


@pytest.mark.ci
@pytest.mark.parametrize("name", ["gcc", "clang"])
@pytest.mark.parametrize(
    "options",
    [("-DRVAFT_MAIN=1", "-O0"), ("-DRVAFT_JSON=0", "-O2")],
    ids=["program", "embedded"],
)
def test_no_warnings(name: str, options: Sequence[str], tmp_path: Path) -> None:
    if shutil.which(name) is None:
        pytest.skip(f"needs {name}")
    for tree in trees():
        for semantics in (Semantics.PROJECTED, SCATTERED) if "-O2" in options else (SCATTERED,):
            text = BACKEND.translate(tree, semantics).text
            compile_strictly(text, tmp_path, *options, compiler=name)
        text = BACKEND.keyed(KEY).translate(tree, SCATTERED).text
        compile_strictly(text, tmp_path, *options, "-DRVAFT_PLACES=1", compiler=name)


@pytest.mark.parametrize(
    ("text", "options", "semantics"),
    sampled(product([TIED, WINDOW, "top sand a b;"], [(), ("--repeat",), ("--detections",)], Semantics), 13, ci=4),
)
def test_the_output_of_monitor(
    text: str, options: tuple[str, ...], semantics: Semantics, folder: Path, tmp_path: Path
) -> None:
    random, tree = Random(text), loads(text)
    traces = [detecting(random, tree, SCATTERED) for _ in range(8)]
    log = tmp_path / "log.jsonl"
    log.write_text("\n\n".join(json.dumps(event) for trace in traces for event in trace), encoding="utf-8")
    file = tmp_path / "tree.rvaft"
    file.write_text(text, encoding="utf-8")
    known = ("event", "verdict", "line", "detection")
    ours = run("monitor", str(file), str(log), "--format", "jsonl", "--semantics", semantics, *options)
    records = [json.loads(line) for line in ours.stdout.splitlines()]
    wanted = [{name: record[name] for name in known if name in record} for record in records]
    code, out, error = status(program(text, folder, semantics), log.read_bytes(), *options)
    assert [json.loads(line) for line in out.splitlines()] == wanted, error
    assert code == ours.exit_code


def test_a_full_array_is_no_verdict(folder: Path) -> None:
    log = b"".join(b'{"k": 1, "u": %d}\n' % number for number in range(100))
    code, out, error = status(program(TIED, folder, capacity=64), log)
    assert (code, out.count("\n")) == (3, 64)
    assert error == "<stdin>:65: error: an array is full: build with a larger --capacity\n"


def test_windows_bound_what_is_stored(folder: Path) -> None:
    log = b"".join(b'{"k": 1, "u": "user%d", "ts": %d}\n' % (number, number) for number in range(20_000))
    code, out, error = status(program(WINDOW, folder, capacity=64), log + b'{"k": 2, "u": "user19995", "ts": 20000}')
    assert (code, error, out.splitlines()[-1]) == (1, "", '{"event": 20001, "verdict": "true", "line": 20001}')


@pytest.mark.parametrize(
    ("tree", "first", "second", "found"),
    [
        ("top sand a b;", "ab", "xb", 1),
        ("time ts as s late 1 s; top sand a b within 5 s;", "....ab", "ab", 2),
    ],
)
def test_a_second_log_begins_anew(tree: str, first: str, second: str, found: int, tmp_path: Path) -> None:
    monitor, logs = program(tree, tmp_path), [tmp_path / "1.jsonl", tmp_path / "2.jsonl"]
    for log, names in zip(logs, (first, second), strict=True):
        lines = (json.dumps({"event": name, "ts": number}) + "\n" for number, name in enumerate(names))
        log.write_text("".join(lines), encoding="utf-8")
    code, printed, _ = status(monitor, b"", "--detections", *map(str, logs))
    assert (code, printed.count("verdict")) == (1, found)


@pytest.mark.parametrize(
    ("tree", "event"),
    [
        ("event e(v) = { v: v }; top or a; a on e(V) when V * V > 1;", {"v": 2**40}),
        ("event e(v) = { v: v }; top or a; a on e(V) when V + 1 > 1;", {"v": 10**20}),
        ("time ts as s; top and a b within 1 s;", {"event": "a", "ts": 10**12}),
    ],
)
def test_more_than_64_bits_are_no_verdict(tree: str, event: Json) -> None:
    monitor = CMonitor(BACKEND.translate(loads(tree), SCATTERED).text)
    assert "needs more than 64 bits" in (monitor.left_open or (lambda _: ""))([event])
    with pytest.raises(NoVerdict):
        monitor.step(event)


@pytest.mark.parametrize(
    ("backend", "semantics"), [*((BACKEND, one) for one in Semantics), (BACKEND.keyed(KEY), SCATTERED)]
)
def test_the_size_is_told(backend: CBackend, semantics: Semantics) -> None:
    for tree in trees():
        text = backend.translate(tree, semantics).text
        found = re.search(r"sizeof\(rvaft_monitor\) is (\d+) bytes", text)
        assert found is not None
        assert int(found[1]) == CMonitor(text).size


def test_a_letter_of_more_than_64_bits_is_no_failure(tmp_path: Path) -> None:
    (tree := tmp_path / "tree.rvaft").write_text(
        "event p(v) = { x: v }; top or a b; a on p(X) when not X / 2 > null; b on p(2);", encoding="utf-8"
    )
    done = run("cross-check", tree, "--backends", "c", "--semantics", "scattered")
    assert done.exit_code == 0, done.output
    assert re.search(r" c .* tested: .*masked \(a number or a time needs more than 64 bits\)", done.stdout)


def test_memory_is_released_without_a_collection() -> None:
    """The state of a monitor has its greatest size, so that a few hundred of them would reach a limit."""
    made = CMonitor(BACKEND.translate(loads(WINDOW), SCATTERED).text)
    twin = made.fork()
    gone = [ref(made), ref(twin)]
    gc.disable()
    try:
        del made, twin
        assert [one() for one in gone] == [None, None]
    finally:
        gc.enable()


def test_other_texts() -> None:
    with pytest.raises(LanguageError, match="not a monitor in C"):
        BACKEND.read("int x;")
    with pytest.raises(LanguageError, match="not a monitor in C"):
        BACKEND.read("nonsense")


def test_a_changed_text_has_no_list_of_tests() -> None:
    text = BACKEND.translate(loads('top sand a b; b on x("*/é"); event x(v) = { v: v };'), SCATTERED).text
    assert len(BACKEND.observed(text) or ()) == 2
    assert BACKEND.observed(f"{text} ") is None


ANALYSED = """
#include "__fc_builtin.h"
static rvaft_monitor the_monitor;
static char text[16];
static rvaft_event e;
void analysed(void) {
    rvaft_init(&the_monitor, 1);
    Frama_C_make_unknown(text, sizeof text);
    while (Frama_C_interval(0, 1)) {
        int i;
        e.time = Frama_C_long_long_interval(INT64_MIN, INT64_MAX);
        e.has_time = Frama_C_interval(0, 1);
        for (i = 0; i < RVAFT_FIELDS; i++) {
            e.field[i].text = text;
            e.field[i].size = (uint32_t)Frama_C_interval(0, 16);
            e.field[i].real = Frama_C_double_interval(-1e300, 1e300);
            e.field[i].integer = Frama_C_long_long_interval(INT64_MIN, INT64_MAX);
            e.field[i].tag = (uint32_t)Frama_C_interval(0, RVAFT_TEXT);
        }
        (void)rvaft_step(&the_monitor, &e);
        if (Frama_C_interval(0, 1)) {
            rvaft_again(&the_monitor);
        }
    }
}
"""
"""Any number of any events, with a new start after some of them."""


SCANNED = """
#include "__fc_builtin.h"
static rvaft_reader the_reader;
static char line[64];
void analysed(void) {
    rvaft_event e;
    size_t size = (size_t)Frama_C_interval(0, 40);
    Frama_C_make_unknown(line, sizeof line);
    line[size] = '\\n';
    (void)rvaft_read(&the_reader, line, size, &e);
}
"""
"""Any line of up to 40 bytes."""
TIMES = """
#include "__fc_builtin.h"
static char line[64];
static rvaft_event the_event;
static void read_times(int least, int most, const char *text) {
    int64_t time = 0;
    uint32_t i;
    for (i = 0; i < RVAFT_FIELDS; i++) {
        the_event.field[i].tag = (uint32_t)Frama_C_interval(least, most);
        the_event.field[i].integer = Frama_C_long_long_interval(INT64_MIN, INT64_MAX);
        the_event.field[i].text = text;
        the_event.field[i].size = text == NULL ? 0U : (uint32_t)Frama_C_interval(0, 40);
    }
    (void)READ_TIME(&the_event, &time);
}
void analysed(void) {
    Frama_C_make_unknown(line, sizeof line);
    read_times(RVAFT_ABSENT, RVAFT_TEXT, line);
    read_times(RVAFT_OBJECT, RVAFT_LIST, NULL);
}
"""
"""Any values of the field of the time."""
WHOLE = """
#include "__fc_builtin.h"
static rvaft_reader the_reader;
static char line[64];
void analysed(void) {
    rvaft_value v = {0};
    int undefined = 0;
    Frama_C_make_unknown(line, sizeof line);
    Frama_C_make_unknown(the_reader.scratch, sizeof the_reader.scratch);
    Frama_C_make_unknown((char *)the_reader.member, sizeof the_reader.member);
    the_reader.reason = "";
    the_reader.text = line;
    the_reader.size = (size_t)Frama_C_interval(0, 40);
    the_reader.used = (uint32_t)Frama_C_interval(0, RVAFT_SCRATCH);
    the_reader.at = (size_t)Frama_C_interval(0, 40);
    the_reader.members = (uint32_t)Frama_C_interval(0, MEMBERS);
    (void)canonical(&the_reader, &undefined);
    /*@ assert the_reader.used <= RVAFT_SCRATCH && the_reader.members <= MEMBERS; */
    (void)whole_value(&the_reader, &v, (size_t)Frama_C_interval(0, 40));
}
"""
"""Any value in a line of up to 40 bytes; inner values are what the contract of `canonical` says."""
needs_frama_c = pytest.mark.skipif(
    shutil.which("frama-c") is None, reason="needs Frama-C (apt-get install frama-c-base)"
)
GATES = {name: load(TREES / "gates" / f"{name}.rvaft") for name in ("or", "and", "sand", "sand_rl", "pand", "vot")}
WITHIN = loads("time ts as s late 0 s; top sand a b within 10 s;")
NESTED = loads(
    "time ts as s late 0 s; top and f g within 9 s; f times 3; g sand a h; h pand c d; c and p q; d sand r s;"
)


def analysis(text: str, file: Path, *options: str) -> str:
    file.write_text(text, encoding="utf-8")
    command = ["frama-c", "-machdep", "gcc_x86_64", "-main", "analysed", "-warn-special-float", "none", *options]
    return subprocess.run([*command, file, "-eva"], capture_output=True, text=True, check=False, timeout=900).stdout


@pytest.mark.slow
@needs_frama_c
@pytest.mark.parametrize(
    ("tree", "semantics"),
    [*product(GATES.values(), Semantics), (WITHIN, SCATTERED), (NESTED, SCATTERED)],
    ids=lambda one: str(one)[:40],
)
def test_no_run_time_errors_by_eva(tree: RVAFT, semantics: Semantics, tmp_path: Path) -> None:
    """The functions that a contract names write no more than it says."""
    text = BACKEND.translate(tree, semantics).text
    options = ("-cpp-extra-args=-DRVAFT_JSON=0", "-eva-precision", "1", "-from-verify-assigns")
    found = analysis(text + ANALYSED, tmp_path / "monitor.c", *options)
    assert "  0 alarms generated by the analysis" in found, found[-2000:]
    assert not re.search(r"function (match|relevant|scattered|replaced|insert_starts): assigns got status", found)


PAGE = (ROOT / "docs" / "reference" / "languages" / "c.md").read_text(encoding="utf-8")
SHIPPED = sorted(
    str(file.relative_to(TREES).with_suffix(""))
    for file in TREES.rglob("*.rvaft")
    if file.parent.name != "gates" and file.name != "listing.rvaft"  # with an error, as published
)


@pytest.mark.slow
@needs_frama_c
@pytest.mark.parametrize("name", SHIPPED)
def test_no_run_time_errors_of_shipped_trees_by_eva(name: str, tmp_path: Path) -> None:
    text = BACKEND.translate(load(TREES / f"{name}.rvaft"), SCATTERED).text
    options = ("-cpp-extra-args=-DRVAFT_JSON=0 -DRVAFT_CAPACITY=4", "-eva-precision", "1")
    found = analysis(text + ANALYSED, tmp_path / "monitor.c", *options)
    assert "  0 alarms generated by the analysis" in found, found[-2000:]


@pytest.mark.slow
@needs_frama_c
def test_no_run_time_errors_of_the_scanner_by_eva(tmp_path: Path) -> None:
    """With the conversion of decimals, and the digits of those with more than 64 bits."""
    text = BACKEND.translate(load(TREES / "gates" / "sand.rvaft"), SCATTERED).text
    options = ("-cpp-extra-args=-DRVAFT_SCRATCH=512", "-eva-precision", "1")
    found = analysis(text + SCANNED, tmp_path / "monitor.c", *options)
    assert "  0 alarms generated by the analysis" in found, found[-2000:]
    assert {"nearest", "digits_of"} <= set(re.findall(r"Values at end of function (\w+)", found))


@pytest.mark.slow
@needs_frama_c
@pytest.mark.parametrize("form", ["s", "ns", "iso8601", "filetime", "ros"])
def test_no_run_time_errors_of_times_by_eva(form: str, tmp_path: Path) -> None:
    text = BACKEND.translate(loads(f"time ts as {form} late 1 s; top sand a b within 2 s;"), SCATTERED).text
    found = analysis(text + TIMES, tmp_path / "monitor.c", "-eva-precision", "1")
    assert "  0 alarms generated by the analysis" in found, found[-2000:]
    assert not re.search("function mem.* got status unknown", found)
    assert "Values at end of function read_times" in found


SHARED = "time ts as s late 0 s; event e(k, u) = { k: k, u: u }; top sand a b within 10 s;" + "".join(
    f' {name} on e("{name}", U);' for name in "ab"
)


@pytest.mark.slow
@needs_frama_c
@pytest.mark.parametrize("options", ["-DRVAFT_PLACES=1", "-DRVAFT_KEYS=3", "-DRVAFT_PLACES=1 -DRVAFT_KEYS=3"])
@pytest.mark.parametrize("text", [SHARED, "top and x y z;"])
def test_no_run_time_errors_with_keys_and_places_by_eva(text: str, options: str, tmp_path: Path) -> None:
    written = BACKEND.keyed([(("key",), ("robot", "id"))]) if "KEYS" in options else BACKEND
    extra = f"-cpp-extra-args=-DRVAFT_JSON=0 -DRVAFT_CAPACITY=4 {options}"
    source = written.translate(loads(text), SCATTERED).text
    found = analysis(source + ANALYSED, tmp_path / "monitor.c", extra, "-eva-precision", "1")
    assert "  0 alarms generated by the analysis" in found, found[-2000:]
    assert not re.search("function mem.* got status unknown", found)
    assert {"key_of", "copy_places", "note_match"} & set(re.findall(r"Values at end of function (\w+)", found))


FRONTED = {
    "add_windows": "time ts as s late 2 s; top sand a p within 10 s; p 2of3 b c d; a times 2;",
    "join_best": "time ts as s late 2 s; top and x y within 10 s; x 2of3 b c d; y sand e a; a times 2;",
}
"""Functions, and trees that call them."""


@pytest.mark.slow
@needs_frama_c
@pytest.mark.parametrize("function", FRONTED)
def test_no_run_time_errors_of_fronts_by_eva(function: str, tmp_path: Path) -> None:
    extra = "-cpp-extra-args=-DRVAFT_JSON=0 -DRVAFT_CAPACITY=4 -DRVAFT_PLACES=1"
    text = BACKEND.translate(loads(FRONTED[function]), SCATTERED).text
    found = analysis(text + ANALYSED, tmp_path / "monitor.c", extra, "-eva-precision", "1")
    assert "  0 alarms generated by the analysis" in found, found[-2000:]
    assert function in re.findall(r"Values at end of function (\w+)", found)


@pytest.mark.slow
@needs_frama_c
def test_no_run_time_errors_of_whole_values_by_eva(tmp_path: Path) -> None:
    """By induction: the contract of inner calls of `canonical` is assumed, and that of the outer call is asserted."""
    text = BACKEND.translate(loads("event e(u) = { u: u }; top sand a b; a on e(U); b on e(U);"), SCATTERED).text
    options = ("-cpp-extra-args=-DRVAFT_SCRATCH=512", "-eva-precision", "1", "-eva-unroll-recursive-calls", "0")
    found = analysis(text + WHOLE, tmp_path / "monitor.c", *options, "-from-verify-assigns")
    assert "  0 alarms generated by the analysis" in found, found[-2000:]
    assert not re.search("function (mem.*|canonical: (assigns|precondition).*) got status", found)
    assert re.search(r"Assertions +1 valid +0 unknown", found)
    assert "Values at end of function note_members" in found


PROVED = (
    "rvaft_step",
    "step",
    "decided",
    "is_late",
    *("add", "subtract", "multiply", "unusable", "unsupported", "result", "rvaft_real"),
    *("plain", "integer", "is_number", "as_real", "magnitude"),
)
"""The functions whose contracts and accesses WP proves."""


@pytest.fixture(scope="module")
def provers() -> str:
    found = (
        ""
        if shutil.which("frama-c") is None
        else subprocess.run(["frama-c", "-wp-detect"], capture_output=True, text=True, check=False).stdout
    )
    if not all(f"[{name}|" in found for name in ("z3", "cvc4")):
        pytest.skip("needs Frama-C, Z3 and CVC4 (apt-get install frama-c-base why3 z3 cvc4; why3 config detect)")
    return "z3,cvc4"


@pytest.mark.slow
@pytest.mark.parametrize(
    ("tree", "semantics"),
    [*((GATES["sand"], one) for one in Semantics), (WITHIN, SCATTERED), (loads(TIED), SCATTERED)],
    ids=lambda one: str(one)[:40],
)
def test_contracts_by_wp(tree: RVAFT, semantics: Semantics, provers: str, tmp_path: Path) -> None:
    file = tmp_path / "monitor.c"
    file.write_text(BACKEND.translate(tree, semantics).text, encoding="utf-8")
    command = ["frama-c", "-machdep", "gcc_x86_64", "-cpp-extra-args=-DRVAFT_JSON=0", "-warn-special-float", "none"]
    proof = ["-wp", "-wp-rte", "-wp-prover", provers, "-wp-timeout", "60", "-wp-fct", ",".join(PROVED)]
    found = subprocess.run([*command, *proof, file], capture_output=True, text=True, check=False, timeout=900).stdout
    goals = re.search(r"Proved goals:\s+(\d+) / (\d+)", found)
    assert goals is not None, found[-2000:]
    assert goals[1] == goals[2], re.findall(r".*(?:Failed|Timeout|Unknown).*", found)
    assert {f"typed_{name}_" for name in PROVED} <= set(re.findall(r"typed_(?:" + "|".join(PROVED) + ")_", found))


def test_the_example_of_the_page(tmp_path: Path) -> None:
    text = BACKEND.translate(load(TREES / "gates" / "sand.rvaft"), SCATTERED).text
    (tmp_path / "monitor.c").write_text(text, encoding="utf-8")
    example = (ROOT / "docs" / "first" / "application.c").read_text(encoding="utf-8")
    calls = 'start(); return on_event("a") + 3 * on_event("b") + 9 * on_event("c") + 27 * on_event("d");'
    options = (*WARNINGS, "-DRVAFT_JSON=0", "-Wno-unused-parameter")
    compile_c(f"{example}\nint main(void) {{ {calls} }}\n", tmp_path / "application", options)
    assert status(tmp_path / "application", b"")[0] == 9 + 27  # detected at c; final


LARGE = """
int main(void) {
    static rvaft_monitor m;
    rvaft_event e = {0};
    rvaft_init(&m, 1);
    e.field[0] = rvaft_real(1e300);
    e.field[1] = rvaft_real(1e301);
    return -rvaft_step(&m, &e);
}
"""


@pytest.mark.parametrize("guard", ["V > 5", "V == W"])
def test_a_large_double_of_a_program_is_no_verdict(guard: str, tmp_path: Path) -> None:
    tree = loads(f"event e(v, w) = {{ v: v, w: w }}; top or a; a on e(V, W) when {guard};")
    text = BACKEND.translate(tree, SCATTERED).text
    compile_c(text + LARGE, tmp_path / "monitor", (*SANITIZERS, "-DRVAFT_JSON=0"))
    assert status(tmp_path / "monitor", b"")[0] == 2  # RVAFT_UNSUPPORTED


ZIG = shutil.which("zig")
ROWS = re.findall(r"^\| `(\w+/\w+)` \| ([\d,]+) \| ([\d,]+) \|$", PAGE, re.MULTILINE)


def allocated(file: Path) -> tuple[int, int]:
    """The bytes of an ELF file for 32 bits that are constant, and those that are not."""
    data = file.read_bytes()
    (headers,) = struct.unpack_from("<I", data, 0x20)
    size, count = struct.unpack_from("<HH", data, 0x2E)
    found = [0, 0]
    for number in range(count):
        _, _, flags, _, _, length = struct.unpack_from("<6I", data, headers + number * size)
        if flags & 2:
            found[flags & 1] += length
    return found[0], found[1]


@pytest.mark.slow
@pytest.mark.skipif(ZIG is None and find_spec("ziglang") is None, reason="needs zig (the extra native)")
@pytest.mark.parametrize(("name", "flash", "ram"), ROWS)
def test_the_sizes_on_a_microcontroller(name: str, flash: str, ram: str, tmp_path: Path) -> None:
    """Other versions of the compiler may need a tenth more or less."""
    zig = [ZIG] if ZIG else [sys.executable, "-m", "ziglang"]
    text = BACKEND.translate(load(TREES / f"{name}.rvaft"), SCATTERED).text
    target = ("-target", "thumb-freestanding-eabi", "-mcpu=cortex_m3", "-ffreestanding", "-Os", "-c")
    options = (*WARNINGS, *target, "-DRVAFT_JSON=0", "-DRVAFT_CAPACITY=32")
    compile_c(f"{text}\nrvaft_monitor the_monitor;\n", tmp_path / "monitor.o", options, command=[*zig, "cc"])
    stated = int(flash.replace(",", ""))
    constant, variable = allocated(tmp_path / "monitor.o")
    assert abs(constant - stated) <= stated / 10, constant
    assert variable == int(ram.replace(",", ""))


def spoiled(random: Random, line: bytes) -> bytes:
    """A line with a few bytes changed, often those that JSON is made of."""
    data = bytearray(line)
    for _ in range(random.randrange(1, 4)):
        at = random.randrange(len(data) + 1)
        new = random.choice([b'"', b"\\", b"{", b"}", b"[", b"]", b",", b":", b"1", b"e", b"-", b".", b"\\u", b"\xc3"])
        data[at : at + random.randrange(3)] = random.choice([new, b"", bytes([random.randrange(256)])])
    return bytes(data).replace(b"\n", b" ")


def accepts(tree: RVAFT, line: bytes) -> bool:
    try:
        decode(line, reads=TreeReads(tree))
    except (ValueError, TraceError):
        return False
    return True


@pytest.mark.parametrize("rounds", [*part_and_whole(1, 6), pytest.param(24, marks=pytest.mark.slow)])
def test_sanitizers(rounds: int, tmp_path: Path) -> None:
    """Random trees and traces, and spoiled lines, with checks of memory and of undefined behaviour."""
    random, compared = Random(rounds), 0
    shapes = [Shape(), *SHAPES.values()]
    for number in range(rounds):
        tree = random_tree(random, shapes[number % len(shapes)]) if number else loads(VARIED[-1])
        semantics = list(Semantics)[number % 4]
        try:
            text = BACKEND.translate(tree, semantics).text
        except (NotExpressible, TooLarge):
            continue
        file = tmp_path / "monitor"
        compile_c(text, file, (*SANITIZERS, "-DRVAFT_MAIN=1", "-DRVAFT_LINE=1000000", "-DRVAFT_CAPACITY=512"))
        traces = [random_trace(random, tree) for _ in range(5)]
        try:
            found = [detecting(random, tree, semantics) for _ in range(5)]
            traces += [*found, *(disturbed(random, one, tree) for one in found)]
        except NoTraceFound:
            pass
        for trace in traces:
            lines = [json.dumps(event, ensure_ascii=False).encode() for event in trace]
            code, out, error = status(file, b"\n".join(lines))
            assert code in (0, 1, 3), error
            if code < 2:
                got = [json.loads(line)["verdict"] for line in out.splitlines()]
                assert got == [verdict.value for verdict in Reference(tree, semantics).run(trace)]
                compared += 1
            for line in lines[:3]:
                bad = spoiled(random, line)
                code, _, error = status(file, bad)
                assert code in (0, 1, 2, 3), error
                assert "runtime error" not in error
                assert "Sanitizer" not in error
                assert accepts(tree, bad) or code in (2, 3) or not bad.strip(), bad
    assert compared >= 5


PIECES = """
#include <stdio.h>
static rvaft_log the_log;
static char text[1 << 20];
int main(void) {
    size_t size = fread(text, 1, sizeof text - 16, stdin), at = 0;
    rvaft_log_begin(&the_log, 1, 1);
    while (at < size && the_log.verdict >= 0) {
        uint32_t i;
        at += rvaft_log_read(&the_log, text + at, size - at);
        for (i = 0; i < the_log.taken; i++) {
            printf(i == 0 ? "%d" : " %d", (int)the_log.match[i].number);
        }
        printf(the_log.taken == 0 ? "" : "\\n");
    }
    return the_log.verdict < 0 ? 3 : 0;
}
"""
"""Prints the numbers of the events of each detection."""


@pytest.mark.parametrize("rounds", [*part_and_whole(1, 6), pytest.param(24, marks=pytest.mark.slow)])
def test_sanitizers_with_keys(rounds: int, tmp_path: Path) -> None:
    """The detections of each key are those of an engine for its events, and each is one by the definition."""
    random, compared = Random(rounds), 0
    for number in range(rounds):
        tree = random_tree(random, Shape(max_nodes=6, variables=1, guards=0.3)) if number else loads(TIED)
        try:
            text = BACKEND.keyed([(("key",), ("key",))]).translate(tree, SCATTERED).text
            traces = [detecting(random, tree, SCATTERED) for _ in range(30)]
        except (NotExpressible, TooLarge, NoTraceFound):
            continue
        file = tmp_path / "monitor"
        compile_c(text + PIECES, file, (*SANITIZERS, "-DRVAFT_PLACES=1", "-DRVAFT_KEYS=3", "-DRVAFT_CAPACITY=512"))
        events = [{**event, "key": random.choice(["a", 1, [True]])} for trace in traces for event in trace]
        code, out, error = status(file, b"\n".join(json.dumps(event).encode() for event in events))
        assert code in (0, 3), error
        found = [[int(one) for one in line.split()] for line in out.splitlines()]
        wanted = []
        for key in ("a", 1, [True]):
            watching = Repetition(monitor(tree, semantics=SCATTERED))
            own = [place for place, one in enumerate(events) if one["key"] == key]
            wanted += [place + 1 for place in own if watching.step(events[place]) is Verdict.TRUE]
        if code == 0:
            assert sorted(one[-1] for one in found) == sorted(wanted)
            for one in found:
                assert [*Reference(tree, SCATTERED).run([events[place - 1] for place in one])][-1] is Verdict.TRUE
                assert len({str(events[place - 1]["key"]) for place in one}) == 1
            compared += len(found)
    assert compared >= 3
