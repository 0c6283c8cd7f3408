"""What the robot's cameras saw last: the newest cloud of each, as it came."""

from __future__ import annotations

import threading

from handrail.messages import PointCloud
from handrail.runtime import Runtime
from handrail.topics import Subscriber


class Sight:
    """Listens to the cameras in a thread of its own."""

    def __init__(self, runtime: Runtime):
        self._newest: dict[str, PointCloud] = {}
        self._endpoint = runtime.endpoint("sensors.events")
        self._closing = threading.Event()
        self._thread = threading.Thread(target=self._listen, name="cameras", daemon=True)
        self._thread.start()

    def clouds(self) -> list[PointCloud]:
        """One of each camera, packed. Which are too old is for whoever reads them to say."""
        return list(self._newest.values())

    def close(self) -> None:
        """End the thread."""
        self._closing.set()
        self._thread.join(2.0)

    def _listen(self) -> None:
        subscriber = Subscriber(self._endpoint, PointCloud, queue=20)
        try:
            while not self._closing.is_set():
                message = subscriber.receive(0.2)  # the timeout is only there to notice the closing
                if message is not None:
                    self._newest[message.camera] = message
        finally:
            subscriber.close()
