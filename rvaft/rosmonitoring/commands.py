"""What to run: an oracle for each monitor, then ROSMonitoring's generator."""

import shlex
from collections.abc import Iterator, Sequence

from rvaft.rosmonitoring.options import Options, Oracle
from rvaft.rosmonitoring.planning import Planned
from rvaft.serving.hosts import is_address
from rvaft.serving.server import LOCAL
from rvaft.verdict import Semantics


def commands_text(monitors: Sequence[Planned], options: Options, *, tree: str, configuration: str) -> str:
    """The commands, to be run in the folder of the files; `tree` is the path of the tree from there."""
    lines = ["# Run in this folder, each oracle in a terminal of its own."]
    for monitor in monitors:
        rml = options.oracle is Oracle.RML
        lines.append(_rml_oracle(monitor) if rml else shlex.join(_serve(monitor, options, tree)))
    lines.append("# Then the monitors.")
    version = options.ros_version.value
    words = ["rosmonitoring", "generate", configuration, "--ros-version", version, "--output", "generated"]
    return "\n".join([*lines, shlex.join(words)]) + "\n"


def _rml_oracle(monitor: Planned) -> str:
    """ROSMONITORING_HOME is what ROSMonitoring's own instructions call its checkout."""
    script = '"$ROSMONITORING_HOME"/oracle/RMLOracle/prolog/online_monitor.sh'
    return f"{script} {monitor.id}.pl {monitor.port}"


def _serve(monitor: Planned, options: Options, tree: str) -> Iterator[str]:
    yield from ("rvaft", "serve", tree, "--port", str(monitor.port))
    if options.host != LOCAL:
        yield from ("--host", options.host)
        if options.host != "localhost" and not is_address(options.host):
            yield from ("--origin", f"http://{options.host}:{monitor.port}")
    if options.semantics is not Semantics.PROJECTED:
        yield from ("--semantics", options.semantics.value)
    whole = monitor.tree.part_of
    if whole is not None and whole.branch is not None:
        yield from ("--branch", str(whole.branch))
    elif whole is not None and whole.kind is not None:
        yield from ("--kind", whole.kind.value)
