"""SQL: names and texts that try to leave the query, paths that DuckDB interprets, and limits of `--engine duckdb`."""

import csv
import gzip
import json
import os
import signal
import sqlite3
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Sequence
from itertools import product
from pathlib import Path
from typing import Any

import pytest

from backends.sql import connections
from backends.sql.connections import DuckDbConnection, NamedFile
from backends.sql.dialects import identifier, literal, qualified
from backends.sqlite import SqliteConnection
from rvaft import Semantics, loads
from rvaft.backend import backend
from rvaft.errors import LanguageError, NotExpressible, RvaftError
from tests.cli.runs import COMMAND, lines, run, soon, started, written
from tests.tables import sampled

duckdb = pytest.importorskip("duckdb", reason="DuckDB is not installed")

ASSUMED = "assume types, present; semantics scattered;"
TREE = (
    'event x(u: text) = { event: "x", u: u }; event y(u: text) = { event: "y", u: u };'
    f"{ASSUMED} top sand a b; a on x(U); b on y(U);"
)
FOUND = [{"event": "x", "u": "a"}, {"event": "z", "u": "a"}, {"event": "y", "u": "a"}]
COPY = (
    'e" AS c1, NULL::VARCHAR AS time_number, NULL::VARCHAR AS time_text, NULL AS instant, false AS odd, '
    "false AS doubtful FROM (SELECT 'x' AS e)); COPY (SELECT 42) TO 'stolen.csv' (USE_TMP_FILE false); --"
)
NAMES = (
    COPY,
    'a"',
    '"',
    '""',
    "a'b",
    "';--",
    "; DROP TABLE log; --",
    "a -- b",
    "/* a",
    "a\\",
    "\\'",
    "a\nb",
    "[a]",
    "a]",
    "{a}",
    "$1",
    "?",
    "%s",
    "select",
    "a.b",
    "pos",
    "key",
    "other",
    "json",
    "f",
    "c1",
    "f0",
    "k0",
    "odd",
    "long",
    "rowid",
    "filename",
    "file_row_number",
    "*",
    "v1_key",
    "é",
    "😀",
    " a ",
)


def names(of: Sequence[str] = NAMES) -> pytest.MarkDecorator:
    return pytest.mark.parametrize("name", sampled([(name,) for name in of], 4, pytest.mark.slow), ids=range(len(of)))


def field_tree(name: str) -> str:
    """A tree that reads the field as text, in a literal and in a parameter."""
    field = json.dumps(name, ensure_ascii=False)
    return (
        f'event x(u: text) = {{ event: "x", {field}: u }}; event y() = {{ event: "y", {field}: "q" }};'
        f'{ASSUMED} top sand a b; a on x("p"); b on y();'
    )


def answers(tree: Path, log: Path | str, *options: object) -> bool:
    """Assert that the run with DuckDB equals the run without it; return whether DuckDB answered."""
    plain, asked = run("monitor", tree, log, *options), run("monitor", tree, log, *options, "--engine", "duckdb")
    told = [line for line in asked.stderr.splitlines() if "is read without DuckDB: " not in line]
    assert (asked.stdout, asked.exit_code, told) == (plain.stdout, plain.exit_code, plain.stderr.splitlines())
    return len(told) == len(asked.stderr.splitlines())


def parquet(path: Path, columns: dict[str, list[Any]]) -> Path:
    pa = pytest.importorskip("pyarrow", reason="pyarrow is not installed")
    pq = pytest.importorskip("pyarrow.parquet", reason="pyarrow is not installed")
    pq.write_table(pa.table([pa.array(column) for column in columns.values()], names=list(columns)), path)
    return path


def there(folder: Path | str = ".") -> list[str]:
    return sorted(path.name for path in Path(folder).iterdir())


@pytest.fixture(autouse=True)
def inside(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)


# Names in logs and trees.


@names()
@pytest.mark.parametrize("options", [(), ("--key", "u")], ids=["", "key"])
def test_a_column_of_parquet_is_a_name(name: str, options: Sequence[str], tmp_path: Path) -> None:
    log = parquet(tmp_path / "log.parquet", {"event": ["x", "z", "y"], name: ["p", "q", "q"], "u": ["k", "k", "k"]})
    assert answers(written(tmp_path / "tree.rvaft", field_tree(name)), log, *options)
    assert run("monitor", tmp_path / "tree.rvaft", log, "--engine", "duckdb").exit_code == 1
    assert there() == ["log.parquet", "tree.rvaft"]


@names()
def test_a_column_of_parquet_that_is_not_read_and_one_that_is_absent_are_names(name: str, tmp_path: Path) -> None:
    log = parquet(tmp_path / "log.parquet", {"event": ["x", "z", "y"], name: ["p", "q", "q"], "u": ["a", "a", "a"]})
    answers(written(tmp_path / "tree.rvaft", TREE), log)
    answers(tmp_path / "tree.rvaft", log, "--key", name)
    other = parquet(tmp_path / "other.parquet", {"event": ["x", "z", "y"], "u": ["a", "a", "a"]})
    answers(tmp_path / "tree.rvaft", other, "--key", name)
    answers(written(tmp_path / "tree.rvaft", field_tree(name)), other)
    assert there() == ["log.parquet", "other.parquet", "tree.rvaft"]


@names()
def test_a_column_of_csv_is_a_name(name: str, tmp_path: Path) -> None:
    for quoting in (csv.QUOTE_MINIMAL, csv.QUOTE_ALL):
        with (tmp_path / "log.csv").open("w", newline="", encoding="utf-8") as stream:
            writer = csv.writer(stream, quoting=quoting)
            writer.writerows([["event", name, "u"], ["x", "p", "k"], ["z", "q", "k"], ["y", "q", "k"]])
        tree = written(tmp_path / "tree.rvaft", field_tree(name))
        answers(tree, tmp_path / "log.csv")
        answers(tree, tmp_path / "log.csv", "--key", "u")
        answers(tree, tmp_path / "log.csv", "--key", name)
        answers(tree, written(tmp_path / "other.csv", "event,u\nx,k\ny,k\n"), "--key", name)
    assert there() == ["log.csv", "other.csv", "tree.rvaft"]


@names()
def test_a_field_of_json_is_a_name(name: str, tmp_path: Path) -> None:
    events = [{"event": "x", name: "p"}, {"event": "z", name: "q"}, {"event": "y", name: "q"}]
    log = written(tmp_path / "log.jsonl", lines(events))
    answers(written(tmp_path / "tree.rvaft", field_tree(name)), log)
    answers(tmp_path / "tree.rvaft", log, "--key", name)
    answers(written(tmp_path / "tree.rvaft", TREE), log, "--key", name)
    assert there() == ["log.jsonl", "tree.rvaft"]


@pytest.mark.parametrize(
    "columns",
    [
        {"event": ["x", "y"], "u": ["a", "b"], "U": ["a", "a"]},
        {"event": ["x", "y"], "U": ["b", "b"], "u": ["a", "a"]},
        {"event": ["x", "y"], "U_1": ["a", "a"]},
        {"event": ["z", "z"], "EVENT": ["x", "y"], "u": ["a", "a"]},
    ],
    ids=range(4),
)
def test_columns_that_differ_in_case_only_are_not_renamed(columns: dict[str, list[Any]], tmp_path: Path) -> None:
    log = parquet(tmp_path / "log.parquet", columns)
    answers(written(tmp_path / "tree.rvaft", TREE), log)
    answers(written(tmp_path / "tree.rvaft", field_tree("EVENT_1")), log)
    answers(written(tmp_path / "tree.rvaft", field_tree("u_1")), log)


@pytest.mark.parametrize(
    "head",
    [
        "sep=,",
        "[event,u",
        "{event,u",
        " [event,u",
        '""event,u',
        '"event,u',
        'ev"ent,u',
        '"event""",u',
        "event,",
        "<a>,u",
    ],
)
def test_a_header_of_csv_is_that_of_the_reader(head: str, tmp_path: Path) -> None:
    log = written(tmp_path / "log.csv", f"{head}\nx,a\ny,a\n")
    answers(written(tmp_path / "tree.rvaft", TREE), log)
    log.write_bytes(head.encode("utf-16") + b"\nx,a\n")
    answers(tmp_path / "tree.rvaft", log)
    log.write_bytes(b"event,u,\xff\nx,a,b\ny,a,b\n")
    answers(tmp_path / "tree.rvaft", log)
    written(log, "sep=x\nevent\nx\ny\n")
    answers(written(tmp_path / "tree.rvaft", "semantics scattered; top sand x y;"), log)


def test_quotes_that_stay_open_do_not_take_quadratic_time(tmp_path: Path) -> None:
    log = written(tmp_path / "log.csv", "event,u\n" + '",\n' * 60_000)
    begun = time.process_time()
    run("monitor", written(tmp_path / "tree.rvaft", TREE), log, "--engine", "duckdb")
    assert time.process_time() - begun < 20


# Names in texts.

KEYWORDS = duckdb.connect().execute("SELECT keyword_name FROM duckdb_keywords() ORDER BY 1").fetchall()


@pytest.mark.parametrize(
    "ask", [lambda: SqliteConnection().ask, lambda: DuckDbConnection().ask], ids=["sqlite", "duckdb"]
)
def test_every_keyword_and_every_text_is_a_name(ask: Callable[[], Callable[[str], Any]]) -> None:
    words = [
        *(word for (word,) in KEYWORDS if word not in ("true", "false")),
        "add",
        "autoincrement",
        "escape",
        "raise",
    ]
    query = ask()
    for name in map(identifier, [*words, *NAMES]):
        rows = query(f"SELECT {name}, e.{name} AS {name} FROM (SELECT 'x' AS {name}) AS e GROUP BY {name}, e.{name}")
        assert rows[1] == [("x", "x")]


@pytest.mark.parametrize("name", ["", "a\0b", "a\ud800"])
def test_what_is_no_name_in_sql_is_refused(name: str) -> None:
    with pytest.raises(NotExpressible, match="no name of a column"):
        identifier(name)
    with pytest.raises(NotExpressible):
        qualified(f"main.{name}")


@names([*NAMES, "\x1b[2J", "a\u2028b"])
def test_a_value_is_a_literal(name: str) -> None:
    assert SqliteConnection().ask(f"SELECT {literal(name, 'char')}")[1] == [(name,)]
    assert DuckDbConnection().ask(f"SELECT {literal(name)}")[1] == [(name,)]


@names()
@pytest.mark.parametrize("dialect", ["sqlite", "duckdb"])
def test_a_column_of_a_table_is_a_name(name: str, dialect: str, tmp_path: Path) -> None:
    tree, field = loads(field_tree(name)), name
    table = {"table": "n1", "columns": {field: name}, "dialect": dialect}
    try:
        text = backend("sql").mapped(table).translate(tree, Semantics.SCATTERED).text
    except RvaftError:
        assert set(name) & set('"\n'), name
        return
    if name == "a.b":  # dots separate the parts of a name that a user gives
        return
    program = sqlite3.connect(":memory:") if dialect == "sqlite" else duckdb.connect()
    quoted = '"' + name.replace('"', '""') + '"'
    if dialect == "duckdb" or name != "rowid":
        program.execute(f"CREATE TABLE n1 (event TEXT, {quoted} TEXT)")
        program.execute("INSERT INTO n1 VALUES ('x', 'p'), ('z', 'q'), ('y', 'q')")
        assert len(program.execute(text).fetchall()) == 1
    assert there(tmp_path) == []


def test_a_name_in_the_comment_of_a_text_does_not_run() -> None:
    text = (
        '-- rvaft sql {0}\n-- table "t (a INTEGER); ATTACH \'x.db\' AS x; --\\"", position "rowid"\n'
        '-- column "u" text of ["u"]\nSELECT 1 AS detected\n'
    )
    for dialect in ("sqlite", "duckdb"):
        with pytest.raises(LanguageError, match="no name of a column"):
            backend("sql-table").mapped({"table": "t", "dialect": dialect}).read(text.format(dialect))


@pytest.mark.parametrize("text", ["epoch_us(at)", "v1_key", "e1.v1_json", "'v1_key'"])
def test_a_literal_is_not_rewritten(text: str) -> None:
    pytest.importorskip("sqlglot", reason="SQLGlot is not installed")
    tree = loads(
        f"event x(u: text) = {{ event: {json.dumps(text)}, u: u }}; {ASSUMED} time t as iso8601; "
        "top sand a b within 1 s; a on x(U); b on x(U);"
    )
    for dialect in ("duckdb", "trino"):
        table = {"table": "t", "time": "at:timestamp", "position": "pos", "dialect": dialect}
        found = backend("sql").mapped(table).translate(tree, Semantics.SCATTERED).text
        assert literal(text) in found


# Texts of strangers.

REFUSED = {
    "sqlite": (
        "SELECT 1 AS trace, 1 AS detected) AS found; DROP TABLE events; --",
        "SELECT 1 AS trace, 1 AS detected) AS a UNION SELECT 1, 2 FROM (SELECT 1",
        "SELECT 1 AS trace, 1 AS detected /*",
        "SELECT 1 AS trace, 1 AS detected; SELECT 2",
        "SELECT 1 AS trace, 1 AS detected FROM events\0",
        "ATTACH 'stolen.db' AS q",
        "VACUUM INTO 'stolen.db'",
        "PRAGMA user_version",
        "INSERT INTO events VALUES (1, 1, '', 1) RETURNING 1 AS trace, 1 AS detected",
        "CREATE TABLE a (b)",
        "EXPLAIN SELECT 1 AS trace, 1 AS detected",
        "SELECT 1 AS trace, load_extension('x') AS detected",
        "SELECT 1 AS trace, writefile('stolen.csv', 'x') AS detected",
        "SELECT 1 AS trace, length(readfile('/etc/passwd')) AS detected",
        "SELECT 1 AS trace, 1 AS detected FROM pragma_database_list",
        "SELECT 1 AS trace, 1 AS detected FROM sqlite_master",
        "SELECT 1 AS trace, length(zeroblob(900000000)) AS detected",
    ),
    "duckdb": (
        "SELECT 1 AS trace, 1 AS detected) AS found; DROP TABLE events; --",
        "SELECT 1 AS trace, 1 AS detected) AS a UNION SELECT 1, 2 FROM (SELECT 1",
        "SELECT 1 AS trace, 1 AS detected /*",
        "SELECT 1 AS trace, 1 AS detected; SELECT 2",
        "SELECT 1 AS trace, 1 AS detected\0",
        "ATTACH 'stolen.db' AS q",
        "COPY (SELECT 42) TO 'stolen.csv'",
        "EXPORT DATABASE 'stolen'",
        "PRAGMA version",
        "CALL pragma_version()",
        "INSTALL httpfs",
        "LOAD httpfs",
        "SET enable_external_access = true",
        "CREATE TABLE a AS SELECT 1",
        "EXPLAIN SELECT 1",
        "PREPARE v AS SELECT 1",
        "SELECT 1 AS trace, 1 AS detected FROM read_csv('/etc/passwd')",
        "SELECT 1 AS trace, 1 AS detected FROM read_text('/etc/passwd')",
        "SELECT 1 AS trace, 1 AS detected FROM read_blob('/etc/passwd')",
        "SELECT 1 AS trace, 1 AS detected FROM sniff_csv('/etc/passwd')",
        "SELECT 1 AS trace, 1 AS detected FROM '/etc/passwd'",
        "SELECT 1 AS trace, 1 AS detected FROM 'http://localhost/a.csv'",
        "SELECT 1 AS trace, 1 AS detected FROM query('FROM read_text(''/etc/passwd'')')",
        "SELECT 1 AS trace, 1 AS detected FROM glob('/etc/*')",
        "SELECT 1 AS trace, len(getenv('HOME')) AS detected",
        "SELECT 1 AS trace, 1 AS detected FROM REFUSED",
        "SELECT 1 AS trace, 1 AS detected FROM sqlite_scan('stolen.db', 'a')",
    ),
}


@pytest.mark.parametrize(
    ("dialect", "text"),
    [
        pytest.param(name, text, id=f"{name}-{number}")
        for name, some in REFUSED.items()
        for number, text in enumerate(some)
    ],
)
def test_a_text_can_select_events_and_nothing_else(dialect: str, text: str, tmp_path: Path) -> None:
    name = "sql" if dialect == "sqlite" else "sql-duckdb"
    with pytest.raises(LanguageError):
        backend(name).read(f"-- rvaft sql {dialect}\n{text}\n")
    assert there(tmp_path) == []
    tables = "events, json_each(event) AS a, json_tree(event) AS b"
    monitor = backend(name).read(f"WITH c AS (SELECT trace, pos AS detected FROM {tables}) SELECT * FROM c")
    assert [verdict.symbol for verdict in monitor.run([{"event": "x"}])] == ["⊤"]


@pytest.mark.parametrize(
    "statement",
    [*REFUSED["duckdb"][5:8], *REFUSED["duckdb"][10:13], "SET threads = 8", "SET lock_configuration = false"],
)
def test_a_connection_to_duckdb_neither_writes_nor_changes_its_settings(statement: str, tmp_path: Path) -> None:
    with DuckDbConnection(spills=True) as connection, pytest.raises(duckdb.Error):
        connection.ask(statement)
    assert there(tmp_path) == []


@pytest.mark.parametrize(
    "statement", ["ATTACH 'stolen.db' AS q", "PRAGMA hard_heap_limit = 0", "VACUUM INTO 'stolen.db'"]
)
def test_a_connection_to_sqlite_opens_no_other_database(statement: str, tmp_path: Path) -> None:
    with pytest.raises(sqlite3.Error):
        SqliteConnection().execute(statement)
    assert there(tmp_path) == []


# Paths.

FOLDERS = (
    "event=noise",
    "u=b",
    "w*",
    "w?",
    "w[1]",
    "w[!1]",
    "w{1,2}",
    "w\\",
    "w\\*",
    "**",
    "s3:",
    "http:",
    "~",
    "a'b",
    'a"b',
    "a;b",
    "a\nb",
    " a ",
    "é",
    "%41",
    "$HOME",
    "a=b=c",
)


def log_of(path: Path, events: list[dict[str, Any]]) -> Path:
    """Write the events in the format of the suffix."""
    columns = {name: [event[name] for event in events] for name in events[0]}
    match path.suffix:
        case ".jsonl":
            return written(path, lines(events))
        case ".csv":
            return written(
                path, "\n".join(",".join(row) for row in [[*columns], *zip(*columns.values(), strict=True)]) + "\n"
            )
        case _:
            return parquet(path, columns)


@names(FOLDERS)
@pytest.mark.parametrize("suffix", [".jsonl", ".csv", ".parquet"])
def test_a_path_is_that_of_one_file(name: str, suffix: str, tmp_path: Path) -> None:
    tree = written(tmp_path / "tree.rvaft", TREE)
    for other in ("w1", "w2", "wa", "w", "a"):  # what the name means as a pattern has a match
        (tmp_path / other).mkdir()
        log_of(tmp_path / other / f"log{suffix}", FOUND)
        log_of(tmp_path / other / f"more{suffix}", FOUND)
    folder = tmp_path / name
    folder.mkdir()
    log_of(folder / f"log{suffix}", FOUND[:2])
    assert answers(tree, f"./{name}/log{suffix}")
    log_of(folder / f"log{suffix}", [*FOUND[1:2] * 100, *FOUND])  # what groups of events have first is no detection
    assert answers(tree, folder / f"log{suffix}", "--detections")
    link = tmp_path / f"link{suffix}"
    link.symlink_to(folder / f"log{suffix}")
    assert run("monitor", tree, link, "--engine", "duckdb").exit_code == 1


@names([*FOLDERS, "log*", "[log]"])
@pytest.mark.parametrize("suffix", [".jsonl", ".csv", ".parquet"])
def test_a_name_of_a_file_is_no_pattern(name: str, suffix: str, tmp_path: Path) -> None:
    tree = written(tmp_path / "tree.rvaft", TREE)
    for other in ("log1", "w1", "w2", "l", "a"):
        log_of(tmp_path / f"{other}{suffix}", FOUND)
    log = log_of(tmp_path / f"{name}{suffix}", FOUND[:2])
    assert answers(tree, f"./{log.name}")


@names(FOLDERS)
def test_without_names_of_descriptors_a_private_link_names_the_file(
    name: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(connections, "DESCRIPTORS", "/absent")
    (tmp_path / name).mkdir()
    log, tree = log_of(tmp_path / name / "log.jsonl", FOUND), written(tmp_path / "tree.rvaft", TREE)
    assert answers(tree, log)
    assert answers(tree, Path(name, "log.jsonl"))
    (tmp_path / "tmp*").mkdir()
    monkeypatch.setattr("tempfile.tempdir", str(tmp_path / "tmp*"))
    assert not answers(tree, log)
    assert there(tmp_path / "tmp*") == []


@pytest.mark.parametrize(
    ("damage", "packing", "suffix"),
    sampled(
        product(
            ["none", "plain", "gz", "zst", "twice", "truncated", "checksum", "rest"],
            [".gz", ".zst", ".GZ", "", ".bz2"],
            [".jsonl", ".csv"],
        ),
        7,
        pytest.mark.slow,
    ),
)
def test_the_suffix_decides_about_compression(suffix: str, packing: str, damage: str, tmp_path: Path) -> None:
    zstandard = pytest.importorskip("zstandard", reason="zstandard is not installed")
    pack: Callable[[bytes], bytes] = {".gz": gzip.compress, ".zst": zstandard.compress}.get(packing.lower(), bytes)
    data = log_of(tmp_path / f"plain{suffix}", FOUND).read_bytes()
    packed = pack(data)
    found = {
        "plain": data,
        "gz": gzip.compress(data),
        "zst": zstandard.compress(data),
        "twice": pack(data[:20]) + pack(data[20:]),
        "truncated": packed[:-9],
        "checksum": packed[:-8] + b"\0\0\0\0" + packed[-4:],
        "rest": packed + b"\0rest",
    }.get(damage, packed)
    log = tmp_path / f"log{suffix}{packing}"
    log.write_bytes(found)
    form = ["--input", suffix[1:]] if suffix == ".csv" else []
    tree = written(tmp_path / "tree.rvaft", TREE)
    plain = run("monitor", tree, log, *form)
    asked = run("monitor", tree, log, *form, "--engine", "duckdb")
    assert (asked.stdout, asked.exit_code) == (plain.stdout, plain.exit_code)
    if damage == "none":
        assert "without DuckDB" not in asked.stderr


@pytest.mark.parametrize("place", [0, 4, 60, 200, -40, -5, -1])
def test_a_damaged_table_is_an_error(place: int, tmp_path: Path) -> None:
    log = log_of(tmp_path / "log.parquet", FOUND)
    data = bytearray(log.read_bytes())
    data[place] ^= 0xFF
    log.write_bytes(data)
    answers(written(tmp_path / "tree.rvaft", TREE), log)
    log.write_bytes(data[:place])
    answers(tmp_path / "tree.rvaft", log)


# Other files than regular ones, interrupts and limits.


@pytest.mark.parametrize("suffix", ["jsonl", "csv"])
def test_a_pipe_is_read_without_duckdb(suffix: str, tmp_path: Path) -> None:
    tree, data = written(tmp_path / "tree.rvaft", TREE), log_of(tmp_path / f"log.{suffix}", FOUND).read_bytes()
    os.mkfifo(tmp_path / f"pipe.{suffix}")
    writer = threading.Thread(target=(tmp_path / f"pipe.{suffix}").write_bytes, args=(data,), daemon=True)
    writer.start()
    with started("monitor", tree, tmp_path / f"pipe.{suffix}", "--engine", "duckdb") as running:
        told = running.communicate(timeout=20)
    assert running.returncode == 1
    assert "is read without DuckDB: it is not a regular file" in told[1]
    writer.join(5)


@pytest.mark.parametrize("name", ["absent.jsonl", "absent.csv", "absent.parquet", "folder.jsonl", "below/log.jsonl"])
def test_a_log_that_cannot_be_opened_has_the_ordinary_error_alone(name: str, tmp_path: Path) -> None:
    tree, log = written(tmp_path / "tree.rvaft", TREE), tmp_path / name
    written(tmp_path / "below", "")
    if name == "folder.jsonl":
        log.mkdir()
    asked = run("monitor", tree, log, "--engine", "duckdb")
    assert (asked.exit_code, asked.stderr) == (2, run("monitor", tree, log).stderr)
    assert len(asked.stderr.splitlines()) == 1


@pytest.mark.parametrize("name", ["log.jsonl", r"a \1 [log].jsonl", "log.parquet"])
def test_errors_of_duckdb_have_the_name_of_the_log(name: str, tmp_path: Path) -> None:
    log = written(tmp_path / name, '{"event": "a"}\n{"event": "b" "x"}\n')
    told = run("monitor", written(tmp_path / "tree.rvaft", TREE), log, "--engine", "duckdb").stderr
    assert f"{log} is read without DuckDB: DuckDB: " in told
    assert str(log) in told.partition("DuckDB: DuckDB: ")[2].splitlines()[0]
    assert "/proc/" not in told


@pytest.mark.parametrize("name", ["/dev/null", "/dev/zero", "absent.jsonl", "."])
def test_a_device_is_not_opened(name: str) -> None:
    with pytest.raises(OSError, match="not a regular file"):
        NamedFile(Path(name))


def bomb(path: Path, mebibytes: int) -> Path:
    """Events that fill much more memory than the file."""
    block = lines([{"event": "x", "u": "a"}]).encode() * (2**20 // 26)
    with gzip.open(path, "wb", compresslevel=1) as stream:
        for _ in range(mebibytes):
            stream.write(block)
    return path


_MEASURING = (
    "import json, resource, subprocess, sys\n"
    "silent = dict.fromkeys(('stdin', 'stdout', 'stderr'), subprocess.DEVNULL)\n"
    "done = subprocess.run(sys.argv[1:], **silent)\n"
    "print(json.dumps([done.returncode, resource.getrusage(resource.RUSAGE_CHILDREN).ru_maxrss]))"
)


def measured(*args: object, **options: Any) -> tuple[int, int]:
    """Run the command; return the status and the peak of its memory in MiB.

    A small process starts it: the peak of a process includes what its parent had when it was forked.
    """
    words = [sys.executable, "-c", _MEASURING, *COMMAND, *map(str, args)]
    done = subprocess.run(words, stdout=subprocess.PIPE, check=True, **options)
    status, memory = json.loads(done.stdout)
    return status, memory // (2**10 if sys.platform == "linux" else 2**20)


@pytest.mark.parametrize("mebibytes", [50, pytest.param(1500, marks=pytest.mark.slow)])
def test_a_packed_log_does_not_fill_the_memory(mebibytes: int, tmp_path: Path) -> None:
    log, tree = bomb(tmp_path / "log.jsonl.gz", mebibytes), written(tmp_path / "tree.rvaft", TREE)
    (tmp_path / "tmp").mkdir()
    status, memory = measured("monitor", tree, log, "--engine", "duckdb", env={**os.environ, "TMPDIR": "tmp"})
    assert (status, there("tmp")) == (0, [])
    assert memory < (1_000 if mebibytes == 50 else 1_400)


@pytest.mark.parametrize(("memory", "spilled"), [("20MB", "16GiB"), ("20MB", "0KiB"), ("1MB", "16GiB")])
def test_without_memory_or_disk_the_log_is_read_without_duckdb(
    memory: str, spilled: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(connections, "SETTINGS", {**connections.SETTINGS, "memory_limit": memory})
    monkeypatch.setattr(connections, "SPILLED", spilled)
    values = [f"{number}{'a' * 4000}" for number in range(5_000)]
    log = log_of(tmp_path / "log.csv", [{"event": "xy"[number % 2], "u": one} for number, one in enumerate(values)])
    assert not answers(written(tmp_path / "tree.rvaft", TREE), log)


def test_without_a_temporary_folder_the_log_is_read_without_duckdb(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("tempfile.tempdir", str(tmp_path / "absent"))
    assert not answers(written(tmp_path / "tree.rvaft", TREE), log_of(tmp_path / "log.jsonl", FOUND))


def test_an_interrupt_ends_a_load(tmp_path: Path) -> None:
    log, tree = bomb(tmp_path / "log.jsonl.gz", 400), written(tmp_path / "tree.rvaft", TREE)
    (tmp_path / "tmp").mkdir()
    given = {"env": {**os.environ, "TMPDIR": str(tmp_path / "tmp")}}
    with started("monitor", tree, log, "--engine", "duckdb", **given) as running:
        assert soon(lambda: bool(there("tmp")))
        time.sleep(1)
        begun = time.monotonic()
        running.send_signal(signal.SIGINT)
        running.wait(timeout=20)
    assert running.returncode == 130
    assert time.monotonic() - begun < 5
    assert there("tmp") == []


def test_a_statement_ends_at_its_time_limit_and_the_next_one_runs() -> None:
    slow = "SELECT count(*) FROM range(100000000) AS a, range(100000000) AS b WHERE a.range + b.range = 1"
    connection = DuckDbConnection()
    begun = time.monotonic()
    with pytest.raises(TimeoutError):
        connection.ask(slow, seconds=0.3)
    assert connection.ask("SELECT 1")[1] == [(1,)]
    assert time.monotonic() - begun < 10


def test_as_many_keys_as_events_are_not_kept(tmp_path: Path) -> None:
    log = log_of(tmp_path / "log.jsonl", [{"event": "x", "u": str(number)} for number in range(3_000)])
    assert not answers(written(tmp_path / "tree.rvaft", TREE), log, "--key", "u", "--max-keys", "100")


@pytest.mark.parametrize(
    ("form", "times"),
    [
        ("iso8601", ['"2024-01-01T00:00Z"', '"2023-01-01T00:00:00Z"', '"2023-01-01T00:00:01Z"']),
        ("iso8601", ['"2024-01-01T00:00:00.1234567891Z"', '"2023-01-01T00:00:00Z"', '"2023-01-01T00:00:01Z"']),
        ("s", ["1000000000000", "5", "6"]),
        ("s", ["100.0000000001", "5", "6"]),
        ("ns", [str(2**63), "5", "6"]),
    ],
)
def test_a_time_that_only_one_reads_makes_no_event_late_for_one_alone(
    form: str, times: list[str], tmp_path: Path
) -> None:
    tree = written(
        tmp_path / "tree.rvaft",
        f'assume types, present, exact; time "t" as {form} late 1 s; event ev(x: text) = {{ "event": x }};'
        'top sand a b within 10 s; a on ev("a"); b on ev("b"); semantics scattered;',
    )
    log = written(
        tmp_path / "log.jsonl",
        "".join(f'{{"event": "{name}", "t": {time}}}\n' for name, time in zip("xab", times, strict=True)),
    )
    plain, asked = run("monitor", tree, log), run("monitor", tree, log, "--engine", "duckdb")
    assert (asked.stdout, asked.exit_code) == (plain.stdout, plain.exit_code)
