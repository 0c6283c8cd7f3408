"""How long frames occupy the bus."""

from __future__ import annotations

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st

from hal.can import frames
from hal.can.timing import LoadMeter, frame_bits, frame_ns

_DLC = {length: dlc for dlc, length in enumerate(frames.FD_LENGTHS)}


def _stuffed(bits: str) -> int:
    """Stuff bits that a transmitter puts into `bits`, one after every five equal ones, the stuff bits included."""
    count, level, run = 0, "", 0
    for bit in bits:
        run = run + 1 if bit == level else 1
        level = bit
        if run == 5:
            count, level, run = count + 1, "1" if bit == "0" else "0", 1
    return count


def _crc15(bits: str) -> str:
    crc = 0
    for bit in bits:
        out = int(bit) ^ (crc >> 14)
        crc = (crc << 1) & 0x7FFF
        if out:
            crc ^= 0x4599
    return f"{crc:015b}"


def _reference(can_id: int, flags: int, data: bytes) -> tuple[int, int]:
    """Frame bits written out as ISO 11898-1 draws them."""
    extended, payload = flags & frames.EXTENDED, "".join(f"{byte:08b}" for byte in data)
    base, extension = (f"{can_id >> 18:011b}", f"{can_id & 0x3FFFF:018b}") if extended else (f"{can_id:011b}", "")
    dlc = f"{_DLC[len(data)]:04b}"
    if not flags & frames.FD:
        head = "0" + base + ("11" + extension + "0" + "00" if extended else "000") + dlc
        stuffed = head + payload + _crc15(head + payload)
        return len(stuffed) + _stuffed(stuffed) + 1 + 2 + 7 + 3, 0
    arbitration = "0" + base + ("11" + extension + "0" if extended else "00") + "10" + str(flags & frames.BRS)
    all_bits = arbitration + ("1" if flags & frames.ESI else "0") + dlc + payload
    # A stuff bit behind the last bit of all is left out: the CRC field begins with one of its own.
    dynamic = _stuffed(all_bits[:-1]) - _stuffed(arbitration)
    crc = 17 if len(data) <= 16 else 21
    field = 4 + crc
    nominal = len(arbitration) + _stuffed(arbitration) + 2 + 7 + 3
    in_data = len(all_bits) - len(arbitration) + dynamic + field + -(-field // 4) + 1
    return (nominal, in_data) if flags & frames.BRS else (nominal + in_data, 0)


def _record(can_id: int, flags: int, data: bytes) -> np.ndarray:
    record = frames.empty(1)
    record["can_id"], record["flags"], record["length"] = can_id, flags, len(data)
    record["data"][0, : len(data)] = np.frombuffer(data, np.uint8)
    return frames.words(record)


_runs = st.sampled_from([b"\x00", b"\xff", b"\x07", b"\xe0", b"\x1f", b"\xf8", b"\x55", b"\xa7"])
"""Bytes that stuff much or hardly."""


@settings(deadline=None)  # the first example may have to compile
@given(
    extended=st.booleans(),
    can_id=st.integers(0, 0x1FFFFFFF),
    rate=st.sampled_from([0, frames.BRS, frames.ESI, frames.BRS | frames.ESI]),
    length=st.sampled_from(frames.FD_LENGTHS),
    data=st.one_of(st.binary(min_size=64, max_size=64), st.lists(_runs, min_size=64, max_size=64).map(b"".join)),
)
def test_a_can_fd_frame_has_the_bits_that_the_standard_draws(
    extended: bool, can_id: int, rate: int, length: int, data: bytes
) -> None:
    flags = frames.FD | rate | (frames.EXTENDED if extended else 0)
    can_id = can_id if extended else can_id & 0x7FF
    assert frame_bits(_record(can_id, flags, data[:length]), 0) == _reference(can_id, flags, data[:length])


@settings(deadline=None)  # the first example may have to compile
@given(
    extended=st.booleans(),
    can_id=st.integers(0, 0x1FFFFFFF),
    data=st.one_of(st.binary(max_size=8), st.lists(_runs, max_size=8).map(b"".join)),
)
def test_a_classic_frame_has_the_bits_that_the_standard_draws(extended: bool, can_id: int, data: bytes) -> None:
    flags = frames.EXTENDED if extended else 0
    can_id = can_id if extended else can_id & 0x7FF
    assert frame_bits(_record(can_id, flags, data), 0) == _reference(can_id, flags, data)


def test_the_data_phase_takes_the_data_bit_rate() -> None:
    words = _record(0x100, frames.FD | frames.BRS, bytes(range(64)))
    nominal, data = frame_bits(words, 0)
    assert frame_ns(words, 0, 1_000_000, 5_000_000) == nominal * 1000 + data * 200
    assert frame_ns(words, 0, 500_000, 2_000_000) == nominal * 2000 + data * 500


def test_load_is_the_share_of_the_last_second_in_use() -> None:
    meter = LoadMeter()
    busy = 0
    for step in range(50):  # 5 s, a quarter in use, then 2 s of silence
        busy += 25_000_000
        load = meter.update(step * 100_000_000, busy)
    assert 0.24 < load < 0.26
    for step in range(50, 70):
        load = meter.update(step * 100_000_000, busy)
    assert load == 0.0
