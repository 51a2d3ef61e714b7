"""Published fault trees in the Galileo format: the static ones load, the dynamic ones are refused by name and place."""

import re
from collections import Counter
from pathlib import Path

import pytest

from rvaft.api import load, loads
from rvaft.errors import LanguageError
from rvaft.language.printer import dumps

CORPUS = Path(__file__).parents[3] / "shared" / "corpus" / "galileo"
FILES = sorted(CORPUS.rglob("*.dft"))
DYNAMIC = re.compile(r"(?m)^\s*\"?[\w']+\"?\s+(wsp|csp|hsp|spare|fdep|seq|pand|por|mutex|rdep|pdep)\b")
"""Found by looking at the words of the files, independently of the parser."""

pytestmark = pytest.mark.skipif(not FILES, reason="the corpus of Galileo files is not there")


def test_the_corpus_is_complete() -> None:
    kinds = Counter("dynamic" if DYNAMIC.search(path.read_text()) else "static" for path in FILES)
    assert kinds == {"static": 66, "dynamic": 347}


@pytest.mark.parametrize("path", FILES, ids=lambda path: str(path.relative_to(CORPUS)))
def test_a_file_loads_or_is_refused(path: Path) -> None:
    text = path.read_text()
    dynamic = DYNAMIC.search(text)
    if dynamic is None:
        tree = load(path)
        assert loads(dumps(tree)) == tree
        assert tree.root == re.findall(r'toplevel\s+"?(.*?)"?;', text)[0]
        return
    with pytest.raises(LanguageError, match=r"the gate `\w+` of `.*` has no meaning here yet") as caught:
        load(path)
    assert caught.value.file == str(path)
    assert caught.value.line == text.count("\n", 0, dynamic.start(1)) + 1
    assert f"`{dynamic[1]}`" in caught.value.message
