"""Motions to goals: joints, postures, poses; one more key frame on the way; executed and followed to its end."""

import math

import handrail
from handrail.messages import ActionEvent, FrameGoal, Pose, PostureGoal


def execute(robot: handrail.Client, plan: str) -> str:
    """How the plan's last segment ended."""
    with robot.events(ActionEvent) as actions:
        robot.execute_plan(plan)
        return next(event.outcome for event in actions if event.state == "ended")


with handrail.connect() as robot:
    robot.enable()
    tip = robot.robot().tips["left"]
    there = FrameGoal(frame=tip, pose=Pose(position=(0.45, 0.30, 0.30)), angle=math.pi)  # however it is turned
    plan = robot.plan_motion([there], "left")
    print(f"reach: {plan.duration:.1f} s, clearance {plan.clearance * 1000:.0f} mm")

    higher = FrameGoal(frame=tip, pose=Pose(position=(0.40, 0.35, 0.40)), angle=math.pi)
    edited = robot.edit_plan(plan.id, [higher], time=plan.duration / 2)
    print(f"over a key frame at {edited.key_times[0]:.1f} s: {edited.duration:.1f} s;", execute(robot, edited.id))

    home = robot.plan_motion([PostureGoal(name="ready")], "left")
    print("home again:", execute(robot, home.id))
