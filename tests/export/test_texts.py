"""The formats of text: pinned as a whole for a tree with every part and for looks at others, and
laws for texts that try to leave their place.
"""

import json
import re
from typing import Any

import pytest

from rvaft import RVAFT, Node, OptionError, TreeError, load, loads, to_dot
from rvaft.export import Format, format_of
from rvaft.export.drawing import draw
from rvaft.export.galileo_text import losses
from rvaft.export.latex import escaped
from rvaft.export.layout import Look, looking, wrapped, wrapped_code
from rvaft.export.text import MAX_LEVELS
from tests.cli.runs import FULL, PRUNED, run
from tests.export.trees import AWKWARD, PINNED, awkward, chain
from tests.tables import rows

EVERY = PINNED / "every.rvaft"


@pytest.mark.parametrize(("file", "name", "options"), rows(__file__, "shown.txt"))
def test_a_drawing_is_pinned(file: str, name: str, options: str) -> None:
    tree = {"full": FULL, "pruned": PRUNED}.get(name, PINNED / f"{name}.rvaft")
    form = format_of(file)
    assert form is not None
    assert run("show", tree, "--format", form, *options.split()).stdout == (PINNED / file).read_text(encoding="utf-8")


def test_a_chain_of_thousands_of_gates_keeps_its_indentation_bounded() -> None:
    tree = chain(2000)
    drawings = {form: draw(tree, form) for form in Format if form not in (Format.SVG, Format.PDF, Format.PNG)}
    assert all(b"g2000" in drawing for drawing in drawings.values())
    lines = drawings[Format.TREE].decode().splitlines()
    assert max(map(len, lines)) < 3 * MAX_LEVELS + 40
    assert {re.findall(r"g\d+", line)[0] for line in lines if line} == {f"g{number}" for number in range(2001)}
    assert lines[MAX_LEVELS] == "   " * (MAX_LEVELS - 1) + f"└─ g{MAX_LEVELS} AND  (continued below)"
    assert lines[MAX_LEVELS + 1 : MAX_LEVELS + 3] == ["", f"g{MAX_LEVELS} AND"]
    assert draw(tree, Format.TREE, Look(depth=1)).decode() == "g0 AND\n└─ g1 AND  (… 1999 nodes)\n"
    text = " ".join(f"g{n} and g{n + 1};" for n in range(1, MAX_LEVELS))
    later = loads(f"toplevel g0; g0 and g1 g{MAX_LEVELS}; {text} g{MAX_LEVELS} and x; x;")
    assert f"└─ g{MAX_LEVELS} (see below)\n\ng{MAX_LEVELS} AND\n└─ x\n" in draw(later, Format.TREE).decode()


def test_no_text_leaves_its_place() -> None:
    tree = awkward()
    text = draw(tree, Format.TREE).decode()
    assert all(line.isprintable() for line in text.splitlines())
    assert len(text.splitlines()) == 1 + len(AWKWARD) + len([label for label in AWKWARD if label.strip()])
    nodes = json.loads(draw(tree, Format.JSON))["nodes"]
    assert [node["label"] for node in nodes[1 : 1 + len(AWKWARD)]] == list(AWKWARD)
    leaf = next(name for name in tree.order if tree.nodes[name].leaf)
    look = looking(tree, branch=1, legend=True, wrap=4, collapse=leaf, depth=1)
    body = draw(tree, Format.TIKZ, look).decode().partition(r"\begin{document}")[2]
    assert body.count(r"\end{tikzpicture}") == body.count(r"\begin{tikzpicture}") == 1
    assert re.search(r"(?<!\\)[%$]", body) is None
    plain = "%$#_{}~^\\&"
    commands = r"\\text(backslash|asciitilde|asciicircum)\{\}|\\[%$#_{}&]"
    assert re.sub(commands, "", escaped(plain)) == ""
    assert len(re.findall(commands, escaped(plain))) == len(plain)
    assert "\n" not in escaped("a\nb")
    assert escaped("--") == r"-{\kern0pt}-", "no dash"


def test_the_language_and_a_static_fault_tree_in_galileo_read_back() -> None:
    every = load(EVERY)
    assert loads(draw(every, Format.RVAFT).decode()) == every
    tree = loads('toplevel "A"; "A" or "B" "C d"; "B" and "C d" "E"; "C d" lambda=0.5; "E" prob=0.1;', "tree.dft")
    assert loads(draw(tree, Format.GALILEO).decode(), "tree.dft") == tree
    assert list(losses(tree)) == []


def test_galileo_says_what_is_lost_and_lets_no_attribute_become_a_statement() -> None:
    lost = " ".join(losses(load(EVERY)))
    told: tuple[str, ...] = (
        "2 sand gates",
        "4 runtime events",
        "1 guard ",
        "2 fault or attack marks",
        "3 labels",
        "4 basic events",
    )
    told += ("1 number of events (times)", "1 window (within)", "the time of events")
    assert "semantics" not in lost  # that of a file of Galileo
    assert [what for what in told if what not in lost] == []
    attributes = 'a k="x; sneaky or hidden" lambda=0.5; b m="1\\" // z" "k\\"];x"="1";'
    tree = loads(f"top or a b; {attributes} ignore e(); event e() = {{}};")
    assert draw(tree, Format.GALILEO).decode() == 'toplevel "top";\n"top" or "a" "b";\n"a" lambda=0.5;\n"b";\n'
    lost = " ".join(losses(tree))
    assert "3 attributes left out" in lost
    assert "ignore declarations left out" in lost
    for tree in (
        awkward(),
        RVAFT("back\\slash", [Node("back\\slash")]),
    ):  # where Galileo has no escapes, this language has
        with pytest.raises(OptionError, match="Galileo cannot write the name"):
            draw(tree, Format.GALILEO)


def test_a_suffix_names_a_format() -> None:
    found = [format_of(file) for file in ("a.gv", "a.tex", "a.SVG", "a.odt", "tree")]
    assert found == [Format.DOT, Format.TIKZ, Format.SVG, None, None]


@pytest.mark.parametrize(("tree", "options", "error"), rows(__file__, "wrong_looks.txt"))
def test_a_look_that_a_tree_cannot_have(tree: str, options: dict[str, Any], error: str) -> None:
    for form in (Format.TREE, Format.DOT, Format.TIKZ, Format.SVG):
        with pytest.raises((OptionError, TreeError), match=error):
            draw(loads(tree), form, looking(loads(tree), **options))
    with pytest.raises((OptionError, TreeError), match=error):
        to_dot(loads(tree), **options)


@pytest.mark.parametrize(("what", "text", "width", "lines"), rows(__file__, "broken.txt"))
def test_labels_keep_words_and_code_breaks_where_its_parts_end(
    what: str, text: str, width: int, lines: list[str]
) -> None:
    assert (wrapped_code if what == "code" else wrapped)(text, width) == lines


@pytest.mark.parametrize("wrap", [wrapped, wrapped_code])
def test_wrapping_takes_any_text(wrap: Any) -> None:
    for text in AWKWARD:
        for width in (4, 11, 26):
            assert all(len(line) <= width + width // 2 and line.isprintable() for line in wrap(text, width))
    long = "x" * 60_000 + " word" * 8_000 + " " * 60_000
    for width in (14, 100_000):
        assert "".join(wrap(long, width)).replace(" ", "") == long.replace(" ", "")
