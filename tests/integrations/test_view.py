"""`rvaft view`: the page over HTTP, how it grows with its log, and what else may come to that port;
and the page of `rvaft serve`.
"""

import json
import signal
import socket
import subprocess
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from time import time
from typing import Any, Final
from urllib.parse import urlsplit
from urllib.request import urlopen

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import rvaft
from rvaft import Semantics
from rvaft.reports import log_report as report
from rvaft.reports.log_report import LogReport
from rvaft.stream import pipeline
from rvaft.stream.data_warnings import DataWarnings
from rvaft.stream.event_buffer import EventBuffer
from rvaft.stream.keys import Key
from rvaft.stream.monitor_set import MonitorSet, columns
from rvaft.stream.plan import MonitoringPlan, Totals
from rvaft.stream.run import TraceRun
from tests.cli.pages import Shown, data_of, fetched
from tests.cli.runs import SAND, failed, run, soon, started, written

TREE: Final = "top sand a b; a attack; b fault;\n"
NASTY: Final = (
    "<script>window.hacked = 1</script>",
    "<img src=x onerror='window.hacked = 1'>",
    "</script>\r\ndata: {}\n\n",
)
WAYS: Final = ("--semantics", "scattered", "--repeat")


def line(event: str, **more: object) -> str:
    return json.dumps({"event": event, **more}) + "\n"


def add(log: Path, *lines: str) -> None:
    with log.open("a", encoding="utf-8") as stream:
        stream.write("".join(lines))


@contextmanager
def viewing(folder: Path, *more: object, text: str = line("a"), follow: bool = True) -> Iterator[tuple[Any, str, Path]]:
    """`rvaft view` as a process of its own, where its page is, and the log."""
    tree, log = written(folder / "tree.rvaft", TREE), written(folder / "log.jsonl", text)
    with started("view", tree, log, *(["--follow"] if follow else []), *more) as running:
        said = running.stdout.readline()
        assert said.startswith("the page is at http://127.0.0.1:"), (said, running.stderr.read())
        yield running, said.split()[-1], log


def ended(running: Any, sign: signal.Signals = signal.SIGTERM) -> tuple[int, list[str]]:
    """The exit status after a signal, and what was said on standard error."""
    running.send_signal(sign)
    said = running.communicate(timeout=20)[1]
    return running.returncode, said.splitlines()


def news(url: str, cursor: str) -> dict[str, Any]:
    """The first event of the stream after a cursor."""
    with urlopen(f"{url}events?after={cursor}", timeout=20) as stream:
        found = dict(stream.readline().decode().rstrip("\n").split(": ", 1) for _ in range(2))
        return {"id": found["id"], **json.loads(found["data"])}


def raw(url: str, sent: bytes) -> bytes:
    """What is answered to these bytes, up to the end of the connection."""
    host, port = urlsplit(url).netloc.split(":")
    with socket.create_connection((host, int(port)), timeout=20) as connection:
        connection.sendall(sent)
        return b"".join(iter(lambda: connection.recv(65536), b""))


BAD: Final = {
    b"nonsense passwd\r\n\r\n": 400,
    b"nonsense of /etc/passwd\r\n\r\n": 400,
    b"GET / HTTP/9.9\r\n\r\n": 505,
    b"GET / HTTP/1.1\r\n\r\n": 403,
    b"GET / HTTP/1.1\r\nHost: evil.example\r\n\r\n": 403,
    b"GET / HTTP/1.1\r\nHost: 127.0.0.1\r\nHost: evil.example\r\n\r\n": 403,
    b"GET / HTTP/1.1\r\nX: " + b"y" * 70_000 + b"\r\n\r\n": 431,
    b"GET / HTTP/1.1\r\n" + b"X: y\r\n" * 200 + b"\r\n": 431,
    b"GET /" + b"y" * 70_000 + b" HTTP/1.1\r\n\r\n": 414,
    b"GET /../../etc/passwd HTTP/1.1\r\nHost: localhost\r\n\r\n": 404,
    b"GET /%2e%2e/etc/passwd HTTP/1.1\r\nHost: localhost\r\n\r\n": 404,
    b"GET http://[/ HTTP/1.1\r\nHost: localhost\r\n\r\n": 404,
    b"POST / HTTP/1.1\r\nHost: localhost\r\nContent-Length: 2\r\n\r\nhi": 405,
    b"passwd / HTTP/1.1\r\nHost: localhost\r\n\r\n": 501,
    b"HEAD / HTTP/1.1\r\nHost: localhost\r\n\r\n": 200,
    b"HEAD /events HTTP/1.1\r\nHost: localhost\r\n\r\n": 200,
}


@pytest.mark.ci
def test_whatever_comes_is_answered_and_the_page_goes_on(tmp_path: Path) -> None:
    with viewing(tmp_path) as (running, url, _):
        for sent, status in BAD.items():
            answer = raw(url, sent)
            assert answer.startswith(f"HTTP/1.1 {status} ".encode()), (sent[:60], answer[:100])
            assert b"passwd" not in answer
        host, port = urlsplit(url).netloc.split(":")
        for sent in (b"", b"GET", b"GET /events HTTP/1.1\r\nHost: localhost\r\n\r\n"):  # gone before the answer
            with socket.create_connection((host, int(port))) as connection:
                connection.sendall(sent)
        with urlopen(url, timeout=20) as answer:
            rules = answer.headers["Content-Security-Policy"]
        assert "default-src 'none'" in rules
        assert "unsafe" not in rules
        assert ended(running) == (0, [f"rvaft: the page at {url} is closed"])


@pytest.mark.ci
def test_the_page_grows_with_its_log(tmp_path: Path) -> None:
    with viewing(tmp_path, *WAYS) as (running, url, log):
        data = fetched(url)
        assert (data["places"]["number"], data["watches"]) == ([1], [[0, None, 1, [["?", None, 0]], False]])
        add(log, line("other"), line("b"))
        new = news(url, data["cursor"])
        assert (new["places"]["number"], new["at"]) in (([3], [1]), ([], []))  # it may look between the two
        assert soon(lambda: fetched(url)["watches"] == [[0, None, 3, [["?", None, 1]], False]])
        for nonsense in ("", "x", "0-0-0-0-0-0-0-0", data["cursor"].replace("-1", "-9999"), "%00%0d%0a"):
            assert news(url, nonsense)["places"]["number"] == [1, 3]
        log.rename(log.with_suffix(".1"))
        written(log, line("a") + line("b"))
        assert soon(lambda: fetched(url)["places"]["number"] == [1, 3, 4, 5])
        assert "was replaced and is now read from its start" in fetched(url)["told"]["said"][0]
        status, said = ended(running, signal.SIGINT)
        assert (status, said[-1]) == (1, f"rvaft: the page at {url} is closed")


def test_a_log_that_falls_silent_is_decided_by_the_clock(browser: Any, tmp_path: Path) -> None:
    text = "semantics scattered; time t as s; event e(x) = { e: x }; lost on e(X) without e(X) for 300 ms after;\n"
    tree = written(tmp_path / "tree.rvaft", text)
    log = written(tmp_path / "log.jsonl", f'{{"e": 7, "t": {time()}}}\n')
    with started("view", tree, log, "--follow", "--clock", "100ms") as running:
        url = running.stdout.readline().split()[-1]
        assert soon(lambda: fetched(url)["watches"] == [[0, None, 1, [["⊤", 1, 1]], False]])
        shown = Shown(browser, url)
        assert shown.text("#event").startswith("No event: the monitor was told the time ")
        assert shown.text("#detections ul") == "no e(X) for 300 ms after event 1"
        assert ended(running)[0] == 1
    failed(run("view", tree, log, "--clock", "1s"), "--clock needs events that arrive: --follow")
    failed(run("view", SAND, log, "--follow", "--clock", "1s"), "--clock needs the time of events")
    done = run("report", tree, log, "--complete", "-o", tmp_path / "page.html")
    assert done.exit_code == 1
    (change,) = data_of((tmp_path / "page.html").read_text(encoding="utf-8"))["changes"]
    assert change["passed"] == "end of the log"


def test_several_trees_have_a_page_each(tmp_path: Path) -> None:
    trees = [written(tmp_path / "one.rvaft", TREE), written(tmp_path / "two.rvaft", "top sand b a;\n")]
    log = written(tmp_path / "log.jsonl", line("a"))
    with started("view", *trees, *WAYS, "--follow", "--", log) as running:
        url = running.stdout.readline().split()[-1]
        cursor = fetched(f"{url}one/")["cursor"]
        add(log, line("b"))
        assert soon(lambda: fetched(f"{url}one/")["watches"] == [[0, None, 2, [["?", None, 1]], False]])
        assert news(f"{url}one/", cursor)["places"]["number"] == [2]
        assert fetched(f"{url}two/")["watches"] == [[0, None, 2, [["?", None, 0]], False]]
        with urlopen(url, timeout=20) as answer:
            assert f'<a href="one/">{trees[0]}</a></td><td>top</td><td class="number">1</td>' in answer.read().decode()
        for target in (b"/events", b"/three/", b"/three", b"/one/two/", b"/two/../"):
            assert raw(url, b"GET %s HTTP/1.1\r\nHost: localhost\r\n\r\n" % target).startswith(b"HTTP/1.1 404 ")
        assert raw(url, b"GET /one HTTP/1.1\r\nHost: localhost\r\n\r\n").startswith(b"HTTP/1.1 308 ")
        with urlopen(f"{url}two?x=1", timeout=20) as answer:
            assert answer.url == f"{url}two/"
        assert ended(running)[0] == 1


def test_the_pages_of_several_trees_over_a_finished_log(browser: Any, tmp_path: Path) -> None:
    trees = [written(tmp_path / "one.rvaft", TREE), written(tmp_path / "two.rvaft", "top sand b a;\n")]
    log = written(tmp_path / "log.jsonl", line("a") + line("b"))
    with started("view", *trees, *WAYS, "--", log) as running:
        url = running.stdout.readline().split()[-1]
        shown = Shown(browser, url)
        assert shown.text("tr.found td:last-child") == f"event 2 of {log}"
        browser.find_element("link text", str(trees[0])).click()
        assert shown.nodes("lit") == ["top", "a", "b"]
        browser.find_element("link text", "all trees").click()
        assert shown.text("h1") == "2 trees"
        assert [one for one in browser.get_log("browser") if url in one["message"]] == []
        assert ended(running)[0] == 1


def test_a_log_that_cannot_be_read_on_stays_on_the_page(tmp_path: Path) -> None:
    with viewing(tmp_path) as (running, url, log):
        add(log, "nonsense\n", line("b"))
        assert soon(lambda: any("log.jsonl:2: not JSON" in one for one in fetched(url)["told"]["said"]))
        assert fetched(url)["places"]["number"] == [1]
        status, said = ended(running)
        assert (status, len(said)) == (2, 2)


def test_a_finished_log(tmp_path: Path) -> None:
    origin = ("--origin", "https://robots.example")
    with viewing(tmp_path, *WAYS, *origin, text=line("a") + line("b"), follow=False) as (running, url, log):
        output = tmp_path / "report.html"
        assert run("report", tmp_path / "tree.rvaft", log, *WAYS, "-o", output).exit_code == 1
        found, wanted = fetched(url), data_of(output.read_text(encoding="utf-8"))
        assert {**found, "token": ""} == {**wanted, "token": ""}
        for target, status in ((b"/events", b"404"), (b"/", b"200")):
            answer = raw(url, b"GET %s HTTP/1.1\r\nHost: robots.example\r\n\r\n" % target)
            assert answer.startswith(b"HTTP/1.1 %s " % status)
        assert ended(running) == (1, [f"rvaft: the page at {url} is closed"])


def test_what_cannot_be_shown(tmp_path: Path) -> None:
    log = written(tmp_path / "log.jsonl", "nonsense\n")
    failed(run("view", SAND, tmp_path / "none.jsonl", "--follow"), "none.jsonl")
    with socket.create_server(("127.0.0.1", 0)) as taken:
        port = taken.getsockname()[1]
        failed(run("view", SAND, log, "--port", port), f"http://127.0.0.1:{port}", "--port")
    for more in ([], ["--follow"]):
        done = run("view", SAND, log, *more)
        assert (done.exit_code, done.stdout) == (2, "")
        assert "log.jsonl:1: not JSON" in done.stderr.splitlines()[0]


# -- what is new
# ---------------------------------------------------------------------------------------------------------


class _Following:
    """A log that is read event by event, and what a page that is told what is new has of it."""

    def __init__(self, most: int) -> None:
        tree = rvaft.loads(TREE)
        monitors = MonitorSet(columns(tree), rvaft.monitor, Semantics.SCATTERED, repeat=True)
        plan = MonitoringPlan(monitors, Key.parse(["who"]))
        self.notes = LogReport(tree, plan, most=most, grows=True)
        self.run = TraceRun(plan, "log", [self.notes], Totals(None, DataWarnings(monitors.types)), buffer=EventBuffer())
        self.run.begin()
        self.cursor, self.data, self.wholes = "", dict[str, Any](), 0

    def read(self, events: Sequence[dict[str, Any]]) -> None:
        for _ in pipeline.read([self.run], events, "log"):
            pass

    def look(self, told: Any = None) -> None:
        """Take what is new, as the page does."""
        self.notes._due = 0.0
        self.cursor, text = self.notes.since(self.cursor, "tree", told or {"said": [], "held": []})
        more = json.loads(text) if text else None
        if more is None:
            return
        if "cursor" in more:
            self.data = more
            self.wholes += 1
            return
        for name, some in more["places"].items():
            self.data["places"][name] += some
        for name in ("node_sets", "waits", "texts", "at", "changes"):
            self.data[name] += more[name]
        for place, state in more["late"]:
            self.data["places"]["waits"][place] = state
        for watch, row in more["watches"]:
            self.data["watches"][watch:] = [row, *self.data["watches"][watch + 1 :]]
        self.data |= {"traces": more["traces"], "clock": more["clock"], "told": more.get("told", self.data["told"])}

    def seen(self, place: int) -> tuple[Any, ...]:
        """What the page says was seen of that key at that place."""
        data, watch = self.data, self.data["places"]["watch"][place]
        verdict, fresh, known = data["before"].get(str(watch), ["?", False, []])
        seen = {node: (number, times) for node, number, times in known}
        for one in range(place + 1):
            if data["places"]["watch"][one] != watch:
                continue
            seen, verdict, fresh = ({}, "?", False) if fresh else (seen, verdict, False)
            for node in data["node_sets"][data["places"]["nodes"][one]]:
                seen[node] = data["places"]["number"][one], seen.get(node, (0, 0))[1] + 1
            if one in data["at"]:
                verdict = data["changes"][data["at"].index(one)]["verdicts"][0][1]
                fresh = verdict == "⊤"
        return data["watches"][watch][1], seen, verdict


@given(
    st.lists(st.lists(st.tuples(st.sampled_from("abc"), st.sampled_from("xy")), max_size=6), min_size=1, max_size=12),
    st.integers(2, 9),
)
@settings(max_examples=40, deadline=None)
def test_what_is_new_makes_the_whole(pieces: list[list[tuple[str, str]]], most: int) -> None:
    few, all_ = _Following(most), _Following(10_000)
    for one in (few, all_):
        for piece in pieces:
            one.read([{"event": event, "who": who} for event, who in piece])
            one.look()
    everything = json.loads(few.notes.since("", "tree", {"said": [], "held": []})[1])
    assert {**few.data, "cursor": ""} == {**everything, "cursor": ""}
    numbers = few.data["places"]["number"]
    assert all_.data["places"]["number"][len(all_.data["places"]["number"]) - len(numbers) :] == numbers
    assert len(numbers) <= most
    gap = len(all_.data["places"]["number"]) - len(numbers)
    for place in range(len(numbers)):
        assert few.seen(place) == all_.seen(gap + place)
    assert bool(gap) == any("no longer on this page" in line for line in few.notes.left_out)
    assert all_.wholes == 1


def test_what_goes_since_there_is_too_much_is_told(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(report, "CHANGES", 4)
    going = _Following(100)
    going.read([{"event": event, "who": "x"} for event in "ab" * 6])
    going.look()
    assert len(going.data["changes"]) <= 4
    (said,) = going.notes.left_out
    detections = 6 - len(going.data["changes"])
    assert said.startswith(
        f"{12 - len(going.data['places']['number'])} events with {detections} detections are no longer"
    )
    before = going.cursor
    going.look({"said": ["new"], "held": []})
    assert (going.data["told"]["said"], going.wholes, before != going.cursor) == (["new"], 1, True)


def test_the_latest_event_is_told_what_is_waited_for_as_soon_as_there_is_time(monkeypatch: pytest.MonkeyPatch) -> None:
    going = _Following(100)
    going.notes._left = going.notes._most_left = 0.0
    going.read([{"event": "a", "who": "x"}, {"event": "a", "who": "y"}])
    going.look()
    assert going.data["places"]["waits"] == [-1, -1]
    going.notes._most_left = 1.0
    monkeypatch.setattr(going.notes, "_refilled", -1e9)
    going.look()
    assert going.data["places"]["waits"] == [-1, 0]
    assert going.data["waits"] == [[[1, [2], ""]]]
    assert going.wholes == 1


# -- in a browser
# --------------------------------------------------------------------------------------------------------


@pytest.fixture
def quiet(browser: Any) -> Iterator[Any]:
    """The browser, which complains of nothing but of a server that is gone."""
    browser.get_log("browser")
    yield browser
    browser.get("about:blank")
    assert [one for one in browser.get_log("browser") if "ERR_" not in one["message"]] == []


def test_nodes_light_up_as_the_log_grows(quiet: Any, tmp_path: Path) -> None:
    with viewing(tmp_path, *WAYS, "--key", "who", text=line("a", who=NASTY[0])) as (running, url, log):
        shown = Shown(quiet, url)
        slider = "document.getElementById('slider')"
        assert (shown.nodes("seen"), shown.nodes("waits"), shown.ask(f"{slider}.max")) == (["a"], ["b"], "0")
        add(log, line("b", who=NASTY[0]))
        assert soon(lambda: shown.nodes("lit") == ["top", "a", "b"])
        assert (shown.ask(f"{slider}.value"), shown.text("#detections h2")) == ("1", "Detections (1)")
        shown.press("HOME")
        add(log, line("a", who=NASTY[1]), line("a", who=NASTY[2]))
        assert soon(lambda: shown.ask(f"{slider}.max") == "3")
        assert (shown.ask(f"{slider}.value"), shown.nodes("seen")) == ("0", ["a"])
        shown.click("#live")
        add(log, line("b", who=NASTY[2]))
        assert soon(lambda: shown.ask(f"{slider}.value") == "4")
        assert shown.text(".found td") == "▸ 2"  # the newest first
        assert shown.ask("window.hacked === undefined && document.querySelectorAll('img').length === 0")
        assert shown.ask("document.scripts.length") == 2
        keys = shown.text("#keys tbody")
        assert NASTY[0] in keys
        assert NASTY[1] in keys
        assert shown.text("#state") == "live"
        assert ended(running)[0] == 1


@pytest.mark.ci
def test_the_page_of_the_server_shows_what_a_client_caused(quiet: Any, tmp_path: Path) -> None:
    client = pytest.importorskip("websockets.sync.client", reason="needs websockets")
    tree = written(tmp_path / "tree.rvaft", TREE)
    with started("serve", tree, "--port", "0", "--semantics", "scattered", stderr=subprocess.DEVNULL) as running:
        url = running.stdout.readline().split()[-1]
        shown = Shown(quiet, url.replace("ws:", "http:"))
        assert shown.text("#place") == "No relevant event yet."
        with client.connect(url, proxy=None) as connection:
            for event in ("a", NASTY[1], "b"):
                connection.send(json.dumps({"event": event}))
                connection.recv(timeout=20)
            connection.send(NASTY[0])
            connection.recv(timeout=20)
            assert soon(lambda: shown.nodes("lit") == ["top", "a", "b"])
            assert "1 from 127.0.0.1" in shown.text("#detections tbody")
            assert "⊤ at event 3" in shown.text("#keys tbody")
        assert soon(
            lambda: "(closed)" in shown.text("#keys tbody") and "closed after 3 events" in shown.text("#missed")
        )
        assert shown.ask("window.hacked === undefined && document.querySelectorAll('img').length === 0")
        running.send_signal(signal.SIGTERM)
        assert running.wait(20) == 0
