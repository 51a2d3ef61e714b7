"""Cases: what is saved is loaded again, whole or not at all, and what is no case is said in one line."""

import json
import re
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from itertools import count
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from cross_check.counterexamples import Case, CaseError, case_folders, case_name, load, save
from cross_check.generate.strategies import trees_with_traces
from rvaft import RVAFT, Gate, Kind, Node, RvaftError, Semantics, TraceError, Verdict, dumps, loads
from rvaft.core.restriction import restrict
from rvaft.model.patterns import Literal
from rvaft.model.values import Json
from tests.tables import rows, spelled

UNKNOWN, TRUE, FALSE = Verdict.UNKNOWN, Verdict.TRUE, Verdict.FALSE
TREE = """event x(p) = { x: p, "näme": "ü\\n" };
top sand a b label "Ωμέγα — \\"quoted\\" 😀" lambda="0.1";
a on x(1.0) attack;
b when V > 1 on x(V);
"""
CASE = Case(
    "sand-projected-12ab",
    loads(TREE),
    ({"x": 1, "näme": "ü\n"}, {"x": 1.0, "y": ["\u2028", None, True, {"": 1e300}]}),
    Semantics.PROJECTED,
    1,
    Kind.ATTACK,
    {"reference": (UNKNOWN, TRUE), "my döts/x.rml": (UNKNOWN, FALSE)},
    {
        "my döts/x.rml": ("rml", "Main = a;\r\n"),
        "rml": ("rml", ""),
        "tree": ("rvaft", "a;"),
        "case": ("json", "{}"),
        "RML!": ("rml", "another"),
    },
)


def test_the_files_are_for_people(tmp_path: Path) -> None:
    path = save(CASE, tmp_path / "new" / "folder")
    assert path == tmp_path / "new" / "folder" / CASE.name
    assert load(path) == CASE
    names = "tree.rvaft trace.jsonl case.json my-d-ts-x-rml.rml rml.rml tree-2.rvaft case-2.json rml-2.rml"
    assert {file.name for file in path.iterdir()} == set(names.split())
    assert (path / "tree.rvaft").read_text(encoding="utf-8") == dumps(CASE.tree)
    assert (path / "my-d-ts-x-rml.rml").read_bytes() == b"Main = a;\r\n"
    assert [json.loads(line) for line in (path / "trace.jsonl").read_bytes().split(b"\n")[:-1]] == list(CASE.trace)
    text = (path / "case.json").read_text(encoding="utf-8")
    assert "döts" in text
    record = json.loads(text)
    assert (record["semantics"], record["branch"], record["kind"]) == ("projected", 1, "attack")
    assert record["verdicts"] == {"reference": ["unknown", "true"], "my döts/x.rml": ["unknown", "false"]}
    assert record["specifications"]["my döts/x.rml"] == {"language": "rml", "file": "my-d-ts-x-rml.rml"}


TEXTS = st.text(st.characters(exclude_categories=["Cs"]), max_size=12)


@settings(max_examples=20, suppress_health_check=list(HealthCheck))
@given(st.data(), trees_with_traces(max_length=4))
def test_every_case_reads_back(data: st.DataObject, pair: tuple[Any, list[Any]]) -> None:
    tree, trace = pair
    verdicts = st.lists(st.sampled_from(Verdict), min_size=len(trace), max_size=len(trace)).map(tuple)
    case = Case(
        "n",
        tree,
        tuple(trace),
        data.draw(st.sampled_from(Semantics)),
        data.draw(st.none() | st.integers(1, 10**6)),
        data.draw(st.none() | st.sampled_from(Kind)),
        data.draw(st.dictionaries(TEXTS, verdicts, max_size=3)),
        data.draw(st.dictionaries(TEXTS, st.tuples(TEXTS, TEXTS), max_size=3)),
    )
    with TemporaryDirectory() as folder:
        path = save(case, folder)
        again = load(path)
        assert (again, repr(again.trace)) == (case, repr(case.trace))
        assert save(again, folder) == path


def test_another_case_of_the_name_gets_a_number(tmp_path: Path) -> None:
    others: list[dict[str, Any]] = [
        {"trace": ({"x": True, "näme": ""}, CASE.trace[1])},
        {"trace": ({**CASE.trace[0], "x": 1.0}, CASE.trace[1])},
        *({"semantics": Semantics.STRICT}, {"branch": 2}, {"kind": None}, {"verdicts": {}}, {"specifications": {}}),
        {"tree": loads(TREE.replace("1.0", "1"))},
    ]
    cases = [CASE, *(replace(CASE, **other) for other in others)]
    paths = [save(case, tmp_path) for case in cases]
    assert [path.name for path in paths] == [CASE.name, *(f"{CASE.name}-{number}" for number in range(2, 10))]
    assert [save(case, tmp_path) for case in cases] == paths
    assert {path.name for path in tmp_path.iterdir()} == {path.name for path in paths}
    assert [repr(load(path).trace) for path in paths] == [repr(case.trace) for case in cases]


def test_what_is_in_the_way_stays(tmp_path: Path) -> None:
    (tmp_path / "n").write_text("mine")
    (tmp_path / "n-2").mkdir()
    (tmp_path / "n-3").symlink_to("nowhere")
    assert save(replace(CASE, name="n"), tmp_path) == tmp_path / "n-4"
    assert ((tmp_path / "n").read_text(), list((tmp_path / "n-2").iterdir())) == ("mine", [])


NAMES = {"../up": "up", "a/b": "a-b", "": "case", "..": "case", "Ä Ö": "case", ".x": "x", "x" * 200: "x" * 60}


@pytest.mark.parametrize(("name", "folder"), NAMES.items())
def test_a_name_stays_in_its_folder(tmp_path: Path, name: str, folder: str) -> None:
    home = tmp_path / "home"
    assert save(replace(CASE, name=name), home) == home / folder
    assert [path.name for path in tmp_path.iterdir()] == ["home"]


def test_names_tell_the_gate_the_semantics_and_a_digest() -> None:
    tree, trace = loads("top and a b;"), [{"event": "a"}]
    name = case_name(tree, trace, Semantics.PROJECTED)
    assert re.fullmatch("and-projected-[0-9a-f]{4}", name)
    assert name == case_name(loads(dumps(tree)), list(trace), Semantics.PROJECTED)
    parts: list[dict[str, Any]] = [{}, {"branch": 1}, {"kind": Kind.FAULT}]
    pairs = [(tree, trace), (tree, []), (loads("top and a c;"), trace)]
    others = {case_name(*pair, Semantics.PROJECTED, **part) for pair in pairs for part in parts}
    assert len(others) == 9
    assert case_name(loads("a;"), trace, Semantics.STRICT).startswith("leaf-strict-")


def test_many_at_once_do_not_disturb_each_other(tmp_path: Path) -> None:
    many = [replace(CASE, name="n", branch=number % 3 + 1) for number in range(12)]
    with ThreadPoolExecutor(12) as threads:
        paths = set(threads.map(lambda case: save(case, tmp_path), many))
    assert paths == set(tmp_path.iterdir())
    assert {load(path).branch for path in paths} == {1, 2, 3}


@pytest.mark.parametrize("error", [OSError(28, "No space left on device"), KeyboardInterrupt()])
@pytest.mark.parametrize("fails_at", [1, 2, 3, 4])
def test_nothing_is_left_of_a_case_that_could_not_be_written(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, fails_at: int, error: BaseException
) -> None:
    writing = count(1)

    def failing(self: Path, data: bytes) -> int:
        if next(writing) == fails_at:
            raise error
        return write(self, data)

    write = Path.write_bytes
    monkeypatch.setattr(Path, "write_bytes", failing)
    said = r"^[^\n]*cannot be written: No space left on device$" if isinstance(error, OSError) else None
    with pytest.raises(CaseError if said else KeyboardInterrupt, match=said):
        save(CASE, tmp_path)
    assert list(tmp_path.iterdir()) == []


def _deep(levels: int) -> Json:
    value: Json = 1
    for _ in range(levels):
        value = [value]
    return value


SILENT = RVAFT("a", [Node("a", Gate.OR, ("b",)), Node("b", when=Literal(True))])
NO_EVENTS = {
    "half a surrogate pair": {"x": "\ud800"},
    "nested too deeply to be read": {"x": _deep(600)},
    "nested too deeply to be written": {"x": _deep(100_000)},
    "too many digits": {"x": 10**5000},
    "no JSON value": {"x": object()},
    "a tuple for a list": {"x": (1, 2)},
    "a key that is no string": {1: 2},
    "an event that is no object": [1],
}
CANNOT_BE_SAVED: dict[str, dict[str, Any]] = {
    **{what: {"trace": (event, {})} for what, event in NO_EVENTS.items()},
    "half a pair in a specification": {"specifications": {"a": ("rml", "\udfff")}},
    "half a pair in a participant": {"verdicts": {"\udfff": (TRUE, TRUE)}},
    "a tree that breaks a rule": {"tree": SILENT},
}


@pytest.mark.parametrize("what", CANNOT_BE_SAVED)
def test_what_could_not_be_read_back_is_not_written(tmp_path: Path, what: str) -> None:
    with pytest.raises(CaseError) as caught:
        save(replace(CASE, **CANNOT_BE_SAVED[what]), tmp_path)
    assert "\n" not in str(caught.value)
    assert str(tmp_path) not in str(caught.value)
    assert list(tmp_path.iterdir()) == []


def test_what_cannot_be_a_case() -> None:
    with pytest.raises(CaseError, match="rml has 1 verdicts for a trace of length 2"):
        replace(CASE, verdicts={"rml": (TRUE,)})
    with pytest.raises(CaseError, match="whole tree"):
        replace(CASE, tree=restrict(loads("top or a b;"), branch=1))


@pytest.mark.parametrize(("name", "put", "message"), rows(__file__, "no_cases.txt"))
def test_what_is_no_case_is_said_in_one_line(tmp_path: Path, name: str, put: Any, message: str) -> None:
    path = save(CASE, tmp_path)
    if isinstance(put, dict):
        put = json.dumps({**json.loads((path / name).read_bytes()), **put})
    (path / name).unlink()
    if put is True:
        (path / name).mkdir()
    elif put is not None:
        (path / name).write_bytes(spelled(put))
    with pytest.raises(RvaftError) as caught:
        load(path)
    first, *caret = str(caught.value).splitlines()
    assert message in first
    assert first.startswith(str(path))
    assert not caret or message.startswith("tree.rvaft")
    if message == "trace.jsonl:2: not JSON":
        assert isinstance(caught.value, TraceError)
        assert (caught.value.file, caught.value.line) == (str(path / "trace.jsonl"), 2)


def test_what_may_be_left_out(tmp_path: Path) -> None:
    path = save(CASE, tmp_path)
    (path / "case.json").write_bytes(b'\xef\xbb\xbf{"semantics": "strict", "verdicts": {}}\r\n')
    assert load(path) == Case(CASE.name, CASE.tree, CASE.trace, Semantics.STRICT)


@pytest.mark.parametrize("name", ["file", "file/inner", "a\0b"])
def test_a_path_that_is_no_folder(tmp_path: Path, name: str) -> None:
    (tmp_path / "file").write_text("{}")
    with pytest.raises(CaseError, match="there is no folder of this name"):
        load(tmp_path / name)
    with pytest.raises(CaseError, match=r"^[^\n]*cannot be read: "):
        case_folders(tmp_path / name)
    with pytest.raises(CaseError, match="cannot be written"):
        save(CASE, tmp_path / name)
    assert [path.name for path in tmp_path.iterdir()] == ["file"]


def test_the_name_is_that_of_the_folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path = save(CASE, tmp_path).rename(tmp_path / "Übernommen 1")
    assert load(path).name == "Übernommen 1"
    monkeypatch.chdir(path)
    assert load(".").name == "Übernommen 1"


def test_all_cases_of_a_folder(tmp_path: Path) -> None:
    with pytest.raises(CaseError, match="there is no case here"):
        case_folders(tmp_path)
    many = [replace(CASE, name=name) for name in ("b", "c", "a")]
    paths = [save(case, tmp_path) for case in many]
    (tmp_path / "README.md").write_text("about these cases")
    (tmp_path / ".a.12ab34cd").mkdir()
    assert case_folders(str(tmp_path)) == tuple(sorted(paths))
    assert case_folders(paths[0]) == (paths[0],)
