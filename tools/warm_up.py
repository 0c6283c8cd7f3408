"""Compiles every numba kernel into its cache, so that the first start of a robot is as quick as the second.

Run by `make setup`, and again whenever a file with kernels changed: only what changed is compiled. What is stored of functions that
are no more is deleted.
"""

from __future__ import annotations

import tempfile
import threading
from concurrent.futures import ProcessPoolExecutor
from multiprocessing import get_context
from pathlib import Path

ROOT, ROBOT, FREE = Path(__file__).resolve().parent.parent, "talos_upper", "talos"


def main() -> None:
    with ProcessPoolExecutor(mp_context=get_context("spawn")) as processes:
        for part in [processes.submit(compile_part) for compile_part in (_robot, _arms, _base)]:
            part.result()
    for package in ("hal", "daemon", "engines"):
        delete_leftovers(ROOT / package)
    print("kernels compiled")


def delete_leftovers(package: Path) -> None:
    """What was compiled of functions that no source has any longer; of the others handrail.compiled keeps one version."""
    for stored in package.rglob("__pycache__/*.nb[ic]"):
        module, function, *_ = stored.name.split(".")
        source = stored.parent.parent / f"{module}.py"
        if not source.exists() or f"def {function}(" not in source.read_text():
            stored.unlink()


def _robot() -> None:
    """What bus, drives, plant and loop are made of."""
    import numpy as np

    from daemon.warm_up import warm_up
    from hal.can import frames
    from hal.can.codec import Codec
    from hal.can.hub import Hub
    from hal.can.port import HubPort
    from hal.drives import DBC_FILES
    from hal.drives.crc import crc_of
    from hal.drives.protocol import LimbProtocol
    from hal.hardware import Hardware
    from hal.joint import JointCommand
    from hal.plant import service
    from hal.plant.bus_node import BusNode
    from hal.plant.scene import load
    from hal.plant.world import World
    from handrail.robot import library as robots
    from handrail.robot.kinematics import Kinematics

    description = robots.load(ROBOT)
    protocol = LimbProtocol(description)
    warm_up(Kinematics(description))
    with tempfile.TemporaryDirectory(prefix="hr") as folder:
        hub = Hub(Path(folder) / "bus.sock", description.channels)
        joined = threading.Event()
        serving = threading.Thread(target=lambda: [hub.poll(0.05) for _ in iter(joined.is_set, True)])
        serving.start()
        try:
            Hardware(description, HubPort(Path(folder) / "bus.sock"), protocol).close()
        finally:
            joined.set()
            serving.join()
            hub.close()
    service.warm_up(description, load("valve"))
    node, records = BusNode(World(description, load("valve"))), frames.empty(protocol.frames_a_cycle)
    node.receive(records[: protocol.encode_commands(JointCommand(len(protocol.joints)), 0, 20, records)])
    node.answer()

    codec, crc = Codec.from_file(DBC_FILES["limb_fd"]), np.zeros(8, np.uint64)
    codec.decode("Sync", codec.encode("Sync", np.zeros((1, 1)), records))
    crc_of(crc, 0, 0, 8, 0)


def _base() -> None:
    """What estimates where a free base is."""
    from daemon.state.estimator import BaseEstimator
    from hal.device import DeviceState
    from hal.joint import JointState
    from handrail.robot import library as robots
    from handrail.robot.kinematics import Kinematics

    description = robots.load(FREE)
    joints, devices = JointState(len(description.joints)), DeviceState(len(description.devices))
    BaseEstimator(Kinematics(description), joints, devices, description.period_ns * 1e-9).update(0)


def _arms() -> None:
    """What whole-body control and the planner are made of: in one process, since both need much of numba's own library compiled."""
    _whole_body()
    _planner()


def _whole_body() -> None:
    from daemon.wbc import moving
    from daemon.wbc.hierarchy import WholeBody
    from daemon.wbc.model import WholeBodyModel
    from handrail.robot import library as robots
    from handrail.robot.kinematics import Kinematics

    WholeBody(WholeBodyModel.of(Kinematics(robots.load(ROBOT))), []).warm_up()
    moving.warm_up(1)


def _planner() -> None:
    import numpy as np

    from engines.planning.collision.sweep import Sweep
    from engines.planning.collision.world import World
    from engines.planning.ik.constraints import Clearance
    from engines.planning.ik.mechanism import Mechanism
    from engines.planning.ik.solver import Solver
    from engines.planning.strokes.manipulation import ManipulationPlanner
    from handrail.robot import library as robots
    from handrail.robot.kinematics import Kinematics

    description = robots.load(ROBOT)
    kinematics = Kinematics(description)
    ManipulationPlanner(description, kinematics)
    mechanism = Mechanism.of(kinematics)
    anywhere, world = mechanism.configuration(np.zeros(len(mechanism.joints))), World(mechanism)
    Solver(mechanism).solve([Clearance(scene=world)], anywhere)
    Sweep(world).nearest(anywhere)


if __name__ == "__main__":
    main()
