"""Reachability is told while somebody watches: the newest instances are asked about, one question at a time, and nobody waits."""

from __future__ import annotations

import socket
import threading
from types import SimpleNamespace

import numpy as np
import pytest

from affordance_templates.server import AffordanceServer
from engines.nodes.wire import Wire
from engines.plans.freshness import World
from engines.reach.desk import ReachDesk
from engines.reach.wire import Ask, Told
from handrail.messages import Base, GetReach, MoveInstance, PlaceInstance, Pose, Reach, RemoveInstance, WaypointReach
from handrail.robot import library as robots
from handrail.topics import RefusedError

LONG_S = 30.0
QUESTION = GetReach(instance="it", trajectory="grasp", arm="right", lasts=60.0, rate=30.0)
HERE = [WaypointReach(name="here", state="reached")]


class Other:
    """The process's end of the wire."""

    def __init__(self) -> None:
        self.wire: Wire | None = None
        self.started, self.ended = 0, 0
        self._there = threading.Event()

    def start(self):
        ours, theirs = socket.socketpair()
        self.wire, self.started = Wire(theirs, Ask), self.started + 1
        self._there.set()
        return ours, self._end

    def _end(self) -> None:
        self.ended += 1

    def asked(self) -> Ask:
        assert self._there.wait(LONG_S) and self.wire is not None
        found = self.wire.receive(LONG_S)
        assert found is not None, "nothing was asked"
        return found

    def tell(self, ask: Ask, *, settled: bool = True) -> None:
        assert self.wire is not None
        version = next(each.version for each in ask.instances if each.name == ask.instance)
        self.wire.send(Told(ask.number, version, HERE, settled))

    def die(self) -> None:
        assert self.wire is not None
        self._there.clear()
        self.wire.close()


class Heard:
    def __init__(self) -> None:
        self.events: list[Reach] = []
        self._changed = threading.Condition()

    def __call__(self, event) -> None:
        with self._changed:
            self.events.append(event)
            self._changed.notify_all()

    def of_version(self, version: int) -> Reach:
        with self._changed:
            assert self._changed.wait_for(lambda: any(e.version == version for e in self.events), LONG_S), self.events
        return next(e for e in self.events if e.version == version)


@pytest.fixture
def stand(tmp_path):
    description = robots.load("talos_upper")
    world = World(0, description.home_position("ready"), None)
    stand = SimpleNamespace(other=Other(), heard=Heard(), world=world)
    stand.server = AffordanceServer(tmp_path / "instances.json", changed=lambda _: stand.desk.instance_changed())
    stand.desk = ReachDesk(
        description, stand.server, SimpleNamespace(world=lambda: stand.world), stand.heard, stand.other.start
    )  # type: ignore[arg-type]
    stand.server.place(PlaceInstance(name="it", template="box", pose_in_world=Pose(position=(0.5, -0.3, 0.1))))
    yield stand
    stand.desk.close()


def move(stand, x: float) -> None:
    stand.server.move(MoveInstance(name="it", pose_in_world=Pose(position=(x, -0.3, 0.1))))


def test_while_one_question_is_open_only_the_newest_version_waits_for_the_next(stand):
    answer = stand.desk.ask(QUESTION)
    first = stand.other.asked()
    for k in range(1, 6):
        move(stand, 0.5 + 0.01 * k)
    stand.other.tell(first)
    second = stand.other.asked()
    assert [each.instances[0].version for each in (first, second)] == [1, 6]
    stand.other.tell(second)
    assert answer.result(LONG_S) == stand.heard.of_version(1)
    assert stand.heard.of_version(6).waypoints == HERE
    assert {e.version for e in stand.heard.events} == {1, 6}, "what was in between was not worked on"


def test_a_call_is_answered_once_it_is_settled_and_watchers_are_told_before(stand):
    answer = stand.desk.ask(QUESTION)
    ask = stand.other.asked()
    stand.other.tell(ask, settled=False)
    assert not stand.heard.of_version(1).settled
    assert not answer.done()
    stand.other.tell(ask)
    assert answer.result(LONG_S).settled
    assert stand.desk.ask(QUESTION).result(0).settled, "nothing has changed: it is known"


def test_another_joint_than_the_arms_that_moves_is_asked_about(stand):
    stand.desk.ask(QUESTION)
    stand.other.tell(stand.other.asked())
    stand.heard.of_version(1)
    description = robots.load("talos_upper")
    arm = description.index(description.arms["right"].joints)
    others = np.setdiff1d(np.arange(len(description.joints)), arm)
    own, carried = stand.world.command.copy(), stand.world.command.copy()
    own[arm] += 0.3
    carried[others] += 0.1
    stand.world = World(1, own, None)
    stand.world = World(2, carried, None)
    assert stand.other.asked().position == carried.tolist()


def base(turned: float = 0.0, source: str = "feet") -> Base:
    still = (0.0, 0.0, 0.0)
    pose = Pose(orientation=(0.0, 0.0, float(np.sin(turned / 2)), float(np.cos(turned / 2))))
    return Base(
        time_ns=0, pose_in_world=pose, linear_velocity=still, angular_velocity=still,
        position_deviation=0.0, orientation_deviation=0.0, source=source,
    )  # type: ignore[arg-type]  # fmt: skip


@pytest.mark.parametrize("later", [base(turned=0.3), base(source="none")], ids=["turned", "lost"])
def test_a_base_that_turns_where_it_is_or_is_lost_is_asked_about(stand, later):
    stand.world = World(0, stand.world.command, base())
    stand.desk.ask(QUESTION)
    stand.other.tell(stand.other.asked())
    stand.heard.of_version(1)
    stand.world = World(1, stand.world.command, later)
    assert stand.other.asked().base == later


def test_what_is_not_there_is_refused_with_what_there_is(stand):
    for wrong, words in {
        "instance": "expected one of: it",
        "trajectory": "expected one of: grasp, grasp_top",
        "arm": "expected one of: ",
    }.items():
        with pytest.raises(RefusedError, match=words) as refused:
            stand.desk.ask(GetReach(**{"instance": "it", "trajectory": "grasp", "arm": "right", wrong: "nothing"}))
        assert refused.value.refusal.value == "nothing"
    with pytest.raises(RefusedError, match="field arm, value none"):
        stand.desk.ask(GetReach(instance="it", trajectory="grasp"))
    assert stand.other.started == 0


def test_a_process_that_dies_refuses_what_waits_and_is_started_anew_by_the_next(stand):
    answer = stand.desk.ask(QUESTION)
    stand.other.asked()
    stand.other.die()
    with pytest.raises(RefusedError, match="it has ended"):
        answer.result(LONG_S)
    again = stand.desk.ask(QUESTION)
    stand.other.tell(stand.other.asked())
    assert again.result(LONG_S).waypoints == HERE
    assert (stand.other.started, stand.other.ended) == (2, 1)


def test_without_a_robot_that_tells_where_it_is_the_problem_is_told_at_once(stand):
    stand.world = None
    assert "is it running" in stand.desk.ask(QUESTION).result(LONG_S).problem


def test_an_instance_that_is_gone_is_still_asked_about_so_that_watchers_hear_of_it(stand):
    stand.desk.ask(QUESTION)
    stand.other.tell(stand.other.asked())
    stand.heard.of_version(1)
    stand.server.remove(RemoveInstance(name="it"))
    assert stand.other.asked().instances == []


def test_closing_refuses_what_waits(stand):
    answer = stand.desk.ask(QUESTION)
    stand.other.asked()
    stand.desk.close()
    with pytest.raises(RefusedError, match="the engine ends"):
        answer.result(LONG_S)
