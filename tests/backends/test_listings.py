"""Specifications as listings in LaTeX: nothing of a tree ends the listing early, and all else stands there as it is."""

import re
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from backends.rml.writer.terms import RESERVED
from rvaft import RVAFT, EventType, Gate, Node, On, Semantics, all_backends, dumps, load, loads, translate
from rvaft.backend import backend
from rvaft.export.latex import listing
from rvaft.model.patterns import Literal, ObjectPattern
from tests.backends.texts import readable
from tests.cli.runs import PRUNED, failed, run
from tests.tex import compiled, needs_tex

ESCAPE = re.compile(r"\(\*@(.*?)@\*\)")
END = r"\end{lstlisting}"
PIECES = [END, r"\end", "{lstlisting}", "(*@", "@*)", "(", "*@", "\\", "é", "東", "\n", "\x00", "\u2028", "'"]
WILD = st.lists(st.sampled_from(PIECES) | st.text(max_size=3)).map("".join)


def body(text: str) -> str:
    """What stands in the only listing of a text."""
    assert text.count(END) == 1
    assert text.endswith(f"\n{END}\n")
    start = text.index("\n", text.index(r"\begin{lstlisting}[")) + 1
    return text[start : -len(END) - 2]


@given(WILD)
def test_no_text_ends_a_listing_or_escapes_from_it(text: str) -> None:
    inside = body(listing(text, None))
    plain = ESCAPE.sub("\t", inside)
    assert "(*@" not in plain
    assert re.fullmatch(r"[\n\t -~]*", plain)
    assert all("\n" not in part for part in ESCAPE.findall(inside))
    if text.isascii() and text.isprintable() and "end{" not in text and "(*@" not in text:
        assert inside == text


@pytest.mark.parametrize("name", readable(*sorted(all_backends())))
def test_every_backend_is_listed_and_hard_strings_stay_inside(name: str) -> None:
    semantics = "projected" if Semantics.PROJECTED in backend(name).semantics else "scattered"
    plain = ("eql", "kql", "mtl", "mtl-r2u2", "sigma", "sql-table", "sql-table-duckdb", "stix")
    source = PRUNED.parents[1] / "gates" / "vot.rvaft" if name in plain else PRUNED
    # `plain`: no variables of several events, or none without declared types
    emitting = ("emit", source, "--to", name, "--semantics", semantics)
    found = run(*emitting, "--format", "latex")
    assert (found.exit_code, found.stderr) == (0, "")
    assert body(found.stdout) == run(*emitting).stdout.rstrip("\n")
    if name not in ("kql", "rml-paper", "sigma"):  # which cannot say it, or have no strings
        text = translate(hard_tree(), name, semantics=semantics).text
        assert "gr(*@ö@*)(*@ß@*)e" in body(listing(text, backend(name).highlighting))


def test_rml_brings_the_definition_of_its_language() -> None:
    text = run("emit", PRUNED, "--to", "rml", "--format", "latex").stdout
    assert text.index(r"\lstdefinelanguage{RML}{") < text.index(", language=RML]")
    failed(run("emit", PRUNED, "--to", "rml", "--format", "tex"), "'tex' is not one of 'text', 'latex'")
    words = {word for found in re.findall(r"morekeywords=(?:\[2\])?\{(.*?)\}", text) for word in found.split(",")}
    assert words == RESERVED


HARD = rf"größe {END} (*@ % $ & # _ ^ ~ \ 'quoted' @*) \begin{{x}}"


def hard_tree() -> RVAFT:
    """A tree whose strings and names are hard to print."""
    event = EventType(HARD, (), ObjectPattern(((HARD, Literal(HARD)),)))
    tree = RVAFT(HARD, [Node(HARD, Gate.SAND, ("a", "b")), Node("a", on=On(HARD, ())), Node("b")], [event])
    return loads(dumps(tree))


@needs_tex
def test_listings_compile(tmp_path: Path) -> None:
    texts = [(translate(tree, "rml").text, "rml") for tree in (load(PRUNED), hard_tree())]
    texts += [(translate(load(PRUNED), "rml-prolog").text, "rml-prolog")]
    parts = [listing(text, backend(name).highlighting) for text, name in texts]
    column = [r"\hsize=8.5cm \linewidth=\hsize", *parts, listing(HARD, None)]
    assert r"Overfull \hbox" not in compiled("\n".join(column), tmp_path, "listings", "textcomp")
