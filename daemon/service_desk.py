"""What one may ask the supervisor of the robot's service, at a socket of its own: how its processes are, what they said, a restart.

One packet is the call, one is the answer (Unix seqpacket, MessagePack as everywhere). The supervisor answers between two looks at
its children, so it answers while every one of them is dead.
"""

from __future__ import annotations

import contextlib
import os
import shutil
import socket
import sys
import time
from pathlib import Path
from typing import Any

import msgspec

from daemon.process_use import Processes, Row
from daemon.supervisor import Child, Supervisor
from handrail import messages as m
from handrail.runtime import Runtime, recordings_folder
from handrail.topics import RefusedError, refuse

_LARGEST_CALL = 4096
_LARGEST_ANSWER = 128 * 1024
"""bytes: a packet must fit into the socket's buffer, as Linux makes them by default"""
_RECORDING = "recording"
"""the child that records what StartRecording asked for"""
_LEAST_ROOM = 500e6
"""bytes that are free where a recording begins: one fills 1 to 5 MB/s of the robot's time"""
_FRESH_S = 0.9
"""wall time between two looks at what processes use: processor time is counted from one to the next"""
_PEOPLE = ("operator", "developer", "")
"""roles that may start processes anew; none: who asks is on the robot's own machine"""


class ServiceDesk:
    """Answers `handrail.messages.ServiceCall` from the supervisor's own thread."""

    def __init__(self, runtime: Runtime, supervisor: Supervisor):
        self._runtime, self._supervisor = runtime, supervisor
        self._processes = Processes(runtime.folder)
        self._rows: list[Row] = []
        self._looked_at = -_FRESH_S
        self._decoder = msgspec.msgpack.Decoder(m.ServiceCall)
        self._encoder = msgspec.msgpack.Encoder()
        runtime.service.unlink(missing_ok=True)  # of a supervisor that was killed
        self._listening = socket.socket(socket.AF_UNIX, socket.SOCK_SEQPACKET | socket.SOCK_NONBLOCK)
        self._listening.bind(str(runtime.service))
        self._listening.listen(16)
        self._open: set[socket.socket] = set()
        self._file, self._recording_since = Path(), 0.0
        """of the recording that was begun last"""
        supervisor.hear(self._listening, self._accept)

    def close(self) -> None:
        """Answer no more."""
        for each in list(self._open):
            self._drop(each)
        self._supervisor.forget(self._listening)
        self._listening.close()
        self._runtime.service.unlink(missing_ok=True)

    def _accept(self) -> None:
        with contextlib.suppress(BlockingIOError, ConnectionError):  # it has gone again
            asking, _ = self._listening.accept()
            asking.setblocking(False)
            self._open.add(asking)
            self._supervisor.hear(asking, lambda: self._take(asking))

    def _drop(self, asking: socket.socket) -> None:
        self._open.discard(asking)
        self._supervisor.forget(asking)
        asking.close()

    def _take(self, asking: socket.socket) -> None:
        try:
            packet = asking.recv(_LARGEST_CALL + 1)
            if packet:
                asking.send(self._encoder.encode(self._answer(packet)))
        except BlockingIOError:
            return
        except OSError:
            pass  # who asked has gone
        self._drop(asking)

    def _answer(self, packet: bytes) -> msgspec.Struct:
        try:
            return self._carry_out(self._decoder.decode(packet))
        except RefusedError as error:
            return error.refusal
        except (msgspec.DecodeError, UnicodeDecodeError, RecursionError) as error:
            return m.Refused(message=f"not a call that the supervisor knows: {error}")

    def _carry_out(self, call: Any) -> msgspec.Struct:
        if isinstance(call, m.StartRecording | m.StopRecording | m.Mark | m.ListRecordings):
            return self._record(call)
        if isinstance(call, m.GetProcesses):
            return m.Processes(processes=[_use(row) for row in self._look()])
        known = [told.name for told in self._supervisor.processes()]
        if call.process not in known:
            raise refuse("no such process", "process", call.process, f"one of: {', '.join(known)}")
        if isinstance(call, m.GetProcessLog):
            return self._log(call)
        _check_people(call)
        if call.process == _RECORDING:
            raise refuse("a recording is ended, not started anew", "process", call.process, "StopRecording")
        self._supervisor.restart(call.process, f"to be started anew, as {call.by or 'somebody here'} asked")
        return m.Ok()

    # ------------------------------------------------------------------------------------------------------ recordings

    def _record(self, call: m.StartRecording | m.StopRecording | m.Mark | m.ListRecordings) -> msgspec.Struct:
        running = next((each for each in self._supervisor.processes() if each.name == _RECORDING), None)
        if isinstance(call, m.ListRecordings):
            if running is None:
                return m.Recordings(recordings=[])
            return m.Recordings(
                recordings=[], running=self._file.stem, running_s=max(0.0, time.monotonic() - self._recording_since)
            )
        _check_people(call)
        if isinstance(call, m.StartRecording):
            if running is not None:
                raise refuse(f"{self._file.stem} is being made", "name", call.name, "after StopRecording")
            self._start_recording(call.name)
        elif isinstance(call, m.StopRecording):
            if running is None:
                raise refuse("nothing is being recorded")
            self._supervisor.ask_to_end(_RECORDING)
        elif running is None and all(each.name != "recorder" for each in self._supervisor.processes()):
            raise refuse("nothing is being recorded", "text", call.text, "after StartRecording")
        return m.Ok()

    def _start_recording(self, name: str) -> None:
        place = recordings_folder()
        file = place / f"{name}.mcap"
        try:
            place.mkdir(parents=True, exist_ok=True)
            room = shutil.disk_usage(place).free
        except OSError as error:
            raise refuse(f"{place}: {error.strerror}; expected a folder that can be written") from error
        if not os.access(place, os.W_OK):
            raise refuse(f"{place} can't be written")
        if file.exists():
            raise refuse("there is one of that name", "name", name, "a name of its own")
        if room < _LEAST_ROOM:
            raise refuse(f"{room / 1e6:.0f} MB are free in {place}; expected at least {_LEAST_ROOM / 1e6:.0f}")
        command = (
            sys.executable,
            "-m",
            "handrail.recorder",
            "--runtime",
            str(self._runtime.folder),
            "--out",
            str(file),
        )
        self._file, self._recording_since = file, time.monotonic()
        # Its supervisor's line for `recorder` is the one of `handrail up --record`: that one says its own name.
        self._supervisor.add(Child(_RECORDING, command, keep=False, says="recorder"))

    def _look(self) -> list[Row]:
        now = time.monotonic()
        if now - self._looked_at >= _FRESH_S:
            self._rows, self._looked_at = self._processes.look(), now
        return self._rows

    def _log(self, call: m.GetProcessLog) -> m.ProcessLog:
        lines = [m.SaidLine(age_s=age, text=text) for age, text in self._supervisor.log(call.process, call.lines)]
        size = 0
        for fitting, line in enumerate(reversed(lines)):
            size += len(line.text.encode(errors="replace")) + 32
            if size > _LARGEST_ANSWER:
                lines = lines[len(lines) - fitting :]
                break
        return m.ProcessLog(process=call.process, lines=lines)


def _check_people(call: Any) -> None:
    """Raise RefusedError unless it came from somebody here, or from a person's key."""
    if call.role not in _PEOPLE:
        raise refuse(
            f"this is for people: {call.by}'s key has the role {call.role}", "role", call.role, "operator or developer"
        )


def _use(row: Row) -> m.ProcessUse:
    return m.ProcessUse(
        name=row.name.strip() or "?",
        depth=row.depth,
        state=row.state,  # type: ignore[arg-type]
        for_s=float(row.up_s),
        process=row.process or 0,
        cpu=round(row.cpu / 100.0, 3),
        memory_mb=round(row.memory_mb, 1),
        deaths=row.restarts,
        last=row.last,
    )
