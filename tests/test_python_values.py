"""What Python users give: values of NumPy, pandas and the standard library, and tables as logs."""

from collections.abc import Callable
from datetime import UTC, date, datetime, timedelta
from decimal import Decimal
from enum import Enum, IntEnum, StrEnum
from types import MappingProxyType
from typing import Any

import pytest

import rvaft
from rvaft import Verdict

np = pytest.importorskip("numpy")
pd = pytest.importorskip("pandas")


class Colour(StrEnum):
    RED = "red"


class Level(IntEnum):
    HIGH = 300


class Word(str, Enum):  # noqa: UP042 (as older code writes it)
    RED = "red"


VALUES: list[tuple[Any, Any]] = [
    (np.int64(300), 300),
    (np.float64(2.5), 2.5),
    (np.float32(0.5), 0.5),
    (np.bool_(True), True),
    (np.str_("red"), "red"),
    (np.array([1, 2]), [1, 2]),
    (np.datetime64("2026-01-02T03:04:05"), "2026-01-02T03:04:05"),
    (np.datetime64("NaT"), None),
    (np.timedelta64(2, "s"), 2_000_000_000),
    (Decimal("2.5"), 2.5),
    (Decimal(300), 300),
    (pd.Timestamp("2026-01-02T03:04:05Z"), "2026-01-02T03:04:05Z"),
    (pd.NaT, None),
    (pd.NA, None),
    (pd.Timedelta("1s"), 1_000_000_000),
    (datetime(2026, 1, 2, 3, 4, 5), "2026-01-02T03:04:05"),
    (datetime(2026, 1, 2, 3, 4, 5, tzinfo=UTC), "2026-01-02T03:04:05Z"),
    (date(2026, 1, 2), "2026-01-02"),
    (timedelta(seconds=2), 2_000_000_000),
    (Colour.RED, "red"),
    (Word.RED, "red"),
    (Level.HIGH, 300),
    ((1, (2, np.int8(3))), [1, [2, 3]]),
    (MappingProxyType({"y": np.int16(4)}), {"y": 4}),
    ({"y": [np.int16(4)]}, {"y": [4]}),
]


@pytest.mark.parametrize(("given", "meant"), VALUES)
def test_a_value_is_read_as_that_of_json(given: Any, meant: Any) -> None:
    tree = rvaft.loads("semantics scattered; event e(k, x) = { k: k, x: x }; top sand a b; a on e(1, X); b on e(2, X);")
    for first, second in ((given, meant), (meant, given), (given, given)):
        monitor = rvaft.monitor(tree)
        assert [*monitor.run([{"k": 1, "x": first}, {"k": 2, "x": second}])][-1] is Verdict.TRUE
        assert monitor.explanation is not None
        assert rvaft.monitor(tree).step({"k": 1, "x": first}) is Verdict.UNKNOWN


@pytest.mark.parametrize("guard", ["X > 200", "X == 300", "X in (300)", "X * 2 == 600"])
@pytest.mark.parametrize("given", [np.int64(300), np.float32(300), Decimal(300), Level.HIGH])
def test_guards_read_them(guard: str, given: Any) -> None:
    tree = rvaft.loads(f"event e(x) = {{ x: x }}; top on e(X) when {guard};")
    for semantics in rvaft.Semantics:
        assert rvaft.monitor(tree, semantics=semantics).step({"x": given})
    assert rvaft.translate(tree, "sql", semantics="scattered").monitor().step({"x": given})


@pytest.mark.parametrize("given", [{1}, b"red", object(), 1j, np.complex64(1)])
def test_a_value_without_a_form_in_json_is_refused(given: Any) -> None:
    tree = rvaft.loads("event e(x) = { y: { x: x } }; top on e(300);")
    with pytest.raises(rvaft.WrongType, match=r"the value of y\.x must be a value of JSON .*, not"):
        rvaft.monitor(tree).step({"y": {"x": given}})


def test_an_instant_where_the_tree_reads_a_number_is_refused() -> None:
    text = "time t as {}; top sand a b within 1 h;"
    events = [{"event": "a", "t": pd.Timestamp("2026-01-01")}, {"event": "b", "t": datetime(2026, 1, 1, 0, 30)}]
    assert [*rvaft.monitor(rvaft.loads(text.format("iso8601"))).run(events)][-1]
    for late in ("", " late 5 s"):
        with pytest.raises(rvaft.WrongType, match="the time t of an event must be a value that the tree reads `as s`"):
            rvaft.monitor(rvaft.loads(text.format(f"s{late}"))).step(events[0])


@pytest.mark.parametrize("second", [pd.Timedelta("1s"), timedelta(seconds=1), np.timedelta64(1, "s")])
def test_a_length_of_time_is_a_time_in_nanoseconds_alone(second: Any) -> None:
    text, event = "time t as {}; top sand a b within 1 h;", {"event": "a", "t": second}
    rvaft.monitor(rvaft.loads(text.format("ns"))).step(event)
    for form in ("s", "iso8601"):
        with pytest.raises(rvaft.WrongType, match=f"must be a value that the tree reads `as {form}`"):
            rvaft.monitor(rvaft.loads(text.format(form))).step(event)


def test_a_verdict_is_true_where_something_is_detected() -> None:
    monitor = rvaft.monitor(rvaft.loads("top sand a b;"))
    assert [bool(monitor.step({"event": name})) for name in "ab"] == [False, True]
    assert [verdict for verdict in Verdict if verdict] == [Verdict.TRUE]


ROWS: dict[str, list[Any]] = {
    "event": ["a", "b", None],
    "size": [300, None, 2],
    "at": [datetime(2026, 1, 1, 0, n) for n in range(3)],
}


def _polars(rows: dict[str, list[Any]]) -> Any:
    return pytest.importorskip("polars").DataFrame(rows)


def _arrow(rows: dict[str, list[Any]]) -> Any:
    return pytest.importorskip("pyarrow").table(rows)


@pytest.mark.parametrize("make", [pd.DataFrame, _polars, _arrow])
def test_a_table_is_a_log(make: Callable[[dict[str, list[Any]]], Any]) -> None:
    events = list(rvaft.log(make(ROWS)))
    assert [(one.get("event"), one.get("size")) for one in events] == [("a", 300), ("b", None), (None, 2)]
    tree = rvaft.loads("time at as iso8601; top sand a b within 1 min;")
    assert [verdict.symbol for verdict in rvaft.monitor(tree).run(events)] == ["?", "⊤", "⊤"]


def test_columns_of_several_types_are_read() -> None:
    frame = pd.DataFrame({"x": [1, "a", {"y": np.int8(1)}, float("nan")]}, index=[5, 6, 7, 8])
    assert list(rvaft.log(frame)) == [{"x": 1}, {"x": "a"}, {"x": {"y": 1}}, {}]


@pytest.mark.parametrize("given", [None, [{"event": "a"}], "log.jsonl"])
def test_no_table_is_refused(given: Any) -> None:
    with pytest.raises(rvaft.WrongType, match="a log must be a DataFrame"):
        list(rvaft.log(given))
