"""Trees of other tools: fault trees of Open-PSA and attack trees of ADTool (XML), and attack trees of ATTop."""

import time
from contextlib import suppress
from dataclasses import replace
from pathlib import Path

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from rvaft import RVAFT, Gate, LanguageError, Node, OptionError, RvaftError, Semantics, Severity, dumps, load, loads
from rvaft.export.open_psa import losses, open_psa_text
from rvaft.language.parser import parse
from rvaft.rules.registry import check
from tests.cli.runs import run
from tests.language.strategies import texts, trees
from tests.tables import rows


@pytest.mark.parametrize(("text", "meant", "said"), rows(__file__, "other_formats.txt"))
def test_how_trees_of_other_tools_are_read(text: str, meant: str, said: list[str]) -> None:
    tree = loads(text)
    assert tree == loads(f"semantics scattered; {meant}")
    assert loads(dumps(tree)) == tree
    findings = [finding for finding in check(parse(text)) if finding.code == "other-format"]
    assert sorted(finding.message for finding in findings) == sorted(said)
    assert {finding.severity for finding in findings} == {Severity.INFORMATION}


@pytest.mark.parametrize(("text", "error"), rows(__file__, "refused_formats.txt"))
def test_what_has_no_meaning_is_refused_in_one_line(
    text: str, error: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    Path("tree.xml").write_text(text, encoding="utf-8")
    for command in (["check"], ["show"], ["branches"]):
        told = run(*command, "tree.xml")
        assert told.exit_code == (1 if told.stdout else 2)
        [line] = [one for one in (told.stdout + told.stderr).splitlines() if "error: " in one]
        assert error in line
        assert "tree.xml:" in line


def test_a_deep_document_is_read_or_refused_and_a_large_one_is_quick(tmp_path: Path) -> None:
    deep = "<or>" * 3_000 + '<basic-event name="a"/>' + "</or>" * 3_000
    start, end = (
        '<opsa-mef><define-fault-tree name="t"><define-gate name="g">',
        "</define-gate></define-fault-tree></opsa-mef>",
    )
    assert len(loads(f"{start}{deep}{end}").nodes) == 3_001
    deep = '<node refinement="and"><label>l{}</label>'
    inner = "".join(map(deep.format, range(3_000))) + "</node>" * 3_000
    assert len(loads(f"<adtree>{inner}</adtree>").nodes) == 3_000
    with pytest.raises(LanguageError, match="not well-formed"):
        loads("<a>" * 100_000)
    gates = [
        f'<define-gate name="g{i}"><or><gate name="g{i + 1}"/><basic-event name="e{i}"/></or></define-gate>'
        for i in range(1_500)
    ]
    last = '<define-gate name="g1500"><basic-event name="e"/></define-gate>'
    begun = time.process_time()
    file = tmp_path / "large.xml"
    file.write_text(f'<opsa-mef><define-fault-tree name="t">{"".join(gates)}{last}</define-fault-tree></opsa-mef>')
    assert len(load(file).nodes) == 3_002
    assert time.process_time() - begun < 10


def test_every_command_reads_them_and_a_tree_imports_them(tmp_path: Path) -> None:
    model, data, log = tmp_path / "model.xml", tmp_path / "data.xml", tmp_path / "log.jsonl"
    gate = '<define-gate name="g"><and><event name="a"/><event name="b"/></and></define-gate>'
    other = '<define-gate name="h"><or><gate name="g"/><event name="c"/></or></define-gate>'
    model.write_text(f'<opsa-mef><define-fault-tree name="t">{gate}{other}</define-fault-tree></opsa-mef>')
    data.write_text(
        '<opsa-mef><model-data><define-basic-event name="a"><float value="0.1"/>'
        "</define-basic-event></model-data></opsa-mef>"
    )
    log.write_text("".join(f'{{"event": "{name}"}}\n' for name in ("a", "x", "b")))
    outer = tmp_path / "outer.rvaft"
    outer.write_text('import "model.xml"; import "data.xml"; toplevel g; a fault;')
    tree = load(outer)
    assert (tree.root, tree.semantics, tree.nodes["a"].attributes) == ("g", "scattered", (("prob", "0.1"),))
    assert run("monitor", model, log).exit_code == run("monitor", outer, log).exit_code == 1
    assert run("monitor", model, log, "--semantics", "strict").exit_code == 0
    assert run("monitor", model, outer, "--", log).exit_code == 1
    assert run("check", "-", data=model.read_text()).exit_code == 0
    outer.write_text('import "model.xml"; semantics projected;')
    assert load(outer).semantics == "projected"


def test_a_document_that_is_no_tree_is_not_quoted(tmp_path: Path) -> None:
    for name, text in (("a.conf", "<secret-name>x</secret-name>"), ("b.xml", "<x secret='1'><y></x>")):
        (tmp_path / name).write_text(text)
        told = run("check", tmp_path / name)
        assert told.exit_code != 0
        assert "secret" not in told.stdout + told.stderr


def test_attack_trees_of_attop(tmp_path: Path) -> None:
    file = tmp_path / "tree.at"
    file.write_text('toplevel "T";\n"T" sand "A" "B";\n"A" sor "C" "D";\n"C" cost=10 mintime=6 maxtime=6 lambda=2;\n')
    assert load(file) == loads(
        "semantics scattered; toplevel T; T sand A B; A or C D; C cost=10 mintime=6 maxtime=6 lambda=2;"
    )
    [finding] = [one for one in check(parse(file.read_text(), str(file))) if one.code == "dynamic-gate"]
    assert (
        finding.message
        == "`sor` of A is read as `or`: any part attains it, and no event shows which ones were attempted before"
    )
    for text, error in (
        ('"T" rdep 0.5 "A" "B";', "the gate `rdep` of `T` is not supported: it changes failure rates"),
        ('toplevel "T" 100;', "a root has no costs here; write them as attributes of leaves"),
    ):
        file.write_text(text)
        with pytest.raises(LanguageError) as caught:
            load(file)
        assert error in str(caught.value)
    with pytest.raises(
        LanguageError, match="the gate `sor` of `t` is not supported: it needs failures at the same time"
    ):
        loads("t sor a b;")


# Open-PSA, written.

identifiers = st.from_regex(r"[A-Za-z][A-Za-z0-9_]{0,2}(-[a-z0-9]{1,2})?", fullmatch=True)
pairs = st.tuples(
    st.sampled_from(["prob", "lambda", "dorm", "site", "a b"]),
    st.sampled_from(["0.1", "1e-3", ".5", "1/h", "x"]) | texts,
)


@st.composite
def fault_trees(draw: st.DrawFn) -> RVAFT:
    """A tree that Open-PSA can write: a gate at the root, and names that are identifiers."""
    names = draw(st.lists(identifiers, min_size=2, max_size=8, unique=True))
    nodes = []
    for place, name in enumerate(names):
        later = names[place + 1 :]
        below = tuple(draw(st.lists(st.sampled_from(later), min_size=1, max_size=4, unique=True))) if later else ()
        gate = (
            draw(st.sampled_from([Gate.OR, Gate.AND, Gate.VOT]))
            if below and (not place or draw(st.booleans()))
            else None
        )
        below = below if gate else ()
        threshold = draw(st.integers(1, len(below))) if gate is Gate.VOT else None
        attributes = tuple(draw(st.lists(pairs, max_size=3, unique_by=lambda pair: pair[0])))
        nodes.append(Node(name, gate, below, threshold, label=draw(st.none() | texts), attributes=attributes))
    return RVAFT(names[0], nodes, semantics=Semantics.SCATTERED)


def written(tree: RVAFT) -> RVAFT:
    """The reachable nodes, with the words of labels one blank apart, and attributes in the order of their names."""
    nodes = [
        replace(node, label=" ".join((node.label or "").split()) or None, attributes=tuple(sorted(node.attributes)))
        for node in tree.top_down()
    ]
    return RVAFT(tree.root, nodes, semantics=tree.semantics)


@given(fault_trees())
def test_what_is_written_for_open_psa_is_read_as_an_equal_tree(tree: RVAFT) -> None:
    again = loads(open_psa_text(tree))
    if any("left out" in loss for loss in losses(tree)):
        assert {name: again.nodes[name].children for name in again.nodes} == {
            n.name: n.children for n in tree.top_down()
        }
    else:
        assert written(again) == written(tree)
    assert open_psa_text(again) == open_psa_text(loads(open_psa_text(again)))


@settings(max_examples=30)
@given(trees())
def test_any_tree_is_refused_or_its_structure_is_read_again(tree: RVAFT) -> None:
    with suppress(OptionError):
        check_structure(tree, open_psa_text(tree))


def check_structure(tree: RVAFT, text: str) -> None:
    try:
        again = parse(text).build()
    except RvaftError:
        with pytest.raises(RvaftError):
            loads(dumps(tree))
        return
    assert again.root == tree.root
    for node in tree.top_down():
        other = again.nodes[node.name]
        assert (node.children, node.threshold) == (other.children, other.threshold)
        assert node.gate == other.gate or len(node.children) == 1


@pytest.mark.parametrize(
    ("text", "error"),
    [
        ("top sand a b;", "cannot write top: it has no place for the order of sand"),
        ("top pand a b;", "the order of pand"),
        ("top or a b on e(); event e() = { e: 1 };", "cannot write top: it has no place for the event of a gate"),
        ("top or a b; a on e(X) when X > 1; event e(x) = { e: x };", "cannot write a: it has no place for a guard"),
        ("top and a b; a on e(X); b on e(X); event e(x) = { e: x };", "a variable that several events share"),
        ("top and a b within 5 s; time t as s;", "a window (within)"),
        ("top and a b without c() before; event c() = { c: 1 };", "an absent event (without)"),
        ("top and a b; a times 3;", "a number of events (times)"),
        ('top and "a b" c;', "cannot write the name 'a b': a name is a letter"),
        ("top;", "the top event is a gate, as in top or a;"),
    ],
)
def test_what_open_psa_cannot_mean_is_refused(text: str, error: str) -> None:
    with pytest.raises(OptionError) as caught:
        open_psa_text(loads(text))
    assert error in str(caught.value)


def test_what_open_psa_lacks_is_said(tmp_path: Path) -> None:
    file = tmp_path / "tree.rvaft"
    file.write_text(
        'event e(x) = { e: x }; top or a b label "\\u0001"; ignore e(1); b prob=.5;a fault on e(X) "a b"=1 "\\u0001"=2;'
    )
    told = run("show", file, "-o", tmp_path / "tree.xml")
    assert told.exit_code == 0
    assert [line.removeprefix("rvaft: warning: open-psa: ") for line in told.stderr.splitlines()] == [
        "1 runtime event left out: a basic event stands for each",
        "1 fault or attack mark left out",
        "1 label left out that XML cannot write",
        "1 attribute left out that XML lacks",
        "ignore declarations left out",
        "semantics projected left out; the file is read as scattered: failures persist",
        "1 basic event without a rate or probability, which most tools require",
    ]
    assert load(tmp_path / "tree.xml").nodes["a"].attributes == (("a b", "1"),)
