"""Typed access to a family's messages: a class a message, with a field a signal in physical units, made from the description.

::

    from hal.drives.limb_fd.messages import DriveStatus, LimbControl      # known to editors and type checkers
    messages = hal.drives.typed.messages("limb_fd")                       # of any family, a user's own too

    bus.send(LimbControl(limb=0, controlword=[Controlword.SHUTDOWN]).encode())
    status = DriveStatus.decode(bus.recv())                               # raises FrameError, e.g. for a wrong CRC

The classes' source is written by hal.drives.typed_source (`handrail drives types`); what they do is here. They are for test
benches and tools: a frame goes signal by signal here, where the daemon's tables (hal.drives.protocol) take a batch at once.
"""

from __future__ import annotations

import functools
import importlib
import itertools
import sys
import time
import types
from collections import defaultdict
from collections.abc import Collection, Iterator, Sequence
from pathlib import Path
from typing import Any, ClassVar, Self

import can
import numpy as np

from hal.can import frames
from hal.can.convert import to_message, to_record
from hal.can.layout import MessageLayout
from hal.drives.family import load, read
from hal.drives.fields import Field, Role
from hal.drives.lifecycle import Command
from hal.drives.typed_fields import COUNTED, TypedField
from hal.drives.typed_plan import Plan, plan_of
from hal.drives.typed_source import source

NEXT = -1
"""A sequence number that `encode` fills in: the next of this limb (or device), counted by this process."""
NOW = -1
"""A time of measurement that `encode` fills in: this computer's monotonic clock, in us, as far as it fits."""

_counters: defaultdict[tuple[Any, ...], Iterator[int]] = defaultdict(itertools.count)


class FrameError(ValueError):
    """A frame that is not what it was read as: identifier, length, format, CRC or a constant is wrong."""


class TypedMessage:
    """A message of a drive family; its subclasses are dataclasses that `handrail drives types` writes."""

    _family: ClassVar[str] = ""
    _kind: ClassVar[str] = ""

    def __init_subclass__(cls, *, family: str = "", message: str = "", **more: Any):
        super().__init_subclass__(**more)
        cls._family, cls._kind = family, message

    def encode(self) -> can.Message:
        """The frame, its CRC, constants and what was left to NEXT and NOW filled in.

        Raises ValueError naming message, signal, value and range for what does not fit, ConfigError for a family that is not
        there.
        """
        return _message(self.record())

    def record(self, bus: int = 0) -> np.ndarray:
        """The frame as hal.can.frames.RECORD (1,); otherwise as `encode`."""
        plan, numbers = plan_of(type(self)), self._numbers()
        layout, out = plan.layout(numbers), frames.empty(1)
        if plan.payloads:
            out["can_id"], out["length"], out["flags"] = layout.frame_id, 8, layout.head >> 40 & 0xFF
            out["data"][0, :8] = np.frombuffer(plan.payloads[Command(self.command).name.lower()], np.uint8)  # type: ignore[attr-defined]
            out["bus"] = bus
            return out
        values = np.zeros((1, len(layout.signals)))
        for item in plan.fields:
            self._fill(plan, item, layout, numbers, values[0])
        for signal, raw in plan.constants(numbers):
            at = layout.signals.index(signal)
            values[0, at] = raw * layout.scales[at, 0] + layout.scales[at, 1]
        plan.family.codec.encode(layout.name, values, out, bus=bus)
        if plan.crc_signal:
            values[0, layout.signals.index(plan.crc_signal.format_map(numbers))] = plan.crc(layout, numbers, out)
            plan.family.codec.encode(layout.name, values, out, bus=bus)
        return out

    @classmethod
    def decode(cls, message: can.Message | np.ndarray | np.void) -> Self:
        """What a frame says. Raises FrameError for one that is none of these, or damaged."""
        plan, record = plan_of(cls), _record(message)
        numbers = plan.numbers_of(record)
        if numbers is None:
            raise FrameError(f"frame {int(record['can_id'][0]):#x}: no {plan.kind.name}; expected {plan.identifiers}")
        layout, length = plan.layout(numbers), int(record["length"][0])
        wanted = layout.head >> 40 & frames.FD
        if length != layout.length or int(record["flags"][0]) & (frames.FD | frames.REMOTE) != wanted:
            raise FrameError(
                f"{layout.name}: {length} bytes; expected {layout.length} of {'CAN FD' if wanted else 'CAN'}"
            )
        own: dict[str, Any] = {name: numbers[name] for name in plan.kind.numbers}
        command = plan.command_of(record["data"][0, :8].tobytes())
        if plan.payloads:
            if command is None:
                raise FrameError(f"{layout.name}: {record['data'][0, :8].tobytes().hex(' ')}; expected a fixed frame")
            return cls(**own, **{"command": command})
        if command is not None:
            raise FrameError(f"{layout.name}: the fixed frame {command.name.lower()}; expected set-points")
        values = plan.family.codec.decode(layout.name, record)[0].tolist()
        if plan.crc_signal:
            at, right = layout.signals.index(plan.crc_signal.format_map(numbers)), plan.crc(layout, numbers, record)
            if values[at] != right:
                raise FrameError(f"{layout.name}: CRC {round(values[at]):#x}; expected {right:#x}")
        for signal, raw in plan.constants(numbers):
            at = layout.signals.index(signal)
            is_there = round((values[at] - layout.scales[at, 1]) / layout.scales[at, 0])
            if is_there != raw:
                raise FrameError(f"{layout.name}: {signal}: {is_there}; expected {raw}")
        for item in plan.fields:
            said = [plan.typed(item, item.meant(values[at])) for at in _places(item, layout, numbers)]
            own[item.name] = said if item.axes else said[0]
        return cls(**own)

    def _numbers(self) -> dict[str, int]:
        plan, numbers = plan_of(type(self)), {"limb": 0, "axis": 0, "device": 0}
        for name in plan.kind.numbers:
            value, room = (
                getattr(self, name),
                getattr(plan.family, {"limb": "limbs", "axis": "axes", "device": "devices"}[name]),
            )
            if not (isinstance(value, int) and 0 <= value < room):
                raise ValueError(f"{plan.kind.name}: {name} {value!r}; expected 0 to {room - 1}")
            numbers[name] = value
        return numbers

    def _fill(
        self, plan: Plan, item: TypedField, layout: MessageLayout, numbers: dict[str, int], values: np.ndarray
    ) -> None:
        given = getattr(self, item.name)
        # The meaning first: arrays must not be compared with a number.
        if item.meaning is Field.SEQUENCE and plan.kind.role in COUNTED and given == NEXT:
            status = plan.kind.role is Role.DEVICE_STATUS
            given = next(_counters[self._family, status, numbers["limb"], numbers["device"]]) % (1 << item.bits)
        elif item.meaning is Field.TIME and given == NOW:
            given = time.monotonic_ns() // 1000 % (1 << item.bits)
        many = list(given) if item.axes else [given]
        if item.axes and len(many) > item.axes:
            raise ValueError(
                f"{layout.name}: {item.name}: {len(many)} values; expected at most {item.axes}, one an axis"
            )
        for at, value in zip(_places(item, layout, numbers), many, strict=False):
            values[at] = item.check(value, f"{layout.name}: {layout.signals[at]}")


def _places(item: TypedField, layout: MessageLayout, numbers: dict[str, int]) -> list[int]:
    """Which of the layout's signals a field is."""
    own = [{**numbers, "axis": axis} for axis in range(item.axes)] if item.axes else [numbers]
    return [layout.signals.index(item.signal.format_map(of)) for of in own]


def _record(message: can.Message | np.ndarray | np.void) -> np.ndarray:
    if isinstance(message, can.Message):
        try:
            return np.frombuffer(bytearray(to_record(message, 0)), frames.RECORD)
        except ValueError as error:
            raise FrameError(str(error)) from error
    return np.ascontiguousarray(message, frames.RECORD).reshape(-1)[:1]


def _message(record: np.ndarray) -> can.Message:
    message = to_message(record.tobytes(), ("",), rx=False)
    message.channel = None
    return message


def decode_any(kinds: Sequence[type[TypedMessage]], message: can.Message | np.ndarray | np.void) -> Any:
    """The message that a frame is by its identifier, None when it is none of these. Raises FrameError for a damaged one."""
    record, problem = _record(message), None
    for kind in kinds:
        if plan_of(kind).numbers_of(record) is None:
            continue
        try:
            return kind.decode(record)
        except FrameError as error:  # fixed frames and set-points may share an identifier
            problem = error
    if problem is not None:
        raise problem
    return None


def signed(family: str, message: can.Message, given: Collection[str] = ()) -> can.Message:
    """A frame of this family, made by whatever means, with its CRC and constants as they should be.

    given: names of signals that stay as they are. A frame that is none of the family's, or too short, is returned unchanged.
    """
    record = _record(message)
    for plan in map(plan_of, messages(family).MESSAGES):
        numbers = plan.numbers_of(record)
        if numbers is None or plan.payloads or int(record["length"][0]) != plan.layout(numbers).length:
            continue
        layout = plan.layout(numbers)
        values = plan.family.codec.decode(layout.name, record)
        for signal, raw in plan.constants(numbers):
            if signal not in given:
                at = layout.signals.index(signal)
                values[0, at] = raw * layout.scales[at, 0] + layout.scales[at, 1]
        plan.family.codec.encode(layout.name, values, record)
        crc_signal = plan.crc_signal.format_map(numbers)
        if crc_signal and crc_signal not in given:
            values[0, layout.signals.index(crc_signal)] = plan.crc(layout, numbers, record)
            plan.family.codec.encode(layout.name, values, record)
        return _message(record)
    return message


def messages(family: str) -> types.ModuleType:
    """The classes of a family as a module: for a built-in one hal.drives.FAMILY.messages, for a user's own the same made now.

    Raises config.ConfigError as hal.drives.family.load does.
    """
    folder = load(family).folder
    if folder.parent == Path(__file__).parent:
        return importlib.import_module(f"hal.drives.{family}.messages")
    return _made(folder)


@functools.cache
def _made(folder: Path) -> types.ModuleType:
    module = types.ModuleType(f"hal.drives.of_workspace.{folder.name}")
    sys.modules[module.__name__] = module  # where dataclasses look types up
    exec(compile(source(read(folder)), f"{folder.name} (made by hal.drives.typed)", "exec"), module.__dict__)
    return module
