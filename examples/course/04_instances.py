"""Templates in the world: place one, move it, change it, look, take it away."""

import handrail
from handrail.messages import Pose

with handrail.connect() as robot:
    for instance in robot.instances():
        robot.remove_instance(instance.name)

    placed = robot.place_instance("guess", "wheel", Pose(position=(0.60, -0.30, 0.25)), {"spokes": 4})
    print(f"{placed.name}: version {placed.version}, radius {placed.parameters['radius']} m")

    moved = robot.move_instance("guess", Pose(position=(0.56, -0.34, 0.29)))
    print(f"moved: version {moved.version}")
    try:
        robot.set_parameters("guess", {"spokes": 40})
    except handrail.client.RefusedError as refused:  # field, value and what was expected; nothing has changed
        print("refused:", refused)

    # Several operators may edit one instance: each changes the fields that he names, and takes back his own.
    robot.hold_instance("guess")  # nobody else moves it now; all until it is released is one step to undo
    for x in (0.57, 0.58, 0.59):
        edited = robot.edit_instance("guess", position=(x, -0.34, 0.29), base=moved.version)
    robot.release_instance("guess")
    print(f"dragged: {edited.fields} changed, over others' newer values: {edited.overwrote or 'none'}")
    print("undone:", robot.undo_instances().instance.pose_in_world.position)
    print("done again:", robot.redo_instances().instance.pose_in_world.position)

    # An instance goes along with another one, or with a link of the robot, as once it is grasped.
    robot.place_instance("mark", "box", Pose(position=(0.60, -0.30, 0.45)), source="lesson 4")
    robot.attach_instance("mark", instance="guess")
    robot.move_instance("guess", Pose(position=(0.60, -0.30, 0.25)))
    print("went along:", next(each for each in robot.instances() if each.name == "mark").pose_in_world.position)
    robot.attach_instance("mark")  # it stands in the world again, where it is
    robot.remove_instance("mark")

    robot.remove_instance("guess")
    robot.place_instance("crate", "box", Pose(position=(0.55, -0.30, 0.10)))
    for waypoint in robot.reach("crate", "grasp", "right").waypoints:
        print(f"  the right hand at {waypoint.name}: {waypoint}")
    # Goes on while it is dragged: each tells of which version it is.
    for told in robot.watch_reach("crate", "grasp", "right"):
        far = [waypoint.name for waypoint in told.waypoints if waypoint.state == "not"]
        print(f"version {told.version}: out of reach: {', '.join(far) or 'nothing'}")
        if far:
            break
        robot.move_instance("crate", Pose(position=(1.55, -0.30, 0.10)))
    robot.remove_instance("crate")
    robot.place_instance(
        "wheel_1", "wheel", Pose(position=(0.55, -0.35, 0.30))
    )  # where the valve is: for the lessons to come
    print("in the world:", ", ".join(instance.name for instance in robot.instances()))
