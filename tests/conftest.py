"""What all tests share: the order in which files are run, and signals that are heard."""

from __future__ import annotations

import os
import signal

import pytest

# A shell that runs the tests in the background ignores these, and so would all processes that tests start and end by them.
signal.signal(signal.SIGINT, signal.default_int_handler)
signal.signal(signal.SIGHUP, signal.SIG_DFL)

# What tests run is nobody's experience.
os.environ["HANDRAIL_LEARNED"] = "off"

_LONG = ("hil", "planning", "plant", "robots", "daemon")
"""folders whose files take long, with few tests: xdist would begin them last, and one worker would wait for the other"""


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    items.sort(key=lambda item: _LONG.index(item.path.parts[-2]) if item.path.parts[-2] in _LONG else len(_LONG))
