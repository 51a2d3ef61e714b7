r"""What was found about the paper, each finding with the commands that show it.

`shows` is what the output of a command must contain for the finding to hold; the generated page says where it does not.
"""

from dataclasses import dataclass, replace
from typing import Final

from papers.fmas2022.shell import COMPILER, MONITOR, Need

_TREES: Final = "trees/remote_inspection"
_TRACES: Final = f"{_TREES}/pruned.traces"
_TEXTS: Final = "papers/fmas2022/texts"
_COMPILE: Final = "java -jar $RML_COMPILER --input={0} --output={1}"
_RUN: Final = "swipl -O -p monitor=$RML_MONITOR $RML_MONITOR/monitor.pl -- {0} {1} | tail -n 1"
_REJECTED: Final = "Trace did not match specification"
_ACCEPTED: Final = "Execution terminated correctly"


@dataclass(frozen=True, slots=True)
class Step:
    """A command, what its output must contain (without that it must print nothing and succeed), and what it needs.

    A line of the output that begins with `not run: ` says that the command itself had to leave something out.
    """

    command: str
    shows: str = ""
    needs: tuple[Need, ...] = ()
    before: str = ""
    """What to know before reading the command, if anything; it asserts nothing, as the command may not be run."""


@dataclass(frozen=True, slots=True)
class Finding:
    """A claim, what it rests on in words, and the commands.

    Where not all commands can be run, `asked` is the title instead, if the claim hangs on them, and
    `seen`, which says what they show, is left out.
    """

    title: str
    text: str
    steps: tuple[Step, ...]
    asked: str = ""
    seen: str = ""


def _published(tree: str, semantics: str, name: str, *, trace: str = "", words: str = "") -> tuple[Step, ...]:
    """The published tools reject a trace, from a file or of default events, by the paper's translation of a tree."""
    given = trace or f"$OUT/{name}.jsonl"
    commands = [
        f"rvaft emit {tree} --to rml-paper --semantics {semantics} -o $OUT/{name}.rml",
        _COMPILE.format(f"$OUT/{name}.rml", f"$OUT/{name}.pl"),
        *([] if trace else [f"""printf '{{"event": "%s"}}\\n' {words} > {given}"""]),
        _RUN.format(f"$OUT/{name}.pl", given),
    ]
    *quiet, last = (Step(command, needs=COMPILER + MONITOR) for command in commands)
    return replace(quiet[0], before="And by the published tools:"), *quiet[1:], replace(last, shows=_REJECTED)


FINDINGS: Final = (
    Finding(
        "The Listing uses NewWp where nothing binds it",
        "In the Listing the altered goal may follow the radiation reading directly. Its guard compares the "
        "goal with NewWp, "
        "which only the other alternative binds. The formula φ of section 4.2 has the command to move before both.",
        (
            Step(f"rvaft check {_TREES}/listing.rvaft", "variable NewWp in the guard of altered is not bound"),
            Step(
                f"rvaft check {_TREES}/pruned.rvaft",
                before="In the tree the command to move stands before the choice, and nothing is found:",
            ),
            Step(
                f"rvaft emit {_TREES}/pruned.rvaft --to rml --semantics strict -o $OUT/listing.rml",
                before="What the Listing is to say, in RML (`listing.rml`), means what the tree means:",
            ),
            Step(
                f"rvaft cross-check {_TREES}/pruned.rvaft --against $OUT/listing.rml --semantics strict | "
                "tail -n 1 | sed 's/.*; //'",
                "no disagreement",
            ),
        ),
    ),
    Finding(
        "The published compiler rejects the Listing as printed",
        "In print the variables of event types begin with capitals, some strings stand without quotes "
        "(topics have them) and guards are joined "
        "by `and`. In RML variables are written in lower case, every string in quotes, and guards join by "
        "`&&`. `in_print.rml` is a small text in the manner of "
        "the Listing, since the Listing itself is its authors'.",
        (
            Step(
                _COMPILE.format(f"{_TEXTS}/in_print.rml", "$OUT/printed.pl") + " && wc -c < $OUT/printed.pl",
                "no viable alternative at input 'go(Place'\n0",
                COMPILER,
            ),
            Step(
                f"rvaft cross-check {_TREES}/pruned.rvaft --against {_TEXTS}/in_print.rml",
                "unexpected '('",
                before="The reader of rvaft, on the same text:",
            ),
            Step(
                f"rvaft emit {_TREES}/pruned.rvaft --to rml --semantics strict -o $OUT/listing.rml",
                needs=COMPILER,
                before="The one that `make paper` writes:",
            ),
            Step(_COMPILE.format("$OUT/listing.rml", "$OUT/listing.pl"), needs=COMPILER),
        ),
        asked="Whether the published compiler takes the Listing as printed",
        seen="The compiler stops at the first variable, as it does on the Listing itself. It complains on "
        "standard error, writes nothing, "
        "and ends with exit status 0. The one that `make paper` writes compiles without a word.",
    ),
    Finding(
        "The event types of the Listing match no event of the tables, and do not tell an inspection from a move",
        "Topics of the Listing have no leading slash, those of the tables have one. And `move` and "
        "`inspect` are the same event type "
        "there, as the name of the command is not in them: with the slashes taken away, a second command "
        "to the same waypoint passes "
        "for the inspection.",
        (
            Step(
                f"rvaft monitor {_TEXTS}/listing_types.rvaft {_TRACES}/table2_row1.jsonl",
                "near miss: 3 events would be move but for the field topic",
            ),
            Step(
                f'sed \'s|"/|"|; s/"inspect"/"move"/\' {_TRACES}/table2_row1.jsonl'
                f" | rvaft monitor {_TEXTS}/listing_types.rvaft | head -n 4",
                "event 4: true",
            ),
        ),
    ),
    Finding(
        "Table 3 prints ⊥ for φ too early",
        "In traces 1 and 2 the print has ⊥ for φ after the fourth event. φ₁ (φ₂) is lost there: the "
        "command to move came in time. "
        "But φ₃ (φ₄) is not: its goal may still come. One more event and the attack is there.",
        (
            Step(f"rvaft monitor {_TREES}/pruned.rvaft {_TRACES}/table3_row1.jsonl", "verdict unknown after 4 events"),
            Step(
                f"""(cat {_TRACES}/table3_row1.jsonl; echo '{{"topic": "/move_base/goal", "goal": 2, "time": 20.0}}')"""
                f" | rvaft monitor {_TREES}/pruned.rvaft",
                "event 5: true",
            ),
        ),
    ),
    Finding(
        "The third and fourth trace of both tables lack an event",
        "The print goes from the radiation reading to the goal. φ₃ and φ₄ need the command to move between "
        "the two, as it binds the "
        "waypoint that the goal is compared with. As printed, no branch can be completed: the ⊤ of Table 2 "
        "cannot come, and the ⊥ of "
        "Table 3 comes whatever the goal is. With a move to waypoint 1 between the two the printed verdicts follow.",
        (
            Step(f"rvaft monitor {_TREES}/pruned.rvaft {_TRACES}/table2_row3_as_printed.jsonl", "event 4: false"),
            Step(f"rvaft monitor {_TREES}/pruned.rvaft {_TRACES}/table2_row3.jsonl | head -n 2", "event 5: true"),
            Step(
                f"grep -v '\"waypoint\": 1' {_TRACES}/table2_row4.jsonl | rvaft monitor {_TREES}/pruned.rvaft",
                "event 4: false",
            ),
            Step(f"rvaft monitor {_TREES}/pruned.rvaft {_TRACES}/table2_row4.jsonl | head -n 2", "event 5: true"),
        ),
    ),
    Finding(
        "φ₁ ∨ φ₃ in RML misses the attack",
        "RML is monitored deterministically: a union commits to its left operand as long as that can take "
        "the event. φ₁ and φ₃ start "
        "alike, so φ₁ takes the reading and what precedes it; a command to move that comes in time is then "
        "no part of it, and φ₃ is no "
        "longer there. The union of the branches as it stands rejects the attack of Table 2; the "
        "translation of rvaft finds it.",
        (
            Step(
                f"rvaft monitor {_TREES}/pruned.rvaft {_TRACES}/table2_row3.jsonl --backend rml-paper | head -n 1",
                "event 4: false",
            ),
            Step(
                f"rvaft monitor {_TREES}/pruned.rvaft {_TRACES}/table2_row3.jsonl --backend rml | head -n 1",
                "event 5: true",
            ),
            Step(
                f"rvaft cross-check {_TREES}/pruned.rvaft --semantics projected --backends rml-paper | head -n 1",
                "rml-paper differs from reference",
            ),
            *_published(f"{_TREES}/pruned.rvaft", "projected", "union", trace=f"{_TRACES}/table2_row3.jsonl"),
        ),
    ),
    Finding(
        "The unrolled VOT loses interleavings of compound children",
        "For two of {a then d, b, c} the events a b d suffice. The unrolling of section 3.2 takes a child "
        "as a whole before it "
        "looks for the next, so b may not come between a and d.",
        (
            Step(
                f'rvaft monitor {_TEXTS}/vot_over_compound.rvaft --word "a b d" --semantics strict | head -n 1',
                "event 3: true",
            ),
            Step(
                f'rvaft monitor {_TEXTS}/vot_over_compound.rvaft --word "a b d" --semantics strict --backend rml-paper'
                " | head -n 1",
                "event 2: false",
            ),
            Step(
                f"rvaft cross-check {_TEXTS}/vot_over_compound.rvaft --semantics strict --backends "
                "rml-paper | sed '/^$/,$d'",
                "rml-paper differs from reference",
            ),
            *_published(f"{_TEXTS}/vot_over_compound.rvaft", "strict", "compound", words="a b d"),
        ),
    ),
    Finding(
        "The unrolled VOT means exactly K where something follows it",
        "The text of section 3.2 says at least k. Two of {a, b, c} and then d is there in a b c d; the "
        "unrolling counts down to "
        "zero and then wants d, so a third child ends it.",
        (
            Step(
                f'rvaft monitor {_TEXTS}/vot_followed.rvaft --word "a b c d" --semantics strict | head -n 1',
                "event 4: true",
            ),
            Step(
                f'rvaft monitor {_TEXTS}/vot_followed.rvaft --word "a b c d" --semantics strict --backend rml-paper'
                " | head -n 1",
                "event 3: false",
            ),
            Step(
                f"rvaft cross-check {_TEXTS}/vot_followed.rvaft --semantics strict --backends rml-paper | "
                "sed '/^$/,$d'",
                "rml-paper differs from reference",
            ),
            *_published(f"{_TEXTS}/vot_followed.rvaft", "strict", "followed", words="a b c d"),
        ),
    ),
    Finding(
        "The published monitor takes a goal 1.0 after a command to waypoint 1 for an attack",
        "By value, as in JSON, 1 and 1.0 are equal. The trace is the third of Table 3, where nothing was "
        "altered; rvaft's monitor, asked first, raises no alarm.",
        (
            Step(
                f'sed \'s/"goal": 1,/"goal": 1.0,/\' {_TRACES}/table3_row3.jsonl'
                f" | rvaft monitor {_TREES}/pruned.rvaft | head -n 1",
                "event 5: false",
            ),
            Step(
                f'sed \'s/"goal": 1,/"goal": 1.0,/\' {_TRACES}/table3_row3.jsonl > $OUT/decimal.jsonl',
                needs=MONITOR,
                before="And by the published monitor, with a faithful text, the trace with 1.0 and then "
                "the one with 1:",
            ),
            Step(f"rvaft emit {_TREES}/pruned.rvaft --to rml-prolog -o $OUT/faithful.pl", needs=MONITOR),
            Step(_RUN.format("$OUT/faithful.pl", "$OUT/decimal.jsonl"), _ACCEPTED, MONITOR),
            Step(_RUN.format("$OUT/faithful.pl", f"{_TRACES}/table3_row3.jsonl"), _REJECTED, MONITOR),
        ),
        asked="Whether the published monitor takes a goal 1.0 after a command to waypoint 1 for an attack",
        seen="The published monitor tells 1 from 1.0: it takes the trace with 1.0 for an attack. So a "
        "planner that writes its goals as decimals "
        "looks like an attacker.",
    ),
    Finding(
        "About the tool, not the paper: all participants agree on every cell of Tables 2 and 3",
        "The reference, the engine and the texts of all faithful backends, each run by the reader of its "
        "own language, are asked for "
        "a verdict after every event of the completed traces. Those of the engine are the cells of the "
        "generated tables.",
        (Step("python -m papers.fmas2022.verdict_table", " agree"),),
        asked="Whether all participants agree on the cells of Tables 2 and 3",
    ),
)
