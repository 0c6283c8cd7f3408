"""The gate's side of the supervisor of the robot's service: a packet there, a packet back, at a socket of its own."""

from __future__ import annotations

import asyncio
import socket

from handrail.link.backend import Gone
from handrail.runtime import Runtime

_LARGEST_ANSWER = 256 * 1024


async def ask_supervisor(runtime: Runtime, encoded: bytes, timeout_s: float) -> bytes:
    """The supervisor's answer (MessagePack) to a call (MessagePack). Raises Gone."""
    loop = asyncio.get_running_loop()
    with socket.socket(socket.AF_UNIX, socket.SOCK_SEQPACKET | socket.SOCK_NONBLOCK) as asking:
        try:
            async with asyncio.timeout(timeout_s):
                await loop.sock_connect(asking, str(runtime.service))
                await loop.sock_sendall(asking, encoded)
                answer = await loop.sock_recv(asking, _LARGEST_ANSWER)
        except TimeoutError:
            raise Gone(
                f"the supervisor (handrail up) did not answer in {timeout_s:g} s; the call may still be carried out"
            ) from None
        except OSError as error:
            raise Gone(
                f"the processes were not started by handrail up, or it is gone ({error.strerror}); nothing was done"
            ) from error
    if not answer:
        raise Gone("the supervisor (handrail up) ended before it answered")
    return answer
