"""What an editor shows about a text, without the protocol."""

from pathlib import Path
from typing import Final

import pytest
from hypothesis import given
from hypothesis import strategies as st

import rvaft
from rvaft.integrations.editor import sample_log
from rvaft.integrations.editor.analysis import definition, hover, problems, references, symbols
from rvaft.integrations.editor.completion import proposals
from rvaft.integrations.editor.document import MAX_TEXT, Document, Position, Target
from rvaft.integrations.editor.sample_log import Sample
from rvaft.rules.registry import meanings
from tests.cli.runs import written
from tests.language.test_lexemes import PIECES

LOG: Final = (
    {"event": "login", "user": "eve", "at": {"host": "a"}},
    {"event": "login", "user": "bob", "at": {"host": "a"}},
    {"event": "logout", "user": "eve", "at": {"host": "b", "port": 22}},
)
SAMPLE: Final = Sample("log.jsonl", LOG)
TREE: Final = (
    'event login(who, host) = { event: "login", user: who, at: { host: host } };\n'
    "top sand first last;\n"
    'first on login("eve", Host) when Host != "b";\n'
    "last fault;\n"
)


def labels(text: str, sample: Sample = SAMPLE, file: str = "<text>") -> list[str]:
    """The proposals at the sign | of a text."""
    document = Document(text.replace("|", "", 1), file)
    return [one.label for one in proposals(document, text.index("|"), sample)]


def shown(text: str, sample: Sample = SAMPLE) -> str:
    """The hover at the sign | of a text, or ""."""
    found = hover(Document(text.replace("|", "", 1)), text.index("|"), sample)
    return found.markdown if found else ""


# Positions


@given(PIECES)
def test_positions_and_offsets_are_inverse(text: str) -> None:
    document = Document(text)
    for offset in range(len(text) + 1):
        if not (text[:offset].endswith("\r") and text[offset:].startswith("\n")):  # within a line break
            assert document.offset(document.position(offset)) == offset


def test_positions_count_units_of_utf_16() -> None:
    document = Document("# é😀\r\n# \u2028x\ray")
    assert [tuple(document.position(one)) for one in (2, 3, 4, 6, 9, 11)] == [
        (0, 2),
        (0, 3),
        (0, 5),
        (1, 0),
        (1, 3),
        (2, 0),
    ]
    assert document.offset(Position(0, 99)) == 4
    assert document.offset(Position(99, 0)) == len(document.text)


# Findings


@pytest.mark.parametrize("code", [code for code, one in meanings().items() if one.bad and not one.python])
def test_the_findings_are_those_of_check(code: str) -> None:
    text = meanings()[code].bad
    try:
        expected = [(one.code, one.place.line - 1, one.place.column - 1, one.message) for one in rvaft_check(text)]
    except rvaft.LanguageError as error:
        expected = [("syntax", error.line - 1, error.column - 1, error.message)]
    found = problems(Document(text))
    assert [(one.code, *one.region.start, one.message) for one in found] == expected
    assert expected
    for one in found:
        assert one.region.start < one.region.end
        assert one.explanation == ("" if one.code == "syntax" else meanings()[one.code].explanation)


def rvaft_check(text: str) -> list[rvaft.Finding]:
    from rvaft.language.parser import parse
    from rvaft.rules.registry import check

    return check(parse(text))


def test_a_finding_is_about_a_whole_lexeme() -> None:
    (found,) = problems(Document('# 😀\ntop or a "b 😀"; a;'))
    assert (found.code, found.region) == ("undeclared", ((1, 9), (1, 15)))


def test_a_syntax_error_at_the_end_is_shown() -> None:
    (found,) = problems(Document("top or a b"))
    assert (found.code, found.severity.value) == ("syntax", "error")
    assert "`;` is missing" in found.message


def test_a_file_that_declares_events_only_has_no_finding() -> None:
    assert problems(Document("event e(x) = { x: x };")) == []
    assert [one.code for one in problems(Document(""))] == ["syntax"]


def test_a_finding_in_an_imported_file_is_at_the_import(tmp_path: Path) -> None:
    written(tmp_path / "events.rvaft", "event e(x) = { x: x };")
    inner = written(tmp_path / "inner.rvaft", 'import "part.rvaft";')
    part = written(tmp_path / "part.rvaft", "\n a or b c; b when 1 > 2;")
    text = 'import "events.rvaft"; import "inner.rvaft"; top or a d; d on e(_);'
    found = {one.code: one for one in problems(Document(text, str(tmp_path / "top.rvaft")))}
    assert found.keys() == {"undeclared", "infeasible-scenario"}
    assert found["undeclared"].region == ((0, 30), (0, 43))
    assert found["undeclared"].message.startswith(f"{part}:2:9: ")
    assert found["undeclared"].origin == (str(part), ((1, 8), (1, 9)))
    inner.write_text("a or ;", encoding="utf-8")
    (wrong,) = problems(Document(text, str(tmp_path / "top.rvaft")))
    assert (wrong.code, wrong.region) == ("syntax", ((0, 30), (0, 43)))
    assert wrong.origin is not None
    assert wrong.origin.file == str(inner)


def test_imports_can_be_confined(tmp_path: Path) -> None:
    written(tmp_path / "out.rvaft", "event secret() = { x: 1 };")
    (tmp_path / "in").mkdir()
    text, file = 'import "../out.rvaft"; top on secret();', str(written(tmp_path / "in" / "top.rvaft", ""))
    assert problems(Document(text, file)) == []
    assert len(definition(Document(text, file), text.index("secret"))) == 1
    confined = Document(text, file, confined=True)
    assert "outside the folder" in problems(confined)[0].message
    assert definition(confined, text.index("secret")) == []
    assert hover(confined, text.index("secret"), Sample()) is None


def test_a_text_that_is_too_large_is_not_analysed() -> None:
    document = Document("top or a b;" + " " * MAX_TEXT)
    assert "not analysed" in problems(document)[0].message
    assert symbols(document) == []


# Hover


@pytest.mark.parametrize(
    ("text", "start"),
    [
        ("top sa|nd a b;", "`sand a b`: all children occur, from left to right"),
        ("top 2o|f3 a b c;", "`2of3 a b c`: at least two"),
        ("top or a b; a wh|en 1 < 2;", "`when Value >= 250`: the guard of the node"),
        ("top or a b; a when 1 < 2 o|r 2 < 3;", "`or`: disjunction"),
        ("sem|antics scattered;", "`semantics NAME;`"),
        ("time t as iso|8601;", "`iso8601`"),
        ('top label "o|r";', ""),
        ("top x=o|r;", ""),
        ("# o|r", ""),
        ("event or(o|r) = { or: or };", ""),
    ],
)
def test_a_word_has_its_meaning_where_it_is_one(text: str, start: str) -> None:
    assert shown(text).startswith(start)
    assert bool(shown(text)) is bool(start)


def test_a_node_shows_its_statements_and_its_event() -> None:
    found = shown(TREE.replace("sand first", "sand fi|rst"))
    assert found == (
        '```rvaft\nfirst on login("eve", Host) when Host != "b";\n'
        'event login(who, host) = { event: "login", user: who, at: { host: host } };\n```\n\n'
        "1 of the first 3 events of log.jsonl matches, 1 of them satisfies the guard."
    )
    assert "default event" in shown(TREE.replace("last fault", "la|st fault"))


@pytest.mark.parametrize(
    ("guard", "end"),
    [
        ("", "3 of the first 4 events of log.jsonl match."),
        ("when N > 1", "3 of the first 4 events of log.jsonl match, 2 of them satisfy the guard."),
        ("when N > 2", "3 of the first 4 events of log.jsonl match, 1 of them satisfies the guard."),
        (
            "when N > 1 and M != N",
            "3 of the first 4 events of log.jsonl match; the guard depends on other events, too.",
        ),
        (
            "when at(b) - at(a) > 1 s",
            "3 of the first 4 events of log.jsonl match; the guard depends on other events, too.",
        ),
    ],
)
def test_the_count_of_a_node_respects_its_guard(guard: str, end: str) -> None:
    sample = Sample("log.jsonl", ({"n": 1}, {"n": 2}, {"n": 3}, {"m": 3}))
    text = f"time t as s; event e(x) = {{ n: x }}; top sand b a; b on e(M); |a on e(N) {guard};"
    assert shown(text, sample).endswith(end)


def test_an_event_type_shows_its_pattern_and_its_count() -> None:
    found = shown(TREE.replace("event login", "event lo|gin"))
    assert '{ event: "login", user: who' in found
    assert found.endswith("2 of the first 3 events of log.jsonl match.")
    assert "match" not in shown(TREE.replace("event login", "event lo|gin"), Sample())
    assert "match" not in shown(
        TREE.replace("event login", "event lo|gin") + "x or ;"
    )  # with an error there is no tree


def test_a_fence_is_longer_than_those_inside() -> None:
    assert shown('to|p label "```";').startswith("````rvaft\n")


# Names


def test_definitions_and_references(tmp_path: Path) -> None:
    part = written(tmp_path / "part.rvaft", 'event e(x) = { x: x };\n"a" fault;')
    text = 'import "part.rvaft"; top or a b; a on e(X); b on e(X) when at(a) < at("b");'
    document = Document(text, str(tmp_path / "top.rvaft"))

    def at(places: list[Target]) -> list[tuple[str, int, int]]:
        return [(Path(file).name, *region[0]) for file, region in places]

    assert at(definition(document, text.index("a b;"))) == [("top.rvaft", 0, 33), ("part.rvaft", 1, 0)]
    assert at(definition(document, text.index("e(X)"))) == [("part.rvaft", 0, 6)]
    assert at(references(document, text.index("e(X)"), declarations=False)) == [
        ("top.rvaft", 0, 38),
        ("top.rvaft", 0, 49),
    ]
    assert at(references(document, text.index("b;"))) == [("top.rvaft", 0, n) for n in (30, 44, text.index('"b"'))]
    assert at(definition(document, text.index("part"))) == [("part.rvaft", 0, 0)]
    assert definition(document, text.index("when")) == definition(document, text.index("X)")) == []
    assert part.read_text(encoding="utf-8").startswith("event e")


def test_imports_in_a_circle_end(tmp_path: Path) -> None:
    written(tmp_path / "b.rvaft", 'import "a.rvaft"; import "a.rvaft"; b fault;')
    text = 'import "b.rvaft"; import "none.rvaft"; top or b;'
    document = Document(text, str(written(tmp_path / "a.rvaft", text)))
    assert [Path(page.file).name for page in document.pages] == ["a.rvaft", "b.rvaft"]


def test_symbols_are_nodes_and_event_types() -> None:
    assert [(one.name, one.sort.value, one.detail) for one in symbols(Document(TREE + "x on ;"))] == [
        ("login", "event", ""),
        ("top", "node", "sand first last"),
        ("first", "node", ""),
        ("last", "node", ""),
        ("x", "node", ""),
    ]


# Completion


@pytest.mark.parametrize(
    ("text", "first"),
    [
        ("|", ["toplevel", "param"]),
        ("top or a b; |", ["top", "a", "b", "toplevel"]),
        ("ev|", ["event"]),
        ("top s|", ["sand", "sand_rl", "seq", "spare"]),
        ("top 2|", ["2of3"]),
        ("top or a b; b wi|", ["within", "without"]),
        ("semantics |", ["strict", "projected", "consecutive", "scattered"]),
        ("semantics sc|", ["scattered"]),
        ("assume types, |", ["types", "present", "case", "exact", "order"]),
        ("time t as |", ["s", "ms", "us", "ns"]),
        ("time |", ["event", "user", "at"]),
        ("causality |", ["top_down", "bottom_up"]),
        ("event e(x: |", ["text", "integer"]),
        ("event e(x) = { |", ["event", "user", "at"]),
        ("event e(x) = { at: { |", ["host", "port"]),
        ("event e(x) = { at: { host: 1 }, u|", ["user"]),
        ("event e(x) = { event: |", ['"login"', '"logout"', "x"]),
        ('event e(x) = { event: "logo|', ['"logout"']),
        ('event e(x) = { event: "logo|", user: x };', ['"logout"']),
        ("event e(x) = { at: { port: |", ["22", "x"]),
        ("event e(x) = { at: [|", ["x"]),
        (TREE + "x on |", ["login"]),
        (TREE + "x on login(|", ['"eve"', '"bob"']),
        (TREE + "x on login(_, |", ['"a"', '"b"']),
        (TREE + "x on login(_, Host) when |", ["Host"]),
        (TREE + "x when at(|", ["top", "first", "last"]),
        (TREE + "x when st|", ["start", "startswith"]),
        (TREE + "toplevel |", ["top", "first", "last"]),
        ("top or |a b; a fault;", ["top", "b", "a"]),
    ],
)
def test_completion_by_place(text: str, first: list[str]) -> None:
    found = labels(text)
    assert [label for label in found if label in first][: len(first)] == first
    assert set(found[: len(first)]) & set(first)


@pytest.mark.parametrize("text", ["top or ;|;", "a on ) |", "# o|", 'top label "x|', "top label |", "x on e() times |"])
def test_no_completion(text: str) -> None:
    assert [label for label in labels(text) if label != "top"] in ([], labels("|"))


def test_a_completed_text_is_in_the_grammar() -> None:
    text = TREE + "x on "
    document = Document(text)
    for one in proposals(document, len(text), SAMPLE):
        assert problems(Document(text[: one.start] + one.label + "(_, _); top or x;")) is not None
    quoted = Document('event e(x) = { event: "logo", user: x };')
    (found,) = proposals(quoted, quoted.text.index('",'), SAMPLE)
    assert quoted.text[: found.start] + found.label + quoted.text[found.end :] == (
        'event e(x) = { event: "logout", user: x };'
    )


@given(PIECES, st.data())
def test_any_text_is_analysed(text: str, data: st.DataObject) -> None:
    document = Document(text)
    offset = data.draw(st.integers(0, len(text)))
    assert problems(document) is not None
    for one in proposals(document, offset, SAMPLE):
        assert one.start <= offset <= one.end
    hover(document, offset, SAMPLE)
    references(document, offset)
    for symbol in symbols(document):
        assert symbol.region.start <= symbol.selection.start <= symbol.selection.end <= symbol.region.end


# Samples


def test_the_sample_is_that_of_the_traces_or_of_the_setting(tmp_path: Path) -> None:
    tree = tmp_path / "a.rvaft"
    (tmp_path / "a.traces").mkdir()
    written(tmp_path / "a.traces" / "one.jsonl", '{"n": 1}\n{"n": 2}\n')
    written(tmp_path / "a.traces" / "two.jsonl", '{"n": 3}\nno JSON\n')
    other = written(tmp_path / "other.csv", "n\n4\n")
    found = sample_log.read(sample_log.files_of(str(tree)))
    assert (found.name, [event["n"] for event in found.events]) == ("2 logs", [1, 2, 3])
    assert sample_log.files_of(str(tree), "other.csv") == [other]
    assert sample_log.read([other]).values(("n",)) == ["4"]
    assert sample_log.files_of(str(tree), "mqtt://broker/x") == sample_log.files_of(str(tree), "none.jsonl") == []
    assert sample_log.read([]).events == ()


def test_a_sample_is_bounded(tmp_path: Path) -> None:
    log = written(tmp_path / "log.jsonl", '{"n": 1}\n' * 3_000)
    assert len(sample_log.read([log]).events) == sample_log.EVENTS
