"""Signals become exceptions, at once or at the end of a block of `held`, even if other code catches them."""

from __future__ import annotations

import signal

import pytest

from ibdata.errors import Interrupted
from ibdata.system.signals import STOPPING, check, held, stoppable


def arrive(number):
    """As when the system hands the signal to another thread: the handler runs, whatever is masked here."""
    signal.getsignal(number)(number, None)


@pytest.fixture(autouse=True)
def _handlers_are_as_before():
    before = [signal.getsignal(number) for number in STOPPING]
    yield
    assert [signal.getsignal(number) for number in STOPPING] == before
    check()  # and nothing is left over


@pytest.mark.parametrize("number", STOPPING)
def test_a_signal_is_an_exception_with_the_exit_code_of_shells(number):
    with pytest.raises(Interrupted) as error, stoppable():
        arrive(number)
    assert error.value.exit_code == 128 + number


@pytest.mark.parametrize("send", [arrive, signal.raise_signal])
def test_a_signal_waits_until_what_is_held_is_done(send):
    done = []

    def work():
        with stoppable():
            with held():
                with held():
                    send(signal.SIGTERM)
                    done.append("inner")
                done.append("outer")
            done.append("after")

    with pytest.raises(Interrupted):
        work()
    assert done == ["inner", "outer"]


def test_a_second_signal_changes_nothing():
    def work():
        with stoppable():
            try:
                arrive(signal.SIGTERM)
            finally:
                assert signal.getsignal(signal.SIGINT) is signal.SIG_IGN

    with pytest.raises(Interrupted) as error:
        work()
    assert error.value.exit_code == 128 + signal.SIGTERM


def test_code_that_takes_the_exception_for_its_own_error_does_not_hide_the_signal():
    def work():
        with stoppable():
            try:
                arrive(signal.SIGHUP)
            except ValueError:
                raise OSError("cannot be written") from None

    with pytest.raises(Interrupted):
        work()


def test_other_errors_stay_as_they_are():
    def work():
        with stoppable():
            raise OSError("full")

    with pytest.raises(OSError, match="full"):
        work()


def test_a_signal_that_arrives_while_handlers_are_installed_leaves_none_of_them(monkeypatch):
    install, installed = signal.signal, []

    def installing(number, handler):
        before = install(number, handler)
        installed.append(number)
        if len(installed) == 1:
            arrive(number)
        return before

    with monkeypatch.context() as late:
        late.setattr(signal, "signal", installing)
        with pytest.raises(Interrupted), stoppable():
            pass
    assert len(installed) == 1 + 2 * len(STOPPING)
