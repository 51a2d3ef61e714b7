"""Fault trees in the Galileo format: the static ones load, dynamic gates are read as observed
failures or refused with the reason.
"""

import re
from collections import Counter
from contextlib import suppress
from dataclasses import replace
from pathlib import Path
from random import Random

import pytest

from cross_check.generate.trees import PLAIN, random_tree
from rvaft import RVAFT, Gate, LanguageError, RvaftError, Semantics, Severity, dumps, load, loads, monitor
from rvaft.export import Format
from rvaft.export.drawing import draw
from rvaft.export.galileo_text import losses
from rvaft.language.parser import parse
from rvaft.rules.registry import check
from rvaft.semantics.scenarios import ReferenceScenario, Resolution, branches, of_branch, scenarios
from tests.cli.runs import run
from tests.tables import rows

CORPUS = Path(__file__).parents[3] / "shared" / "corpus" / "galileo"
FILES = sorted(CORPUS.rglob("*.dft"))
DYNAMIC = re.compile(r"(?m)^\s*\"?[\w']+\"?\s+(wsp|csp|hsp|spare|fdep|seq|pand|por|mutex|rdep|pdep)\b")
"""Found by looking at the words of the files, independently of the parser."""
REASONS = ("share the spare", "`por`", "`rdep`", "`mutex`", "`pdep=", "form a cycle")

needs_corpus = pytest.mark.skipif(not FILES, reason="the corpus of Galileo files is not there")


@pytest.mark.parametrize(("text", "meant", "said"), rows(__file__, "dynamic.txt"))
def test_dynamic_gates_are_read_as_observed_failures(text: str, meant: str, said: list[str]) -> None:
    assert loads(text) == loads(meant, strict_galileo=True)
    findings = [finding for finding in check(parse(text)) if finding.code == "dynamic-gate"]
    assert [finding.message for finding in findings] == said
    assert {finding.severity for finding in findings} <= {Severity.INFORMATION}
    if said:
        with pytest.raises(LanguageError, match=r"<text>:1:\d+: the dynamic gate `.*` of `.*` is refused"):
            loads(text, strict_galileo=True)


@pytest.mark.parametrize(("text", "error"), rows(__file__, "refused_dynamic.txt"))
def test_what_failures_do_not_tell_is_refused(text: str, error: str) -> None:
    with pytest.raises(RvaftError) as caught:
        loads(text)
    assert error in str(caught.value)


def test_every_command_can_be_strict_and_tells_of_pand_in_files_of_galileo(tmp_path: Path) -> None:
    files = [tmp_path / name for name in ("tree.dft", "tree.rvaft", "log.jsonl")]
    for file in files[:2]:
        file.write_text('toplevel "A"; "A" pand "B" "C"; "B" lambda=1; "C" lambda=1;')
    files[2].write_text('{"event": "B"}\n')
    told = run("check", "--strict", *files[:2])
    assert (
        told.stdout
        == f"{files[0]}:1:19: information: `pand` of A is read as `pand`: its inputs fail from left to right "
        "[dynamic-gate]\n"
    )
    assert told.exit_code == 0
    for command in (["check"], ["show"], ["branches"], ["emit", "--to", "rml"], ["traces"]):
        assert run(*command, "--strict-galileo", files[0]).exit_code == 2
        assert "the dynamic gate `pand` of `A` is refused" in run(*command, "--strict-galileo", files[0]).stderr
        assert run(*command, "--strict-galileo", files[1]).exit_code == 0
    assert run("monitor", "--strict-galileo", files[0], files[2]).exit_code == 2
    assert run("monitor", files[0], files[2]).exit_code != 2


@pytest.mark.parametrize("suffix", [".dft", ".galileo", ".DFT"])
def test_failures_persist(tmp_path: Path, suffix: str) -> None:
    """A component that has failed stays so, whatever fails between it and the last of its branch."""
    tree, outer, log = tmp_path / f"tree{suffix}", tmp_path / "outer.rvaft", tmp_path / "log.jsonl"
    text = 'toplevel "T"; "T" or "L" "R"; "L" and "A" "B"; "R" and "C" "D"; "A" lambda=1; "B" lambda=1;'
    tree.write_text(text)
    outer.write_text(f'import "{tree.name}"; "A" fault;')
    log.write_text("".join(f'{{"event": "{name}"}}\n' for name in "ACB"))
    assert [load(file).semantics for file in (tree, outer)] == ["scattered", "scattered"]
    assert [run("monitor", file, log).exit_code for file in (tree, outer)] == [1, 1]
    assert run("monitor", tree, log, "--semantics", "projected").exit_code == 0
    outer.write_text(f'import "{tree.name}"; semantics projected;')
    assert run("monitor", outer, log).exit_code == 0
    assert loads(text).semantics is None
    assert not [lost for lost in losses(load(tree)) if "semantics" in lost]
    assert [lost for lost in losses(loads(text)) if "semantics projected left out" in lost]


@needs_corpus
def test_the_corpus_is_complete() -> None:
    kinds = Counter("dynamic" if DYNAMIC.search(path.read_text()) else "static" for path in FILES)
    assert kinds == {"static": 66, "dynamic": 347}


@pytest.mark.ci
@needs_corpus
def test_how_many_files_are_read_and_why_others_are_not() -> None:
    found: Counter[str] = Counter()
    for path in FILES:
        try:
            tree = load(path)
        except RvaftError as error:
            found[next((reason for reason in REASONS if reason in str(error)), str(error))] += 1
            continue
        found["read"] += 1
        check_written(tree)
        text = path.read_text()
        dynamic = DYNAMIC.search(text)
        if dynamic is None:
            assert parse(dumps(tree)).build() == tree
            assert tree.root == re.findall(r'toplevel\s+"?(.*?)"?;', text)[0]
        elif len(text) < 2_000:
            with pytest.raises(LanguageError, match=r"the dynamic gate `\w+` of `.*` is refused") as caught:
                parse(text, str(path), strict_galileo=True)
            assert caught.value.line == text.count("\n", 0, dynamic.start(1)) + 1
    assert found == {
        "read": 376,
        "share the spare": 5,
        "`por`": 11,
        "`rdep`": 7,
        "`pdep=": 5,
        "`mutex`": 1,
        "form a cycle": 8,
    }


def check_written(tree: RVAFT) -> None:
    """What is written as Galileo is the tree again, but for `sand` over single events, which is `pand` there."""
    told = [loss for loss in losses(tree) if "without a rate" not in loss]
    if told:
        assert all("written as pand" in loss or "absent event" in loss for loss in told)
        assert any(node.without for node in tree.nodes.values()) == any("absent event" in loss for loss in told)
        return
    again = parse(draw(tree, Format.GALILEO).decode(), "tree.dft").build()
    assert set(again.nodes) == set(tree.order)
    for one in tree.top_down():
        other = again.nodes[one.name]
        ordered = {Gate.SAND: Gate.PAND, Gate.SAND_RL: Gate.PAND}.get(one.gate, one.gate)  # type: ignore[arg-type]
        children = one.children[::-1] if one.gate is Gate.SAND_RL else one.children
        expected = (ordered, children, one.threshold, one.attributes)
        assert expected == (other.gate, other.children, other.threshold, other.attributes)


def meaning(tree: RVAFT) -> set[object]:
    """The branches of a tree by the reference, each with its scenarios: what they keep and in which orders."""
    return {
        (_kept(branch), frozenset((_kept(s.kept), _orders(s)) for s in scenarios(tree) if of_branch(s, branch)))
        for branch in branches(tree)
    }


def _kept(resolution: Resolution) -> frozenset[object]:
    return frozenset((name, frozenset(children)) for name, children in resolution.items())


def _orders(scenario: ReferenceScenario) -> frozenset[object]:
    return frozenset(frozenset(order.items()) for order in scenario.orders)


@pytest.mark.parametrize("seed", range(60))
def test_what_is_written_as_galileo_and_loses_nothing_means_the_same_when_it_is_read(seed: int) -> None:
    random = Random(f"galileo {seed}")
    grown = random_tree(random, replace(PLAIN, sharing=0.3, max_nodes=8))
    nodes = [replace(n, attributes=() if n.children else (("lambda", "0.1"),)) for n in grown.nodes.values()]
    tree = RVAFT(grown.root, nodes, semantics=Semantics.SCATTERED)
    again = loads(draw(tree, Format.GALILEO).decode(), "again.dft")
    check_written(tree)
    if not list(losses(tree)):
        assert meaning(again) == meaning(tree)


@pytest.mark.parametrize("seed", range(40))
def test_dependencies_bring_about_what_the_structure_of_the_fault_tree_says(seed: int) -> None:
    """Against the failures themselves: a set of failed parts, closed under the dependencies, and
    the gates evaluated over it.
    """
    random = Random(f"dependencies {seed}")
    leaves = [f"e{number}" for number in range(6)]
    while True:
        gates: dict[str, tuple[str, list[str]]] = {}
        for number in range(4):
            below = random.sample([*leaves, *gates], random.randint(2, 3))
            gates[f"g{number}"] = (random.choice(["and", "or", "wsp", f"2of{len(below)}"]), below)
        causes = [[random.choice([*leaves, "g0"]), *random.sample(leaves, 2)] for _ in range(2)]
        text = [f"{name} {word} {' '.join(below)};" for name, (word, below) in gates.items()]
        text += [f"f{number} fdep {' '.join(names)};" for number, names in enumerate(causes)]
        with suppress(LanguageError):  # a spare is shared, or the dependencies form a cycle
            tree = loads(f"toplevel g3; {' '.join(text)}")
            break

    def failed(parts: set[str]) -> bool:
        while True:
            before = len(parts)
            for name, (word, below) in gates.items():
                need = 1 if word == "or" else 2 if word[0] == "2" else len(below)
                parts |= {name} if len(parts.intersection(below)) >= need else set()
            for trigger, *dependents in causes:
                parts |= set(dependents) if trigger in parts else set()
            if len(parts) == before:
                return "g3" in parts

    for _ in range(10):
        trace = random.sample(leaves, len(leaves))
        watching = monitor(tree, semantics="scattered")
        for place, name in enumerate(trace, 1):
            assert (watching.step({"event": name}) == "true") is failed(set(trace[:place])), (text, trace[:place])
