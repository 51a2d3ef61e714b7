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
    folder: Path = tmp_path_factory.mktemp("site")
    command = [sys.executable, "-m", "mkdocs", "build", "--quiet", "--site-dir", str(folder)]
    subprocess.run(command, cwd=ROOT, check=True)
    server = ThreadingHTTPServer(("127.0.0.1", 0), partial(Quiet, directory=str(folder)))
    threading.Thread(target=server.serve_forever, daemon=True).start()
    yield f"http://127.0.0.1:{server.server_port}"
    server.shutdown()
    server.server_close()


def text(browser: Any, name: str) -> str:
    """The text of a part of the page."""
    found: str = browser.execute_script(f"return document.getElementById('pg-{name}').textContent")
    return found


def put(browser: Any, name: str, value: str) -> None:
    """Write into a field as a person does."""
    script = "const e = document.getElementById(arguments[0]); e.value = arguments[1];"
    browser.execute_script(f"{script} e.dispatchEvent(new Event('input'))", f"pg-{name}", value)


def test_a_tree_is_drawn_monitored_and_translated(site: str, browser: Any) -> None:
    browser.get(f"{site}/playground.html")
    end = monotonic() + 120
    while browser.execute_script("return document.getElementById('playground').dataset.ready") != "yes":
        assert monotonic() < end, text(browser, "state")
        sleep(0.2)
    assert "⊤" in text(browser, "verdicts")
    assert "sequence with maxspan=1h" in text(browser, "text")
    put(browser, "tree", "top sand a b; a; b;")
    put(browser, "log", '{"event": "a"}\n{"event": "c"}')
    assert [line[:1] for line in text(browser, "verdicts").splitlines()] == ["?", "?"]
    put(browser, "semantics", "strict")
    assert [line[:1] for line in text(browser, "verdicts").splitlines()] == ["?", "⊥"]
    put(browser, "language", "rml")
    assert "Main = a b all;" in text(browser, "text")
    put(browser, "tree", "top sandy a b;")
    assert "sandy" in text(browser, "state")
    put(browser, "tree", 'top or a; a label "<img src=x onerror=document.title=1>";')
    assert browser.execute_script("return document.querySelectorAll('#pg-drawing img').length") == 0
