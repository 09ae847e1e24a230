"""``python -m navbench`` is the command line."""

import os
import sys

if sys.path[:1] == [os.getcwd()]:  # which python -m puts there: libraries would import what lies there by chance
    del sys.path[0]

from navbench.cli.main import main  # noqa: E402

main()
