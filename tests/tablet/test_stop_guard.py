"""STOP is heard while the window's own thread hangs: real clicks of the X server, a process beside the window, a real gate.

The test's thread is the window's: as long as the test does not let Qt work, the window hangs.
"""

from __future__ import annotations

import ctypes
import ctypes.util
from collections.abc import Iterator
from typing import Any

import pytest

from tablet_client.guarding import StopGuard

pytestmark = pytest.mark.window

_F12 = 96  # X's code of that key


class Pointer:
    """A finger that the X server believes in."""

    def __init__(self, screen: str):
        x11, xtst = ctypes.util.find_library("X11"), ctypes.util.find_library("Xtst")
        assert x11 and xtst, "libX11 and libXtst are not installed: make setup installs them"
        self._x11, self._xtst = ctypes.CDLL(x11), ctypes.CDLL(xtst)
        self._x11.XOpenDisplay.restype = ctypes.c_void_p
        self._display = ctypes.c_void_p(self._x11.XOpenDisplay(screen.encode()))
        assert self._display

    def press(self, x: int, y: int) -> None:
        self._xtst.XTestFakeMotionEvent(self._display, -1, x, y, ctypes.c_ulong(0))
        for down in (1, 0):
            self._xtst.XTestFakeButtonEvent(self._display, 1, down, ctypes.c_ulong(0))
        self._x11.XSync(self._display, 0)

    def key(self, code: int) -> None:
        for down in (1, 0):
            self._xtst.XTestFakeKeyEvent(self._display, code, down, ctypes.c_ulong(0))
        self._x11.XSync(self._display, 0)

    def close(self) -> None:
        self._x11.XCloseDisplay(self._display)


@pytest.fixture
def pointer(screen: str) -> Iterator[Pointer]:
    made = Pointer(screen)
    yield made
    made.close()


@pytest.fixture
def guarded(behind: Any, show: Any) -> Iterator[Any]:
    """Makes a window with its guard, which has begun."""
    behind.open_gate()
    shown = show()
    made: list[StopGuard] = []

    def make(silent_s: float) -> tuple[Any, StopGuard]:
        address, keys = f"tcp://127.0.0.1:{behind.port}", behind.folder / "k"
        made.append(StopGuard(shown.window, address, keys, "Ada", silent_s))
        made[0].start()
        shown.until(lambda: made[0].in_corner)
        return shown, made[0]

    yield make
    for guard in made:
        guard.close()


def test_a_touch_of_the_corner_stops_the_robot_while_the_window_hangs(guarded, behind, pointer, wait):
    shown, _ = guarded(600.0)  # the large STOP never comes
    corner = shown.middle("stop")
    at = shown.window.x() + corner.x(), shown.window.y() + corner.y()
    # From here on the window hangs: nothing lets Qt work.
    wait(lambda: pointer.press(*at) or behind.stops)
    assert behind.stops[0] == "STOP Ada, at the tablet"


def test_a_window_that_is_silent_is_covered_by_a_stop_as_large_as_itself_and_uncovered_when_it_lives(
    guarded, behind, pointer, wait
):
    shown, guard = guarded(1.0)
    window = shown.window
    middle = window.x() + window.width() // 2, window.y() + window.height() // 2
    wait(lambda: guard.covered)  # it hangs
    wait(lambda: pointer.press(*middle) or behind.stops)
    assert behind.stops[0] == "STOP Ada, at the tablet, whose window hung"
    shown.until(lambda: not guard.covered)  # it lives


def test_a_key_stops_the_robot_while_the_window_hangs(guarded, behind, pointer, wait):
    _, guard = guarded(1.0)
    wait(lambda: guard.covered)
    wait(lambda: pointer.key(_F12) or behind.stops)
    assert behind.stops[0] == "STOP Ada, at the tablet, whose window hung"


def test_a_guard_that_is_killed_is_started_anew(guarded, monkeypatch):
    shown, guard = guarded(600.0)
    monkeypatch.setattr("tablet_client.guarding._AGAIN_S", 0.0)
    first = guard.process
    first.kill()
    first.wait()
    shown.until(lambda: guard.process is not first)
    guard.close()
    assert guard.process is None
