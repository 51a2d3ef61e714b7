"""The reader of JSON in C, beside that in Python."""

import json
import math
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from backends.c.library import CMonitor, compiler
from rvaft import loads
from rvaft.model.values import Json
from tests.backends.c.programs import BACKEND, READING, SCATTERED, TIED, program, status
from tests.tables import rows, spelled

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
