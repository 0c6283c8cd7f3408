"""The gate's side of recordings: they are read by a process that lives for one call, and one call at a time."""

from __future__ import annotations

import asyncio
import contextlib
import sys

import msgspec

from handrail.link.backend import Gone
from handrail.messages import GetSamples, ListRecordings


class Archive:
    """Asks `handrail.recordings`."""

    def __init__(self) -> None:
        self._one = asyncio.Lock()

    async def ask(self, call: ListRecordings | GetSamples, timeout_s: float) -> bytes:
        """The answer (MessagePack). Raises Gone."""
        name = type(call).__name__
        async with self._one:
            reading = await asyncio.create_subprocess_exec(
                *(sys.executable, "-m", "handrail.recordings"),
                stdin=asyncio.subprocess.PIPE,
                stdout=asyncio.subprocess.PIPE,
            )
            try:
                async with asyncio.timeout(timeout_s):
                    answer, _ = await reading.communicate(msgspec.msgpack.encode(call))
            except TimeoutError:
                raise Gone(f"{name}: reading took more than {timeout_s:g} s; ask for less at once") from None
            finally:
                if reading.returncode is None:
                    with contextlib.suppress(ProcessLookupError):
                        reading.kill()
                    await reading.wait()
        if reading.returncode or not answer:
            raise Gone(
                f"{name}: reading ended with exit status {reading.returncode}; what it said is in the link's log"
            )
        return answer
