"""What the hub says about its bus (hal.can.control): loads, nodes, faults."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass

from hal.can import tally
from hal.can.control import BusReport, ChannelState, IdentifierLoad, NodeState
from hal.can.tally import Tally
from hal.can.timing import BusTiming, LoadMeter
from hal.can.traffic import Traffic


@dataclass(frozen=True)
class ChannelStatistics:
    """What one channel has carried."""

    name: str
    frames: int
    busy_ns: int
    load: float
    """share of the time in use over about the last second of the hub's clock; above 1: more than the bus can carry"""


class Reporter:
    """Looks at a hub's tallies and traffic."""

    def __init__(self, channels: Sequence[BusTiming], tallies: Tally, names: Sequence[str]):
        """names: of the nodes by number, kept up to date by the hub."""
        self._channels, self._tally, self._names = channels, tallies, names
        self._meters = [LoadMeter() for _ in channels]

    def statistics(self, now: int) -> list[ChannelStatistics]:
        """What every channel has carried at `now` (ns)."""
        totals = self._tally.totals[:, (tally.FRAMES, tally.BUSY)].tolist()
        return [
            ChannelStatistics(channel.name, frames, busy, meter.update(now, busy))
            for channel, (frames, busy), meter in zip(self._channels, totals, self._meters, strict=True)
        ]

    def report(
        self, now: int, traffic: Traffic, places: Iterable[tuple[int, int]], unread: Mapping[int, int]
    ) -> BusReport:
        """Everything about the bus at `now` (ns). places: of the nodes, (number, channel's index); unread: by number."""
        channels = [
            ChannelState(
                name=channel.name,
                bitrate=channel.bitrate,
                data_bitrate=channel.data_bitrate,
                frames=of.frames,
                busy_ns=of.busy_ns,
                error_frames=int(self._tally.totals[bus, tally.ERRORS]),
                load=of.load,
                identifiers=[
                    IdentifierLoad(can_id=can_id, extended=extended, frames=frames, busy_ns=busy)
                    for can_id, extended, frames, busy in tally.seen(self._tally.identifiers, bus)
                ],
            )
            for bus, (channel, of) in enumerate(zip(self._channels, self.statistics(now), strict=True))
        ]
        return BusReport(
            time_ns=now,
            timing=traffic.timing,
            channels=channels,
            nodes=self.node_states(traffic, places, unread),
            faults=traffic.disturbance.faults,
            hits=traffic.disturbance.hits,
        )

    def node_states(
        self, traffic: Traffic, places: Iterable[tuple[int, int]], unread: Mapping[int, int]
    ) -> list[NodeState]:
        """How the nodes at these places fare."""
        return [self._node_state(traffic, number, bus, unread.get(number, 0)) for number, bus in places]

    def _node_state(self, traffic: Traffic, number: int, bus: int, unread: int) -> NodeState:
        state, transmit_errors, receive_errors, waiting, overflows = traffic.of_node(number, bus)
        return NodeState(
            name=self._names[number],
            channel=self._channels[bus].name,
            state=state,
            transmit_errors=transmit_errors,
            receive_errors=receive_errors,
            waiting=waiting,
            overflows=overflows,
            unread=unread,
        )
