"""Things with joints in a scene: springs, latches, threads, friction; the scenes of the library."""

from __future__ import annotations

import math

import pytest

from hal.plant.likeness import Likeness
from hal.plant.scene import Linkage, library, load
from hal.plant.world import World
from handrail.config import ConfigError


@pytest.fixture
def world_of(robot):
    worlds = []

    def make(scene: str) -> World:
        worlds.append(World(robot, load(scene)))
        return worlds[-1]

    yield make
    for world in worlds:
        world.close()


def pushed(world: World, joint: str, effort: float, steps: int = 300) -> float:
    """Where a linkage's joint is after so many ms of `effort` N·m (N) from outside."""
    thing, _, name = joint.partition(".")
    linkage = world.linkage(thing)
    for _ in range(steps):
        linkage.pushes[name] = effort
        world.step(felt=False)
    linkage.pushes.clear()
    return world.hinge_angle(joint)


def test_a_door_stays_shut_until_its_handle_is_down(world_of):
    world = world_of("door")
    assert pushed(world, "door.hinge", 20.0) < math.radians(2)
    world.set_hinge_angle("door.latch", 0.6)
    linkage = world.linkage("door")
    for _ in range(300):
        linkage.pushes.update(latch=3.0, hinge=20.0)  # somebody holds it down
        world.step(felt=False)
    assert world.hinge_angle("door.hinge") > math.radians(15)
    linkage.pushes.clear()
    world.advance(300)
    assert world.hinge_angle("door.latch") < 0.05, "its spring turns the handle back"


def test_a_joint_with_a_latch_at_either_end_is_held_at_both(world_of, tmp_path):
    text = library()["door"].read_text()
    one = "{holds: hinge, freed_by: latch"
    assert text.count(one) == 1
    file = tmp_path / "door.yaml"
    file.write_text(text.replace(one, f"{one}, beyond: 0.5, at: 1.0}}, {one}"))
    world = world_of(str(file))
    assert pushed(world, "door.hinge", 20.0) < math.radians(2)
    world.set_hinge_angle("door.hinge", 1.0)
    assert pushed(world, "door.hinge", 20.0) == pytest.approx(1.0, abs=0.03)


def test_a_button_gives_way_and_comes_back(world_of):
    world = world_of("button_panel")
    assert pushed(world, "panel.press_2", 2.0) < 5e-4, "its spring is under 3 N already"
    assert pushed(world, "panel.press_2", 5.0) == pytest.approx((5.0 - 0.3) / 800 - 0.004, abs=5e-4)
    assert pushed(world, "panel.press_2", 20.0) == pytest.approx(0.006, abs=3e-4)
    world.advance(300)
    assert abs(world.hinge_angle("panel.press_2")) < 5e-4
    assert abs(world.hinge_angle("panel.press_1")) < 5e-4


def test_a_cap_rises_on_its_thread_as_it_turns(world_of):
    world = world_of("cap")
    turned = pushed(world, "canister.thread", 0.6, 400)
    assert turned > math.radians(90)
    assert world.hinge_angle("canister.rise") == pytest.approx(0.003 * turned / (2 * math.pi), abs=2e-4)
    assert pushed(world, "canister.thread", 0.1, 200) == pytest.approx(world.hinge_angle("canister.thread"))


def test_a_lever_is_held_by_friction(world_of):
    world = world_of("lever_valve")
    assert abs(pushed(world, "valve.stem", 1.5)) < 1e-3
    assert pushed(world, "valve.stem", 4.0) > 0.2


@pytest.mark.parametrize(("scene", "thing"), [("cylinder", "can"), ("drill", "drill"), ("box", "box")])
def test_what_is_loose_stands_where_it_was_put(world_of, scene, thing):
    world = world_of(scene)
    before = world.truth().poses_in_world[thing]
    world.advance(400)
    after = world.truth().poses_in_world[thing]
    assert after.position == pytest.approx(before.position, abs=4e-3)
    assert abs(after.orientation[3]) > 0.999


def test_cameras_see_joints_where_the_truth_has_them(robot, world_of):
    world = world_of("door")
    world.set_hinge_angle("door.hinge", 0.5)
    truth = world.truth()
    assert truth.hinges == {"door.hinge": pytest.approx(0.5), "door.latch": pytest.approx(0.0)}
    likeness = Likeness(robot, load("door"))
    likeness.show(truth)
    assert likeness.hinge_angle("door.hinge") == pytest.approx(0.5)
    likeness.close()


def test_every_scene_of_the_library_loads():
    scenes = {name: load(name) for name in library()}
    assert sum(isinstance(thing, Linkage) for scene in scenes.values() for thing in scene.objects.values()) >= 6


@pytest.mark.parametrize(
    ("was", "becomes", "field", "says"),
    [
        ("parent: hinge", "parent: leaf", "objects.door.links.latch.parent", "expected one of hinge, latch"),
        ("parent: hinge", "parent: latch", "objects.door.links.latch.parent", "carries itself"),
        ("hinge:", "base:", "objects.door.links.base", "not base"),
        ("freed_by: latch", "freed_by: key", "objects.door.latches[0].freed_by", "expected one of"),
        ("lower: 0, upper: 1.91986", "lower: 2, upper: 1.9", "objects.door.links.hinge.joint.upper", "more than lower"),
        ("size: [0.04, 0.5, 1]", "size: [0.04, 0.5]", "objects.door.links.hinge.shapes[0].size", "a box has 3"),
        ("axis: [0, 0, 1]", "axis: [0, 0, 0]", "objects.door.links.hinge.joint.axis", "no direction"),
        ("stiffness: 1", "stiffness: -1", "objects.door.links.latch.joint.stiffness", ">= 0"),
    ],
)
def test_a_wrong_linkage_is_told_line_field_and_expectation(tmp_path, was, becomes, field, says):
    text = library()["door"].read_text()
    assert was in text
    file = tmp_path / "door.yaml"
    file.write_text(text.replace(was, becomes, 1))
    with pytest.raises(ConfigError) as caught:
        load(file)
    assert caught.value.field.startswith(field.rpartition(".")[0]) and says in str(caught.value), str(caught.value)
    assert caught.value.line
