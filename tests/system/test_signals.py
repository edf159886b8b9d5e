"""Signals become exceptions, at once or at the end of a block of `held`, even if other code catches them."""

import signal

import pytest

from ibdata._system.signals import STOPPING, check, held, stoppable, whole_imports
from ibdata.errors import IbdataError, Interrupted


def arrive(number):
    """As when the system hands the signal to another thread: the handler runs, whatever is masked here."""
    signal.getsignal(number)(number, None)


@pytest.fixture(autouse=True)
def _handlers_are_as_before():
    before = [signal.getsignal(number) for number in STOPPING]
    yield
    assert [signal.getsignal(number) for number in STOPPING] == before
    check()  # and nothing is left over, which a public call would meet
    with whole_imports():
        pass


@pytest.mark.parametrize("number", STOPPING)
def test_a_signal_is_a_keyboard_interrupt(number):
    with pytest.raises(Interrupted) as error, stoppable():
        arrive(number)
    assert error.value.exit_code == 128 + number
    assert isinstance(error.value, KeyboardInterrupt)
    assert not isinstance(error.value, IbdataError | Exception)


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


def test_nothing_hides_or_disturbs_a_signal():
    """Neither a second one, nor a library that turns Interrupted into an error of its own."""

    def work():
        with stoppable():
            try:
                arrive(signal.SIGHUP)
            except BaseException:
                assert signal.getsignal(signal.SIGINT) is signal.SIG_IGN
                raise OSError("cannot be written") from None

    with pytest.raises(Interrupted) as error:
        work()
    assert error.value.exit_code == 128 + signal.SIGHUP


def test_a_signal_that_is_ignored_stays_so():
    """As SIGHUP is under nohup."""
    before = signal.signal(signal.SIGHUP, signal.SIG_IGN)
    with stoppable():
        signal.raise_signal(signal.SIGHUP)
    signal.signal(signal.SIGHUP, before)
