"""When the loop says that it is ready: whoever hears it may enable the robot."""

import pytest

from daemon import loop
from daemon.exchange import Answer, Kind


@pytest.fixture
def run(bench, monkeypatch, capsys):
    """Runs the loop, whose first cycles a drive is silent in; the cycle after which it said that it was ready, 0: never."""

    def run(silent_for: int, cycles: int) -> int:
        ready = []

        def cycle(really=bench.loop.cycle) -> None:
            if "loop ready" in capsys.readouterr().out:
                ready.append(bench.loop.cycles)
            bench.drives.silent[3] = bench.loop.cycles < silent_for
            really()
            bench.loop.ending = bench.loop.cycles >= cycles

        monkeypatch.setattr(bench.loop, "cycle", cycle)
        bench.loop.run()
        assert len(ready) <= 1
        return ready[0] if ready else 0

    return run


def test_the_loop_is_ready_once_every_drive_has_answered_and_can_be_enabled_then(bench, run):
    assert run(silent_for=3, cycles=8) == 5, "what the fourth cycle asks the fifth one hears"
    assert bench.ask(Kind.ENABLE) is Answer.ACCEPTED


def test_the_loop_is_ready_without_a_drive_that_does_not_answer(run, monkeypatch):
    monkeypatch.setattr(loop, "MEETING_S", 0.0)
    assert run(silent_for=20, cycles=8) == 1
