"""What every test has: Ctrl-C, and the command line in this process."""

import signal
import sys
from pathlib import Path

import pytest
from commands import Command, Done

if signal.getsignal(signal.SIGINT) is signal.SIG_IGN:  # as nohup and a script's & leave it, to all that the tests start
    signal.signal(signal.SIGINT, signal.default_int_handler)


@pytest.fixture
def command(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str]) -> Command:
    """Runs the command line in this process, in a folder of its own."""
    from navbench.cli import main as cli

    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(sys, "path", list(sys.path))
    monkeypatch.setenv("HYDRA_FULL_ERROR", "0")

    def run(*words: str) -> Done:
        for name in ("mine", "compiled_mine"):  # of the folder before
            sys.modules.pop(name, None)
        monkeypatch.setattr(sys, "argv", ["navbench", *words])
        with pytest.raises(SystemExit) as end:
            cli.main()
        out, err = capfd.readouterr()
        return Done(int(end.value.code or 0), out, err)

    return run
