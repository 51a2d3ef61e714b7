"""Observational determinism: the product, the criterion, the reference, and the texts for published tools."""

import os
import subprocess
import sys
from itertools import chain, combinations, product
from pathlib import Path
from typing import Final

import pytest

from papers.multipath import __main__ as command
from papers.multipath.determinism import EventLetter, Machine, aiger, difference, hyperltl, machine
from rvaft import RVAFT, NotExpressible, Semantics, Verdict, load, loads
from rvaft.semantics import Reference

pytest.importorskip("spot", reason="needs Spot")
pytestmark = pytest.mark.spot

GATES: Final = Path(__file__).parents[2] / "trees" / "gates"
TEXTS: Final = (
    *(path.read_text(encoding="utf-8") for path in sorted(GATES.glob("*.rvaft"))),
    "top or a c; c and a b;",
    "top sand a g; g or b c; g2 and a c; toplevel top;",
    "top and g h; g or a b; h sand b c;",
    "top sand a b; a times 2; b;",
)
MCHYPER: Final = os.environ.get("MCHYPER", "")
RVHYPER: Final = os.environ.get("RVHYPER", "")


def sets(of: Machine) -> list[tuple[str, ...]]:
    return [*chain.from_iterable(combinations(of.types, size) for size in range(len(of.types) + 1))]


def event(letter: EventLetter) -> dict[str, str]:
    """The event of a tree whose leaves observe their default events."""
    (name,) = letter.types
    return {"event": name}


def last(tree: RVAFT, semantics: Semantics, trace: list[dict[str, str]]) -> Verdict:
    """The verdict of the reference at the end of a trace."""
    return [Verdict.UNKNOWN, *Reference(tree, semantics).run(trace)][-1]


@pytest.mark.parametrize("semantics", Semantics)
@pytest.mark.parametrize("text", TEXTS)
def test_the_product_the_criterion_and_the_reference_agree(text: str, semantics: Semantics) -> None:
    """Against all pairs of traces of up to four events, and each pair that the product gives."""
    tree = loads(text)
    of = machine(tree, semantics)
    traces = [trace for size in range(5) for trace in product(of.types, repeat=size)]
    verdict = {trace: last(tree, semantics, [{"event": one} for one in trace]) for trace in traces}
    for hidden in sets(of):
        found = difference(of, hidden)
        assert (found is None) is all(map(of.loops, hidden))
        groups: dict[tuple[str, ...], set[Verdict]] = {}
        for trace, end in verdict.items():
            groups.setdefault(tuple(one for one in trace if one not in hidden), set()).add(end)
        if found is None:
            assert all(len(verdicts) == 1 for verdicts in groups.values())
            continue
        pair = [[event(letter) for letter in steps if letter is not None] for steps in zip(*found, strict=True)]
        seen = [[one for one in trace if one["event"] not in hidden] for trace in pair]
        ends = [last(tree, semantics, trace) for trace in pair]
        assert seen[0] == seen[1]
        assert ends[0] is not ends[1]
        if max(map(len, pair)) <= 4:
            assert any(len(verdicts) > 1 for verdicts in groups.values())


def test_what_no_verdict_depends_on_may_be_hidden() -> None:
    of = machine(loads("top or a c; c and a b;"), Semantics.SCATTERED)
    assert [hidden for hidden in sets(of) if difference(of, hidden) is None] == [(), ("b",)]


def test_ignored_events_are_refused() -> None:
    with pytest.raises(NotExpressible, match="ignore"):
        machine(loads("top or a; event e() = { e: 1 }; ignore e();"), Semantics.PROJECTED)


def simulated(circuit: str, letters: list[int]) -> list[dict[str, bool]]:
    """The outputs of a circuit in the ASCII format of AIGER, per step."""
    (_, _, inputs, latches, outputs, gates), *lines = [line.split() for line in circuit.splitlines()]
    size, rows = [int(inputs), int(latches), int(outputs), int(gates)], iter(lines)
    given, stored, told, made = ([next(rows) for _ in range(number)] for number in size)
    names = [name for kind, name in rows if kind.startswith("o")]
    state, found = dict.fromkeys((int(row[0]) for row in stored), False), []
    for code in letters:
        values = {0: False, **state, **{int(row[0]): bool(code >> bit & 1) for bit, row in enumerate(given)}}

        def value(literal: int, values: dict[int, bool] = values) -> bool:
            return values[literal & ~1] ^ bool(literal & 1)

        for gate, one, other in (map(int, row) for row in made):
            values[gate] = value(one) and value(other)
        found.append({name: value(int(row[0])) for name, row in zip(names, told, strict=True)})
        state = {int(row[0]): value(int(row[1])) for row in stored}
    return found


@pytest.mark.parametrize("text", TEXTS)
def test_the_circuit_is_the_automaton(text: str) -> None:
    of = machine(loads(text), Semantics.PROJECTED)
    hidden = of.types[:1]
    for codes in product(range(len(of.letters) + 1), repeat=4):
        state = 0
        for code, outputs in zip(codes, simulated(aiger(of, hidden), [*codes]), strict=True):
            state = of.next[state][code - 1] if code else state
            verdict = of.verdicts[state]
            assert (outputs["detected"], outputs["over"]) == (verdict is Verdict.TRUE, verdict is Verdict.FALSE)
            nothing = code == 0 or of.is_hidden(of.letters[code - 1], hidden)
            assert any(on for name, on in outputs.items() if name.startswith("o") and name != "over") is not nothing


def test_the_command(tmp_path: Path) -> None:
    words = [sys.executable, "-m", "papers.multipath"]
    root = str(Path(__file__).parents[2])
    env = {**os.environ, "PYTHONPATH": root}

    def run(*more: str) -> "subprocess.CompletedProcess[str]":
        return subprocess.run([*words, *more], cwd=tmp_path, env=env, capture_output=True, text=True, check=False)

    tree = str(GATES / "sand.rvaft")
    done = run(tree, "a")
    assert (done.returncode, done.stdout) == (0, "not deterministic\n")
    assert {path.name for path in tmp_path.iterdir()} == {"sand.hltl", "sand.mchyper", "sand.aag"}
    assert (tmp_path / "sand.hltl").read_text().startswith("forall x. forall y. ((detected_x <-> detected_y)")
    wrong = run(tree, "z")
    assert (wrong.returncode, wrong.stderr) == (
        2,
        "papers.multipath: error: no event type z; known: a, b, c\n",
    )
    assert run(str(tmp_path / "none.rvaft")).returncode == 2


def test_the_page_has_the_results() -> None:
    """Its figures are of all shipped trees; those of the paper are decided again."""
    page = (Path(command.__file__).parent / "README.md").read_text()
    paper = [*command.results("remote_inspection/*.rvaft")]
    written = command.page(page, paper)
    parts = [{of["name"]: of[3] for of in command.PART.finditer(text)} for text in (page, written)]
    assert [*map(sorted, parts)] == [["counts", "pairs", "states", "times"]] * 2
    assert parts[0]["pairs"] == parts[1]["pairs"]
    assert {*parts[1]["states"].splitlines()} < {*parts[0]["states"].splitlines()}
    assert command.PART.sub("", page) == command.PART.sub("", written)
    for name in ("pruned", "full"):
        tree = load(GATES.parent / "remote_inspection" / f"{name}.rvaft")
        of = {semantics: machine(tree, semantics) for semantics in (Semantics.PROJECTED, Semantics.STRICT)}
        row = next(line for line in page.splitlines() if line.startswith(f"| `remote_inspection/{name}` |"))
        assert [int(cell) for cell in row.split("|")[2:5]] == [
            len(of[Semantics.STRICT].types),
            len(of[Semantics.STRICT].next),
            len(of[Semantics.PROJECTED].next),
        ]
        assert not any(map(of[Semantics.PROJECTED].loops, of[Semantics.PROJECTED].types))


def gate(name: str) -> RVAFT:
    return load(GATES / f"{name}.rvaft")


@pytest.mark.published
@pytest.mark.skipif(not MCHYPER, reason="MCHYPER names no script")
@pytest.mark.parametrize("semantics", [Semantics.PROJECTED, Semantics.SCATTERED])
@pytest.mark.parametrize("text", TEXTS)
def test_mchyper_decides_alike(text: str, semantics: Semantics, tmp_path: Path) -> None:
    of = machine(loads(text), semantics)
    for hidden in sets(of):
        (tmp_path / "tree.aag").write_text(aiger(of, hidden))
        words = [MCHYPER, "-f", hyperltl(of, hidden)["mchyper"], str(tmp_path / "tree.aag"), "-pdr", "-cex"]
        done = subprocess.run(words, cwd=tmp_path, capture_output=True, text=True, check=False)
        assert ("Counterexample found" in done.stdout) is (difference(of, hidden) is not None), done.stdout


@pytest.mark.published
@pytest.mark.skipif(not RVHYPER, reason="RVHYPER names no program")
@pytest.mark.parametrize("name", ["and", "or", "sand", "vot"])
def test_rvhyper_reports_the_pairs(name: str, tmp_path: Path) -> None:
    of = machine(gate(name), Semantics.SCATTERED)
    for hidden in sets(of):
        steps = difference(of, hidden)
        if steps is None:
            continue
        files = []
        for number, letters in enumerate(zip(*steps, strict=True)):
            codes = [0 if letter is None else 1 + of.letters.index(letter) for letter in letters]
            outputs = simulated(aiger(of, hidden), codes)
            lines = [
                ",".join(name for name, on in step.items() if on and name not in ("detected", "over"))
                + ";"
                + ",".join(name for name in ("detected", "over") if step[name])
                for step in outputs
            ]
            files.append(tmp_path / f"{number}.tr")
            files[-1].write_text("\n".join(lines) + "\n")
        words = [RVHYPER, "-s", hyperltl(of, hidden)["rvhyper"], "--", *map(str, files)]
        assert "violation" in subprocess.run(words, capture_output=True, text=True, check=False).stdout
