"""The reader of JSON in C, beside that in Python."""

import json
import math
import struct
from collections import Counter
from decimal import Decimal, localcontext
from pathlib import Path
from random import Random

import pytest
from hypothesis import given
from hypothesis import strategies as st

from backends.c.library import CMonitor, compile_c, compiler
from rvaft import NoVerdict, Verdict, loads, monitor
from rvaft.core.fields_to_read import TreeReads
from rvaft.model.values import Json
from rvaft.readers.json_lines import decode
from tests.backends.c.programs import BACKEND, READING, SANITIZERS, SCATTERED, TIED, program, status
from tests.tables import rows, sampled, spelled

pytestmark = pytest.mark.skipif(compiler() is None, reason="needs a C compiler")
READERS = str(Path(__file__).parents[2] / "readers" / "test_json_lines.py")
LINES = [(kind, name, spelled(text)) for kind, name, text in rows(READERS, "lines.txt")]
REPEATED = rows(READERS, "repeated_keys.txt")


@pytest.mark.parametrize(("kind", "data"), [(kind, data) for kind, _, data in LINES], ids=[row[1] for row in LINES])
def test_what_the_python_reader_refuses(kind: str, data: bytes, folder: Path) -> None:
    """Numbers that are not finite are undefined, unless a log is read strictly; where a tree reads nothing, a
    repeated key is no error.
    """
    if kind == "odd":
        return
    first = b'{"a":1}\n\n' if kind == "bad" else b""
    code, _, error = status(program(READING, folder), first + data)
    assert (code == 2) == (kind == "bad"), error
    assert bool(error) == (kind == "bad")


@pytest.mark.parametrize(("kind", "line"), REPEATED)
def test_repeated_keys(kind: str, line: str, folder: Path) -> None:
    """The native reader refuses them in all fields of the tree, and anywhere in a list or an object that it
    compares.
    """
    tree = 'event e(v) = { topic: "t", pose: { x: _ }, value: v, list: [{ y: 1 }] }; top or a; a on e(V);'
    code, _, error = status(program(tree, folder), line.encode())
    if kind == "refused":
        assert code == 2
        assert error.startswith("<stdin>:1: error: not JSON: a key is repeated (byte ")
    else:
        assert code in (0, 2)


def test_errors_name_the_line(folder: Path) -> None:
    code, out, error = status(program(TIED, folder), b'{"k": 1}\n\n{"k": nope}\n{"k": 1}\n')
    assert (code, out) == (2, '{"event": 1, "verdict": "unknown"}\n')
    assert error == "<stdin>:3: error: not JSON: expecting value (byte 7 of the line)\n"


def equal(left: str, right: str) -> bool:
    """Whether two JSON numbers are equal for a monitor, which then detects."""
    monitor = CMonitor(BACKEND.translate(loads(TIED), SCATTERED).text)
    found = monitor.read_line(f'{{"k": 1, "u": {left}}}'.encode())
    found = monitor.read_line(f'{{"k": 2, "u": {right}}}'.encode())
    return found.value == "true"


@given(st.floats(allow_nan=False, allow_infinity=False))
def test_decimals_become_the_nearest_double(number: float) -> None:
    exact = f"{number:.800e}" if abs(number) < 1e300 else repr(number)
    assert equal(repr(number), exact)
    assert not equal(repr(number), repr(math.nextafter(number, 0) if number else 5e-324))


ZEROS = "0" * 100_009
EXTREMES = (
    f"0.{ZEROS}1e1000019",
    f"0.{ZEROS}1e100010",
    f"1{ZEROS}.0e-100009",
    f"0.{ZEROS}e99999999999999999999",
    "1e99999999999999999999",
    "1e-99999999999999999999",
    "1.7976931348623158e308",
    "1.7976931348623159e308",
    "2.4703282292062327e-324",
    "2.4703282292062328e-324",
    "-9223372036854775808.0",
)


@pytest.mark.parametrize("text", EXTREMES, ids=lambda text: text[-24:])
def test_extreme_decimals(text: str) -> None:
    """An infinite number is undefined, so it does not equal itself."""
    assert equal(text, repr(float(text)) if math.isfinite(float(text)) else text) == math.isfinite(float(text))


def decimal(random: Random) -> str:
    """A decimal: a double, a number halfway between two doubles, or some digits."""
    double: float = struct.unpack("d", random.randbytes(8))[0]
    double = double if math.isfinite(double) else 1.5
    match random.randrange(3):
        case 0:
            return repr(double)
        case 1:
            with localcontext(prec=1200):
                exact = (Decimal(double) + Decimal(math.nextafter(double, 0))) / 2
            return f"{exact:e}".replace("e", random.choice(["e", "0001e"]))
        case _:
            zeros = "0" * random.choice([0, 1, 20, 330, 1000])
            digits = random.randrange(10 ** random.randrange(1, 30))
            return f"{random.choice(['', '-'])}{digits}.{zeros}{digits}e{random.randrange(-400, 400)}"


def test_decimals_with_sanitizers(tmp_path: Path) -> None:
    """Each decimal equals its nearest double, with checks of memory and of undefined behaviour."""
    random, program = Random(1), tmp_path / "monitor"
    texts = [text for text in (decimal(random) for _ in range(3000)) if math.isfinite(float(text))]
    text = BACKEND.translate(loads(TIED), SCATTERED).text
    compile_c(text, program, (*SANITIZERS, "-DRVAFT_MAIN=1", "-DRVAFT_LINE=100000"))
    lines = (f'{{"k": 1, "u": {one}}}\n{{"k": 2, "u": {float(one)!r}}}\n' for one in texts)
    code, out, error = status(program, "".join(lines).encode(), "--repeat", "--detections")
    assert (code, out.count("\n"), error) == (1, len(texts), "")


ODD_TIMES = ("-Infinity", "Infinity", "NaN", "true", "null", '"x"', '""', '"-"', "[1]", "{}", "-0.0", "0e0", "1e400")


def written_time(random: Random, form: str) -> str:
    """A time that is a number or its text, some with few digits, some to be rounded."""
    if random.random() < 0.1:
        return random.choice(ODD_TIMES)
    size, places = random.randrange(1, 21), random.randrange(13)
    digits = str(random.randrange(10**size)).zfill(places + 1)
    whole, rest = digits[: len(digits) - places], digits[len(digits) - places :]
    if form == "filetime":  # from 1696 to 2234
        return f"{random.randrange(3 * 10**16, 2 * 10**17)}{'.' if rest else ''}{rest}"
    text = f"{random.choice(['', '-'])}{whole.lstrip('0') or '0'}{'.' if rest else ''}{rest}"
    text += random.choice(["", "", "", "e0", "e-3", "E+1"])
    return json.dumps(text) if random.random() < 0.2 else text


def respelled(random: Random, text: str) -> str:
    """Another text of the same number, or of one that is near."""
    if not text[-1].isdigit() or "e" in text.lower():
        return text
    ends = [
        "e0",
        "E+00",
        *(["0", "000", "4", "5", "50001", "9"] if "." in text else [".0", ".5", ".50", ".4999999999"]),
    ]
    return text + random.choice(ends)


@pytest.mark.parametrize("form", sampled(["s", "ms", "us", "ns", "filetime"], 5))
def test_times_are_those_of_the_engine(form: str) -> None:
    tree = loads(f"time ts as {form}; top sand a b when at(b) - at(a) == 0 s;")
    fresh, engine = CMonitor(BACKEND.translate(tree, SCATTERED).text), monitor(tree, semantics=SCATTERED)
    random, found = Random(form), Counter[str]()
    for _ in range(3000):
        first = written_time(random, form)
        second = random.choice([first, respelled(random, first), respelled(random, first), written_time(random, form)])
        lines = [
            f'{{"event": "{name}", "ts": {time}}}'.encode() for name, time in zip("ab", (first, second), strict=True)
        ]
        wanted = [*engine.fork().run([decode(line, reads=TreeReads(tree)) for line in lines])]
        watching = fresh.fork()
        try:
            assert [watching.read_line(line) for line in lines] == wanted, lines
            found[wanted[-1]] += 1
        except NoVerdict:
            found["none"] += 1
    assert min(found[Verdict.TRUE], found[Verdict.UNKNOWN]) > 500
    assert found["none"] < 1500


@pytest.mark.parametrize("guard", ["V > 5", "V == W"])
def test_a_large_decimal_without_room_is_no_verdict(guard: str, folder: Path) -> None:
    """Its digits are kept beside the decoded strings of the event."""
    tree = f"event e(s, v, w) = {{ s: s, v: v, w: w }}; top or a; a on e(_, V, W) when {guard};"
    line = '{"s": "\\n%s", "v": 1e300, "w": 1e301}'
    code, out, _ = status(program(tree, folder), (line % "short").encode())
    assert (code, out.count("true")) == ((1, 1) if guard == "V > 5" else (0, 0))
    code, out, error = status(program(tree, folder), (line % ("x" * 65_500)).encode())
    assert (code, out) == (3, "")
    assert "RVAFT_SCRATCH" in error


@given(st.integers(-(10**25), 10**25), st.integers(-2, 2))
def test_integers_are_exact(number: int, offset: int) -> None:
    assert equal(str(number), str(number + offset)) == (offset == 0)
    assert equal(str(number), repr(float(number))) == (int(float(number)) == number)


@given(
    st.recursive(
        st.none() | st.booleans() | st.integers(-3, 3) | st.floats(-2, 2, width=16) | st.text(max_size=2),
        lambda inner: st.lists(inner, max_size=3) | st.dictionaries(st.text(max_size=2), inner, max_size=3),
        max_leaves=6,
    )
)
def test_lists_and_objects_are_compared_as_a_whole(value: Json) -> None:
    other = json.dumps(value, sort_keys=True, ensure_ascii=True, indent=1).replace("\n", "")
    assert equal(json.dumps(value, ensure_ascii=False), other)
    assert not equal(json.dumps([value]), other)


def test_deep_objects_are_compared_in_little_time(folder: Path) -> None:
    """To order its keys an object is passed once more; the time does not double with each level."""
    deep, ordered = '{"b": [{"q": "}"}, %s], "a": 1}', '{"a": 1e0, "b": [{"\\u0071": "}"}, %s]}'
    file = program(TIED, folder, capacity=4096)
    left, right = "0.0", "-0"
    for _ in range(240):
        left, right = deep % left, ordered % right
    code, out, error = status(file, f'{{"k": 1, "u": {left}}}\n{{"k": 2, "u": {right}}}\n'.encode())
    assert (code, out.count("true"), error) == (1, 1, "")
    code, out, error = status(file, f'{{"k": 1, "u": {left}}}\n{{"k": 2, "u": 1}}\n'.encode())
    assert (code, out.count("true"), error) == (0, 0, "")
