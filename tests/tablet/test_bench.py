"""Editing template instances: what is sent when, what is shown meanwhile, what can be taken back. Without a screen."""

from __future__ import annotations

import math

import msgspec
import pytest

from affordance_templates.instance import Instance
from affordance_templates.server import AffordanceServer
from handrail.messages import (
    EditInstance,
    GetEngine,
    GetReach,
    GetRobot,
    HoldInstance,
    InstanceEdit,
    PlaceInstance,
    Pose,
    Reach,
    RedoEdit,
    ReleaseInstance,
    RemoveInstance,
    UndoEdit,
    WaypointReach,
)
from tablet_client.models import arrivals
from tablet_client.models.situation import Situation


@pytest.fixture
def situation(robot) -> Situation:
    """Attached, with a wheel that is selected."""
    made = Situation("tcp://somewhere:47800")
    made.take(arrivals.Attached(robot.answer(GetRobot()), robot.status()))
    robot.instances = [robot.wheel()]
    made.take(arrivals.EngineAttached(robot.answer(GetEngine())))
    made.bench.select("wheel_1")
    return made


def at(x: float) -> tuple[float, float, float]:
    return (x, 0.0, 0.3)


def carry(situation: Situation, robot, now: float) -> list:
    """Send what is due, and take the answers."""
    calls = [call for call in situation.bench.edits.want(now)]
    for call in calls:
        situation.take(arrivals.CallDone(call, robot.answer(call)))
    return calls


def test_of_a_drag_the_latest_place_is_sent_one_call_at_a_time_and_thirty_times_a_second_at_most(situation, robot):
    edits = situation.bench.edits
    edits.drag("wheel_1", position=at(0.49))
    assert carry(situation, robot, 0.0) == [HoldInstance(name="wheel_1")], "nobody else moves it before it is moved"
    edits.drag("wheel_1", position=at(0.50))
    (first,) = edits.want(0.0)
    for step in range(20):
        edits.drag("wheel_1", position=at(0.51 + step / 1000))
    assert edits.want(0.02) == [], "one is under way"
    situation.take(arrivals.CallDone(first, robot.answer(first)))
    assert edits.want(0.02) == [], "too soon after the one before"
    edits.drop("wheel_1")
    assert carry(situation, robot, 0.034) == [EditInstance(name="wheel_1", position=at(0.529))]
    assert carry(situation, robot, 0.07) == [ReleaseInstance(name="wheel_1")], "once the last place is there"
    assert not edits.waiting


def test_a_finger_that_rests_on_an_instance_goes_on_holding_it(situation, robot):
    edits = situation.bench.edits
    edits.drag("wheel_1", position=at(0.5))
    carry(situation, robot, 0.0)
    carry(situation, robot, 0.0)
    assert carry(situation, robot, 0.5) == [] and carry(situation, robot, 0.71) == [HoldInstance(name="wheel_1")]
    assert situation.bench.held_by("wheel_1") == "", "it is this operator"
    edits.drop("wheel_1")
    carry(situation, robot, 0.8)
    assert carry(situation, robot, 2.0) == [] and situation.world.instances["wheel_1"].held_by == ""


def test_what_somebody_else_holds_stays_and_is_told_whose_it_is(situation, robot):
    bench = situation.bench
    situation.take(robot.wheel(held_by="ben"))
    assert bench.held_by("wheel_1") == "ben"
    bench.edits.drag("wheel_1", position=at(0.7))
    (hold,) = bench.edits.want(0.0)
    situation.take(arrivals.CallFailed(hold, "wheel_1 is held by ben", refused=True))
    bench.edits.drag("wheel_1", position=at(0.8))
    assert bench.edits.want(1.0) == [] and bench.shown()["wheel_1"] == situation.world.instances["wheel_1"]
    bench.edits.drop("wheel_1")
    bench.edits.drag("wheel_1", position=at(0.9))
    assert bench.edits.want(2.0) == [HoldInstance(name="wheel_1")], "the next finger asks anew"


def test_what_is_dragged_is_shown_where_the_finger_is_before_the_robot_has_answered(situation, robot):
    bench = situation.bench
    bench.edits.drag("wheel_1", position=at(0.7))
    assert bench.shown()["wheel_1"].pose_in_world.position == at(0.7)
    assert situation.world.instances["wheel_1"].pose_in_world.position != at(0.7)
    carry(situation, robot, 0.0)
    (call,) = bench.edits.want(0.1)
    situation.take(arrivals.CallFailed(call, "somebody else drags it", refused=True))
    assert bench.shown()["wheel_1"] == situation.world.instances["wheel_1"]
    assert situation.journal.entries[-1].details == ("EditInstance", "somebody else drags it")


def test_undo_is_the_engines_and_leaves_when_all_of_a_drag_has_arrived(situation, robot):
    edits, before = situation.bench.edits, situation.world.instances["wheel_1"].pose_in_world
    for step in range(5):
        edits.drag("wheel_1", position=at(0.5 + step / 10))
        carry(situation, robot, float(step))
    edits.drop("wheel_1")
    edits.undo()
    sent = [call for step in range(4) for call in carry(situation, robot, 10.0 + step)]
    assert [type(call) for call in sent] == [EditInstance, ReleaseInstance, UndoEdit]
    assert situation.world.instances["wheel_1"].pose_in_world == before
    assert situation.journal.entries[-1].details == ("wheel_1, orientation", "ben has changed it")
    assert edits.can_redo
    edits.redo()
    assert edits.want(20.0) == [RedoEdit()]


def test_a_drag_and_its_undo_go_together_with_the_affordance_servers(situation, tmp_path):
    server, edits = AffordanceServer(tmp_path / "instances.json", changed=situation.take), situation.bench.edits
    before = Pose(position=(0.55, -0.35, 0.30))
    server.place(PlaceInstance(name="mine", template="wheel", pose_in_world=before))
    answers = {HoldInstance: server.hold, ReleaseInstance: server.release, EditInstance: server.edit}

    def answer(call):
        done = server.undo(call) if isinstance(call, UndoEdit) else answers[type(call)](call)
        return done.state() if isinstance(done, Instance) else done

    for step in range(9):
        if step < 5:
            edits.drag("mine", position=at(0.5 + step / 10))
        elif step == 5:
            assert situation.world.instances["mine"].held_by == "local" and server.get("mine").version == 5
            edits.drop("mine")
            edits.undo()
        for call in edits.want(step / 10):
            situation.take(arrivals.CallDone(call, answer(call)))
    assert server.get("mine").pose_in_world == before and server.get("mine").held_by == ""
    assert situation.world.instances["mine"].pose_in_world == before


def test_when_the_engine_knows_of_nothing_to_take_back_the_button_says_so_until_the_next_edit(situation, robot):
    edits = situation.bench.edits
    edits.undo()
    (call,) = edits.want(0.0)
    situation.take(arrivals.CallFailed(call, "nothing to undo", refused=True))
    assert not edits.can_undo
    edits.move("wheel_1", position=at(0.7))
    carry(situation, robot, 1.0)
    assert edits.can_undo and not edits.can_redo


def test_parameters_have_the_templates_bounds_units_and_words_and_are_changed_by_their_sliders(situation, robot):
    bench = situation.bench
    radius = next(each for each in bench.parameters if each.name == "radius")
    assert (radius.value, radius.low, radius.high, radius.unit) == (0.15, 0.08, 0.40, "m")
    assert radius.title == "from the shaft to the middle of the rim"
    assert next(each for each in bench.parameters if each.name == "spokes").step == 1.0
    for value in (0.16, 0.18, 0.2):
        bench.turn("radius", value)
    bench.edits.drop("wheel_1")
    assert carry(situation, robot, 0.0) == [EditInstance(name="wheel_1", parameters={"radius": 0.2})]
    assert next(each for each in bench.parameters if each.name == "radius").value == 0.2
    assert not bench.edits.waiting, "what was over before it was told needs no hold"


def test_numbers_are_millimetres_and_degrees_and_one_that_is_typed_leaves_the_others(situation, robot):
    bench = situation.bench
    assert bench.numbers == pytest.approx((550, -350, 300, 0, 0, 0))
    assert bench.put(0, 612.5) == "" and bench.put(5, 90.0) == ""
    assert bench.numbers == pytest.approx((612.5, -350, 300, 0, 0, 90))
    assert bench.put(1, math.nan) == "no_number"
    carry(situation, robot, 0.0)
    assert situation.world.instances["wheel_1"].pose_in_world.position == pytest.approx((0.6125, -0.35, 0.3))


def test_a_joint_that_is_looked_at_is_told_nobody(situation, robot):
    bench = situation.bench
    assert [each.name for each in bench.joints] == ["hinge"]
    before = bench.waypoints
    bench.look_at("hinge", 1.0)
    assert bench.shown()["wheel_1"].joint_state == {"hinge": 1.0} and bench.looked
    assert len(bench.waypoints) == len(before)
    assert bench.edits.want(0.0) == []
    bench.look_away()
    assert bench.shown()["wheel_1"].joint_state == {"hinge": 0.3}


def test_waypoints_stand_in_the_world_and_say_which_can_be_reached_while_it_is_asked_for(situation, robot):
    bench = situation.bench
    asked = [call for call in bench.want(0.0) if isinstance(call, GetReach)]
    assert [(each.instance, each.trajectory, each.arm) for each in asked] == [("wheel_1", "turn", "right")]
    assert not [call for call in bench.want(1.0) if isinstance(call, GetReach)]
    assert [call for call in bench.want(4.1) if isinstance(call, GetReach)], "asked anew before it ends"
    situation.take(arrivals.CallDone(asked[0], robot.answer(asked[0])))
    told = {each.name: each.reach.state if each.reach else None for each in bench.waypoints}
    assert (told["approach"], told["engage"], told["turn"], told["release"]) == ("reached", "near", "not", None)
    assert bench.waypoints[0].pose[:3, 3] == pytest.approx((0.40, -0.25, 0.30))
    bench.arm = "left"
    assert {each.reach for each in bench.waypoints} == {None}, "of another arm nothing is known yet"


def test_a_strokes_waypoints_stand_where_they_would_be_reached(situation):
    turned = WaypointReach(name="approach", state="reached", turned=math.pi / 2)
    situation.take(
        Reach(instance="wheel_1", version=1, trajectory="turn", arm="right", waypoints=[turned], settled=True)
    )
    approach, standoff, *_ = situation.bench.waypoints
    assert approach.pose[:3, 3] == pytest.approx((0.40, -0.35, 0.40)), "a quarter of a turn about the wheel's shaft"
    assert standoff.pose[:3, 3] == pytest.approx((0.47, -0.25, 0.30)), "of the others nothing is known"


def test_what_is_reached_by_an_arm_that_is_not_chosen_is_left_aside(situation):
    situation.take(
        Reach(instance="wheel_1", version=1, trajectory="turn", arm="left", waypoints=[], settled=True, problem="x")
    )
    assert situation.bench.reach_problem == ""
    situation.take(arrivals.CallFailed(GetReach(instance="wheel_1", trajectory="turn"), "no such arm", refused=True))
    assert situation.bench.reach_problem == "no such arm"


def test_a_template_is_placed_under_a_name_of_its_own_and_removed_as_it_was(situation, robot):
    bench = situation.bench
    assert bench.add("wheel") == "wheel_2" and bench.copy("spare") == "spare"
    placed = [call for call in bench.edits.want(0.0) if isinstance(call, PlaceInstance)]
    assert [(each.name, each.template) for each in placed] == [("wheel_2", "wheel"), ("spare", "wheel")]
    bench.edits.remove("wheel_1")
    assert RemoveInstance(name="wheel_1") in bench.edits.want(1.0)


def test_what_somebody_else_takes_away_is_no_longer_selected(situation, robot):
    situation.take(robot.wheel(version=2, removed=True))
    situation.bench.want(0.0)
    assert situation.bench.selected == "" and situation.bench.state is None


def test_an_answer_that_an_event_has_overtaken_changes_nothing(situation, robot):
    situation.take(robot.wheel(version=5, pose_in_world=Pose(position=at(0.9))))
    late = InstanceEdit(name="wheel_1", instance=robot.wheel(version=4))
    situation.take(arrivals.CallDone(EditInstance(name="wheel_1", position=at(0.8)), late))
    assert situation.world.instances["wheel_1"].pose_in_world.position == at(0.9)


def test_what_is_edited_is_all_that_is_sent_and_the_rest_stays_as_others_make_it(situation, robot):
    bench = situation.bench
    bench.put(0, 612.5)
    bench.put(5, 90.0)
    bench.turn("radius", 0.2)
    bench.edits.set_joints("wheel_1", {"hinge": 0.7})
    carry(situation, robot, 0.0)
    (first,) = carry(situation, robot, 0.1)
    assert first.position == pytest.approx((0.6125, -0.35, 0.3))
    assert first.orientation == pytest.approx((0, 0, 0.7071, 0.7071), abs=1e-4)
    assert (first.parameters, first.joints) == ({"radius": 0.2}, {"hinge": 0.7})
    bench.nudge("rz", 1)
    (turned,) = carry(situation, robot, 0.2)
    assert turned.position is None and turned.orientation and not turned.parameters and not turned.joints


def test_a_parameter_of_what_somebody_else_drags_is_changed_and_its_place_is_not(situation, robot):
    bench = situation.bench
    situation.take(robot.wheel(held_by="ben"))
    bench.turn("radius", 0.2)
    (hold,) = bench.edits.want(0.0)
    situation.take(arrivals.CallFailed(hold, "wheel_1 is held by ben", refused=True))
    assert carry(situation, robot, 0.1) == [EditInstance(name="wheel_1", parameters={"radius": 0.2})]
    bench.turn("radius", 0.21)
    bench.edits.drag("wheel_1", position=at(0.9))
    assert carry(situation, robot, 0.2) == [EditInstance(name="wheel_1", parameters={"radius": 0.21})]


def test_whose_newer_value_was_replaced_is_told(situation, robot):
    answer = InstanceEdit(name="wheel_1", instance=robot.wheel(version=3), overwrote={"position": "ben"})
    situation.take(arrivals.CallDone(EditInstance(name="wheel_1", position=at(0.5)), answer))
    assert (situation.journal.entries[-1].code, situation.journal.entries[-1].details) == (
        "overwrote",
        ("wheel_1, position", "ben"),
    )


def test_nothing_is_on_its_way_any_more_when_the_link_is_lost(situation):
    situation.bench.edits.drag("wheel_1", position=at(0.7))
    situation.take(arrivals.Unanswered(1, "gone"))
    assert situation.bench.edits.want(9.0) == []
    assert situation.bench.shown()["wheel_1"] == situation.world.instances["wheel_1"]
    assert msgspec.json.encode(situation.bench.state)
