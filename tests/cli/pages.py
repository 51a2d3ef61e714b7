"""The page of `rvaft report`, `rvaft view` and `rvaft serve`: the data in its text, and what a browser shows of it."""

import json
import re
from pathlib import Path
from typing import Any
from urllib.request import urlopen


def page(path: Path) -> dict[str, Any]:
    """The data in a page."""
    return data_of(path.read_text(encoding="utf-8"))


def data_of(text: str) -> dict[str, Any]:
    """The data in the text of a page."""
    found = re.search(r'<script type="application/json" id="data">([^<]*)</script>', text)
    assert found
    data: dict[str, Any] = json.loads(found[1])
    return data


def fetched(url: str) -> dict[str, Any]:
    """The data in the page at a URL."""
    with urlopen(url, timeout=20) as answer:
        return data_of(answer.read().decode())


class Shown:
    """A page in the browser."""

    def __init__(self, browser: Any, url: str) -> None:
        self.browser = browser
        browser.get(url)

    def ask(self, script: str) -> Any:
        """The value of an expression, once what was asked for before is drawn."""
        drawn = "const done = arguments[0]; requestAnimationFrame(() => requestAnimationFrame(() => done("
        return self.browser.execute_async_script(f"{drawn}{script})))")

    def nodes(self, word: str) -> list[str]:
        """The names of the nodes that are lit so, in top-down order."""
        names = "[...document.querySelectorAll('.node')].sort((a, b) => a.dataset.node - b.dataset.node)"
        found = (
            f"{names}.filter(one => one.classList.contains('{word}')).map(one => "
            "one.querySelector('text:not(.gate-text)').textContent)"
        )
        return list(self.ask(found))

    def text(self, selector: str) -> str:
        """What stands there."""
        return str(self.ask(f"document.querySelector({json.dumps(selector)}).textContent"))

    def press(self, key: str) -> None:
        """Press a key."""
        from selenium.webdriver.common.action_chains import ActionChains
        from selenium.webdriver.common.keys import Keys

        ActionChains(self.browser).send_keys(getattr(Keys, key)).perform()

    def click(self, selector: str) -> None:
        """Click on what stands there."""
        self.ask(f"document.querySelector({json.dumps(selector)}).click()")
