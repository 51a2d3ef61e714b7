"""`rvaft rosmonitoring`: monitors of ROS topics for a tree."""

import os
from collections.abc import Iterator
from pathlib import Path
from typing import Final

import click

from rvaft.cli.options import exclusive, part_options, semantics_option, tree_argument
from rvaft.errors import OptionError
from rvaft.language import load
from rvaft.model import Kind
from rvaft.monitoring.columns import Per
from rvaft.printable import visible
from rvaft.rosmonitoring.commands import commands_text
from rvaft.rosmonitoring.configuration import configuration, stated_ids, yaml_text
from rvaft.rosmonitoring.folder import place
from rvaft.rosmonitoring.options import Action, NoConfiguration, Options, Oracle, RosVersion
from rvaft.rosmonitoring.planning import Planned, planned
from rvaft.rosmonitoring.specifications import LeftOut, leftover, specifications
from rvaft.serving.server import LOCAL, PORT
from rvaft.verdict import Semantics

CONFIGURATION: Final = "monitors.yaml"
COMMANDS: Final = "run.txt"


@click.command("rosmonitoring")
@tree_argument
@click.option(
    "-o", "--output", metavar="DIR", required=True, help="The folder to write to; made where it is not there."
)
@click.option(
    "--per",
    type=click.Choice([choice.value for choice in Per]),
    default=Per.TREE.value,
    show_default=True,
    help="One monitor for the tree, for each branch, or for each kind.",
)
@part_options
@semantics_option
@click.option(
    "--action",
    type=click.Choice([choice.value for choice in Action]),
    help="Log all topics or filter all; default: filter those with publishers, if there is one monitor.",
)
@click.option(
    "--oracle",
    type=click.Choice([choice.value for choice in Oracle]),
    default=Oracle.RVAFT.value,
    show_default=True,
    help="Who answers the monitors: rvaft serve, or the RML oracle of ROSMonitoring.",
)
@click.option("--host", default=LOCAL, show_default=True, metavar="HOST", help="Where the oracles are.")
@click.option(
    "--port",
    type=click.IntRange(1, 65535),
    default=PORT,
    show_default=True,
    help="That of the first oracle; others follow.",
)
@click.option(
    "--ros-version",
    type=click.Choice([choice.value for choice in RosVersion]),
    default=RosVersion.ROS2.value,
    show_default=True,
    help="Which ROS the monitors are generated for.",
)
@click.option("--id", "name", metavar="NAME", help="What the monitors are called; default: as the root of the tree.")
@click.option("--force", is_flag=True, help="Replace files that are there already, and remove those of an earlier run.")
def command(
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
    options = Options(
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
    left_out: list[LeftOut] = []
    for found in _specifications(monitors, options):
        if isinstance(found, LeftOut):
            left_out.append(found)
            files.update(dict.fromkeys(found.files))
        else:
            files.update([found])
    path = tree if Path(tree).is_absolute() else os.path.relpath(tree, output)
    files[COMMANDS] = commands_text(monitors, options, tree=path, configuration=CONFIGURATION)
    for gone in _earlier(Path(output)):
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


def _earlier(folder: Path) -> list[str]:
    """The specifications in the folder of the monitors that its configuration has."""
    try:
        ids = stated_ids((folder / CONFIGURATION).read_text(encoding="utf-8"))
        return list(leftover(folder, ids))
    except (OSError, UnicodeDecodeError):
        return []


def _specifications(monitors: tuple[Planned, ...], options: Options) -> Iterator[tuple[str, str] | LeftOut]:
    """The files for the RML oracle; where that is the one to be asked, none may be left out."""
    for monitor in monitors:
        for found in specifications(monitor, options.semantics):
            if isinstance(found, LeftOut) and options.oracle is Oracle.RML:
                raise NoConfiguration(f"there is nothing for the RML oracle to load: {found}")
            yield found
