"""`python -m papers.multipath [TREE TYPE...]`: write the results, or the texts for the published tools.

Without arguments, `README.md` is written anew. With a tree and hidden event types, the property goes
to `TREE.hltl` and `TREE.mchyper`, and the automaton to `TREE.aag`, in the current folder.
"""

import sys
from collections.abc import Iterator, Sequence
from itertools import chain, combinations
from pathlib import Path
from statistics import median
from time import perf_counter
from typing import Final, NamedTuple

from papers.multipath.determinism import IDLE, EventLetter, Machine, aiger, difference, hyperltl, machine
from rvaft import RvaftError, Semantics, load
from rvaft.support.files import place

FOLDER: Final = Path(__file__).parent
TREES: Final = FOLDER.parents[1] / "trees"
MANY: Final = 8
"""Event types of which every set is decided; of more, each one and all."""


class TreeResult(NamedTuple):
    """A machine, and which sets of its event types may be hidden."""

    tree: str
    semantics: Semantics
    machine: Machine
    free: list[tuple[str, ...]]
    sets: int
    milliseconds: float
    """The median of the decisions."""
    most: float


def results() -> Iterator[TreeResult]:
    """Decide the shipped trees that an automaton expresses without `ignore`."""
    for path in sorted(TREES.rglob("*.rvaft")):
        for semantics in Semantics:
            try:
                found = machine(load(path), semantics)
            except RvaftError:
                continue
            types, times, free = found.types, list[float](), list[tuple[str, ...]]()
            sizes = range(1, len(types) + 1) if len(types) <= MANY else (1, len(types))
            sets = [*chain.from_iterable(combinations(types, size) for size in sizes)]
            for hidden in sets:
                begun = perf_counter()
                if difference(found, hidden) is None:
                    free.append(hidden)
                times.append(1000 * (perf_counter() - begun))
            name = str(path.relative_to(TREES).with_suffix(""))
            yield TreeResult(name, semantics, found, free, len(sets), median(times), max(times))


def page(every: Sequence[TreeResult]) -> str:
    """Return the page of results."""
    text = (FOLDER / "template.md").read_text(encoding="utf-8")
    trees, sets = {one.tree for one in every}, sum(one.sets for one in every)
    free = [one for one in every if one.free]
    shown = [one for one in every if one.tree.startswith(("gates/", "remote_inspection/"))]
    by_tree: dict[str, list[TreeResult]] = {}
    for found in shown:
        by_tree.setdefault(found.tree, []).append(found)
    rows = [
        f"| `{tree}` | {len(some[0].machine.types)} | {' | '.join(str(len(one.machine.next)) for one in some)} |"
        for tree, some in by_tree.items()
    ]
    paper = {(one.tree, one.semantics): one.machine for one in every if one.tree.startswith("remote_inspection/")}
    pairs = []
    for tree, hidden in (("full", ("battery", "image")), *(("pruned", (name,)) for name in ("radiation", "goal"))):
        for semantics in (Semantics.PROJECTED, Semantics.SCATTERED):
            steps = difference(paper[f"remote_inspection/{tree}", semantics], hidden)
            assert steps is not None
            one, other = (_word(letters) for letters in zip(*steps, strict=True))
            pairs.append(f"| {tree} | {_names(hidden)} | {semantics} | {one} | {other} |")
    return text.format(
        trees=len(trees),
        machines=len(every),
        sets=f"{sets:,}",
        free=sum(len(one.free) for one in every),
        of=", ".join(f"{one.tree} under {one.semantics} ({', '.join(map(_names, one.free))})" for one in free)
        or "none",
        rows="\n".join(rows),
        median=f"{median(one.milliseconds for one in every):.1g}",
        most=f"{max(one.most for one in every):.0f}",
        pairs="\n".join(pairs),
    )


def _names(hidden: Sequence[str]) -> str:
    return " and ".join(f"`{name}`" for name in hidden)


def _word(letters: Sequence[EventLetter | None]) -> str:
    return ", ".join(IDLE if letter is None else str(letter) for letter in letters)


def main() -> int:
    """Write what is asked for; return the exit status."""
    if sys.argv[1:] in (["-h"], ["--help"]):
        print(__doc__)
        return 0
    if len(sys.argv) == 1:
        (FOLDER / "README.md").write_text(page([*results()]), encoding="utf-8")
        return 0
    path, *hidden = sys.argv[1:]
    try:
        tree = load(path)
        found = machine(tree, tree.semantics or Semantics.PROJECTED)
    except (OSError, RvaftError) as error:
        print(f"papers.multipath: error: {error}", file=sys.stderr)
        return 2
    if unknown := {*hidden} - {*found.types}:
        print(
            f"papers.multipath: error: no event type {min(unknown)}; known: {', '.join(found.types)}", file=sys.stderr
        )
        return 2
    written, stem = hyperltl(found, hidden), Path(path).stem
    formulas = {f"{stem}.hltl": f"{written['rvhyper']}\n", f"{stem}.mchyper": f"{written['mchyper']}\n"}
    try:
        place(Path(), {**formulas, f"{stem}.aag": aiger(found, hidden)}, force=True)
    except (OSError, RvaftError) as error:
        print(f"papers.multipath: error: {error}", file=sys.stderr)
        return 2
    print("not deterministic" if difference(found, hidden) else "deterministic")
    return 0


if __name__ == "__main__":
    sys.exit(main())
