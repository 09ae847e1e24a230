"""``python -m navbench`` is the command line."""

from navbench.cli.main import main

main()
