"""A run in the hands of whoever supervises it: breakpoints, steps, pauses, ways chosen by hand, parameters, autonomy."""

from collections.abc import Callable

import handrail
from handrail.messages import Pose, Prompt, RunState

with handrail.connect() as robot, robot.events(RunState, Prompt) as events:

    def until(wanted: Callable[[RunState], bool]) -> RunState:
        """The first state of the run that is wanted; what the program asks meanwhile is approved."""
        for event in events:
            if isinstance(event, Prompt):
                robot.answer(event.id, event.options[0], by="lesson 8")
            elif wanted(event):
                print(f"{event.status:9} {'/'.join(event.active)} {event.detail}")
                return event
            elif event.status == "failed":
                raise SystemExit(f"{event.program} failed: {event.detail}")
        raise SystemExit("the connection was closed")

    robot.enable()
    robot.set_autonomy("full")  # transitions that name a level are not asked about
    robot.set_breakpoints(["planning_next"])
    robot.run(robot.deploy("turn_valve", {"arm": "right", "valve": "wheel_1"}, {"goal_deg": 285}))
    until(lambda run: run.active[-1:] == ["stroking"])
    robot.pause_run()  # the motion stops along its path ...
    until(lambda run: run.status == "paused")
    robot.resume_run()  # ... and goes on
    until(lambda run: run.status == "paused" and "planning_next" in run.waiting)

    robot.set_breakpoints([])
    robot.step_run()  # the breakpoint's state plans; what comes after it waits
    paused = until(lambda run: run.status == "paused" and "stroking" in run.waiting)
    robot.set_run_parameters({"goal_deg": 5})  # counts from its next use: this stroke will do
    robot.resume_run()
    until(lambda run: run.status == "succeeded")

    robot.run_from("counting")  # once more from there, with what the run remembers
    until(lambda run: run.status == "succeeded")

    robot.run_from("confirming", paused=True)
    robot.take_transition("confirming", 1)  # its second way out: rejected
    until(lambda run: run.status == "failed")

    # A run that pauses where it fails waits for help: see to the cause and resume, skip the state, or let it fail.
    robot.place_instance("valve_far_off", "wheel", Pose(position=(3.0, 0.0, 1.0)))
    far = robot.deploy("turn_valve", {"arm": "right", "valve": "valve_far_off"})
    robot.run(far, on_failure="pause")
    waiting = until(lambda run: bool(run.failing))  # no plan leads there
    robot.let_fail(next(iter(waiting.failing)))  # the program goes its own way
    until(lambda run: run.status == "failed")

    robot.run_from("planning", paused=True)
    robot.skip("planning")  # as though it were done
    until(lambda run: "confirming" in run.active)
    robot.stop_run()  # whatever moves stops; the robot holds
    until(lambda run: run.status == "stopped")
    robot.remove_instance("valve_far_off")

    # A template alone: its trajectory is a program of its own, which goes one waypoint on, or back, at a time.
    robot.place_instance("crate", "box", Pose(position=(0.55, 0.35, 0.10)))
    print(robot.expand_template("crate", "push", "left").text)  # a file to save and to change
    robot.run_template("crate", "push", "left", steps=1)
    until(lambda run: run.status == "succeeded")
    robot.remove_instance("crate")
