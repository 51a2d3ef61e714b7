"""`rvaft rosmonitoring` writes a configuration of ROSMonitoring; `rvaft serve` runs the oracle."""

import asyncio
import os
import signal
from contextlib import suppress
from pathlib import Path
from typing import Any, Final

import click

from rvaft.cli import log_options, options, warn
from rvaft.cli.trees import ONE_BRANCH, about, loaded, tree_files
from rvaft.errors import NotExpressible, OptionError, TooLarge
from rvaft.integrations.ros import configuration as ros
from rvaft.integrations.ros.connections_page import ConnectionsPage, ConnectionsPages
from rvaft.integrations.ros.protocol import MAX_MESSAGE, MessageProtocol, Polarity, Session, Vocabulary
from rvaft.integrations.ros.server import CONNECTIONS, PORT, Server
from rvaft.model.nodes import Kind
from rvaft.model.tree import RVAFT, resolve_semantics
from rvaft.rules.validity import valid_part
from rvaft.stream.monitor_set import Per
from rvaft.support import output as standard
from rvaft.support.files import place
from rvaft.support.network import LOCAL, origin, require_host
from rvaft.support.terminal import visible

CONFIGURATION: Final = "monitors.yaml"
COMMANDS: Final = "run.txt"
_ACTION: Final = "Log or filter all topics; default: filter topics with publishers, if there is one monitor."
_POLARITY: Final = "The meaning of true: the tree can no longer be detected (property), or is detected."
_DEFINITIVE: Final = "Send a final true when no detection is possible any more; this ends monitors that only log."
_TIME: Final = "What the field time of a message has: seconds, as ROSMonitoring writes, or what the tree declares."
_ORACLE: Final = "The oracle of the monitors: rvaft serve, or the RML oracle of ROSMonitoring."


@click.command("rosmonitoring")
@options.tree_argument
@click.option("-o", "--output", metavar="DIR", required=True, help="The output folder; created if missing.")
@options.choice(
    "--per", words=Per, text="One monitor for the tree, for each branch, or for each kind.", default=Per.TREE
)
@options.part_options
@options.semantics_option
@options.choice("--action", words=ros.Action, text=_ACTION)
@options.choice("--oracle", words=ros.Oracle, text=_ORACLE, default=ros.Oracle.RVAFT)
@click.option("--repeat", is_flag=True, help="Restart the monitors of rvaft serve after each detection.")
@click.option("--host", default=LOCAL, show_default=True, metavar="HOST", help="The host of the oracles.")
@options.number(
    "--port",
    most=65535,
    default=PORT,
    metavar="INTEGER RANGE",
    text="The port of the first oracle; others use the next ports.",
)
@options.choice(
    "--ros-version",
    words=ros.RosVersion,
    text="The ROS version of the generated monitors.",
    default=ros.RosVersion.ROS2,
)
@click.option("--id", "name", metavar="NAME", help="The name of the monitors; default: the root of the tree.")
@click.option("--force", is_flag=True, help="Replace existing files, and remove those of an earlier run.")
def rosmonitoring_command(*, tree: str, output: str, force: bool, **how: Any) -> int:
    """Write a ROSMonitoring configuration for a tree to a folder.

    The folder gets the configuration, the monitors in RML, and the commands that run them. On an
    error nothing is written.
    """
    options.refuse(output in ("", "-"), f"-o names a folder: '{output}' is not valid")
    options.refuse(how["repeat"] and how["oracle"] is ros.Oracle.RML, "--repeat is for --oracle rvaft")
    loaded = options.load_tree(tree)
    wanted = ros.RosOptions(**{**how, "semantics": resolve_semantics(loaded, how["semantics"])})
    if wanted.oracle is ros.Oracle.RVAFT:
        folder = Path(tree).parent.resolve()
        passing = folder == Path("/dev") or Path("/proc") in (folder, *folder.parents)
        if passing or not Path(tree).is_file():  # the tree comes from a stream
            raise OptionError(f"{tree}: the oracles read the tree again when they start: give it as a file")
    if ros.needs_conversion(loaded):
        options.refuse(
            wanted.oracle is ros.Oracle.RML,
            "ROSMonitoring writes `time` in seconds, and its RML oracle converts nothing: write `time time as s;`",
        )
        ros.in_seconds(loaded)
    monitors = ros.planned(loaded, wanted)
    files: dict[str, str | None] = {CONFIGURATION: ros.configuration_text(monitors, wanted)}
    left_out: list[str] = []
    for monitor in monitors:
        try:
            files.update(ros.specifications(monitor, wanted.semantics))
        except (NotExpressible, TooLarge) as error:
            names = [f"{monitor.id}{suffix}" for suffix in ros.SUFFIXES.values()]
            left_out.append(f"{' and '.join(names)} left out: {error}")
            if wanted.oracle is ros.Oracle.RML:
                raise ros.NoConfiguration(f"the RML oracle has no specification to load: {left_out[0]}") from error
            files.update(dict.fromkeys(names))
    path = tree if Path(tree).is_absolute() else os.path.relpath(tree, output)
    files[COMMANDS] = ros.commands_text(monitors, wanted, tree=path, configuration=CONFIGURATION)
    with suppress(OSError, UnicodeDecodeError):  # specifications of an earlier run
        for gone in ros.leftover(Path(output), (Path(output) / CONFIGURATION).read_text(encoding="utf-8")):
            files.setdefault(gone, None)
    place(Path(output), files, force=force)
    for reason in left_out:
        warn(reason)
    return 0


_MEBIBYTE: Final = 1024 * 1024


@click.command("serve")
@click.argument("trees", nargs=-1, required=True, metavar="TREE...")
@options.reading_options
@click.option("--host", default=LOCAL, show_default=True, metavar="HOST", help="Listen at this address.")
@options.number("--port", least=0, most=65535, default=PORT, metavar="INTEGER RANGE", text="0 is any free port.")
@click.option("--origin", multiple=True, metavar="URL", help="Accept web pages from this origin; repeatable.")
@click.option("--shared", is_flag=True, help="One monitor for all connections instead of one for each.")
@options.choice("--message-time", "time", words=ros.MessageTime, text=_TIME)
@options.repeat_options
@options.clock_option
@options.semantics_option
@options.part_options
@options.choice("--per", words=Per, text="Also send a verdict for each branch or kind.", default=Per.TREE)
@options.choice("--polarity", words=Polarity, text=_POLARITY, default=Polarity.PROPERTY)
@options.choice(
    "--vocabulary",
    words=Vocabulary,
    text="Definitive verdicts as JSON booleans (rml) or as strings.",
    default=Vocabulary.RML,
)
@click.option("--definitive", is_flag=True, help=_DEFINITIVE)
@log_options.strict_json
@options.number("--max-connections", most=100_000, default=CONNECTIONS, text="Maximum number of connections.")
@click.option("--quiet", is_flag=True, help="Do not report connections, refused messages and detections.")
@options.number(
    "--max-message", most=64, default=MAX_MESSAGE // _MEBIBYTE, metavar="MIB", text="Maximum size of a message in MiB."
)
def serve_command(
    *,
    trees: tuple[str, ...],
    branch: int | None,
    kind: Kind | None,
    time: ros.MessageTime | None,
    per: Per,
    shared: bool,
    quiet: bool,
    **how: Any,
) -> int:
    """Answer ROSMonitoring monitors over WebSocket: each message is an event, each reply adds a
    verdict.

    Of several trees, or all trees of a folder, a reply has what each of them says, and one verdict. Runs until it is
    interrupted or terminated; the exit status is then 0, also after a detection.
    """
    require_host(how["host"])
    origins = tuple(map(origin, how["origin"]))
    wholes = loaded(tree_files(trees))
    many = len(wholes) > 1
    options.refuse(many and branch is not None, ONE_BRANCH)
    words: Any = {name: how[name] for name in ("polarity", "vocabulary", "definitive", "strict_json")}
    protocols, first = dict[str, MessageProtocol](), dict[str, Session]()
    for file, whole in wholes.items():
        name = click.format_filename(file)
        with about(file, many=many):
            part = _part_of(whole, time, branch, kind)
            protocols[name] = MessageProtocol(part, longest=how["max_message"] * _MEBIBYTE, **words)
            again = {option: how[option] for option in ("repeat", "repeat_by", "cooldown")}
            first[name] = Session(part, how["semantics"], per=per, **again)
    options.require_times(how["clock"], wholes.values())

    standard.unblock()

    def say(line: str) -> None:
        if not quiet:
            click.echo(visible(f"rvaft: {line}"), err=True)

    async def until_stopped() -> None:
        stop = asyncio.Event()
        for sign in (signal.SIGINT, signal.SIGTERM):
            asyncio.get_running_loop().add_signal_handler(sign, stop.set)
        listening = lambda url: click.echo(visible(f"listening at {url}"))  # noqa: E731
        fresh = (lambda: first) if shared else (lambda: {name: session.fork() for name, session in first.items()})
        pages = [ConnectionsPage(name, protocols[name].tree, first[name], shared=shared) for name in first]
        where = how["host"], how["port"], origins, how["max_connections"]
        alone = first if shared else None
        server = Server(protocols, fresh, say, *where, ConnectionsPages(pages), how["clock"], alone)
        await server.serve(stop, listening)

    asyncio.run(until_stopped())
    return 0


def _part_of(whole: RVAFT, time: ros.MessageTime | None, branch: int | None, kind: Kind | None) -> RVAFT:
    """Return the part of a tree to monitor, which reads the times of messages."""
    options.refuse(
        time is None and ros.needs_conversion(whole),
        f"the tree reads `time` as {whole.time and whole.time.format}, and ROSMonitoring writes seconds: give "
        "--message-time seconds to convert them, or --message-time declared if clients send what the tree declares",
    )
    return valid_part(ros.in_seconds(whole) if time is ros.MessageTime.SECONDS else whole, branch, kind)
