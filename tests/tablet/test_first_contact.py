"""The first contact's page: a code that is typed pairs this tablet, and the window turns to that robot."""

from __future__ import annotations

import pytest

from handrail.link.pairing import Accepted, PairingError

pytestmark = pytest.mark.window


def type_in(shown, name: str, text: str) -> None:
    from PySide6.QtCore import Qt

    shown.item(name).forceActiveFocus()
    shown.item(name).setProperty("text", "")
    for digit in text:
        shown.key(Qt.Key.Key_Minus if digit == "-" else Qt.Key(ord(digit)))


def test_a_code_that_is_typed_pairs_and_tells_which_robot_to_turn_to(robot, show):
    robot.reachable = False
    shown = show()
    asked, turned_to = [], []
    desk = shown.desk.pairing
    desk.pair_with = lambda endpoint, code: (
        asked.append((endpoint, code)) or Accepted(mac=bytes(32), role="operator", name="a")
    )
    desk.paired.connect(turned_to.append)
    shown.until(lambda: shown.item("firstContact").isVisible())
    shown.item("pairAddress").setProperty("text", "robot")
    type_in(shown, "pairCode", "7K2M-9QXD")
    shown.press("pair")
    shown.until(lambda: turned_to)
    assert asked == [
        ("tcp://robot:47802", "7k2m-9qxd")
    ]  # as it comes from a keyboard: shown in capitals, and taken either way
    assert turned_to == ["tcp://robot:47800"]
    assert "Paired, as operator" in shown.item("pairSaid").property("text")


def test_what_is_wrong_with_a_code_or_was_declined_stands_below_it(robot, show):
    robot.reachable = False
    shown = show()

    def decline(endpoint: str, code: str) -> Accepted:
        raise PairingError("the robot declined: 2 tries left")

    shown.desk.pairing.pair_with = decline
    shown.until(lambda: shown.item("firstContact").isVisible())
    type_in(shown, "pairCode", "7K")
    shown.press("pair")
    shown.until(lambda: "expected eight digits" in shown.item("pairSaid").property("text"))
    type_in(shown, "pairCode", "7K2M-9QXD")
    shown.press("pair")
    shown.until(lambda: "2 tries left" in shown.item("pairSaid").property("text"))
    assert shown.item("pair").isEnabled()


def test_the_window_turns_to_another_robot_and_leaves_the_one_before(robot, show, behind):
    from handrail.link import keys
    from tablet_client.line import Line

    behind.open_gate()
    shown = show()
    robot.reachable = False  # to the session that the window began with
    shown.until(lambda: shown.desk.situation.link.state == "lost" or shown.desk.situation.link.tries)
    shown.session.close()
    line = Line(shown.opened, "Ada", guarded=False)
    own = keys.for_client(behind.folder / "k")
    line.turn_to("tcp://127.0.0.1:9", own)
    line.turn_to(f"tcp://127.0.0.1:{behind.port}", own)
    shown.until(lambda: shown.desk.situation.link.attached)
    assert shown.desk.header["address"] == f"tcp://127.0.0.1:{behind.port}"
    shown.desk.stop()
    shown.until(lambda: behind.stops)
    line.close()
