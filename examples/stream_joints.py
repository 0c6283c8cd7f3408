"""Streams joint references to the robot that is up and enabled, a hundred a second: python examples/stream_joints.py"""

import math
import time

from handrail import messages as m
from handrail.runtime import Runtime
from handrail.topics import Caller, Subscriber


def swing(runtime: Runtime, joint: str, samples: int = 500, every: float = 0.01) -> None:
    """Swing a joint by 0.2 rad and back, every 2 s, from where it is commanded to be."""
    robot, states = Caller(runtime.endpoint("daemon.call")), Subscriber(runtime.endpoint("daemon.events"), m.RobotState)
    home = states.receive().command[robot.call(m.GetRobot()).joints.index(joint)]
    robot.call(m.StartAction(id="swing", owner="me", motion=m.JointStream(joints=[joint], expiry=0.5)))
    for number in range(1, samples + 1):
        phase = math.pi * number * every
        position, velocity = home + 0.1 * (1 - math.cos(phase)), 0.1 * math.pi * math.sin(phase)
        robot.call(m.StreamJoints(id="swing", sequence=number, positions=[position], velocities=[velocity]))
        time.sleep(every)
    robot.call(m.CancelAction(id="swing"))


if __name__ == "__main__":
    swing(Runtime.at(), "arm_right_4_joint")
