"""A program, from its deployment to its history; whoever answers its questions is told about them."""

import handrail
from handrail.messages import Prompt, RunState

with handrail.connect() as robot:
    robot.enable()
    deployment = robot.deploy("turn_valve", {"arm": "right", "valve": "wheel_1"}, {"goal_deg": 60})
    print("its states:", ", ".join(state.id for state in robot.outline(deployment).states))
    check = robot.check_task(deployment)  # rehearsed whole, before anything moves
    print("rehearsed:", "feasible" if check.feasible else check.detail)

    with robot.events(RunState, Prompt) as events:
        robot.run(deployment)
        for event in events:
            if isinstance(event, Prompt):
                print("asked:", event.text)
                robot.answer(event.id, "approve", by="lesson 7")
            elif event.status in ("succeeded", "failed", "stopped"):
                print(f"{event.status}: {event.detail}")
                break

    *passed, end = robot.run_history().visits
    for visit in passed:
        print(f"  {visit.state:15} {(visit.left_ns - visit.entered_ns) / 1e9:6.2f} s  {visit.event}")
    print(f"  {end.state:15} is where it ended")
    print("kept for whoever comes late:", [plan.label for plan in robot.snapshot().plans])
