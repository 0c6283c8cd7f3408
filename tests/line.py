"""The line between a client and a robot's link, that a test can cut and mend."""

from __future__ import annotations

import asyncio
import contextlib
import threading

from tests.link.conftest import free_ports


class Line:
    """Carries two ports to two others, until it is cut."""

    def __init__(self, to: int):
        self.port, self._to = free_ports(), to
        self._loop = asyncio.new_event_loop()
        self._open: set[asyncio.StreamWriter] = set()
        self._servers: list[asyncio.Server] = []
        self._thread = threading.Thread(target=self._loop.run_forever)
        self._thread.start()
        self.mend()

    def mend(self) -> None:
        self._do(self._mend())

    def cut(self) -> None:
        self._do(self._cut())

    def _do(self, work) -> None:
        asyncio.run_coroutine_threadsafe(work, self._loop).result(20)

    async def _mend(self) -> None:
        for k in (0, 1):
            server = await asyncio.start_server(lambda *ends, k=k: self._carry(*ends, k), "127.0.0.1", self.port + k)
            self._servers.append(server)

    async def _cut(self) -> None:
        for server in self._servers:
            server.close()
        self._servers.clear()
        for end in self._open:
            end.transport.abort()
        self._open.clear()

    async def _carry(self, reader: asyncio.StreamReader, writer: asyncio.StreamWriter, k: int) -> None:
        there, back = await asyncio.open_connection("127.0.0.1", self._to + k)
        self._open |= {writer, back}

        async def pump(source: asyncio.StreamReader, target: asyncio.StreamWriter) -> None:
            with contextlib.suppress(ConnectionError, RuntimeError):
                while data := await source.read(65536):
                    target.write(data)
                    await target.drain()
            target.close()

        await asyncio.gather(pump(reader, back), pump(there, writer))

    def close(self) -> None:
        self.cut()
        self._loop.call_soon_threadsafe(self._loop.stop)
        self._thread.join()
        self._loop.close()
