"""`python -m rvaft.cli`: the command where no script is installed."""

from rvaft.cli import main

main()
