"""`rvaft new`: a tree to start from, which explains the language in comments."""

from pathlib import Path

import click

from rvaft.cli import options
from rvaft.support.files import deliver

START = Path(__file__).with_name("start.rvaft")


@click.command("new")
@click.argument("file", required=False, metavar="[FILE]")
def new_command(*, file: str | None) -> int:
    """Write a tree to start from, with the language in comments, to FILE or standard output.

    A FILE that exists is not overwritten.
    """
    if file not in (None, "-"):
        options.require_writable([file or ""])
        options.refuse(Path(file or "").exists(), f"{file} exists: name another file")
    deliver(START.read_bytes(), file)
    return 0
