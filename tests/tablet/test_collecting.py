"""Python's garbage, where a window is: an object with a timer of Qt's may go on the window's own thread only."""

from __future__ import annotations

import gc
import threading
from typing import Any


def test_while_a_window_is_open_garbage_is_collected_on_its_thread_alone(show: Any) -> None:
    shown = show()
    where: list[threading.Thread] = []

    def note(phase: str, info: dict[str, int]) -> None:
        if phase == "start":
            where.append(threading.current_thread())

    gc.callbacks.append(note)
    try:
        made = threading.Event()

        def litter() -> None:
            for _ in range(20 * gc.get_threshold()[0]):
                knot: list[Any] = []
                knot.append(knot)
            made.set()

        threading.Thread(target=litter).start()
        shown.until(lambda: made.is_set() and where)
    finally:
        gc.callbacks.remove(note)
    assert set(where) == {threading.main_thread()}
