"""What clients must know of the robot."""

from __future__ import annotations

from handrail.messages import RobotInfo
from handrail.robot.description import RobotDescription


def robot_info(description: RobotDescription) -> RobotInfo:
    """Names, limits in rad (m), rad/s and N·m, in the robot's order of joints."""
    return RobotInfo(
        name=description.name,
        joints=list(description.joints),
        lower=description.lower.tolist(),
        upper=description.upper.tolist(),
        velocity_limit=description.velocity_limit.tolist(),
        torque_limit=description.torque_limit.tolist(),
        groups={name: list(joints) for name, joints in description.groups.items()},
        tools={name: arm.tool for name, arm in description.arms.items()},
        tips={name: arm.tip for name, arm in description.arms.items()},
        arms={name: list(arm.joints) for name, arm in description.arms.items()},
        home=description.home,
        period_ns=description.period_ns,
    )
