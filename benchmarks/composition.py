"""Time the composition of studies: from their files to cells that can be run.

Run ``python benchmarks/composition.py [STUDY ...]``, without a name for ``papers``. Times are of the processor, without
imports.
"""

import sys
import time

from navbench.cli.study_configuration import compose_study


def main() -> None:
    """Print a line for each study."""
    for name in sys.argv[1:] or ["papers"]:
        start = time.process_time()
        study = compose_study(name)
        print(
            f"{name}: {len(study.cells)} cells and {len(study.tunings)} tunings in {time.process_time() - start:.1f} s"
        )


if __name__ == "__main__":
    main()
