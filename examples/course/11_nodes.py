"""Process nodes of the engine: started beside the program, given inputs, watched, ended."""

import handrail

with handrail.connect() as robot:
    robot.start_node("low_pass", name="smooth", params={"cutoff": 5.0})
    for k in range(5):
        robot.put_node("smooth", {"wrench": [3.0 * k, 0, 0, 0, 0, 0], "time": 0.02 * k}, step=True)
    (node,) = (each for each in robot.nodes() if each.name == "smooth")
    for port in node.ports:
        print(f"{port.way:9} {port.name:8} {port.value} {port.unit}")
    robot.reload_node("smooth")  # nothing has changed: it goes on
    for value in robot.watch_port("smooth", "force", rate=10.0):
        print(f"smoothed force: {value.value:.2f} N, of {value.count} values")
        break
    robot.stop_node("smooth")

    # A node of one's own, made of one that comes with Handrail; saved once more under that name, `was` says what was edited.
    there = next(each for each in robot.node_library() if each.name == "low_pass")
    text = robot.node_source(there.name).text.replace("class LowPass", "class Smoother")
    if not any(each.name == "smoother" for each in robot.node_library()):
        release = robot.save_node("smoother", text, note="lesson 11")
        print(f"release {release.number}: {', '.join(release.changed)}")
