"""Two machines are paired by a code, once, and whoever stands between is noticed."""

from __future__ import annotations

import stat
import threading
from collections.abc import Callable
from contextlib import closing
from pathlib import Path
from typing import Any

import pytest
import zmq
from typer import Typer
from typer.testing import CliRunner

from handrail.link import keys, pairing
from handrail.link.pair import pair as command
from handrail.link.pairing import Accepted, Declined, Desk, Hello, Offer, PairingError, Proof
from tests.link.conftest import free_ports

CODE = "7K2M-9QXD"


class Robot:
    """A robot that shows a code, in a thread."""

    def __init__(self, folder: Path, **changes: Any):
        self.folder, self.port = keys.ensure(folder / "robot"), free_ports()
        self.desk = Desk(keys.for_gate(self.folder), code=CODE, **changes)
        self.endpoint = f"tcp://127.0.0.1:{self.port}"
        self._thread = threading.Thread(target=self.desk.serve, args=(self.endpoint,))
        self._thread.start()

    def close(self) -> None:
        self.desk.tries = 0
        self._thread.join(10)
        assert not self._thread.is_alive()


@pytest.fixture
def shows(tmp_path: Path) -> Any:
    made: list[Robot] = []

    def make(**changes: Any) -> Robot:
        made.append(Robot(tmp_path, **changes))
        return made[-1]

    yield make
    for robot in made:
        robot.close()


@pytest.mark.parametrize(("role", "folder"), [("operator", ""), ("developer", "developers"), ("engine", "engines")])
def test_who_knows_the_code_is_let_in_by_role_and_knows_the_robot(shows: Callable[..., Robot], tmp_path, role, folder):
    robot, tablet = shows(role=role), tmp_path / "tablet"
    accepted = pairing.pair(robot.endpoint, "7k2m 9qxd", tablet, name="field-1")
    assert (accepted.name, accepted.role) == ("field-1", role)
    own = keys.for_client(tablet)
    gate = keys.for_gate(robot.folder)
    assert own.server == gate.public
    assert gate.identity_of(own.public) == keys.Identity("field-1", role)
    assert (robot.folder / "allowed" / folder / "field-1.key").is_file()
    assert stat.S_IMODE((tablet / "client.key_secret").stat().st_mode) == 0o600


def test_a_code_counts_once(shows, tmp_path):
    robot = shows()
    pairing.pair(robot.endpoint, CODE, tmp_path / "one", name="one")
    assert robot.desk.left_s == 0
    later = robot.desk.answer(b"x", encoded(Hello(client=public(tmp_path), name="two", nonce=bytes(16))))
    assert isinstance(later, Declined) and "does not count any more" in later.why


def test_three_wrong_codes_are_the_last_and_change_nothing(shows, tmp_path):
    robot, tablet = shows(), keys.ensure(tmp_path / "tablet")
    before = keys.for_client(tablet)
    for left in (2, 1, 0):
        with pytest.raises(PairingError, match=f"{left} tries left"):
            pairing.pair(robot.endpoint, "0000-0000", tablet, name="guess")
    assert robot.desk.left_s == 0
    assert keys.for_client(tablet) == before
    assert keys.for_gate(robot.folder).name_of(before.public) is None


def test_a_code_that_is_too_old_counts_no_more(tmp_path):
    desk = Desk(keys.for_gate(tmp_path / "robot"), lasts_s=0.0)
    assert isinstance(desk.answer(b"x", encoded(Hello(client=public(tmp_path), name="a", nonce=bytes(16)))), Declined)


def test_who_stands_between_and_shows_a_key_of_his_own_is_noticed(shows, tmp_path):
    """He passes everything on, but for the robot's key."""
    robot, tablet = shows(), keys.ensure(tmp_path / "tablet")
    before = keys.for_client(tablet)
    his = keys.for_gate(tmp_path / "his").public.decode()
    between, port = zmq.Context(), free_ports()

    def pass_on() -> None:
        with closing(between.socket(zmq.ROUTER)) as near, closing(between.socket(zmq.DEALER)) as far:
            near.bind(f"tcp://127.0.0.1:{port}")
            far.connect(robot.endpoint)
            for _ in range(2):
                client, raw = near.recv_multipart()
                far.send(raw)
                answer = pairing._from_robot.decode(far.recv())
                if isinstance(answer, Offer):
                    answer = Offer(server=his, nonce=answer.nonce)
                near.send_multipart([client, encoded(answer)])

    thread = threading.Thread(target=pass_on)
    thread.start()
    with pytest.raises(PairingError, match="somebody stands between"):
        pairing.pair(f"tcp://127.0.0.1:{port}", CODE, tablet, name="field-1")
    thread.join(10)
    between.destroy(linger=0)
    assert keys.for_client(tablet) == before
    assert keys.for_gate(robot.folder).name_of(before.public) is None
    assert robot.desk.tries == pairing.TRIES - 1


def test_who_answers_without_knowing_the_code_is_not_believed(tmp_path):
    """He offers a key, and accepts whatever proof comes."""
    tablet = keys.ensure(tmp_path / "tablet")
    before = keys.for_client(tablet)
    his = keys.for_gate(tmp_path / "his").public.decode()
    context, port = zmq.Context(), free_ports()

    def accept() -> None:
        with closing(context.socket(zmq.ROUTER)) as socket:
            socket.bind(f"tcp://127.0.0.1:{port}")
            for answer in (Offer(server=his, nonce=bytes(16)), Accepted(mac=bytes(32), role="operator", name="a")):
                client, _ = socket.recv_multipart()
                socket.send_multipart([client, encoded(answer)])

    thread = threading.Thread(target=accept)
    thread.start()
    with pytest.raises(PairingError, match="does not know the code"):
        pairing.pair(f"tcp://127.0.0.1:{port}", CODE, tablet, name="field-1")
    thread.join(10)
    context.destroy(linger=0)
    assert keys.for_client(tablet) == before


@pytest.mark.parametrize(
    "raw", [b"", b"\xc1", b"\x80", b"\x81\xa1a" + b"\x91" * 4000, Proof(mac=bytes(32)),
            Hello(client="#" * 39 + "\n", name="a", nonce=bytes(16)),
            Hello(client="#" * 40, name="../a", nonce=bytes(16))],
)  # fmt: skip
def test_what_is_no_message_of_ours_is_declined_and_costs_no_try(tmp_path, raw):
    desk = Desk(keys.for_gate(tmp_path / "robot"))
    assert isinstance(desk.answer(b"x", raw if isinstance(raw, bytes) else encoded(raw)), Declined)
    assert desk.tries == pairing.TRIES


def test_a_name_that_another_client_has_is_not_taken_over(shows, tmp_path):
    robot = shows(name="local")  # as the robot's own client is called
    before = (robot.folder / "allowed" / "local.key").read_text()
    with pytest.raises(PairingError, match="another client's already"):
        pairing.pair(robot.endpoint, CODE, tmp_path / "tablet", name="field-1")
    assert (robot.folder / "allowed" / "local.key").read_text() == before


@pytest.mark.parametrize("typed", ["", "7K2M", "7K2M-9QX!", "7K2M-9QXDD", "UUUU-UUUU"])
def test_what_is_no_code_is_named(typed):
    with pytest.raises(PairingError, match="expected eight digits"):
        pairing.read_code(typed)


@pytest.mark.parametrize(
    ("address", "endpoint"),
    [
        ("robot", "tcp://robot:47802"),
        ("tcp://10.0.0.7:5000", "tcp://10.0.0.7:5002"),
        ("[::1]:5000", "tcp://[::1]:5002"),
    ],
)
def test_pairing_listens_two_ports_above_the_link(address, endpoint):
    assert pairing.endpoint_of(address) == endpoint
    for wrong in ("", "udp://x", "robot:0", "robot:99999", "a b"):
        with pytest.raises(PairingError, match="expected the link's"):
            pairing.endpoint_of(wrong)


def test_the_command_pairs_and_says_what_went_wrong(shows, tmp_path):
    app = Typer()
    app.command()(command)
    robot = shows()
    at = f"127.0.0.1:{robot.port - pairing.PORT_OFFSET}"
    own = ("--keys", str(tmp_path / "tablet"), "--connect", at)
    wrong = CliRunner().invoke(app, [*own, "ABCD-EFGH"])
    assert wrong.exit_code == 1
    right = CliRunner().invoke(app, [*own, CODE, "--name", "field-1"])
    assert right.exit_code == 0, right.output
    assert "calls this client field-1" in right.output
    assert CliRunner().invoke(app, [CODE]).exit_code == 1


def test_a_machine_that_was_paired_calls_the_robot(stand, tmp_path):
    """The gate reads its folder at every handshake: nothing is restarted."""
    stand.daemon()
    stand.gate()
    desk = Desk(keys.for_gate(stand.keys), code=CODE)
    endpoint = f"tcp://127.0.0.1:{free_ports()}"
    serving = threading.Thread(target=desk.serve, args=(endpoint,))
    serving.start()
    pairing.pair(endpoint, CODE, tmp_path / "tablet", name="field-1")
    serving.join(10)
    assert stand.client(tmp_path / "tablet").robot().name == "talos_upper"


def public(folder: Path) -> str:
    return keys.for_client(folder / "some").public.decode()


def encoded(message: Any) -> bytes:
    return pairing._encoder.encode(message)
