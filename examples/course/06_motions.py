"""Motions to goals: joints, postures, poses; one more key frame on the way; the next planned while one moves; a jog, and home."""

import math

import handrail
from handrail.messages import AwaitPlan, FrameGoal, Pose, PostureGoal

with handrail.connect() as robot:
    robot.enable()
    tip = robot.robot().tips["left"]
    there = FrameGoal(frame=tip, pose=Pose(position=(0.45, 0.30, 0.30)), angle=math.pi)  # however it is turned
    plan = robot.plan_motion([there], "left")
    print(f"reach: {plan.duration:.1f} s, clearance {plan.clearance * 1000:.0f} mm")

    higher = FrameGoal(frame=tip, pose=Pose(position=(0.40, 0.35, 0.40)), angle=math.pi)
    edited = robot.edit_plan(plan.id, [higher], time=plan.duration / 2)
    print(f"over a key frame at {edited.key_times[0]:.1f} s: {edited.duration:.1f} s")
    print("taken back, it would be as before:", robot.undo_edit(edited.id).key_times)

    robot.execute_plan(edited.id)  # has begun; meanwhile the next one is planned from where it will end
    home = robot.plan_motion([PostureGoal(name="ready")], "left", after=edited.id)
    robot.call(AwaitPlan(id=edited.id))
    print("fresh once that was executed:", robot.get_plan(home.id).fresh)
    robot.execute_plan(home.id, wait=True)  # refused here, with the reason, if it ended otherwise
    print("home again: done")

    before = robot.jog(
        {"head_1_joint": 0.2}, by=True, speed=0.3
    )  # nobody plans this: the guard alone knows what is in the way
    print(f"the head is turned to {before['head_1_joint']:.2f} rad")
    print(f"all of it home: {robot.home().duration:.1f} s")
