"""Mutants of a room of the product, held against the verdicts of the reference: `python -m tests.faults.campaign ROOM`.

The reference gives its verdicts before anything is changed; each mutant lives in a process of its own, which runs the participants
on the same traces. A mutant is killed where a verdict differs, somebody raises, or the time is over.
"""

import gc
import json
import os
import pickle
import resource
import signal
from argparse import ArgumentParser
from collections.abc import Callable, Iterator, Sequence
from contextlib import suppress
from dataclasses import dataclass
from functools import partial
from importlib import import_module
from itertools import islice
from pathlib import Path
from random import Random
from typing import Any, Final

import rvaft
from backends.conformance import examples
from cross_check.campaign import catalogue
from cross_check.participants import Participant, reference_of
from cross_check.results import Job
from cross_check.traces import Effort, letters_of, trials
from rvaft import RVAFT, Monitor, NotExpressible, Semantics, TooLarge, Verdict
from rvaft.analysis.branches import restrict
from tests.engine.checking import small_and_valid
from tests.engine.dense import SHAPES as DENSE
from tests.engine.dense import dense_tree
from tests.faults.mutations import Mutant, Source, forget_caches, live_functions

ROOT: Final = Path(rvaft.__file__).parent.parent
ENGINE: Final = "engine"
MEMORY: Final = 4 << 30
"""Bytes that a mutant may take."""
SECONDS: Final = 1.0, 0.04
"""Of processor time that it may take: once, and for each exercise and participant."""


@dataclass(frozen=True, slots=True)
class Room:
    """A part of the product by its folders, and the participants that are wrong where it is."""

    files: tuple[str, ...]
    participants: tuple[str, ...]


BACKENDS: Final = ("automaton", "ltlf", "rml")
ROOMS: Final = {
    ENGINE: Room(("rvaft/engine/**/*.py",), (ENGINE,)),
    **{name: Room((f"backends/{name}/**/*.py",), (name,)) for name in BACKENDS},
    "shared": Room(
        ("rvaft/*.py", "rvaft/support/**/*.py", "rvaft/model/**/*.py", "rvaft/analysis/**/*.py"), (ENGINE, *BACKENDS)
    ),
}
"""What the reference has no part in: it has given its verdicts before a mutant is made."""

EFFORT: Final = Effort(words=60, traces=16)
LONG: Final = 10
"""Events in further traces, drawn from those that the tree tells apart."""


@dataclass(frozen=True, slots=True)
class Exercise:
    """A tree under one semantics, traces, and the verdicts of the reference after each of their prefixes."""

    name: str
    tree: RVAFT
    semantics: Semantics
    traces: Sequence[Sequence[Any]]
    expected: Sequence[Sequence[Verdict]]


@dataclass(frozen=True, slots=True)
class Outcome:
    """What became of a mutant: who differed on which tree, or what was raised; nothing where nobody saw it."""

    mutant: Mutant
    killed: str


def jobs() -> Iterator[tuple[RVAFT, Job]]:
    """The trees of the cross-checker, those of the conformance suite, and some random ones, each under every semantics."""
    trees = [(entry.tree, entry.name, entry.branch, entry.kind) for entry in catalogue()]
    trees += [(example.tree, example.name, None, None) for example in examples()]
    for shape, dense in DENSE.items():
        random = Random(shape)
        made = (tree for _ in range(200) if small_and_valid(tree := dense_tree(random, dense), 30))
        trees += [(tree, f"random {number}, {shape}", None, None) for number, tree in enumerate(islice(made, 12))]
    for tree, name, branch, kind in trees:
        for semantics in Semantics:
            yield tree, Job(name, semantics, branch, kind)


def exercise(tree: RVAFT, job: Job) -> Exercise | None:
    """The traces of one comparison with the verdicts; the tree is as if nobody had looked at it."""
    part = restrict(tree, branch=job.branch, kind=job.kind)
    fresh = pickle.loads(pickle.dumps(part))
    reference = reference_of(tree, job.semantics, branch=job.branch, kind=job.kind)
    if not isinstance(reference, Participant):
        return None
    traces = list(trials(part, job, EFFORT, [reference], words=True))
    random = Random(job.title)
    letters = letters_of([reference.observed or ()]).events
    traces += [random.choices(letters, k=LONG) for _ in range(EFFORT.traces)]
    expected = [list(reference.start().run(trace)) for trace in traces]
    return Exercise(f"{job.title} under {job.semantics}", fresh, job.semantics, traces, expected)


def monitor_of(participant: str, tree: RVAFT, semantics: Semantics) -> Monitor | None:
    """The monitor of a participant, or None where its language cannot say the tree."""
    if participant == ENGINE:
        return rvaft.monitor(tree, semantics=semantics)
    try:
        return rvaft.translate(tree, participant, semantics=semantics).monitor()
    except (NotExpressible, TooLarge):
        return None


def wrong(participants: Sequence[str], work: Sequence[Exercise]) -> str:
    """The first exercise in which a participant is wrong, or nothing."""
    for one in work:
        for participant in participants:
            monitor = monitor_of(participant, one.tree, one.semantics)
            for trace, expected in zip(one.traces, one.expected, strict=True):
                if monitor is not None and list(monitor.fork().run(trace)) != expected:
                    return f"{participant} differs: {one.name}"
    return ""


def in_a_child(work: Callable[[], Any], seconds: float) -> Any:
    """What a function returns that runs in a process of its own, or as text why there is nothing."""
    read, write = os.pipe()
    child = os.fork()
    if child == 0:
        os.close(read)
        resource.setrlimit(resource.RLIMIT_AS, (MEMORY, resource.getrlimit(resource.RLIMIT_AS)[1]))
        signal.setitimer(signal.ITIMER_PROF, seconds)
        try:
            found = work()
        except BaseException as error:  # noqa: BLE001 (a mutant may do anything)
            found = f"{type(error).__name__}: {error}"[:200]
        os.write(write, json.dumps(found).encode())
        os._exit(0)
    os.close(write)
    with os.fdopen(read, "rb") as pipe:
        told = pipe.read()
    _, status = os.waitpid(child, 0)
    if told:
        return json.loads(told)
    return "the time is over" if os.WTERMSIG(status) == signal.SIGPROF else f"died of signal {os.WTERMSIG(status)}"


def sources(room: Room) -> list[Source]:
    """The modules of a room that can be imported, all of them imported."""
    found = []
    for path in sorted({path for pattern in room.files for path in ROOT.glob(pattern) if path.stem != "__main__"}):
        name = ".".join(path.relative_to(ROOT).with_suffix("").parts).removesuffix(".__init__")
        with suppress(ImportError):  # what needs a tool of others
            found.append(Source(import_module(name)))
    return found


def exercises(seed: int, share: float) -> list[Exercise]:
    """A share of all exercises, in no order."""
    random = Random(seed)
    chosen = [job for job in jobs() if random.random() < share]
    random.shuffle(chosen)
    return [one for tree, job in chosen if (one := exercise(tree, job)) is not None]


def campaign(room: Room, work: Sequence[Exercise], mutants: int, *, seed: int, tries: int) -> list[Outcome]:
    """What becomes of so many mutants, drawn from the sites that the exercises reach.

    Each runs at most so many exercises (`tries`), all of which reach its site.
    """
    modules = sources(room)
    gc.unfreeze()  # what is frozen is not found
    live = live_functions()
    forget_caches()
    gc.collect()
    gc.freeze()

    def reaches() -> list[list[list[int]]]:
        """For each exercise and each module the sites that are reached."""
        reached: list[set[int]] = [set() for _ in modules]
        for source, numbers in zip(modules, reached, strict=True):
            source.mark(numbers.add, live)
        told = []
        for one in work:
            differs = wrong(room.participants, [one])
            assert not differs, f"without any mutant {differs}"
            told.append([sorted(numbers) for numbers in reached])
            for numbers in reached:
                numbers.clear()
        return told

    told = in_a_child(reaches, 600)
    assert isinstance(told, list), told
    by_site: dict[tuple[int, int], list[Exercise]] = {}
    for one, places in zip(work, told, strict=True):
        for place, numbers in enumerate(places):
            for number in numbers:
                by_site.setdefault((place, number), []).append(one)

    def judged(source: Source, mutant: Mutant, work: Sequence[Exercise]) -> str:
        source.change(mutant, live)
        return wrong(room.participants, work)

    found = []
    for place, number in Random(seed).sample(sorted(by_site), min(mutants, len(by_site))):
        mutant = modules[place].mutant(number)
        asked = by_site[place, number][:tries]
        seconds = SECONDS[0] + SECONDS[1] * len(asked) * len(room.participants)
        found.append(Outcome(mutant, in_a_child(partial(judged, modules[place], mutant, asked), seconds)))
    return found


def main() -> None:
    """Run a campaign in each of some rooms and print it."""
    parser = ArgumentParser(description=__doc__)
    parser.add_argument("rooms", nargs="+", choices=ROOMS, metavar="ROOM", help=", ".join(ROOMS))
    parser.add_argument("--mutants", type=int, default=40, help="in each room")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--share", type=float, default=0.4, help="of the exercises")
    parser.add_argument("--tries", type=int, default=60, help="exercises for each mutant")
    parser.add_argument("--json", action="store_true")
    given = parser.parse_args()
    work = exercises(given.seed, given.share)
    found = {
        name: campaign(ROOMS[name], work, given.mutants, seed=given.seed, tries=given.tries) for name in given.rooms
    }
    if given.json:
        told = {name: [{"mutant": str(o.mutant), "killed": o.killed} for o in found[name]] for name in found}
        print(json.dumps(told))
        return
    for name, outcomes in found.items():
        for one in outcomes:
            print(f"{one.mutant}\n    {one.killed or 'SURVIVED'}")
        print(f"{name}: {sum(bool(one.killed) for one in outcomes)} of {len(outcomes)} killed")


if __name__ == "__main__":
    main()
