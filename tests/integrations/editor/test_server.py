"""`rvaft lsp` as a process of its own, with a client that speaks JSON-RPC."""

import json
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any, Final

import pytest

from rvaft.errors import ToolMissing
from rvaft.integrations.editor import server
from rvaft.integrations.editor.document import Document
from tests.cli.runs import written

EDITOR: Final[dict[str, Any]] = {"processId": None, "rootUri": None, "capabilities": {}}


class Client:
    """An editor."""

    def __init__(self, *arguments: str) -> None:
        words = [sys.executable, "-m", "rvaft", "lsp", *arguments]
        pipe = subprocess.PIPE
        self.running = subprocess.Popen(words, stdin=pipe, stdout=pipe, stderr=pipe)
        self.number = 0
        self.notified: list[dict[str, Any]] = []

    def send(self, method: str, params: Any, **more: Any) -> None:
        data = json.dumps({"jsonrpc": "2.0", "method": method, "params": params, **more}).encode()
        assert self.running.stdin is not None
        self.running.stdin.write(b"Content-Length: %d\r\n\r\n%b" % (len(data), data))
        self.running.stdin.flush()

    def receive(self) -> dict[str, Any]:
        stream, length = self.running.stdout, 0
        assert stream is not None
        while line := stream.readline().strip():
            name, _, value = line.partition(b":")
            length = int(value) if name.lower() == b"content-length" else length
        found: dict[str, Any] = json.loads(stream.read(length))
        return found

    def ask(self, method: str, params: Any) -> Any:
        """The result of a request."""
        self.number += 1
        self.send(method, params, id=self.number)
        while "method" in (answer := self.receive()):
            self.notified.append(answer)
        assert answer["id"] == self.number
        assert "error" not in answer, answer
        return answer["result"]

    def diagnostics(self) -> dict[str, Any]:
        """The next findings that the server publishes."""
        while not self.notified:
            self.notified.append(self.receive())
        found = self.notified.pop(0)
        assert found["method"] == "textDocument/publishDiagnostics", found
        params: dict[str, Any] = found["params"]
        return params

    def leave(self) -> None:
        """End the server, which says nothing."""
        assert self.ask("shutdown", None) is None
        self.send("exit", None)
        assert self.running.wait(10) == 0
        assert self.running.stderr is not None
        assert self.running.stderr.read() == b""


@pytest.fixture
def client() -> Iterator[Client]:
    pytest.importorskip("pygls", reason="needs pygls")
    made = Client("--confine-imports")
    try:
        yield made
    finally:
        made.running.kill()
        made.running.communicate()


def test_an_editor_is_served(client: Client, tmp_path: Path) -> None:
    text = 'import "events.rvaft";\n# 😀\ntop   or a b c;\na on login("ev'
    tree = written(tmp_path / "a b.rvaft", text)
    events = written(tmp_path / "events.rvaft", "event login(who) = { user: who };\n")
    written(tmp_path / "log.jsonl", '{"user": "eve"}\n{"user": "bob"}\n')
    uri = tree.as_uri()
    document = {"textDocument": {"uri": uri}}

    def at(line: int, character: int) -> dict[str, Any]:
        return {**document, "position": {"line": line, "character": character}}

    options = {"log": "log.jsonl"}
    begun = client.ask(
        "initialize", {"processId": None, "rootUri": None, "capabilities": {}, "initializationOptions": options}
    )
    assert begun["serverInfo"]["name"] == "rvaft"
    assert begun["capabilities"]["textDocumentSync"]["change"] == 1
    client.send("initialized", {})
    client.send(
        "textDocument/didOpen", {"textDocument": {"uri": uri, "languageId": "rvaft", "version": 1, "text": text}}
    )
    (wrong,) = client.diagnostics()["diagnostics"]
    assert (wrong["code"], wrong["severity"], wrong["source"]) == ("syntax", 1, "rvaft")
    assert wrong["range"]["start"] == {"line": 3, "character": 11}

    items = client.ask("textDocument/completion", at(3, 14))["items"]
    assert [one["label"] for one in items] == ['"eve"']
    assert items[0]["textEdit"]["range"]["start"] == {"line": 3, "character": 11}
    assert client.ask("textDocument/formatting", {**document, "options": {"tabSize": 2, "insertSpaces": True}}) is None

    text = text.removesuffix('"ev') + '"eve"); c fault;\n'
    client.send(
        "textDocument/didChange", {"textDocument": {"uri": uri, "version": 2}, "contentChanges": [{"text": text}]}
    )
    published = client.diagnostics()
    assert published["version"] == 2
    found = {one["code"]: one for one in published["diagnostics"]}
    assert found["undeclared"]["range"] == {"start": {"line": 2, "character": 11}, "end": {"line": 2, "character": 12}}
    assert found["undeclared"]["severity"] == 2
    assert "\n" in found["undeclared"]["message"]

    hovered = client.ask("textDocument/hover", at(3, 0))
    assert hovered["contents"]["kind"] == "markdown"
    assert "1 of the first 2 events of log.jsonl match" in hovered["contents"]["value"]
    assert client.ask("textDocument/hover", at(1, 0)) is None
    (there,) = client.ask("textDocument/definition", at(3, 6))
    assert there["uri"] == events.as_uri()
    used = client.ask("textDocument/references", {**at(2, 9), "context": {"includeDeclaration": True}})
    assert [one["range"]["start"] for one in used] == [{"line": 2, "character": 9}, {"line": 3, "character": 0}]
    assert [one["uri"] for one in used] == [uri, uri]
    names = [one["name"] for one in client.ask("textDocument/documentSymbol", document)]
    assert names == ["top", "a", "c"]
    (edit,) = client.ask("textDocument/formatting", {**document, "options": {"tabSize": 2, "insertSpaces": True}})
    assert "top or a b c;\n" in edit["newText"]
    assert edit["newText"].startswith('import "events.rvaft";\n# 😀\n')

    client.send("workspace/didChangeConfiguration", {"settings": {"rvaft": {"log": "none.jsonl"}}})
    assert "match" not in client.ask("textDocument/hover", at(3, 0))["contents"]["value"]
    client.send("textDocument/didClose", document)
    assert client.diagnostics() == {"uri": uri, "diagnostics": []}
    client.leave()


def test_imports_are_confined_by_the_option(client: Client, tmp_path: Path) -> None:
    written(tmp_path / "out.rvaft", "a fault;")
    (tmp_path / "in").mkdir()
    tree, text = written(tmp_path / "in" / "t.rvaft", ""), 'import "../out.rvaft"; top or a;'
    client.ask("initialize", EDITOR)
    given = {"uri": tree.as_uri(), "languageId": "rvaft", "version": 1, "text": text}
    client.send("textDocument/didOpen", {"textDocument": given})
    assert "outside the folder" in client.diagnostics()["diagnostics"][0]["message"]


def test_a_text_without_a_file_is_served(client: Client) -> None:
    client.ask("initialize", EDITOR)
    given = {"uri": "untitled:one", "languageId": "rvaft", "version": 1, "text": "top or a; a;"}
    client.send("textDocument/didOpen", {"textDocument": given})
    assert client.diagnostics() == {"uri": "untitled:one", "version": 1, "diagnostics": []}
    (found,) = client.ask(
        "textDocument/definition", {"textDocument": {"uri": "untitled:one"}, "position": {"line": 0, "character": 7}}
    )
    assert found["uri"] == "untitled:one"


def test_without_pygls_the_error_names_the_extra(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "pygls.lsp.server", None)
    with pytest.raises(ToolMissing, match=r"pygls is not installed: pip install 'rvaft\[editor\]'"):
        server.server()


def test_a_sample_is_read_again_when_its_log_has_changed(tmp_path: Path) -> None:
    workspace = server.Workspace()
    workspace.configure({"rvaft": {"log": "log.jsonl"}})
    document = Document("", str(tmp_path / "t.rvaft"))
    assert workspace.sample(document).events == ()
    log = written(tmp_path / "log.jsonl", '{"n": 1}\n')
    first = workspace.sample(document)
    assert len(first.events) == 1
    assert workspace.sample(document) is first
    with log.open("a", encoding="utf-8") as stream:
        stream.write('{"n": 2}\n')
    assert len(workspace.sample(document).events) == 2
    odd: object
    for odd in (None, {"rvaft": {"log": 3}}, {"rvaft": []}, []):
        workspace.configure(odd)
        assert workspace.log == ""
