"""What every test has: Ctrl-C, and the command line in this process."""

import signal
import sys
from collections.abc import Iterator, Sequence
from pathlib import Path

import pytest
from commands import Command, Done

if signal.getsignal(signal.SIGINT) is signal.SIG_IGN:  # as nohup and a script's & leave it, to all that the tests start
    signal.signal(signal.SIGINT, signal.default_int_handler)


@pytest.fixture(autouse=True)
def _heeded() -> Iterator[None]:
    """Heeds Ctrl-C again, which a command that has ended in this process ignores."""
    before = signal.getsignal(signal.SIGINT)
    yield
    signal.signal(signal.SIGINT, before)


@pytest.fixture
def command(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str]) -> Command:
    """Runs the command line in this process, in a folder of its own, and without workers unless the words name them."""
    from navbench.cli import main as cli

    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(sys, "path", list(sys.path))
    monkeypatch.setenv("HYDRA_FULL_ERROR", "0")

    def run(*words: str) -> Done:
        for name in ("mine", "compiled_mine"):  # of the folder before
            sys.modules.pop(name, None)
        told = ["workers=0"] if _starts_workers(words) else []
        monkeypatch.setattr(sys, "argv", ["navbench", *words[:1], *told, *words[1:]])
        with pytest.raises(SystemExit) as end:
            cli.main()
        out, err = capfd.readouterr()
        return Done(int(end.value.code or 0), out, err)

    return run


def _starts_workers(words: Sequence[str]) -> bool:
    """Return whether words run episodes, and leave it open where."""
    told = {word.split("=")[0] for word in words}
    runs = bool(words) and (words[0].startswith("controller=") or words[0] in ("-m", "study", "tune", "multiverse"))
    return runs and not told & {"workers", "engine", "--help", "--cfg"}
