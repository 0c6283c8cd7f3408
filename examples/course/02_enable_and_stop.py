"""Into operation, stopped by the operator, back, and out of operation. Nothing here moves the robot."""

import handrail

with handrail.connect() as robot:
    robot.enable()  # returns when every drive holds
    print("enabled:", robot.status().enabled)

    robot.stop("lesson 2")  # every drive quick-stops, and the stop latches
    try:
        robot.enable()
    except handrail.client.RefusedError as refused:
        print("refused:", refused)

    robot.clear_stop()  # nothing moves by that: enabling is a step of its own
    robot.enable()
    robot.disable()
    print("enabled:", robot.status().enabled)
