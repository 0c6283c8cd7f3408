"""A node on Handrail's virtual CAN bus with nothing but Python's standard library: the thermometer of can_node.c.

    handrail can up can0 &                       (or a robot: handrail up talos_upper --scene valve)
    python can_node.py /dev/shm/handrail-1000/bus.sock can0
    handrail can dump                            (and: handrail can send Sync Cycle=1)

The wire format is in docs/can.md. With python-can installed there is less to do: can.Bus(interface="handrail", channel="can0").
"""

from __future__ import annotations

import json
import socket
import struct
import sys

WIRE_VERSION, MAX_RECORDS = 2, 512
BRS, ESI, FD, EXTENDED, REMOTE, LOST = 1, 2, 4, 8, 16, 128
RECORD = struct.Struct("<QIBBBx64s")  # time_ns, can_id, length, flags, bus, data: 80 bytes


def join_hub(path: str, channel: str) -> socket.socket:
    """Join the hub: one JSON datagram each way. Raises OSError where no hub is, SystemExit with its words when it refuses."""
    hub = socket.socket(socket.AF_UNIX, socket.SOCK_SEQPACKET)
    hub.connect(path)
    hello = {"type": "hello", "version": WIRE_VERSION, "name": "thermometer", "channels": [channel]}
    hub.send(json.dumps(hello).encode())
    answer = json.loads(hub.recv(65536) or "{}")
    if answer.get("type") != "welcome":
        sys.exit(f"can_node: the hub says: {answer.get('reason', 'nothing')}")
    return hub


def main(path: str, channel: str) -> None:
    """Answer every Sync until the hub ends."""
    try:
        hub = join_hub(path, channel)
    except OSError as error:
        sys.exit(f"can_node: {path}: {error.strerror}")
    print("can_node ready", flush=True)
    temperature, counter = 215, 0  # 0.1 degrees
    while datagram := hub.recv(MAX_RECORDS * RECORD.size):
        for _, can_id, length, flags, bus, data in RECORD.iter_unpack(datagram):
            if flags & LOST:
                print(f"can_node: {can_id} frames lost: this process reads too slowly", file=sys.stderr)
            elif can_id == 0x080 and not flags & (EXTENDED | REMOTE) and length >= 4:
                said = data[:4] + struct.pack("<hB", temperature, counter)
                check = 0
                for byte in said:
                    check ^= byte
                hub.send(RECORD.pack(0, 0x500, 8, FD | BRS, bus, said + bytes([check])))
                counter = (counter + 1) & 0xFF


if __name__ == "__main__":
    if len(sys.argv) != 3:
        sys.exit("usage: can_node.py SOCKET CHANNEL")
    main(*sys.argv[1:])
