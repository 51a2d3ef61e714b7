"""`rvaft serve`: an oracle for ROSMonitoring."""

import asyncio
import signal
import sys

import click

from rvaft.api import narrowed
from rvaft.cli.options import exclusive, part_options, semantics_option, tree_argument
from rvaft.language import load
from rvaft.monitoring.columns import Per
from rvaft.printable import visible
from rvaft.serving.origins import origin as origin_of
from rvaft.serving.protocol import MAX_MESSAGE, Polarity, Protocol, Vocabulary, protocol
from rvaft.serving.server import LOCAL, PORT, Address, serve
from rvaft.serving.session import Session, session

_MEBIBYTE = 1024 * 1024


@click.command("serve")
@tree_argument
@click.option("--host", default=LOCAL, show_default=True, metavar="HOST", help="Listen at this address.")
@click.option("--port", type=click.IntRange(0, 65535), default=PORT, show_default=True, help="0 is any that is free.")
@click.option("--origin", multiple=True, metavar="URL", help="Let web pages from there in; may be repeated.")
@click.option("--shared", is_flag=True, help="One monitor for all connections instead of one for each.")
@semantics_option
@part_options
@click.option(
    "--per",
    type=click.Choice([choice.value for choice in Per]),
    default=Per.TREE.value,
    show_default=True,
    help="Give also a verdict for each branch or kind.",
)
@click.option(
    "--polarity",
    type=click.Choice([choice.value for choice in Polarity]),
    default=Polarity.PROPERTY.value,
    show_default=True,
    help="Whether true means that the tree can never be detected, or that it is.",
)
@click.option(
    "--vocabulary",
    type=click.Choice([choice.value for choice in Vocabulary]),
    default=Vocabulary.RML.value,
    show_default=True,
    help="Definitive verdicts as JSON booleans (rml) or as strings.",
)
@click.option(
    "--max-message",
    type=click.IntRange(1, 64),
    default=MAX_MESSAGE // _MEBIBYTE,
    show_default=True,
    metavar="MIB",
    help="The longest message, in MiB.",
)
def command(
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
) -> int:
    """Answer the monitors of ROSMonitoring over WebSocket: each message one event, each reply that event and a verdict.

    Runs until it is interrupted or terminated; the exit status is then 0, whatever was detected.
    """
    exclusive(branch=branch, kind=kind, per=None if per == Per.TREE else per)
    address = Address(host, port, tuple(map(origin_of, origin)))
    part = narrowed(load(tree), branch, kind)
    speaking = protocol(
        part, polarity=Polarity(polarity), vocabulary=Vocabulary(vocabulary), longest=max_message * _MEBIBYTE
    )
    first = session(part, semantics, per=Per(per))
    asyncio.run(_serve(speaking, first, address, shared=shared))
    return 0


async def _serve(speaking: Protocol, first: Session, address: Address, *, shared: bool) -> None:
    """Serve until a signal says to stop."""
    stop = asyncio.Event()
    loop = asyncio.get_running_loop()
    for number in (signal.SIGINT, signal.SIGTERM):
        loop.add_signal_handler(number, stop.set)
    fresh = (lambda: first) if shared else first.fork
    await serve(speaking, fresh, stop, address=address, listening=_announce)


def _announce(url: str) -> None:
    sys.stdout.write(f"{visible(f'listening at {url}')}\n")
    sys.stdout.flush()
