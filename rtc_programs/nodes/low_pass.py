"""A force without its tremor, and how large it is."""

import math

import numpy as np

from engines.nodes import Case, Input, Node, Output, Param


class LowPass(Node):
    """First-order low pass of a wrench, whatever the time between its samples; tells the smoothed force's size, too."""

    wrench = Input("wrench", "as a sensor measures it")
    time = Input("number", "when it was measured", unit="s")
    smooth = Output("wrench")
    force = Output("number", "size of the smoothed force", unit="N")
    cutoff = Param(2.0, "frequency above which it is damped", unit="Hz", low=1e-3, high=1e3)

    cases = [
        Case(
            name="begins where the first sample is",
            inputs=[{"wrench": [3, 4, 0, 0, 0, 1], "time": 0.0}],
            outputs={"smooth": [3, 4, 0, 0, 0, 1], "force": 5.0},
        ),
        Case(
            name="after one time constant a step is there by 1 - 1/e",
            params={"cutoff": 1.0 / (2.0 * math.pi)},
            inputs=[{"wrench": [0] * 6, "time": 0.0}, {"wrench": [10, 0, 0, 0, 0, 0], "time": 1.0}],
            outputs={"force": 10.0 * (1.0 - math.exp(-1.0))},
        ),
        Case(
            name="a clock that goes back begins anew",
            inputs=[{"wrench": [8, 0, 0, 0, 0, 0], "time": 5.0}, {"wrench": [2, 0, 0, 0, 0, 0], "time": 1.0}],
            outputs={"force": 2.0},
        ),
    ]

    def start(self) -> None:
        self._before: float | None = None
        self._state = np.zeros(6)

    def step(self) -> None:
        elapsed = -1.0 if self._before is None else self.time - self._before
        kept = math.exp(-2.0 * math.pi * self.cutoff * elapsed) if elapsed >= 0.0 else 0.0
        self._state = kept * self._state + (1.0 - kept) * self.wrench
        self._before = self.time
        self.smooth, self.force = self._state, float(np.linalg.norm(self._state[:3]))
