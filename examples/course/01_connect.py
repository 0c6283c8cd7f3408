"""Who is there, and how it is: connect, ask, leave."""

import handrail

with handrail.connect() as robot:
    info = robot.robot()
    print(f"{info.name} at {robot.address}: {len(info.joints)} joints, arms {', '.join(info.arms)}")

    status = robot.status()
    drives = {drive.state for drive in status.drives}
    print(f"{status.clock} clock, {'enabled' if status.enabled else 'not enabled'}, drives {', '.join(sorted(drives))}")

    for entry in robot.library().entries:
        print(f"{entry.kind:9} {entry.name:15} {entry.problem or entry.title}")
