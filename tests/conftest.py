"""What all tests share."""

import signal


def pytest_configure() -> None:
    """Signals as in a terminal: whoever started the tests may ignore or block them (nohup, a
    service), child processes inherit that, and tests of interruption would wait in vain."""
    signal.signal(signal.SIGINT, signal.default_int_handler)
    signal.pthread_sigmask(signal.SIG_SETMASK, ())
