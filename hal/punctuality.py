"""Which replies are late: not by the clock, but by what their channel usually does.

Where the way to the drives and back takes longer than what is left of a cycle, every reply answers the command before: that is how
such a channel works, and nothing to count. A drive that falls behind the others of its channel, or a cycle in which all do, is.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import numpy.typing as npt

from handrail.compiled import compiled

SETTLES_AFTER = 50
"""cycles in which a channel's promptest drive is as late each time, after which that is how the channel works"""


class Punctuality:
    """What is usual on each channel, learned from the ages of the drives' replies."""

    def __init__(self, channel: Sequence[int], channels: int, lost_after: int):
        """`channel`: of each joint (n,), 0 … `channels` − 1; drives whose reply is older than `lost_after` cycles don't count."""
        self._channel, self._lost_after = np.array(channel, np.int64), lost_after
        self._usual = np.zeros((4, channels), np.int64)
        self.behind = False
        """some age was not 0 when it was last looked"""
        self.late(np.zeros(len(self._channel), np.int64), True)

    @property
    def usual(self) -> npt.NDArray[np.int64]:
        """(channels,) cycles between a command and the cycle in which its channel's replies usually are there."""
        return self._usual[0]

    def late(self, age: npt.NDArray[np.int64], behind: bool) -> int:
        """How many of this cycle's replies, whose ages are (n,) cycles, are later than usual.

        `behind`: some age is not 0. Call once in each cycle in which it is, or was in the one before.
        """
        if not behind and not self.behind:
            return 0
        self.behind = behind
        return int(_late(age, self._channel, self._usual, self._lost_after))


@compiled
def _late(age, channel, usual, lost_after):  # type: ignore[no-untyped-def]
    """`usual`: rows of what is usual, what the promptest drive was last, for how many cycles, and what it is now."""
    now = usual[3]
    now[:] = lost_after + 1
    for j in range(age.shape[0]):
        now[channel[j]] = min(now[channel[j]], age[j])
    for c in range(now.shape[0]):
        if now[c] != usual[1, c]:
            usual[1, c], usual[2, c] = now[c], 0
        usual[2, c] += 1
        if now[c] < usual[0, c] or (now[c] <= lost_after and usual[2, c] >= SETTLES_AFTER):
            usual[0, c] = now[c]
    late = 0
    for j in range(age.shape[0]):
        late += usual[0, channel[j]] < age[j] <= lost_after
    return late
