"""Ctrl-C is heard whenever it is pressed, and how a command ended stands when it has."""

import signal
import threading
import time
import weakref

import pytest
from commands import Command
from hydra.errors import ConfigCompositionException

from navbench.cli.interrupts import Interrupts, is_of_interrupt


@pytest.fixture(autouse=True)
def _default() -> None:
    signal.signal(signal.SIGINT, signal.default_int_handler)


class Thing:
    pass


def press(*_: object) -> None:
    signal.raise_signal(signal.SIGINT)


def wait() -> None:
    for _ in range(100):
        time.sleep(0.1)


@pytest.mark.filterwarnings("ignore::pytest.PytestUnraisableExceptionWarning")
def test_an_interrupt_that_gets_lost_in_a_callback_is_raised_again() -> None:
    with Interrupts():
        thing = Thing()
        watched = weakref.ref(thing, press)
        del thing  # where Python prints what is raised, and goes on
        assert watched() is None
        with pytest.raises(KeyboardInterrupt):
            wait()


def test_an_interrupt_that_is_dealt_with_is_not_raised_again() -> None:
    with Interrupts():
        try:
            press()
        except KeyboardInterrupt:
            time.sleep(1.2)
            try:
                raise ValueError
            except ValueError:  # because of it
                time.sleep(1.2)
        try:
            press()
        except KeyboardInterrupt:
            try:
                time.sleep(1.2)
            finally:
                time.sleep(1.2)


def test_what_is_waited_for_does_not_hold_up_a_lost_interrupt() -> None:
    with Interrupts():
        try:
            press()
        except KeyboardInterrupt:
            pass  # as a library does
        with pytest.raises(KeyboardInterrupt):
            threading.Event().wait(10.0)


def test_when_the_command_has_ended_there_is_nothing_to_interrupt() -> None:
    with Interrupts():
        pass
    press()
    assert signal.getsignal(signal.SIGINT) is signal.SIG_IGN


@pytest.mark.parametrize("hosts", [signal.SIG_IGN, lambda *_: None], ids=["ignored", "a host's own"])
def test_how_others_deal_with_it_stays(hosts: signal.Handlers) -> None:
    signal.signal(signal.SIGINT, hosts)
    with Interrupts():
        press()
    assert signal.getsignal(signal.SIGINT) is hosts


def test_what_a_library_raises_because_of_an_interrupt_is_one(
    command: Command, monkeypatch: pytest.MonkeyPatch
) -> None:
    def compose(_: object) -> None:
        try:
            raise KeyboardInterrupt
        finally:
            raise ConfigCompositionException("'NoneType' object has no attribute '_invalidate_flags_cache'")

    monkeypatch.setattr("navbench.cli.report.report", compose)
    done = command("report", "here")
    assert (done.code, done.err) == (130, "navbench: interrupted\n")


@pytest.mark.parametrize("interrupted", [False, True])
def test_a_chain_of_errors_that_leads_back_into_itself_comes_to_an_end(interrupted: bool) -> None:
    first, second = RuntimeError(), OSError()
    first.__cause__, second.__context__ = second, KeyboardInterrupt() if interrupted else first
    assert is_of_interrupt(first) is interrupted
