"""A template's sync with two arms: a program of its own, both hands at one time at its points, which stop when one of them does."""

from __future__ import annotations

import threading
from types import SimpleNamespace

import numpy as np
import pytest

from affordance_templates import catalogue
from affordance_templates.binding import bind_together
from affordance_templates.instance import Instance
from affordance_templates.placement import to_message
from affordance_templates.server import AffordanceServer
from engines.activities.base import ActivityFailed
from engines.activities.meetings import hands, legs, meetings, way_together
from engines.activities.trajectory import TrajectoryActivity
from engines.planning.planners import Planners
from engines.programs import program as programs
from engines.programs.from_template import Wish, expand
from engines.runs.motion import MotionFailed
from engines.template_runs import TemplateRuns
from handrail.messages import ExpandTemplate, MoveInstance, PlaceInstance, Pose, RunTemplate
from handrail.robot import library as robots
from handrail.robot.kinematics import Kinematics
from handrail.topics import RefusedError

SIZE = {"depth": 0.20, "width": 0.30, "height": 0.20, "lift": 0.08}
PLACE = Pose(position=(0.45, 0.0, 0.15))
ARMS = {"carry_right": "right", "carry_left": "left"}
POINTS = ["before", "touch", "press", "lift"]


@pytest.fixture(scope="module")
def robot():
    return robots.load("talos_upper_grippers")


@pytest.fixture
def box() -> Instance:
    return Instance("it", catalogue.load("box"), PLACE, SIZE)


@pytest.fixture
def read(tmp_path):
    """An expanded program, read and checked as any file."""

    def read(expanded):
        file = tmp_path / f"{expanded.name}.yaml"
        file.write_text(expanded.text)
        return programs.read(file)

    return read


@pytest.mark.parametrize(("back", "rounds"), [(False, 1), (True, 1), (False, 3)])
def test_a_sync_is_a_sound_program_of_two_arms_with_a_state_for_each_point(robot, box, read, back, rounds):
    program = read(expand(robot, box, Wish("carry", "right", "left", back=back, rounds=rounds)))
    assert set(program.resources) == {"arm", "other", "what"}
    states = {state.id: state.file for state in program.states()}
    moving = [each.with_["first"] for each in states.values() if each.do == "trajectory"]
    assert moving == (POINTS[::-1] if back else POINTS)
    assert [name for name, each in states.items() if each.do == "plan"] == ([] if back else ["plan_before"])
    assert all(each.with_["other"] == "other" for each in states.values() if each.do)


def test_points_have_names_and_what_is_left_behind_the_last_one_is_gone_as_well(robot):
    cap = Instance("it", catalogue.load("cap"), PLACE)
    found = meetings(cap, "open")
    assert [(each.name, dict(each.reached)) for each in found] == [
        ("before+hold", {"twist": 0, "hold": 2}),
        ("twist+keep", {"twist": 3, "hold": 3}),
        ("back", {"twist": 5, "hold": 3}),
    ]
    way = legs(robot, cap, "open", {"twist": "right", "hold": "left"})
    gone = [{name: [each.waypoint.name for each in part] for name, part in leg.ways.items()} for leg in way]
    assert gone == [
        {"twist": ["before"], "hold": ["before", "around", "hold"]},
        {"twist": ["around", "hold", "twist"], "hold": ["keep"]},
        {"twist": ["let_go", "back"], "hold": []},
    ]


def test_one_plan_leads_both_hands_to_where_they_reach_in(robot, box):
    (leg,) = legs(robot, box, "carry", ARMS, last="before")
    call = way_together(leg, box)
    assert len(call.goals) == 2
    plan = Planners(robot).motion(call, [box], robot.home_position())
    kinematics, end = Kinematics(robot), dict(zip(plan.joints, plan.segments[-1].positions[-1], strict=True))
    there = np.array([end.get(name, rest) for name, rest in zip(robot.joints, robot.home_position(), strict=True)])
    for bound in bind_together(box, "carry", robot, {"right": "right", "left": "left"}).values():
        tip = kinematics.frame(there, bound.arm.tip).translation
        assert np.linalg.norm(tip - bound.waypoints[0].tip_in_world[:3, 3]) < 0.02


def test_what_is_carried_between_two_hands_is_pressed_on_its_way_down_until_it_stands(robot, box):
    back = {leg.name: leg.ways for leg in legs(robot, box, "carry", ARMS, back=True)}
    forces = {name: [way[0].force_in_world for way in ways.values()] for name, ways in back.items()}
    assert [name for name, each in forces.items() if each[0] is not None] == ["press"]
    assert np.allclose(sum(forces["press"]), 0.0) and np.allclose(np.abs(forces["press"][0]), [0, 20, 0])


class Moves:
    """Motions of which each begins only when those of both hands are there, where `both`."""

    def __init__(self, both: int = 2) -> None:
        self.done: list[tuple[str, str, float]] = []
        self.joints: list[set[str]] = []
        self.fail = lambda what, frame: False
        self._both, self._lock = threading.Barrier(both), threading.Lock()
        self.interrupted = threading.Event()

    def run(self, motion, ends, cancelled, *, what, still, hoped):
        self._both.wait(20.0)
        if self.fail(what, motion.frame):
            raise MotionFailed("too_close", f"{what}: the guard stopped it")
        with self._lock:
            self.done.append((what, motion.frame, motion.duration))
            self.joints.append(set(motion.joints))
        if self.fail(what, ""):
            assert cancelled.wait(20.0), "the other one's failure"
            raise MotionFailed("cancelled", f"{what}: it was cancelled")
        return SimpleNamespace(outcome=hoped)

    def interrupt(self):
        self.interrupted.set()


class Activities:
    """Trajectory activities whose hands stand where `at` has them."""

    def __init__(self, robot, folder):
        self.affordances = AffordanceServer(folder / "instances.json")
        self.affordances.place(PlaceInstance(name="it", template="box", pose_in_world=PLACE, parameters=SIZE))
        self.robot, self.moves = robot, Moves()
        self.at: dict[str, Pose] = {}

    def tip_pose(self, position, arm):
        return np.array(self.at[arm].position), np.array(self.at[arm].orientation)

    def stand(self, point: str, *, nearer: float = 0.0) -> None:
        """The hands are at a point, the left one nearer to the other by so many m."""
        instance = self.affordances.get("it")
        for (trajectory, arm), off in zip(ARMS.items(), (0.0, nearer), strict=True):
            (leg,) = legs(self.robot, instance, "carry", ARMS, first=point, last=point)
            there = leg.ways[trajectory][-1].tip_in_world.copy()
            there[1, 3] -= off
            self.at[arm] = to_message(there)

    def begin(self, **given):
        services = SimpleNamespace(
            description=self.robot,
            affordances=self.affordances,
            daemon=SimpleNamespace(command=lambda: np.zeros(len(self.robot.joints))),
            tip_pose=self.tip_pose,
            tip=lambda position, arm: self.tip_pose(position, arm)[0],
        )
        values = {
            "instance": "it", "trajectory": "carry", "arm": "right", "other": "left", "still": "", "first": "", "last": "",
            "grip": "fixed",
            "way": "forwards", "leaving": "", "plan": None, **given,
        }  # fmt: skip
        return TrajectoryActivity(SimpleNamespace(services=services, motion=self.moves), values)


@pytest.fixture
def activities(robot, tmp_path):
    return Activities(robot, tmp_path)


def test_both_hands_move_at_once_for_as_long_as_the_slower_one_and_leave_the_torso_where_it_is(activities):
    activities.stand("before", nearer=0.05)
    ended = activities.begin(first="touch", last="press").run()
    assert ended == {"waypoint": "press", "holds": False, "moved": 0.0}
    done = activities.moves.done
    assert sorted(what for what, _, _ in done) == ["press", "press", "touch", "touch"]
    assert [what for what, _, _ in done[:2]] == ["touch", "touch"], "nobody presses before both have touched"
    assert done[0][1] != done[1][1]
    assert done[0][2] == done[1][2] == pytest.approx((0.10 + 0.03) / 0.03), "10 cm at 3 cm/s, and 3 more"
    one, other = activities.moves.joints[:2]
    assert one.isdisjoint(other) and len(one) == len(other) == 7


def test_one_hand_that_is_stopped_stops_the_other_one_and_is_the_one_that_is_told(activities):
    activities.stand("before")
    activities.moves.fail = lambda what, frame: not frame or "left" in frame
    with pytest.raises(ActivityFailed) as failed:
        activities.begin(first="touch").run()
    assert (failed.value.reason, str(failed.value)) == ("too_close", "touch: touch: the guard stopped it")
    assert activities.moves.interrupted.is_set()
    assert [what for what, _, _ in activities.moves.done] == ["touch"], "nothing has begun after it"


def test_a_cancel_before_the_first_motion_or_in_it_reaches_both_hands(activities):
    activities.stand("before")
    activity = activities.begin(first="touch")
    activities.moves.fail = lambda what, frame: not frame and (activity.cancel() or True)
    with pytest.raises(ActivityFailed) as failed:
        activity.run()
    assert failed.value.reason == "cancelled"
    assert len(activities.moves.done) == 2


def test_a_box_that_was_moved_meanwhile_is_not_gone_on_to(activities):
    activities.stand("before")
    moved = threading.Event()

    def move(what, frame):
        if what == "touch" and not frame and not moved.is_set():
            moved.set()
            activities.affordances.move(MoveInstance(name="it", pose_in_world=Pose(position=(0.5, 0, 0.15))))
        return False

    activities.moves.fail = move
    with pytest.raises(ActivityFailed, match="press: it was moved or edited while it was being used") as failed:
        activities.begin(first="touch").run()
    assert failed.value.reason == "stale"


def test_steps_go_on_while_both_hands_are_where_the_last_run_left_them(activities, tmp_path):
    runs = TemplateRuns(activities.begin().services, tmp_path / "programs")

    def way(**call) -> list[str]:
        text = runs.program(ExpandTemplate(instance="it", trajectory="carry", **call)).text
        return [line.strip(" :")[3:] for line in text.splitlines() if line.startswith("  to_")]

    activities.stand("before")
    assert way(steps=1) == ["before"], "nobody has gone there yet"
    deployed = runs.deploy(RunTemplate(instance="it", trajectory="carry"))
    assert deployed.bindings == {"arm": "right", "other": "left", "what": "it"}
    runs.told(deployed, SimpleNamespace(data={"at": "touch"}))
    activities.stand("touch")
    assert way(steps=1) == ["press"]
    assert way(backwards=True) == ["before"]
    assert way(arm="left", steps=1) == ["before"], "with the hands crossed nobody has gone there"
    activities.stand("touch", nearer=0.06)
    assert way(steps=1) == ["before"], "one hand was moved away"


@pytest.mark.parametrize(
    ("call", "words"),
    [
        ({"trajectory": "nothing"}, "field trajectory, value nothing, expected one of: grasp, .*carry"),
        ({"other": "third"}, "field other, value third, expected one of: right, left"),
        ({"arm": "left", "other": "left"}, "are both left; expected an arm each"),
        ({"trajectory": "grasp", "other": "left"}, "grasp is for one hand; field other, value left, expected none"),
        ({"first": "nowhere"}, "field first, value nowhere, expected one of: before, touch, press, lift"),
        ({"loop": 2, "backwards": True}, "field backwards, value True, expected none beside loop"),
    ],
)
def test_what_two_hands_can_not_go_is_refused_and_told(activities, tmp_path, call, words):
    runs = TemplateRuns(activities.begin().services, tmp_path / "programs")
    with pytest.raises(RefusedError, match=words):
        runs.program(ExpandTemplate(**{"instance": "it", "trajectory": "carry", "arm": "right", **call}))


def test_a_robot_with_one_arm_is_told_that_two_are_needed(box):
    with pytest.raises(RefusedError, match="carry is for two hands; field other, value none, expected another arm"):
        expand(robots.load("talos_upper_grippers"), box, Wish("carry", "right"))
    with pytest.raises(ActivityFailed, match="has no sync 'grasp' for two arms; expected one of carry"):
        hands(box, "grasp", ("right", "left"), robots.load("talos_upper_grippers"))


@pytest.mark.parametrize("beside", ["still", "grip"])
def test_what_is_for_one_hand_alone_is_refused_beside_another(beside):
    given = {"other": "left", beside: "left"}
    assert TrajectoryActivity.problem(given) == (beside, "beside other; expected one of both")
