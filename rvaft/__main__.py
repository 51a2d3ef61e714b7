"""`python -m rvaft` runs the command."""

from rvaft.cli import main

main(prog_name="rvaft")
