"""The state ring, the mailbox and the doorbells, between real processes."""

from __future__ import annotations

import shutil
import subprocess
import sys
import tempfile
import threading
import time
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest

from daemon.exchange.doorbell import Bell, Doorbell
from daemon.exchange.mailbox import MailboxFull, MailboxReader, MailboxWriter
from daemon.exchange.ring import StateRingReader, StateRingWriter
from daemon.exchange.shared_file import SharedFileError

RECORD = np.dtype([("cycle", "i8"), ("values", "f8", 200)], align=True)
COMMAND = np.dtype([("serial", "u8"), ("kind", "u4")], align=True)


@pytest.fixture
def folder() -> Iterator[Path]:
    made = Path(tempfile.mkdtemp(prefix="hr"))
    yield made
    shutil.rmtree(made)


def publish(writer: StateRingWriter, cycle: int) -> None:
    writer.record["cycle"] = cycle
    writer.record["values"][:] = cycle
    writer.publish()


def start_script(script: str, *arguments: object) -> subprocess.Popen[str]:
    return subprocess.Popen(
        [sys.executable, "-c", script, *map(str, arguments)], stdout=subprocess.PIPE, stdin=subprocess.PIPE, text=True
    )


def test_a_late_reader_gets_the_newest_snapshot_and_then_all_in_order(folder: Path) -> None:
    writer = StateRingWriter(folder / "ring", RECORD)
    for cycle in range(5):
        publish(writer, cycle)
    reader = StateRingReader(folder / "ring", RECORD)
    assert reader.read()["cycle"].tolist() == [4]
    for cycle in range(5, 9):
        publish(writer, cycle)
    assert reader.read()["cycle"].tolist() == [5, 6, 7, 8]
    assert len(reader.read()) == 0
    assert reader.missed == 0


def test_a_reader_before_the_first_start_waits_without_error(folder: Path) -> None:
    reader = StateRingReader(folder / "ring", RECORD)
    assert len(reader.read()) == 0
    assert reader.generation == 0
    writer = StateRingWriter(folder / "ring", RECORD)
    assert len(reader.read()) == 0
    publish(writer, 0)
    assert reader.read()["cycle"].tolist() == [0]


def test_a_reader_that_falls_behind_counts_what_it_missed(folder: Path) -> None:
    writer = StateRingWriter(folder / "ring", RECORD, capacity=8)
    reader = StateRingReader(folder / "ring", RECORD)
    publish(writer, 0)
    reader.read()
    for cycle in range(1, 21):
        publish(writer, cycle)
    got = reader.read()["cycle"].tolist()
    assert got == list(range(21 - len(got), 21))
    assert len(got) + reader.missed == 20
    assert reader.missed > 0


def test_snapshots_read_while_another_process_overwrites_them_are_whole(folder: Path) -> None:
    script = """
import sys, numpy as np
from pathlib import Path
from daemon.exchange.ring import StateRingWriter
record = np.dtype([("cycle", "i8"), ("values", "f8", 200)], align=True)
writer = StateRingWriter(Path(sys.argv[1]), record, capacity=16)
print("ready", flush=True)
sys.stdin.readline()
for cycle in range(1, 60001):
    writer.record["cycle"] = cycle
    writer.record["values"][:] = cycle
    writer.publish()
"""
    process = start_script(script, folder / "ring")
    assert process.stdout is not None
    assert process.stdin is not None
    assert process.stdout.readline() == "ready\n"
    reader = StateRingReader(folder / "ring", RECORD)
    reader.read()
    process.stdin.write("go\n")
    process.stdin.flush()
    last = read = torn = 0
    deadline = time.monotonic() + 30
    while last < 60000 and time.monotonic() < deadline:
        got = reader.read()
        torn += int((got["values"] != got["cycle"][:, None]).any(axis=1).sum())
        if len(got):
            assert got["cycle"][0] > last
            assert (np.diff(got["cycle"]) > 0).all()
            last = int(got["cycle"][-1])
            read += len(got)
    process.wait(5)
    assert torn == 0
    assert last == 60000
    assert read + reader.missed == 60000


def test_a_restarted_writer_is_noticed_and_the_old_mapping_stays_readable(folder: Path) -> None:
    old = StateRingWriter(folder / "ring", RECORD)
    reader = StateRingReader(folder / "ring", RECORD)
    publish(old, 7)
    assert reader.read()["cycle"].tolist() == [7]
    new = StateRingWriter(folder / "ring", RECORD, capacity=4)
    publish(old, 8)  # nobody reads what a replaced loop still writes, and it does no harm
    publish(new, 100)
    publish(new, 101)
    assert reader.read()["cycle"].tolist() == [100, 101]
    assert reader.generation == 2


def test_a_ring_of_another_record_is_refused_with_both_sizes(folder: Path) -> None:
    StateRingWriter(folder / "ring", RECORD)
    reader = StateRingReader(folder / "ring", np.dtype([("cycle", "i8")]))
    with pytest.raises(SharedFileError, match=rf"{RECORD.itemsize} bytes.*expected 8 bytes"):
        reader.read()


def test_commands_cross_to_another_process_with_their_payloads(folder: Path) -> None:
    script = """
import sys, time, numpy as np
from pathlib import Path
from daemon.exchange.mailbox import MailboxReader
from daemon.exchange.doorbell import Doorbell
command = np.dtype([("serial", "u8"), ("kind", "u4")], align=True)
folder = Path(sys.argv[1])
mailbox, bell = MailboxReader(folder / "box", command), Doorbell(folder / "bell")
print("ready", flush=True)
for _ in range(20):
    while (mail := mailbox.take()) is None:
        assert bell.wait(10)
    header, payload = mail
    print(int(header[0]["serial"]), int(header[0]["kind"]), len(payload), float(payload.sum()), flush=True)
    mailbox.done()
"""
    process = start_script(script, folder)
    assert process.stdout is not None
    assert process.stdout.readline() == "ready\n"
    writer, bell = MailboxWriter(folder / "box", COMMAND), Bell(folder / "bell")
    sent = []
    for serial in range(1, 21):
        payload = np.full((serial * 1000, 5), 0.5)
        header = np.zeros((), COMMAND)
        header["serial"], header["kind"] = serial, serial % 7
        deadline = time.monotonic() + 10
        while True:
            try:
                writer.post(header, payload)
                break
            except MailboxFull:
                assert time.monotonic() < deadline
                time.sleep(1e-3)
        assert bell.ring()
        sent.append(f"{serial} {serial % 7} {payload.size} {payload.sum()}")
    received = [process.stdout.readline().strip() for _ in sent]
    process.wait(5)
    assert received == sent


def test_a_full_mailbox_says_so_and_goes_on_when_the_loop_takes_again(folder: Path) -> None:
    reader = MailboxReader(folder / "box", COMMAND, slots=2, floats=16)
    writer = MailboxWriter(folder / "box", COMMAND)
    header = np.zeros((), COMMAND)
    writer.post(header)
    writer.post(header)
    with pytest.raises(MailboxFull, match="2 commands"):
        writer.post(header)
    assert reader.take() is not None
    reader.done()
    assert writer.post(header) == 3


def test_a_payload_without_room_is_refused_and_nothing_is_posted(folder: Path) -> None:
    reader = MailboxReader(folder / "box", COMMAND, floats=16)
    writer = MailboxWriter(folder / "box", COMMAND)
    with pytest.raises(ValueError, match="payload of 17 numbers; expected at most 16"):
        writer.post(np.zeros((), COMMAND), np.zeros(17))
    assert reader.take() is None


def test_a_command_for_a_dead_loop_is_not_carried_out_by_the_next(folder: Path) -> None:
    writer = MailboxWriter(folder / "box", COMMAND)
    with pytest.raises(MailboxFull, match="has not started"):
        writer.post(np.zeros((), COMMAND))
    MailboxReader(folder / "box", COMMAND)
    header = np.zeros((), COMMAND)
    writer.post(header)
    anew = MailboxReader(folder / "box", COMMAND)
    assert anew.take() is None
    header["serial"] = 9
    writer.post(header)
    mail = anew.take()
    assert mail is not None
    assert mail[0][0]["serial"] == 9


def test_a_doorbell_wakes_its_sleeper_and_is_silent_after(folder: Path) -> None:
    doorbell, bell = Doorbell(folder / "bell"), Bell(folder / "bell")
    thread = threading.Timer(0.05, bell.ring)
    thread.start()
    assert doorbell.wait(10)
    assert not doorbell.wait(0)
    thread.join()


def test_ringing_never_waits_and_tells_when_nobody_listens(folder: Path) -> None:
    bell = Bell(folder / "bell")
    assert not bell.ring()
    doorbell = Doorbell(folder / "bell")
    assert all(bell.ring() for _ in range(1000))  # nobody clears them
    doorbell.close()
    assert not bell.ring()
    anew = Doorbell(folder / "bell")
    assert bell.ring()
    anew.close()
