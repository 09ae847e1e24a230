"""What every test has: compiled functions of this very source, Ctrl-C, and the command line in this process.

numba's cache of a function notices changes of its own file only, not of the files whose functions it has inlined: so
the cache's folder is named by all of them.
"""

import hashlib
import os
import signal
import sys
from pathlib import Path

import pytest
from commands import Command, Done

ROOT = Path(__file__).parents[1]
SOURCES = sorted([*(ROOT / "navbench").rglob("*.py"), *(ROOT / "controllers").rglob("*.py")])
DIGEST = hashlib.sha256(b"".join(path.read_bytes() for path in SOURCES)).hexdigest()[:12]

if signal.getsignal(signal.SIGINT) is signal.SIG_IGN:  # as nohup and a script's & leave it, to all that the tests start
    signal.signal(signal.SIGINT, signal.default_int_handler)
os.environ["NUMBA_CACHE_DIR"] = str(ROOT / ".pytest_cache" / f"numba-{DIGEST}")


@pytest.fixture
def command(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str]) -> Command:
    """Runs the command line in this process, in a folder of its own."""
    from navbench.cli import main as cli

    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(sys, "path", list(sys.path))
    monkeypatch.setenv("HYDRA_FULL_ERROR", "0")

    def run(*words: str) -> Done:
        sys.modules.pop("mine", None)
        monkeypatch.setattr(sys, "argv", ["navbench", *words])
        with pytest.raises(SystemExit) as end:
            cli.main()
        out, err = capfd.readouterr()
        return Done(int(end.value.code or 0), out, err)

    return run
