"""`rvaft rosmonitoring`: monitors of ROS topics for a tree."""

import asyncio
import os
import signal
from collections.abc import Callable
from contextlib import suppress
from enum import StrEnum
from pathlib import Path
from typing import Any, Final, TypeVar

import click

from rvaft.api import load, narrowed
from rvaft.cli.options import exclusive, part_options, semantics_option, tree_argument
from rvaft.errors import NotExpressible, OptionError, TooLarge
from rvaft.model.nodes import Kind
from rvaft.model.verdict import Semantics
from rvaft.monitoring.monitor_set import Per
from rvaft.ros.addresses import origin as origin_of
from rvaft.ros.configuration import (
    SUFFIXES,
    Action,
    NoConfiguration,
    Oracle,
    RosOptions,
    RosVersion,
    commands_text,
    configuration,
    leftover,
    planned,
    specifications,
    stated_ids,
    yaml_text,
)
from rvaft.ros.protocol import MAX_MESSAGE, Polarity, Protocol, Session, Vocabulary, protocol, session
from rvaft.ros.server import CONNECTIONS, LOCAL, PORT, Address, serve
from rvaft.support.files import place
from rvaft.support.terminal import visible

Command = TypeVar("Command", bound=Callable[..., Any])


def _choice(name: str, kind: type[StrEnum], text: str, default: StrEnum | None = None) -> Callable[[Command], Command]:
    """An option whose value is one of an enumeration."""
    words = click.Choice([choice.value for choice in kind])
    return click.option(
        name, type=words, default=default and default.value, show_default=default is not None, help=text
    )


CONFIGURATION: Final = "monitors.yaml"
COMMANDS: Final = "run.txt"


@click.command("rosmonitoring")
@tree_argument
@click.option(
    "-o", "--output", metavar="DIR", required=True, help="The folder to write to; made where it is not there."
)
@_choice("--per", Per, "One monitor for the tree, for each branch, or for each kind.", Per.TREE)
@part_options
@semantics_option
@_choice(
    "--action", Action, "Log all topics or filter all; default: filter those with publishers, if there is one monitor."
)
@_choice("--oracle", Oracle, "Who answers the monitors: rvaft serve, or the RML oracle of ROSMonitoring.", Oracle.RVAFT)
@click.option("--host", default=LOCAL, show_default=True, metavar="HOST", help="Where the oracles are.")
@click.option(
    "--port",
    type=click.IntRange(1, 65535),
    default=PORT,
    show_default=True,
    help="That of the first oracle; others follow.",
)
@_choice("--ros-version", RosVersion, "Which ROS the monitors are generated for.", RosVersion.ROS2)
@click.option("--id", "name", metavar="NAME", help="What the monitors are called; default: as the root of the tree.")
@click.option("--force", is_flag=True, help="Replace files that are there already, and remove those of an earlier run.")
def rosmonitoring_command(
    *,
    tree: str,
    output: str,
    per: str,
    branch: int | None,
    kind: str | None,
    semantics: str,
    action: str | None,
    oracle: str,
    host: str,
    port: int,
    ros_version: str,
    name: str | None,
    force: bool,
) -> int:
    """Write a configuration of ROSMonitoring for a tree, its monitors in RML, and the commands that run them, to a folder.

    All files are written or none.
    """
    if output in ("", "-"):
        raise click.UsageError(f"-o names a folder, and '{output}' is none", click.get_current_context())
    exclusive(branch=branch, kind=kind, per=None if per == Per.TREE else per)
    options = RosOptions(
        Semantics(semantics),
        None if action is None else Action(action),
        Oracle(oracle),
        host,
        port,
        RosVersion(ros_version),
    )
    loaded = load(tree)
    if options.oracle is Oracle.RVAFT:
        _check_stays(Path(tree))
    monitors = planned(
        loaded, options, per=Per(per), branch=branch, kind=None if kind is None else Kind(kind), name=name
    )
    files: dict[str, str | None] = {CONFIGURATION: yaml_text(configuration(monitors, options))}
    left_out: list[str] = []
    for monitor in monitors:
        try:
            files.update(specifications(monitor, options.semantics))
        except (NotExpressible, TooLarge) as error:
            names = [f"{monitor.id}{suffix}" for suffix in SUFFIXES.values()]
            left_out.append(f"{' and '.join(names)} left out: {error}")
            if options.oracle is Oracle.RML:
                raise NoConfiguration(f"there is nothing for the RML oracle to load: {left_out[0]}") from error
            files.update(dict.fromkeys(names))
    path = tree if Path(tree).is_absolute() else os.path.relpath(tree, output)
    files[COMMANDS] = commands_text(monitors, options, tree=path, configuration=CONFIGURATION)
    with suppress(OSError, UnicodeDecodeError):  # the specifications of the monitors of an earlier run
        ids = stated_ids((Path(output) / CONFIGURATION).read_text(encoding="utf-8"))
        for gone in leftover(Path(output), ids):
            files.setdefault(gone, None)
    place(Path(output), files, force=force)
    for reason in left_out:
        click.echo(visible(f"rvaft: warning: {reason}"), err=True)
    return 0


def _check_stays(tree: Path) -> None:
    """Refuse a tree that the oracles cannot read again: a stream, or standard input by a name of its own."""
    folder = tree.parent.resolve()
    passing = folder == Path("/dev") or Path("/proc") in (folder, *folder.parents)
    if passing or not tree.is_file():
        raise OptionError(f"{tree}: the oracles read the tree again when they start: give it as a file")


# `rvaft serve`: an oracle for ROSMonitoring.

_MEBIBYTE = 1024 * 1024


@click.command("serve")
@tree_argument
@click.option("--host", default=LOCAL, show_default=True, metavar="HOST", help="Listen at this address.")
@click.option("--port", type=click.IntRange(0, 65535), default=PORT, show_default=True, help="0 is any that is free.")
@click.option("--origin", multiple=True, metavar="URL", help="Let web pages from there in; may be repeated.")
@click.option("--shared", is_flag=True, help="One monitor for all connections instead of one for each.")
@semantics_option
@part_options
@_choice("--per", Per, "Give also a verdict for each branch or kind.", Per.TREE)
@_choice(
    "--polarity", Polarity, "Whether true means that the tree can never be detected, or that it is.", Polarity.PROPERTY
)
@_choice("--vocabulary", Vocabulary, "Definitive verdicts as JSON booleans (rml) or as strings.", Vocabulary.RML)
@click.option(
    "--max-connections",
    type=click.IntRange(1, 100_000),
    default=CONNECTIONS,
    show_default=True,
    metavar="N",
    help="Connections at once.",
)
@click.option("--quiet", is_flag=True, help="Say nothing of connections, refused messages and detections.")
@click.option(
    "--max-message",
    type=click.IntRange(1, 64),
    default=MAX_MESSAGE // _MEBIBYTE,
    show_default=True,
    metavar="MIB",
    help="The longest message, in MiB.",
)
def serve_command(
    *,
    tree: str,
    host: str,
    port: int,
    origin: tuple[str, ...],
    shared: bool,
    semantics: str,
    branch: int | None,
    kind: str | None,
    per: str,
    polarity: str,
    vocabulary: str,
    max_message: int,
    max_connections: int,
    quiet: bool,
) -> int:
    """Answer the monitors of ROSMonitoring over WebSocket: each message one event, each reply that event and a verdict.

    Runs until it is interrupted or terminated; the exit status is then 0, whatever was detected.
    """
    exclusive(branch=branch, kind=kind, per=None if per == Per.TREE else per)
    address = Address(host, port, tuple(map(origin_of, origin)), max_connections)
    part = narrowed(load(tree), branch, kind)
    speaking = protocol(
        part, polarity=Polarity(polarity), vocabulary=Vocabulary(vocabulary), longest=max_message * _MEBIBYTE
    )
    first = session(part, semantics, per=Per(per))
    asyncio.run(_serve(speaking, first if shared else None, first, address, quiet=quiet))
    return 0


async def _serve(speaking: Protocol, shared: Session | None, first: Session, address: Address, *, quiet: bool) -> None:
    """Serve until a signal says to stop."""
    stop = asyncio.Event()
    loop = asyncio.get_running_loop()
    for number in (signal.SIGINT, signal.SIGTERM):
        loop.add_signal_handler(number, stop.set)

    def say(line: str) -> None:
        if not quiet:
            click.echo(visible(f"rvaft: {line}"), err=True)

    def listening(url: str) -> None:
        click.echo(visible(f"listening at {url}"))

    fresh = first.fork if shared is None else lambda: shared
    await serve(speaking, fresh, stop, address=address, listening=listening, say=say)
