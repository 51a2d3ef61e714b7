"""The risk in pages: the numbers of `monitor --risk`, the live page, and the curve in a real browser."""

import json
import math
from pathlib import Path
from typing import Any, Final

import pytest

from tests.cli.pages import Shown, fetched, page
from tests.cli.runs import failed, run, soon, started, written

pytest.importorskip("oxidd")

TREE: Final = """semantics scattered; time t as s;
top or leak off; off sand alarm pump call;
leak lambda=0.00001/h; alarm lambda=0.001/h once=no; pump lambda=0.0005/h once=no; call times 2 lambda=0.002/h once=no;
"""
NAMES: Final = ("door", "alarm", "call", "leakage", "alarm", "pump", "call", "pump", "door", "call")
RISK: Final = ("--risk", "24 h")


def log_of(names: "tuple[str, ...] | list[str]", first: int = 0) -> str:
    return "".join(f"{json.dumps({'event': name, 't': 60 * (first + n)})}\n" for n, name in enumerate(names))


@pytest.fixture
def files(tmp_path: Path) -> tuple[Path, Path]:
    return written(tmp_path / "tree.rvaft", TREE), written(tmp_path / "log.jsonl", log_of(NAMES))


def monitored(*args: object) -> dict[int, dict[str, Any]]:
    done = run("monitor", *args, "--format", "jsonl")
    return {one["event"]: one for one in map(json.loads, done.stdout.splitlines()) if "event" in one}


@pytest.mark.parametrize("semantics", ["scattered", "consecutive", "projected"])
def test_a_page_has_the_risk_of_the_monitor(files: tuple[Path, Path], tmp_path: Path, semantics: str) -> None:
    tree, log = files
    ways = (tree, log, *RISK, "--semantics", semantics)
    assert run("report", *ways, "-o", tmp_path / "page.html").exit_code in (0, 1)
    data, told = page(tmp_path / "page.html"), monitored(*ways)
    assert data["risk"] == {"within": "24 h", "bound": False, "timed": True}
    places = data["places"]
    assert places["risk"] == [told[number]["risk"] for number in places["number"]]
    before = 0.0
    for number, one in told.items():  # every change of the risk has a place
        assert one["risk"] == before or number in places["number"] or number == 1
        before = one["risk"]
    for number, outlook in zip(places["number"], places["outlook"], strict=True):
        if "next" in told[number]:
            assert data["outlooks"][outlook][:2] == [told[number]["next"]["node"], told[number]["next"]["risk"]]


def test_contradictions_are_counted(tmp_path: Path) -> None:
    tree = written(tmp_path / "tree.rvaft", "top and a b; a lambda=.1; b lambda=.1;")
    log = written(tmp_path / "log.jsonl", log_of(["a", "a", "a", "b"]))
    run("report", tree, log, "--risk", "1", "--semantics", "scattered", "-o", tmp_path / "page.html")
    data = page(tmp_path / "page.html")
    assert data["places"]["contradictions"] == [0, 1, 2, 0]
    assert data["risk"] == {"within": "1", "bound": False, "timed": False}


def test_a_guard_that_is_taken_to_hold_makes_a_bound(tmp_path: Path) -> None:
    text = "event e(n, v) = {event: n, t: v}; t and a b when V > W; a on e('a', V) lambda=.5; b on e('b', W) lambda=.5;"
    tree = written(tmp_path / "tree.rvaft", text.replace("'", '"'))
    log = written(tmp_path / "log.jsonl", log_of(["a", "b"]))
    run("report", tree, log, "--risk", "1", "--semantics", "scattered", "-o", tmp_path / "page.html")
    assert page(tmp_path / "page.html")["risk"]["bound"]


def test_a_page_without_the_option_has_no_risk(files: tuple[Path, Path], tmp_path: Path) -> None:
    run("report", *files, "-o", tmp_path / "page.html")
    data = page(tmp_path / "page.html")
    assert data["risk"] is None
    assert "risk" not in data["places"]


def test_what_cannot_follow_a_risk_is_refused(files: tuple[Path, Path]) -> None:
    failed(run("report", *files, *RISK, "--order-by", "t"), "--risk follows the events of the engine one by one")
    failed(run("report", *files, "--risk", "24"), "have units: write --risk as")
    failed(run("view", *files, *RISK, "--repeat", "--repeat-by", "X"), "omit --repeat-by")


def test_the_live_page_gets_the_risk_of_new_events(files: tuple[Path, Path]) -> None:
    tree, log = files
    with started("view", tree, log, *RISK, "--follow") as running:
        url = running.stdout.readline().split()[-1]
        assert soon(lambda: len(fetched(url)["places"]["risk"]) == 7)
        with log.open("a") as file:
            file.write(log_of(["leak"], first=99))
        told = monitored(tree, log, *RISK)
        assert soon(lambda: fetched(url)["places"]["risk"][-1] == 1.0)
        data = fetched(url)
        assert data["places"]["risk"] == [told[number]["risk"] for number in data["places"]["number"]]


def test_a_browser_draws_the_curve(browser: Any, files: tuple[Path, Path], tmp_path: Path) -> None:
    tree, _ = files
    many = written(tmp_path / "many.jsonl", log_of([*NAMES[:-1] * 2000, "call"]))
    run("report", tree, many, *RISK, "--repeat", "-o", tmp_path / "page.html")
    data = page(tmp_path / "page.html")
    assert len(data["places"]["risk"]) > 10_000
    shown = Shown(browser, (tmp_path / "page.html").as_uri())
    shown.press("HOME")
    assert f"{data['places']['risk'][0]:.6g}" in shown.text("#risk-now")
    assert "leak would raise it most, to 1" in shown.text("#risk-now")
    width = shown.ask("document.querySelector('#chart').clientWidth")
    assert 0 < len(str(shown.ask("document.querySelector('#chart .curve').getAttribute('d')"))) < 100 * width
    assert float(shown.ask("document.querySelector('#chart .point').getAttribute('cx')")) < width / 4
    shown.press("END")
    assert f"{data['places']['risk'][-1]:.6g}" in shown.text("#risk-now")
    assert float(shown.ask("document.querySelector('#chart .point').getAttribute('cx')")) > width * 3 / 4
    before = shown.text("#chart")
    shown.click("#scale")
    assert shown.text("#chart") != before
    assert browser.get_log("browser") == []


@pytest.mark.parametrize("rate", ["0.2", "2e-3", "3e-5", "7e-9", "1e-13"])
def test_each_value_stands_within_its_axis(browser: Any, tmp_path: Path, rate: str) -> None:
    tree = written(tmp_path / "tree.rvaft", f"top and a b; a lambda={rate} once=no; b lambda=0.9 once=no;")
    log = written(tmp_path / "log.jsonl", log_of(["b", "a"]))
    run("report", tree, log, "--risk", "1", "--semantics", "scattered", "-o", tmp_path / "page.html")
    first = page(tmp_path / "page.html")["places"]["risk"][0]
    shown = Shown(browser, (tmp_path / "page.html").as_uri())
    shown.press("HOME")
    for _ in range(2):  # the axis that the page chooses, and the other one
        labels = "[...document.querySelectorAll('#chart text:not(.from)')]"
        ticks = shown.ask(f"{labels}.map(one => [one.textContent, Number(one.getAttribute('y')) - 4])")[:-1]
        values = [(float(text), y) for text, y in ticks]
        (low, bottom), (high, top) = min(values), max(values)
        assert low <= first <= high
        here = float(shown.ask("document.querySelector('#chart .point').getAttribute('cy')"))
        powers = shown.ask("document.getElementById('scale').getAttribute('aria-pressed')") == "true"
        ends = [math.log10(one) for one in (first, low, high)] if powers else [first, low, high]
        assert here == pytest.approx(bottom + (ends[0] - ends[1]) / (ends[2] - ends[1]) * (top - bottom), abs=0.2)
        shown.click("#scale")
