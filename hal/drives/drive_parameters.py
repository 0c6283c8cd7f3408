"""One drive's parameters as attributes: reading asks the drive over the bus, assigning writes.

::

    from hal.drives.limb_fd.messages import Parameters
    drive = Parameters(bus, limb=0, axis=1)
    drive.torque_limit = 0.8 * drive.torque_limit

For benches and tools with a python-can bus and a drive on it; `ParameterClient` asks a whole robot's drives by joint.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any, ClassVar, Never, NoReturn, Self, overload

import can

from hal.drives.parameter_client import converse
from hal.drives.parameters import Parameter
from hal.drives.protocol import ParameterReply


class DriveParameters:
    """The drive of one axis of one limb. A family's own subclass (`messages(FAMILY).Parameters`) has the attributes.

    They raise hal.drives.parameter_client.ParameterError, which says drive, parameter and why, and can.CanError.
    """

    _family: ClassVar[str] = ""

    def __init_subclass__(cls, *, family: str = ""):
        super().__init_subclass__()
        cls._family = family

    def __init__(self, bus: can.BusABC, *, limb: int, axis: int):
        """`bus`: whatever else arrives on it while a drive is asked is dropped."""
        from hal.drives.typed import messages

        self._bus, self._limb, self._axis = bus, limb, axis
        self._messages: Any = messages(self._family)

    def ask(self, parameter: Parameter, value: float | None = None) -> float:
        """Read a parameter (`value` None) or write it; what the drive reads it as."""

        def send(sequence: int) -> None:
            request = self._messages.ParameterRequest(
                limb=self._limb,
                axis=self._axis,
                index=parameter,
                write=value is not None,
                value=value or 0.0,
                sequence=sequence,
            )
            self._bus.send(request.encode(), timeout=0.1)

        where = f"limb {self._limb}, axis {self._axis}: {parameter.name.lower()}"
        return converse(where, parameter, value, send, self._replies).value

    def _replies(self, wait_s: float) -> Iterator[ParameterReply]:
        message = self._bus.recv(wait_s)
        reply = self._messages.decode(message) if message is not None else None
        if isinstance(reply, self._messages.ParameterReply) and (reply.limb, reply.axis) == (self._limb, self._axis):
            yield ParameterReply(
                self._axis, int(reply.index), bool(reply.write), reply.sequence, int(reply.result), reply.value
            )


class _Attribute:
    def __init__(self, parameter: Parameter):
        self._parameter = parameter

    @overload
    def __get__(self, drive: None, owner: type) -> Self: ...
    @overload
    def __get__(self, drive: DriveParameters, owner: type) -> float: ...
    def __get__(self, drive: DriveParameters | None, owner: type) -> Self | float:
        return self if drive is None else drive.ask(self._parameter)


class Readable(_Attribute):
    """A parameter that can only be read."""

    def __set__(self, drive: DriveParameters, value: Never) -> NoReturn:
        raise AttributeError(f"{self._parameter.name.lower()} can only be read")


class ReadWrite(_Attribute):
    """A parameter that can be read and written."""

    def __set__(self, drive: DriveParameters, value: float) -> None:
        drive.ask(self._parameter, value)


class WriteOnly(ReadWrite):
    """A parameter that can only be written."""

    def __get__(self, drive: DriveParameters | None, owner: type) -> Any:
        if drive is None:
            return self
        raise AttributeError(f"{self._parameter.name.lower()} can only be written")
