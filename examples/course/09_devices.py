"""The power supply, and grippers where the robot has some (talos_upper_grippers)."""

import handrail
from handrail.messages import DeviceStates

with handrail.connect() as robot, robot.events(DeviceStates) as told:
    devices = told.next(timeout_s=10.0)
    for gripper in devices.grippers:
        robot.enable()
        robot.command_gripper(gripper.name, position=gripper.position / 2, effort=1.0)
    for power in devices.powers:
        print(f"{power.name}: {power.voltage:.1f} V, {power.current:.1f} A")
        robot.disable()  # an enabled robot's power is refused, unless `force` says that it is meant
        robot.switch_relay(power.name, closed=False)
        next(now for now in told for supply in now.powers if supply.name == power.name and not supply.relay)
        robot.switch_relay(power.name, closed=True)
        next(now for now in told for supply in now.powers if supply.name == power.name and supply.relay)
        print(f"{power.name}: opened and closed")
