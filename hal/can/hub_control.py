"""The hub's side of the conversation about the bus itself (hal.can.control)."""

from __future__ import annotations

from typing import TYPE_CHECKING

import msgspec

from hal.can import control, wire

if TYPE_CHECKING:
    from hal.can.hub import Hub


def answer(hub: Hub, datagram: bytes) -> bytes:
    """Do what a request asks for, and say so, or why not."""
    said: control.Answer
    try:
        match control.decode_request(datagram):
            case control.GetBus():
                said = hub.report()
            case control.GetNode(name=name):
                said = control.NodeStates(nodes=hub.node_states(name))
            case control.AddFault(fault=fault):
                said = control.FaultAdded(number=hub.add_fault(fault))
            case control.ClearFault(number=number):
                said = control.FaultsCleared(count=hub.clear_fault(number))
    except (msgspec.DecodeError, ValueError, RecursionError) as error:  # the last for nesting without end
        said = wire.Sorry(reason=str(error))
    return wire.encode(said)
