"""What all tests share."""

import signal

import chromium
import pytest


def pytest_configure() -> None:
    """Signals as in a terminal: whoever started the tests may ignore or block them (nohup, a
    service), child processes inherit that, and tests of interruption would wait in vain."""
    signal.signal(signal.SIGINT, signal.default_int_handler)
    signal.pthread_sigmask(signal.SIG_SETMASK, ())


@pytest.fixture(scope="module")
def browser():
    """A Chromium without a window."""
    playwright = pytest.importorskip("playwright.sync_api", reason="playwright is not installed")
    with playwright.sync_playwright() as started:
        opened = started.chromium.launch(executable_path=chromium.CHROMIUM, args=chromium.ARGUMENTS)
        yield opened
        opened.close()
