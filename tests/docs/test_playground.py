"""The playground page in a browser, from the files of the site alone."""

import subprocess
import sys
import threading
from collections.abc import Iterator
from functools import partial
from http.server import SimpleHTTPRequestHandler, ThreadingHTTPServer
from pathlib import Path
from time import monotonic, sleep
from typing import Any

import pytest

import rvaft
from tests.docs.examples import ROOT

pytestmark = pytest.mark.ci


class Quiet(SimpleHTTPRequestHandler):
    """Serves files without a log."""

    def log_message(self, *_: object) -> None:
        """Write nothing."""


@pytest.fixture(scope="module")
def site(tmp_path_factory: pytest.TempPathFactory) -> Iterator[str]:
    """The address of the built site."""
    pytest.importorskip("mkdocs", reason="needs MkDocs")
    if not (ROOT / "out" / "playground" / "wheels.json").exists():
        pytest.skip("`make playground` has not been run")
    wheel = max((ROOT / "out" / "playground").glob("rvaft-*.whl"), key=lambda one: one.stat().st_mtime)
    sources = (file for room in ("rvaft", "backends", "cross_check") for file in (ROOT / room).rglob("*.py"))
    if any(file.stat().st_mtime > wheel.stat().st_mtime for file in sources):
        pytest.skip("`make playground` was run before the last change")
    folder: Path = tmp_path_factory.mktemp("site")
    command = [sys.executable, "-m", "mkdocs", "build", "--quiet", "--site-dir", str(folder)]
    subprocess.run(command, cwd=ROOT, check=True)
    server = ThreadingHTTPServer(("127.0.0.1", 0), partial(Quiet, directory=str(folder)))
    threading.Thread(target=server.serve_forever, daemon=True).start()
    yield f"http://127.0.0.1:{server.server_port}"
    server.shutdown()
    server.server_close()


@pytest.fixture(scope="module")
def page(site: str, browser: Any) -> Any:
    """The page, once it has shown its first answer."""
    browser.get(f"{site}/playground.html")
    wait(browser, "document.getElementById('playground').dataset.ready === 'yes'", 120)
    return browser


def wait(browser: Any, condition: str, seconds: float = 30) -> None:
    """Wait until a condition holds, and nothing is being worked on."""
    end, state = monotonic() + seconds, "document.getElementById('pg-state').textContent"
    while not browser.execute_script(f"return {condition} && !/ing…$/.test({state})"):
        assert monotonic() < end, (condition, text(browser, "state"))
        sleep(0.1)


def text(browser: Any, name: str) -> str:
    """The text of a part of the page."""
    found: str = browser.execute_script(f"return document.getElementById('pg-{name}').textContent")
    return found


def put(browser: Any, name: str, value: str) -> None:
    """Write into a field as a person does, and wait for the answer."""
    before = answers(browser)
    script = "const e = document.getElementById(arguments[0]); e.value = arguments[1];"
    browser.execute_script(f"{script} e.dispatchEvent(new Event('input'))", f"pg-{name}", value)
    wait(browser, f"document.getElementById('playground').dataset.answers > {before}")


def answers(browser: Any) -> int:
    """How many answers the page has shown."""
    return int(browser.execute_script("return document.getElementById('playground').dataset.answers"))


def click(browser: Any, name: str) -> None:
    """Click on a part of the page."""
    browser.execute_script(f"document.getElementById('pg-{name}').click()")
    sleep(0.4)


def texts(browser: Any, language: str) -> str:
    """The text in a language, or the reason why there is none."""
    script = f"return document.querySelector('[data-language={language}]').lastChild.textContent"
    found: str = browser.execute_script(script)
    return found


def test_a_tree_is_drawn_monitored_and_explained(page: Any) -> None:
    put(page, "tree", "semantics scattered; top sand a b; a; b;")
    put(page, "log", '{"event": "a"}\n{"event": "c"}\n{"event": "b"}')
    assert text(page, "verdict") == "detected at line 3 under scattered"
    assert text(page, "why") == "line 1 is aline 3 is b"
    marked = "return [...document.querySelectorAll('#pg-log-back .pg-lit')].map(one => one.textContent.trim())"
    assert page.execute_script(marked) == ['{"event": "a"}', '{"event": "b"}']
    assert page.execute_script("return document.querySelectorAll('#pg-drawing .node.lit').length") == 3
    put(page, "log", '{"event": "a"}')
    assert (text(page, "verdict"), text(page, "why")) == (
        "not detected under scattered",
        "near miss: all but b: event 1",
    )
    put(page, "semantics", "strict")
    put(page, "log", '{"event": "c"}')
    assert text(page, "verdict") == "no longer possible at line 1 under strict"
    put(page, "semantics", "")
    put(page, "log", '{"event": "a"}\nno')
    assert text(page, "wrong").startswith("line 2: no JSON")


def test_errors_are_marked_in_their_place(page: Any) -> None:
    put(page, "tree", "semantics scattered;\ntop sandy a b;")
    assert "line 2: " in text(page, "errors")
    wrong = "return document.querySelector('#pg-tree-back .pg-wrong').textContent.trim()"
    assert page.execute_script(wrong) == "top sandy a b;"
    page.execute_script("document.querySelector('#pg-errors button').click()")
    start = page.execute_script("return document.getElementById('pg-tree').selectionStart")
    assert start >= len("semantics scattered;\n")
    put(page, "tree", "semantics scattered;\ntop sand a b;\na; b when 1 > 2;")
    assert text(page, "errors").startswith("line 2: the tree has no feasible scenario")
    put(page, "tree", "semantics scattered;\ntop or a b;\na; b when 1 > 2;")
    assert text(page, "errors").startswith("line 3: warning: ")
    put(page, "tree", 'top or a; a label "<img src=x onerror=document.title=1>";')
    assert page.execute_script("return document.querySelectorAll('#pg-drawing img').length") == 0


TYPED = (
    "semantics scattered; event e(k: text) = { event: k }; assume types, present;"
    ' top sand a b; a on e("a"); b on e("b");'
)
LANGUAGES = ["sigma", "eql", "kql", "sql", "sql-postgres", "c", "stix", "match-recognize", "mfotl", "mtl", "rml"]


@pytest.mark.parametrize("language", LANGUAGES)
def test_every_language_is_written_as_by_the_program(page: Any, language: str) -> None:
    put(page, "tree", TYPED)
    box = f"document.getElementById('pg-language-{language}')"
    if not page.execute_script(f"return {box}.checked"):
        page.execute_script(f"{box}.click()")
    sleep(0.4)
    wait(page, f"document.querySelector('[data-language={language}]')")
    assert texts(page, language) == rvaft.translate(rvaft.loads(TYPED), language, semantics="scattered").text


def test_a_rule_is_compared(page: Any) -> None:
    put(page, "tree", TYPED)
    put(page, "log", "")
    rule = rvaft.translate(rvaft.loads(TYPED), "kql", semantics="scattered").text
    for text_of_rule, expected in (
        (rule, "They agree on "),
        (rule.replace('"a"', '"x"'), "They differ on "),
        ("no", "no comment"),
    ):
        page.execute_script("document.getElementById('pg-rule').value = arguments[0]", text_of_rule)
        click(page, "compare")
        wait(page, "document.getElementById('pg-comparison').textContent !== 'Comparing…'", 60)
        assert expected in text(page, "comparison")


def test_a_link_has_the_tree_and_the_log(page: Any, site: str) -> None:
    put(page, "tree", "top sand ä b;")
    put(page, "log", '{"event": "ä"}')
    page.execute_script("navigator.clipboard.writeText = async (text) => {}")
    click(page, "share")
    link = page.execute_script("return location.href")
    assert "#p=" in link
    page.get("about:blank")
    page.get(link)
    wait(page, "document.getElementById('playground').dataset.ready === 'yes'", 120)
    assert page.execute_script("return document.getElementById('pg-tree').value") == "top sand ä b;"
    assert page.execute_script("return document.getElementById('pg-log').value") == '{"event": "ä"}'
    examples = page.execute_script("return document.getElementById('pg-example').options.length")
    assert examples > 4


def test_every_example_is_detected_or_explained(page: Any, site: str) -> None:
    page.get("about:blank")
    page.get(f"{site}/playground.html")
    wait(page, "document.getElementById('playground').dataset.ready === 'yes'", 120)
    for number in range(page.execute_script("return document.getElementById('pg-example').options.length")):
        put(page, "example", str(number))
        assert text(page, "errors") == ""
        assert text(page, "wrong") == ""
        assert text(page, "verdict").startswith("detected") or "near miss" in text(page, "why")
