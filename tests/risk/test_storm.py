"""Numbers against those of Storm (dynamic trees) and SCRAM (static ones), where these are installed.

Run on a folder of Galileo files by `pytest -m slow tests/risk -k storm`.
"""

import importlib.util
import json
import math
import re
import shutil
import subprocess
import sys
from pathlib import Path
from xml.etree import ElementTree

import pytest
from hypothesis import given, reject, settings

from rvaft.errors import TooLarge
from rvaft.risk.model import RiskError, of_file
from rvaft.risk.probability import Analysis
from tests.cli.runs import run
from tests.language.test_galileo_corpus import CORPUS, FILES
from tests.risk.forms import form, galileo_texts, static_texts

pytest.importorskip("oxidd")

ORACLE = Path(__file__).with_name("storm.py")
SECONDS = 12
"""How long Storm may work on one file."""
PRECISION = 1e-9
MEAN_PRECISION = 1e-9

needs_storm = pytest.mark.skipif(importlib.util.find_spec("stormpy") is None, reason="stormpy is not installed")
needs_scram = pytest.mark.skipif(shutil.which("scram") is None, reason="SCRAM is not installed")

EXCEPTIONS: dict[str, str] = {}
"""Files of which the numbers differ, with the reason."""

REFUSED = (
    "unavailability",
    "`mutex`",
    "restricts gates",
    "the order of simultaneous failures decides",
    "has a spare gate",
    "no probability and no rate",
    "depends on a trigger",
    "begin at different times",
    "not a rate",
    "rdep",
    "at the same moment",
    "when it is in use",
)
"""Why files have no number here."""


def storm(file: Path) -> tuple[float, float, float | None]:
    """Return P(1), least and greatest, and the mean time; skips what Storm does not solve."""
    try:
        done = subprocess.run(
            [sys.executable, ORACLE, file], capture_output=True, text=True, timeout=SECONDS, check=False
        )
        text, errors = done.stdout, done.stderr
    except subprocess.TimeoutExpired as late:
        text, errors = (late.stdout or b"").decode(), "too slow"
    lines = text.splitlines()
    if len(lines) < 2:
        pytest.skip(f"Storm has no number: {errors.strip()[-150:]}")
    low, high, *mean = json.loads(lines[-1])
    return low, high, mean[0] if mean else None


def compare(file: Path, analysis: Analysis) -> None:
    """Compare both numbers of a file with those of Storm."""
    low, high, mean = storm(file)
    if file.name in EXCEPTIONS:
        assert not low * (1 - PRECISION) <= analysis.at(1.0) <= high * (1 + PRECISION), "no exception any more"
        return
    assert low == pytest.approx(high, rel=PRECISION), "Storm has an interval"
    assert analysis.at(1.0) == pytest.approx(low, rel=PRECISION)
    if mean is not None:
        own = analysis.mean_time()
        assert own == pytest.approx(mean, rel=MEAN_PRECISION) or (math.isinf(own) and mean > 1e300)


@pytest.mark.slow
@needs_storm
@pytest.mark.skipif(not FILES, reason="the corpus of Galileo files is not there")
@pytest.mark.parametrize("path", FILES, ids=lambda path: str(path.relative_to(CORPUS)))
def test_files_of_the_corpus_have_the_numbers_of_storm(path: Path) -> None:
    try:
        analysis = Analysis(of_file(path), states=20_000)
        analysis.at(1.0)
    except TooLarge as error:
        pytest.skip(str(error))
    except RiskError as error:
        if not any(reason in str(error) for reason in REFUSED):
            raise
        pytest.skip(str(error))
    compare(path, analysis)


LEAVES = "a lambda=.5 dorm=D; b lambda=.2 dorm=D; c lambda=.1 dorm=D; d lambda=.7 dorm=D; e lambda=.3 dorm=D;"
GATES = [
    "t wsp a b c;",
    "t and x y; x wsp a c; y wsp b c;",
    "t or x y; x wsp a c d; y wsp b c d;",
    "t and x y; x wsp a c d; y wsp b d c;",
    "t 2of3 x y z; x wsp a d; y wsp b d; z wsp c d;",
    "t wsp x c; x and a b;",
    "t wsp a x; x or b c;",
    "t wsp x y; x or a b; y and c d;",
    "t wsp x c; x wsp a b;",
    "t and x y; x wsp a s; y wsp b s; s or c d;",
    "t pand x y; x wsp a c; y wsp b c;",
    "t pand x d; x wsp a c;",
    "t pand a b c;",
    "t pand x y; x or a b; y and c d;",
    "t pand x y; x or a b; y or b c;",
    "t por a b c;",
    "t por x y; x and a b; y or c d;",
    "t and x y; x pand a b; y pand c d;",
    "t or x y; x pand a b; y pand b a;",
    "t and a b c; q seq a b c;",
    "t or x d; x and a b; q seq b a;",
    "t and a b; q seq a c b;",
    "t or a b c; q mutex a b;",
    "t and x c; x or a b; q mutex a b d;",
    "t or x y; x and a b; y and c d; q mutex a c;",
    "t and b c; f fdep a b c;",
    "t and x d; x or b c; f fdep a b c;",
    "t and b c; f fdep x b c; x and a d;",
    "t wsp b c; f fdep a b;",
    "t wsp b c d; f fdep a c;",
    "t and x y; x wsp a c; y wsp b c; f fdep d c;",
    "t and b c; f fdep a b; g fdep b c;",
    "t and b c; f pdep=0.3 a b c;",
    "t or x y; x and b c; y and c d; f pdep=0.6 a c;",
    "t 2of4 a b c d;",
    "t 3of5 a b c d e;",
    "t and x y; x 2of3 a b c; y 2of3 b c d;",
    "t and x e; x pand y d; y wsp a b;",
    "t or x y; x wsp a c; y pand a c;",
    "t wsp x d; x wsp a b c;",
    "t or x y; x wsp a c d; y wsp b d c;",
    "t and a x; x wsp b c; f fdep a b;",
    "t pand a x; x or b c; f fdep d c;",
    "t and x y; x hsp a c; y hsp b c;",
    "t and x y; x csp a c; y csp b c;",
]


def galileo(text: str, folder: Path) -> Path:
    """Write a text to a file of Galileo's format, a statement on each line."""
    file = folder / "t.dft"
    quoted = re.sub(r"\b([a-z])\b(?!=)", r'"\1"', text)
    file.write_text(quoted.replace("; ", ";\n").replace(";", ";\n").replace("\n\n", "\n"))
    return file


@pytest.mark.slow
@needs_storm
@pytest.mark.parametrize("dormancy", ["0", "0.4", "1"])
@pytest.mark.parametrize("text", GATES)
def test_small_dynamic_trees_have_the_numbers_of_storm(text: str, dormancy: str, tmp_path: Path) -> None:
    leaves = "".join(
        f"{leaf};\n" for leaf in LEAVES.split(";") if leaf and re.search(rf"\b{leaf.split()[0]}\b", text)
    ).replace("=D", f"={dormancy}")
    file = galileo(f"toplevel t;\n{text}\n{leaves}", tmp_path)
    compare(file, Analysis(of_file(file)))


@pytest.mark.slow
@needs_storm
@given(galileo_texts())
@settings(max_examples=60)
def test_random_dynamic_trees_have_the_numbers_of_storm(tmp_path_factory: pytest.TempPathFactory, text: str) -> None:
    file = tmp_path_factory.mktemp("storm") / "t.dft"
    file.write_text(text)
    try:
        analysis = Analysis(of_file(file))
        analysis.at(1.0)
        compare(file, analysis)
    except (RiskError, pytest.skip.Exception):
        reject()


UNREAD = re.compile(r" (or|and) \w+;|\b(1of|2of2|3of3|4of4)|prob=0.0")
"""What SCRAM does not read: gates of one child, votes that are `or` or `and`, and a root that never happens."""


@needs_scram
@given(static_texts(leaves=6).filter(lambda text: not UNREAD.search(text)))
@settings(max_examples=15)
def test_static_trees_have_the_numbers_of_scram(tmp_path_factory: pytest.TempPathFactory, text: str) -> None:
    folder = tmp_path_factory.mktemp("scram")
    (folder / "t.rvaft").write_text(text)
    (folder / "t.xml").write_text(run("show", folder / "t.rvaft", "--format", "open-psa").stdout)
    subprocess.run(
        ["scram", "--bdd", "--probability", "1", "-o", folder / "out.xml", folder / "t.xml"],
        check=True,
        capture_output=True,
    )
    sums = ElementTree.parse(folder / "out.xml").find(".//sum-of-products")
    assert sums is not None
    assert Analysis(form(text)).at(0.0) == pytest.approx(float(sums.get("probability", "0")), rel=1e-5, abs=1e-12)
