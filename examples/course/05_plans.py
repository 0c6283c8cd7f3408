"""One stroke at the wheel: which arm and where, planned, looked at, executed slowly, followed to its end."""

import handrail
from handrail.messages import ActionEvent, PlanProgress, PostureGoal


def execute(robot: handrail.Client, plan: str, segments: list[str]) -> str:
    """How the last of the segments ended."""
    with robot.events(ActionEvent) as actions:
        robot.execute_plan(plan, segments)
        return next(event.outcome for event in actions if event.state == "ended")


with handrail.connect() as robot:
    robot.enable()
    with robot.events(PlanProgress) as progress:
        best, *others = robot.rank_choices("wheel_1", "turn", ["right", "left"])
        print(f"best of {1 + len(others)}: the {best.arm} arm, {100 * best.share:.0f} % feasible")
        for step in progress.drain():
            print("  told meanwhile:", step.doing)

    plan = robot.plan("wheel_1", "turn", best.arm, arc=best.arc)
    for waypoint in plan.waypoints:
        print(f"  {waypoint.name:10} {waypoint.time:5.2f} s, clearance {waypoint.clearance}")
    whole = robot.get_plan(plan.id, details=True)
    print(f"fresh: {whole.fresh}, {whole.duration:.1f} s, {len(whole.tool)} places of the tool's tip")

    robot.cancel_planning()  # ends what other clients wait for, too; nothing plans now
    robot.set_speed(0.5)
    print("approach:", execute(robot, plan.id, ["approach"]))
    robot.set_speed(1.0)
    print("and now the plan is stale:", robot.get_plan(plan.id).stale_because)

    home = robot.plan_motion([PostureGoal(name="ready")], best.arm)
    print("back home:", execute(robot, home.id, []))
