"""How real channels' controllers fare, from whoever tells it, to people. No hardware: a stand-in for iproute2, and for drivers."""

from __future__ import annotations

import io
import json
import sys
import threading
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import can
import pytest
from rich.console import Console

from daemon.state import bus_watch
from daemon.state.bus_watch import BusWatch
from hal.can import bus_check, bus_table, real_port
from hal.can.bus_check import Survey
from hal.can.controller_state import ControllerState, of_bus, of_link
from hal.can.listening import ListenedBus
from handrail.robot.description import Channel
from handrail.runtime import Runtime


def _said(state: str, **counters: int) -> str:
    """As iproute2 6.1 prints it."""
    data = {"state": state, **({"berr_counter": counters} if counters else {})}
    return json.dumps([{"ifname": "can0", "linkinfo": {"info_kind": "can", "info_data": data}}])


@pytest.mark.parametrize(
    ("said", "state"),
    [
        (_said("ERROR-ACTIVE", tx=0, rx=3), ControllerState("error_active", 0, 3)),
        (_said("ERROR-WARNING", tx=100, rx=0), ControllerState("error_active", 100, 0)),
        (_said("ERROR-PASSIVE", tx=136, rx=0), ControllerState("error_passive", 136, 0)),
        (_said("BUS-OFF"), ControllerState("bus_off")),
        ('[{"ifname": "vcan0", "linkinfo": {"info_kind": "vcan"}}]', None),
        ("", None),
        ("no JSON", None),
    ],
)
def test_what_ip_says_of_a_network_interface_is_its_controllers_state(said: str, state: ControllerState | None) -> None:
    assert of_link("can0", lambda name: said) == state


def test_python_cans_state_is_believed_only_where_it_is_the_controllers() -> None:
    def told(interface: str, state: can.BusState | None) -> ControllerState | None:
        return of_bus(SimpleNamespace(state=state), interface, "0")  # type: ignore[arg-type]

    assert told("etas", can.BusState.PASSIVE) == ControllerState("error_passive")
    assert told("ixxat", can.BusState.ERROR) == ControllerState("bus_off")
    assert told("ixxat", can.BusState.PASSIVE) is None, "it was opened to listen"
    assert told("pcan", can.BusState.ACTIVE) is None, "it says how it was opened"
    assert told("etas", None) is None


@pytest.fixture
def ip(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """Says what the file beside it holds, for every interface but can9."""
    program, said = tmp_path / "ip", tmp_path / "said"
    lacking = "import sys\nif sys.argv[-1] == 'can9': sys.exit('Device \"can9\" does not exist.')\n"
    program.write_text(f"#!{sys.executable} -IS\n{lacking}print(open({str(said)!r}).read())\n")
    program.chmod(0o755)
    said.write_text(_said("ERROR-PASSIVE", tx=136, rx=2))
    monkeypatch.setenv("PATH", str(tmp_path))
    return said


def test_stats_of_a_real_bus_show_this_computers_controller(ip: Path) -> None:
    bus = real_port.open_bus("virtual", "told", 1_000_000, 5_000_000)
    heard = ListenedBus(bus, "told", 1_000_000, 5_000_000, "socketcan")
    report = heard.report()
    heard.close()
    assert [(n.name, n.state, n.transmit_errors, n.receive_errors) for n in report.nodes] == [
        ("this computer", "error_passive", 136, 2)
    ]
    console = Console(width=120, record=True, file=io.StringIO())
    report.nodes[0].transmit_errors = report.nodes[0].receive_errors = None
    console.print(bus_table.tables(report, None, lambda can_id, extended: ""))
    assert "error passive    -    -" in console.export_text()


def test_the_daemons_status_has_the_state_of_its_network_interfaces_while_they_are_there(
    ip: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(bus_watch, "_PERIOD_S", 0.02)
    looked = threading.Semaphore(0)
    of_link = bus_watch.of_link

    def heard(*link: Any) -> Any:
        looked.release()
        return of_link(*link)

    monkeypatch.setattr(bus_watch, "of_link", heard)
    channels = [
        Channel(name="left", interface="socketcan", channel="can0", bitrate=1_000_000, data_bitrate=5_000_000),
        Channel(name="gone", interface="socketcan", channel="can9", bitrate=1_000_000, data_bitrate=5_000_000),
        Channel(name="usb", interface="pcan", bitrate=1_000_000, data_bitrate=5_000_000),
    ]
    watch = BusWatch(Runtime.at(tmp_path / "robot"), channels)

    def wait_for(states: dict[str, str]) -> None:
        for _ in range(50):
            if watch.states() == states:
                return
            assert looked.acquire(timeout=10.0)
        assert watch.states() == states

    wait_for({"left": "error_passive"})
    ip.write_text("[]")  # its adapter is unplugged
    wait_for({})
    watch.close()


def test_a_check_says_what_to_do_about_a_controller_in_trouble() -> None:
    channel = SimpleNamespace(name="can0", interface="socketcan", bitrate=1_000_000, data_bitrate=5_000_000)
    limb = SimpleNamespace(name="arm", channel="can0", joints=("a", "b"))
    robot = SimpleNamespace(channels=[channel], limbs=[limb], devices=[])
    found = Survey(missing=["b"], controllers={"can0": ControllerState("error_passive", 136, 0)})
    said = bus_check.refusal(robot, found)
    assert said.startswith(
        "no answer from b of limb arm on channel can0 (socketcan): this computer's controller is error passive"
    )
    assert "(TEC 136, REC 0): nobody acknowledges its frames" in said
    port = real_port.CanPort(
        [SimpleNamespace(name="one", interface="virtual", bitrate=1_000_000, data_bitrate=5_000_000)]
    )
    assert port.states == {"one": None}
    port.close()
