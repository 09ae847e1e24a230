"""Compiled functions of this very source, for every test and every process that a test starts.

numba's cache of a function notices changes of its own file only, not of the files whose functions it has inlined: so
the cache's folder is named by all of them.
"""

import hashlib
import os
from pathlib import Path

ROOT = Path(__file__).parents[1]
SOURCES = sorted([*(ROOT / "navbench").rglob("*.py"), *(ROOT / "controllers").rglob("*.py")])
DIGEST = hashlib.sha256(b"".join(path.read_bytes() for path in SOURCES)).hexdigest()[:12]

os.environ["NUMBA_CACHE_DIR"] = str(ROOT / ".pytest_cache" / f"numba-{DIGEST}")
