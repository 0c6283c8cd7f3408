"""Programs bound and started from the library, and engines' code looked at and rolled back: the models, without a screen."""

from __future__ import annotations

from typing import Any

import pytest

from handrail.messages import (
    CheckTask,
    CodeChanged,
    Deploy,
    Deployment,
    EngineInfo,
    Engines,
    EngineSnapshot,
    GetEngines,
    GetProgram,
    GetReleases,
    GetRobot,
    Library,
    LibraryEntry,
    ListLibrary,
    Release,
    Releases,
    RollBack,
    Run,
    TaskCheck,
    TaskStep,
)
from tablet_client.models import arrivals
from tablet_client.models.situation import Situation


class Engine:
    """Answers what the launch asks, as an engine would."""

    def __init__(self, situation: Situation, robot: Any):
        self.situation, self.robot, self.refuses, self.calls = situation, robot, {}, []

    def slots(self) -> Any:
        return self.situation.launch.slots(tuple(self.situation.robot.info.arms), self.situation.world.instances)

    def ask(self) -> list[Any]:
        """The calls that are due now."""
        calls = [*self.situation.launch.want(self.slots()), *self.situation.deployments.want()]
        self.calls += calls
        return calls

    def serve(self) -> None:
        """Until nothing more is asked."""
        while calls := self.ask():
            for call in calls:
                self.answer(call)

    def answer(self, call: Any) -> None:
        if why := self.refuses.get(type(call)):
            self.situation.take(arrivals.CallFailed(call, why, refused=True))
            return
        answers = {
            ListLibrary: Library(entries=[LibraryEntry(name="turn_valve", kind="program", title="Turn a valve", hash="a" * 32)]),
            GetProgram: self.robot.source(),
            Deploy: Deployment(id=f"deployment-{len(self.calls)}", program="turn_valve", hash="a" * 32),
            Run: None,
            CheckTask: TaskCheck(
                program="turn_valve", hash="a" * 32, feasible=False, first_infeasible="planning", outcome="failed", detail="",
                steps=[TaskStep(state="planning", activity="plan", problem="nothing clear by 3 mm")],
            ),
            GetEngines: Engines(engines=[EngineInfo(name="engine"), EngineInfo(name="vision")]),
            GetReleases: releases(getattr(call, "engine", "")),
        }  # fmt: skip
        self.situation.take(arrivals.CallDone(call, answers[type(call)]))

    def of(self, kind: type) -> list[Any]:
        return [call for call in self.calls if isinstance(call, kind)]


def releases(engine: str) -> Releases:
    first = Release(number=1, program="press", bundle="1" * 32, by="anna", at_ns=0)
    second = Release(number=2, program="press", bundle="2" * 32, by="ben", at_ns=1, changed=["press.yaml"])
    return Releases(
        engine=engine,
        releases=[first, second],
        programs={"press": "2" * 32 if engine == "engine" else "1" * 32, "home": "3" * 32},
    )


@pytest.fixture
def situation(robot) -> Situation:
    made = Situation("tcp://somewhere:47800")
    made.take(arrivals.Attached(robot.answer(GetRobot()), robot.status()))
    made.take(arrivals.EngineAttached(EngineSnapshot(instances=[robot.wheel()], plans=[], run=None, prompts=[])))
    return made


@pytest.fixture
def engine(situation, robot) -> Engine:
    made = Engine(situation, robot)
    made.serve()
    situation.launch.choose("turn_valve")
    made.serve()
    return made


def test_what_only_one_thing_fits_is_bound_and_an_arm_is_chosen(situation, engine):
    launch = situation.launch
    assert launch.about == "Turn a wheel by strokes."
    assert [(slot.bound, len(slot.fitting)) for slot in engine.slots()] == [("", 2), ("wheel_1", 1)]
    assert launch.why_not(engine.slots()) == "unbound"
    launch.bind("arm", "right")
    assert launch.why_not(engine.slots()) == ""


def test_where_no_instance_fits_it_says_so(situation, engine):
    situation.world.replace([])
    situation.launch.bind("arm", "left")
    assert situation.launch.why_not(engine.slots()) == "nothing_fits"


@pytest.mark.parametrize(
    ("name", "value", "fits"),
    [("goal_deg", 4, False), ("goal_deg", 3600, True), ("goal_deg", float("nan"), False), ("strokes", 2.5, False),
     ("strokes", 10**6, True), ("strokes", 0, False), ("trajectory", 3, False), ("gently", True, True)],
)  # fmt: skip
def test_a_parameter_is_held_to_its_type_and_bounds(situation, engine, name, value, fits):
    launch = situation.launch
    launch.bind("arm", "right")
    launch.give(name, value)
    assert next(each for each in launch.parameters if each.parameter.name == name).fits is fits
    assert launch.why_not(engine.slots()) == ("" if fits else "bad_parameter")


def test_run_deploys_what_was_bound_and_given_and_starts_that(situation, engine):
    launch = situation.launch
    launch.bind("arm", "right")
    launch.give("goal_deg", 90.0)
    launch.wish("run")
    assert launch.why_not(engine.slots()) == "sending"
    engine.serve()
    (deploy,) = engine.of(Deploy)
    assert deploy.bindings == {"arm": "right", "valve": "wheel_1"}
    assert deploy.parameters == {"goal_deg": 90.0}
    assert [call.deployment for call in engine.of(Run)] == [launch.deployment.id]
    assert launch.started == 1


def test_a_rehearsal_needs_no_second_deployment_before_the_run(situation, engine):
    launch = situation.launch
    launch.bind("arm", "right")
    launch.wish("check")
    engine.serve()
    assert not launch.check.feasible
    launch.wish("run")
    engine.serve()
    assert len(engine.of(Deploy)) == len(engine.of(Run)) == 1


def test_what_was_changed_while_it_was_deployed_is_not_run(situation, engine):
    launch = situation.launch
    launch.bind("arm", "right")
    launch.wish("run")
    (deploy,) = engine.ask()
    launch.bind("arm", "left")
    engine.answer(deploy)
    engine.serve()
    assert not engine.of(Run)
    assert launch.deployment is None


def test_a_refusal_is_told_and_the_next_run_deploys_anew(situation, engine):
    launch = situation.launch
    launch.bind("arm", "right")
    engine.refuses[Run] = "a program runs already"
    launch.wish("run")
    engine.serve()
    assert launch.problem == "a program runs already"
    assert launch.started == 0
    engine.refuses.clear()
    launch.wish("run")
    engine.serve()
    assert launch.problem == ""
    assert (len(engine.of(Deploy)), launch.started) == (2, 1)


def test_other_code_has_the_program_read_anew_and_keeps_what_it_was_bound_to(situation, engine):
    situation.launch.bind("arm", "left")
    situation.take(CodeChanged(engine="engine", release=releases("engine").releases[1]))
    engine.serve()
    assert len(engine.of(GetProgram)) == len(engine.of(ListLibrary)) == 2
    assert [slot.bound for slot in engine.slots()] == ["left", "wheel_1"]


# ------------------------------------------------------------------------------------------------------------ deployments


def test_engines_are_asked_only_while_someone_looks(situation, engine):
    assert not engine.of(GetEngines)
    situation.deployments.open = True
    engine.serve()
    assert [call.engine for call in engine.of(GetReleases)] == ["engine", "vision"]


def test_a_program_that_engines_have_differently_is_told(situation, engine):
    situation.deployments.open = True
    engine.serve()
    assert [(each.program, each.match) for each in situation.deployments.held("engine")] == [
        ("home", "same"),
        ("press", "differs"),
    ]
    assert situation.deployments.held("engine")[1].release.by == "ben"


def test_an_engine_that_comes_or_has_other_code_is_asked_anew(situation, engine):
    situation.deployments.open = True
    engine.serve()
    situation.take(EngineInfo(name="vision", up=False))
    engine.serve()
    assert len(engine.of(GetReleases)) == 2  # nobody is asked who is not there
    situation.take(EngineInfo(name="vision", up=True))
    situation.take(CodeChanged(engine="engine", release=releases("engine").releases[1]))
    engine.serve()
    assert len(engine.of(GetReleases)) == 4


@pytest.fixture
def desk(situation, engine) -> Any:
    """Of two engines, each of which runs something; `sent`: what buttons asked for."""
    from tablet_client.library_desk import LibraryDesk

    sent: list[Any] = []
    made = LibraryDesk(situation, sent.append, lambda: None)
    made.sent = sent
    situation.deployments.open = True
    engine.serve()
    situation.take(EngineInfo(name="vision", host="cart", program="turn_valve", status="running", hash="b" * 32))
    situation.take(engine.robot.running(program="turn_valve", hash="a" * 32))
    engine.serve()
    made.build()
    return made


def test_of_two_engines_each_says_what_runs_where_and_whether_that_is_what_its_library_has(desk, engine):
    assert [(row["name"], row["host"], row["status"], row["chosen"]) for row in desk.engines.lines] == [
        ("engine", "", "", True),
        ("vision", "cart", "running", False),
    ]
    assert desk.view["runs"] == {"program": "turn_valve", "hash": "a" * 8, "match": "same"}
    assert [(row["program"], row["bundle"], row["match"]) for row in desk.held.lines] == [
        ("home", "3" * 8, "same"),
        ("press", "2" * 8, "differs"),
    ]
    desk.at("vision")
    engine.serve()
    desk.build()
    assert desk.view["runs"] == {"program": "turn_valve", "hash": "b" * 8, "match": "differs"}
    assert [(row["program"], row["bundle"]) for row in desk.held.lines] == [("home", "3" * 8), ("press", "1" * 8)]
    assert [row["chosen"] for row in desk.engines.lines] == [False, True]


def test_what_is_deployed_and_rolled_back_goes_to_the_engine_that_is_looked_at(desk, engine, situation):
    desk.at("vision")
    engine.serve()
    situation.launch.choose("turn_valve")
    engine.serve()
    situation.launch.bind("arm", "right")
    situation.launch.wish("check")
    engine.serve()
    assert [call.engine for call in engine.of(Deploy)] == ["vision"]
    desk.rollBack(1)
    assert desk.sent == [RollBack(number=1, engine="vision")]
    situation.take(EngineInfo(name="vision", up=False))
    assert desk.why("roll_back") == "no_engine"
    desk.rollBack(1)
    assert len(desk.sent) == 1, "nobody is there to do it"
    desk.at("engine")
    assert desk.why("roll_back") == ""


def test_there_is_a_way_back_to_earlier_releases_and_to_no_other(situation, engine):
    situation.deployments.open = True
    engine.serve()
    assert situation.deployments.back(1) == RollBack(number=1, engine="engine")
    assert situation.deployments.back(2) is None  # in force
    assert situation.deployments.back(7) is None
    call = situation.deployments.back(1)
    situation.take(arrivals.CallFailed(call, "needs a developer's key", refused=True))
    assert situation.deployments.problem == "needs a developer's key"
