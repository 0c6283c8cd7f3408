"""The judge's eyes: the plant's ground truth, heard on its own topic, which nothing of the robot reads."""

from __future__ import annotations

import threading

from handrail.demo.verdict import Truth
from handrail.messages import GroundTruth
from handrail.runtime import Runtime
from handrail.topics import Subscriber

_NS = 1e-9


class Judge:
    """Keeps what the plant says of one object, from when it is made until it is closed."""

    def __init__(self, runtime: Runtime, object_name: str):
        self._object = object_name
        self._changed = threading.Condition()
        self._samples: list[Truth] = []
        self._latest: GroundTruth | None = None
        self._closing = False
        self._subscriber = Subscriber(runtime.endpoint("plant.truth"), GroundTruth)
        self._thread = threading.Thread(target=self._listen, name="judge", daemon=True)
        self._thread.start()

    def _listen(self) -> None:
        while not self._closing:
            truth = self._subscriber.receive(0.2)
            if truth is None or self._object not in truth.hinges:
                continue
            name = self._object
            sample = Truth(
                truth.time_ns * _NS, truth.hinges[name], truth.contact_force[name], truth.peak_contact_force[name]
            )
            with self._changed:
                self._samples.append(sample)
                self._latest = truth
                self._changed.notify_all()
        self._subscriber.close()

    @property
    def samples(self) -> list[Truth]:
        """All so far, in order of time."""
        with self._changed:
            return list(self._samples)

    @property
    def latest(self) -> Truth | None:
        with self._changed:
            return self._samples[-1] if self._samples else None

    def snapshot(self, timeout_s: float) -> GroundTruth | None:
        """The next truth that comes, whole; the last one if none comes in time."""
        with self._changed:
            heard = len(self._samples)
            self._changed.wait_for(lambda: len(self._samples) > heard, timeout_s)
            return self._latest

    def wait_until(self, time_s: float, timeout_s: float) -> bool:
        """Wait until the plant's time is `time_s`, at most `timeout_s` of ours."""
        with self._changed:
            return self._changed.wait_for(lambda: bool(self._samples) and self._samples[-1].time_s >= time_s, timeout_s)

    def close(self) -> None:
        self._closing = True
        self._thread.join()
