"""What counts as turned: a pure function of what the plant's ground truth showed.

The hinge's signed angle is read 1 s (simulated) after the tool last touched the valve, against the angle when the program began. A
valve that is still touched then was not released, and a release that is not followed by a second without contact is none.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Sequence
from dataclasses import dataclass

NEEDED_DEG = 270.0
FORCE_LIMIT_N = 100.0
SETTLE_S = 1.0
"""simulated, from the last release to the reading"""
NEEDED_SHARE = 0.95
"""of several seeds"""


@dataclass(frozen=True)
class Truth:
    """The valve at one moment of the plant's time."""

    time_s: float
    angle: float
    """rad, the hinge's signed angle"""
    force: float
    """N, between the robot and the valve, now"""
    peak_force: float
    """N, the largest so far"""


@dataclass(frozen=True)
class Verdict:
    """What the judge says of one run."""

    turned_deg: float
    peak_force_n: float
    touched: bool
    success: bool
    problems: tuple[str, ...]
    """why it is no success, for people"""


def judge(samples: Sequence[Truth], started_s: float, program: str) -> Verdict:
    """Judge a run by its samples in order of time; `started_s`: plant's time when the program began; `program`: its last status.

    Without samples, or when the plant began anew in between, nothing is proven: no success.
    """
    before = [sample for sample in samples if sample.time_s <= started_s] or list(samples[:1])
    after = [sample for sample in samples if sample.time_s > started_s]
    if not before or not after:
        return Verdict(0.0, 0.0, False, False, ("the plant's ground truth was not heard",))

    if any(later.time_s < earlier.time_s for earlier, later in itertools.pairwise(samples)):
        return Verdict(0.0, max(sample.peak_force for sample in samples), False, False, ("the plant was restarted",))
    problems = [] if program == "succeeded" else [f"the program ended as {program or 'nothing'}, not as succeeded"]
    touching = [sample.time_s for sample in after if sample.force > 0]
    reading_s = (touching[-1] if touching else after[0].time_s) + SETTLE_S
    reading = next((sample for sample in after if sample.time_s >= reading_s), None)
    if reading is None:
        problems.append(f"the valve was not let go for {SETTLE_S:g} s before the end")
        reading = after[-1]
    turned = math.degrees(reading.angle - before[-1].angle)
    peak = max(sample.peak_force for sample in samples)
    if turned < NEEDED_DEG:
        problems.append(f"turned {turned:.0f}°, expected at least {NEEDED_DEG:g}°")
    if peak > FORCE_LIMIT_N:
        problems.append(f"pressed with {peak:.0f} N, expected at most {FORCE_LIMIT_N:g} N")
    return Verdict(turned, peak, bool(touching), not problems, tuple(problems))


def enough(successes: int, runs: int) -> bool:
    """Whether so many successes of so many runs are enough (one run: it; twenty: nineteen)."""
    return runs > 0 and successes >= math.ceil(NEEDED_SHARE * runs - 1e-9)
