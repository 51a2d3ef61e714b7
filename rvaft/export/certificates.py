"""The program `rvaft-verified`: the monitor and the validator of texts, extracted from `proofs/`.

`make verified` builds it. It reads a tree as JSON, and uses no part of rvaft.
"""

import json
import shutil
import subprocess
import tempfile
from collections.abc import Sequence
from pathlib import Path
from typing import Final

from rvaft.backend import Backend, Specification
from rvaft.core.branches import branch as numbered
from rvaft.core.solver import witness
from rvaft.errors import NotExpressible, TooLarge, ToolFailed, ToolMissing, unwritten
from rvaft.export.tree_json import json_text, pattern_json
from rvaft.model import guards, patterns
from rvaft.model.nodes import Assumption, Kind
from rvaft.model.tree import RVAFT
from rvaft.model.values import Json
from rvaft.model.verdict import Semantics

PROGRAM: Final = "rvaft-verified"
CERTIFIED: Final = "certified: for every trace the text has the verdict of the tree"
IN_ORDER: Final = "certified: for every trace without late events the text has the verdict of the tree"


def on_path() -> Path | None:
    """Return the program if it is on the PATH."""
    found = shutil.which(PROGRAM)
    return None if found is None else Path(found)


def part_options(tree: RVAFT, semantics: Semantics, branch: int | None, kind: Kind | None) -> tuple[RVAFT, list[str]]:
    """Return the whole tree, and the options of the program for a part of it.

    A restricted tree is its whole tree with a branch or kind, because the alphabet is that of the
    whole tree. Raises `NotExpressible` for a part of a part.
    """
    if (part := tree.part_of) is not None:
        if branch is not None or kind is not None:
            raise NotExpressible(unwritten("a part of a part of a tree"))
        tree, branch, kind = part.tree, part.branch, part.kind
    narrowed = [] if branch is None else ["--choose", json.dumps(dict(numbered(tree, branch).choices))]
    return tree, ["--semantics", semantics, *narrowed, *([] if kind is None else ["--kind", kind])]


def run(
    program: Path, tree: RVAFT, options: Sequence[str], *, given: str = "", text: Json = None, timeout: float
) -> tuple[int, list[str], str]:
    """Return the exit status, the lines of output, and the message of an error.

    `given` is the standard input, `text` a formal text to certify. Raises `ToolMissing`,
    `ToolFailed` and `TimeoutExpired`.
    """
    with tempfile.TemporaryDirectory(prefix="rvaft-") as folder:
        (file := Path(folder) / "tree.json").write_text(json_text(tree), encoding="utf-8")
        (other := Path(folder) / "text.json").write_text(json.dumps(text), encoding="utf-8")
        command = [str(program), str(file), *(["--certify", str(other)] if text is not None else []), *options]
        try:
            done = subprocess.run(  # noqa: S603
                command, input=given, capture_output=True, encoding="utf-8", timeout=timeout, check=False
            )
        except OSError:
            remedy = f"{program} cannot be run; build it by `make verified`, which needs Coq and OCaml"
            raise ToolMissing("the verified monitor", remedy=remedy) from None
    if done.returncode not in (0, 1, 2):
        raise ToolFailed("verified", reason=f"exit status {done.returncode}")
    why = done.stderr.strip().replace(f"{file}: ", "").removeprefix(f"{PROGRAM}: ")
    return done.returncode, done.stdout.split("\n")[:-1], why


def certificate(
    tree: RVAFT,
    speaks: Backend,
    specification: Specification,
    semantics: Semantics,
    program: Path | None,
    *,
    branch: int | None = None,
    kind: Kind | None = None,
    limit: int = 1_000_000,
    timeout: float = 120,
) -> tuple[int, str]:
    """Return an exit status, and why.

    It is 0 if the text has the verdict of the tree on every trace; 1 if it differs on a trace, in its
    verdict (RML) or in whether it accepts the trace (LTLf, HOA); 2 if this is not decided.
    """
    if program is None:
        return 2, f"not certified: {PROGRAM} is not on the PATH: build it by `make verified`, or name it by --verified"
    in_order, status = Assumption.ORDER in specification.assumes, 2
    try:
        formal = speaks.formal(specification.text) | {"in_order": in_order, "samples": _samples(tree)}
        tree, options = part_options(tree, semantics, branch, kind)
        status, lines, why = run(program, tree, [*options, "--limit", str(limit)], text=formal, timeout=timeout)
        why = "".join(lines) or why
        if not why or (status == 0) != (why == "certified"):
            status, why = 2, f"{program} is no validator: its output is {why or 'empty'}"
    except (NotExpressible, TooLarge, ToolMissing, ToolFailed) as error:
        why = error.reason if isinstance(error, NotExpressible) else str(error)
    except subprocess.TimeoutExpired:
        why = f"no answer within {timeout:g} s"
    return status, f"not certified: {why}" if status else IN_ORDER if in_order else CERTIFIED


def _samples(tree: RVAFT) -> list[Json]:
    """Return patterns of events that satisfy conditions on the variables of a node."""
    found: dict[str, Json] = {}
    conditions = [node.when for node in tree.top_down() if node.when and not guards.time_points(node.when)]
    for pattern in [own for node in tree.top_down() if (own := tree.pattern(node.name))]:
        alone = [when for when in conditions if {*guards.variables(when)} <= {*patterns.variables(pattern)}]
        for some in (alone, *([when] for when in alone)):
            values = {name: patterns.Literal(value) for name, value in (witness(some) or {}).items()}
            sample: Json = {"pattern": pattern_json(patterns.substitute(pattern, values)), "condition": None}
            found[json.dumps(sample)] = sample
    return list(found.values())
