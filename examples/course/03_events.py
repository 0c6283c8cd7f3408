"""Being told instead of asking: a stream to read from, and a reaction in a thread of its own."""

import threading

import handrail
from handrail.messages import DaemonStatus, RobotState

with handrail.connect() as robot:
    names = robot.robot().joints
    with robot.events(RobotState) as states:  # of measurements the newest waits, not all that came
        for _ in range(3):
            state = states.next(timeout_s=10.0)
            print(f"{state.time_ns / 1e9:8.3f} s  {names[0]} {state.position[0]:+.4f} rad")

    enabled = threading.Event()
    watching = robot.on(DaemonStatus, lambda status: enabled.set() if status.enabled else None)
    robot.enable()
    assert enabled.wait(10.0)
    watching.close()
    print("told that it is enabled")
