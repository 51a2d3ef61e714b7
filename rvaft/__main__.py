"""`python -m rvaft`: the command where no script is installed."""

from rvaft.cli import main

main(prog_name="rvaft")
