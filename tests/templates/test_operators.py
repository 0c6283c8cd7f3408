"""Several operators edit instances at once: fields merge, each takes back his own, one drags at a time."""

from __future__ import annotations

import msgspec
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from affordance_templates import fields
from affordance_templates.holds import HOLD_S
from affordance_templates.server import LOCAL, AffordanceServer
from handrail.messages import (
    EditInstance,
    HoldInstance,
    MoveInstance,
    PlaceInstance,
    Pose,
    RedoEdit,
    ReleaseInstance,
    RemoveInstance,
    SetParameters,
    UndoEdit,
)
from handrail.topics import RefusedError

POSE = Pose(position=(0.55, -0.35, 0.30))
TURNED = (0.0, 0.0, 1.0, 0.0)


class Clock:
    now = 100.0

    def __call__(self) -> float:
        return self.now


@pytest.fixture
def clock():
    return Clock()


@pytest.fixture
def told():
    return []


@pytest.fixture
def server(tmp_path, clock, told):
    server = AffordanceServer(tmp_path / "instances.json", changed=told.append, clock=clock, utc=lambda: 1e9)
    server.place(PlaceInstance(name="w", template="wheel", pose_in_world=POSE, by="anna"))
    return server


def edit(server, by, **what):
    return server.edit(EditInstance(name="w", by=by, **what))


def position(server, name="w"):
    return server.get(name).pose_in_world.position


def test_fields_that_two_operators_change_at_once_are_both_kept(server):
    edit(server, "anna", position=(1, 0, 0), base=1)
    answer = edit(server, "ben", orientation=TURNED, parameters={"radius": 0.2}, joints={"hinge": 0.5}, base=1)
    assert answer.overwrote == {} and set(answer.fields) == {"orientation", "parameters.radius", "joints.hinge"}
    state = answer.instance
    assert state.pose_in_world == Pose(position=(1, 0, 0), orientation=TURNED)
    assert (state.parameters["radius"], state.joint_state["hinge"], state.version) == (0.2, 0.5, 3)


def test_of_one_field_the_last_value_holds_and_its_writer_learns_whose_it_replaced(server, told):
    edit(server, "anna", position=(1, 0, 0), base=1)
    answer = edit(server, "ben", position=(2, 0, 0), parameters={"radius": 0.2}, base=1)
    assert answer.overwrote == {"position": "anna"}
    assert told[-1].pose_in_world.position == (2, 0, 0) and told[-1].provenance.edited_by == "ben"
    assert edit(server, "ben", position=(3, 0, 0), base=1).overwrote == {}, "his own"
    assert edit(server, "anna", position=(4, 0, 0), base=told[-1].version).overwrote == {}, "she has seen it"


def test_undo_takes_back_ones_own_and_leaves_what_others_have_changed_since(server):
    edit(server, "anna", position=(1, 0, 0), parameters={"radius": 0.2})
    edit(server, "ben", parameters={"radius": 0.22})
    answer = server.undo(UndoEdit(by="anna"))
    assert answer.fields == ["position"] and "ben" in answer.left["parameters.radius"]
    assert position(server) == POSE.position and answer.instance.parameters["radius"] == 0.22
    answer = server.redo(RedoEdit(by="anna"))
    assert answer.fields == ["position"] and not answer.left and position(server) == (1, 0, 0)


def test_an_equal_value_of_somebody_else_is_his_all_the_same(server):
    edit(server, "anna", position=(1, 0, 0))
    edit(server, "ben", position=(2, 0, 0))
    edit(server, "cleo", position=(1, 0, 0))
    assert server.undo(UndoEdit(by="anna")).fields == [] and position(server) == (1, 0, 0)
    edit(server, "ben", position=(1, 0, 0))
    assert server.undo(UndoEdit(by="cleo")).fields == [] and position(server) == (1, 0, 0)


def test_what_another_took_back_can_be_taken_back_before_it(server):
    edit(server, "anna", position=(1, 0, 0))
    edit(server, "ben", position=(2, 0, 0))
    server.undo(UndoEdit(by="ben"))
    assert server.undo(UndoEdit(by="anna")).left == {} and position(server) == POSE.position


def test_undo_of_what_the_robot_has_turned_meanwhile_leaves_the_joint(server):
    edit(server, "anna", joints={"hinge": 0.5})
    server.set_joint("w", "hinge", 1.2)
    assert "robot" in server.undo(UndoEdit(by="anna")).left["joints.hinge"]
    assert server.get("w").joint_state["hinge"] == 1.2


def test_placing_and_removing_are_undone_and_done_again(server):
    edit(server, "anna", parameters={"radius": 0.2})
    before = server.get("w").state()
    server.remove(RemoveInstance(name="w", by="ben"))
    back = server.undo(UndoEdit(by="ben")).instance
    assert (back.parameters, back.pose_in_world, back.provenance) == (
        before.parameters, before.pose_in_world, before.provenance
    )  # fmt: skip
    assert back.version == before.version + 1
    assert server.undo(UndoEdit(by="anna")).fields == ["parameters.radius"], "what came before is still known"
    assert server.undo(UndoEdit(by="anna")).instance is None and server.instances() == []
    assert server.redo(RedoEdit(by="anna")).instance.name == "w"
    assert server.redo(RedoEdit(by="anna")).instance.parameters["radius"] == 0.2


def test_what_another_has_edited_is_not_taken_away_by_undoing_its_placing(server):
    edit(server, "ben", position=(1, 0, 0))
    assert "ben" in server.undo(UndoEdit(by="anna")).left["instance"]
    assert position(server) == (1, 0, 0)


def test_an_edit_after_undo_ends_what_could_be_done_again_and_nothing_is_refused(server):
    edit(server, "anna", position=(1, 0, 0))
    server.undo(UndoEdit(by="anna"))
    edit(server, "anna", position=(3, 0, 0))
    with pytest.raises(RefusedError, match="nothing to redo"):
        server.redo(RedoEdit(by="anna"))
    with pytest.raises(RefusedError, match="nothing to undo: ben"):
        server.undo(UndoEdit(by="ben"))


def test_what_is_held_nobody_else_moves_or_removes_but_its_parameters_are_anybodys(server, told):
    server.hold(HoldInstance(name="w", by="anna"))
    assert told[-1].held_by == "anna" and told[-1].version == 1
    edit(server, "anna", position=(1, 0, 0))
    for move in (
        lambda: edit(server, "ben", position=(2, 0, 0)),
        lambda: server.move(MoveInstance(name="w", pose_in_world=Pose(), by="ben")),
        lambda: server.hold(HoldInstance(name="w", by="ben")),
        lambda: server.remove(RemoveInstance(name="w", by="ben")),
    ):
        with pytest.raises(RefusedError, match="held by anna"):
            move()
    edit(server, "ben", parameters={"radius": 0.2})
    server.release(ReleaseInstance(name="w", by="ben"))
    assert told[-1].held_by == "anna", "what one does not hold one does not let go"
    server.release(ReleaseInstance(name="w", by="anna"))
    assert told[-1].held_by == "" and edit(server, "ben", position=(2, 0, 0)).fields == ["position"]


def test_undo_does_not_move_what_another_holds_and_is_not_lost(server):
    edit(server, "ben", position=(2, 0, 0))
    server.hold(HoldInstance(name="w", by="anna"))
    with pytest.raises(RefusedError, match="held by anna"):
        server.undo(UndoEdit(by="ben"))
    server.release(ReleaseInstance(name="w", by="anna"))
    server.undo(UndoEdit(by="ben"))
    assert position(server) == POSE.position


def test_a_hold_ends_by_itself_after_its_holders_last_call(server, told, clock):
    server.hold(HoldInstance(name="w", by="anna"))
    clock.now += HOLD_S - 0.1
    edit(server, "anna", position=(1, 0, 0))
    clock.now += HOLD_S - 0.1
    assert server.end_holds() == pytest.approx(0.1) and told[-1].held_by == "anna"
    clock.now += 0.2
    assert server.end_holds() is None and told[-1].held_by == ""
    server.hold(HoldInstance(name="w", by="ben"))
    assert told[-1].held_by == "ben"


def test_all_of_a_drag_is_one_step_and_two_drags_are_two(server):
    for to, radius in ((1, 0.16), (2, 0.17)):
        server.hold(HoldInstance(name="w", by="anna"))
        for x in range(5):
            edit(server, "anna", position=(to, x, 0))
        edit(server, "ben", parameters={"radius": radius})
        server.release(ReleaseInstance(name="w", by="anna"))
    server.undo(UndoEdit(by="anna"))
    assert position(server) == (1, 4, 0)
    server.undo(UndoEdit(by="anna"))
    assert position(server) == POSE.position and server.get("w").parameters["radius"] == 0.17


def test_undo_stacks_marks_and_provenance_survive_a_restart_and_holds_do_not(server, tmp_path):
    server.move(MoveInstance(name="w", pose_in_world=Pose(position=(1, 0, 0))))
    edit(server, "ben", parameters={"radius": 0.2})
    server.hold(HoldInstance(name="w", by="ben"))
    edit(server, "ben", parameters={"radius": 0.22})
    again = AffordanceServer(tmp_path / "instances.json")
    state = again.get("w").state()
    assert (state.held_by, state.provenance.placed_by, state.provenance.edited_by) == ("", "anna", "ben")
    assert state.provenance.placed_at == 1e9
    again.undo(UndoEdit(by="ben"))
    assert again.undo(UndoEdit(by="ben")).instance.parameters["radius"] == server.get("w").template.values({})["radius"]
    assert again.undo(UndoEdit(by=LOCAL)).instance.pose_in_world == POSE
    again.edit(EditInstance(name="w", position=(5, 0, 0), by="cleo"))
    assert "cleo" in again.undo(UndoEdit(by="anna")).left["instance"]


def test_a_file_from_before_operators_were_told_apart_still_loads(server, tmp_path):
    state = server.get("w").state()
    old = {
        "name": "w", "template": "wheel", "template_hash": state.template_hash, "version": 7, "removed": False,
        "pose_in_world": {"position": [1, 2, 3], "orientation": [0, 0, 0, 1]}, "parameters": {"radius": 0.2},
        "joint_state": {"hinge": 1.0},
    }  # fmt: skip
    file = tmp_path / "old.json"
    file.write_bytes(msgspec.json.encode({"instances": [old], "versions": {"w": 7}}))
    again = AffordanceServer(file)
    assert not again.problems and again.get("w").version == 7
    again.edit(EditInstance(name="w", position=(0, 0, 0), by="ben"))
    again.undo(UndoEdit(by="ben"))
    assert again.get("w").pose_in_world.position == (1, 2, 3)


@pytest.mark.parametrize(
    ("what", "field"),
    [
        ({"position": (float("nan"), 0.0, 0.0)}, "position"),
        ({"orientation": (0.0, 0.0, 0.0, 2.0)}, "orientation"),
        ({"parameters": {"girth": 1.0}}, "parameters.girth"),
        ({"joints": {"knee": 1.0}}, "joint"),
        ({"joints": {"hinge": float("inf")}}, "position"),
        ({"position": (0.0, 0.0, 0.0), "base": 9}, "base"),
    ],
)
def test_a_wrong_edit_is_refused_and_changes_nothing(server, told, what, field):
    before, count = server.get("w").state(), len(told)
    with pytest.raises(RefusedError) as caught:
        edit(server, "ben", **what)
    assert caught.value.refusal.field == field and caught.value.refusal.expected
    assert server.get("w").state() == before and len(told) == count


def test_a_parameter_taken_back_that_others_leave_no_shape_for_stays(server):
    edit(server, "anna", parameters={"tool_radius": 0.03})
    edit(server, "anna", parameters={"tool_radius": 0.005})
    edit(server, "ben", parameters={"radius": 0.08, "spoke_radius": 0.03})
    answer = server.undo(UndoEdit(by="anna"))
    assert "no shape" in answer.left["parameters.tool_radius"] and answer.fields == []
    assert server.get("w").parameters["tool_radius"] == 0.005


# What three operators do in any order. Each keeps a copy of what is told; a model knows who wrote each field last.

OPERATORS = ("anna", "ben", "cleo")
_numbers = st.floats(-2, 2, width=16).map(float)
_edits = st.fixed_dictionaries(
    {},
    optional={
        "position": st.tuples(_numbers, _numbers, _numbers),
        "orientation": st.sampled_from([TURNED, (0.0, 0.0, 0.0, 1.0), (1.0, 0.0, 0.0, 0.0)]),
        "parameters": st.dictionaries(
            st.sampled_from(["radius", "arc"]), st.sampled_from([0.15, 0.2, 0.25]), max_size=1
        ).map(lambda found: {name: value if name == "radius" else 300 * value for name, value in found.items()}),
        "joints": st.dictionaries(st.just("hinge"), _numbers, max_size=1),
    },
)
_deeds = st.one_of(
    st.tuples(st.just("edit"), _edits),
    st.tuples(st.sampled_from(["undo", "undo", "redo", "hold", "release", "later"]), st.just({})),
)


@settings(max_examples=60, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(st.lists(st.tuples(st.sampled_from(OPERATORS), _deeds), max_size=25))
def test_three_operators_converge_lose_no_field_and_never_undo_anothers(tmp_path, deeds):
    clock, told, file = Clock(), [], tmp_path / "instances.json"
    file.unlink(missing_ok=True)
    server = AffordanceServer(file, changed=told.append, clock=clock)
    server.place(PlaceInstance(name="w", template="wheel", pose_in_world=POSE))

    def values():
        return {each: fields.value(server.get("w"), each) for each in fields.names(server.get("w"))}

    expected, writer = values(), dict.fromkeys(values(), LOCAL)
    for by, (deed, what) in deeds:
        before = values()
        try:
            if deed == "edit":
                asked = fields.asked(EditInstance(name="w", **what), server.get("w"))
                server.edit(EditInstance(name="w", by=by, **what))
                expected |= asked
                writer |= dict.fromkeys(asked, by)
            elif deed == "hold":
                server.hold(HoldInstance(name="w", by=by))
            elif deed == "release":
                server.release(ReleaseInstance(name="w", by=by))
            elif deed == "later":
                clock.now += 1.5
                server.end_holds()
            else:
                answer = server.undo(UndoEdit(by=by)) if deed == "undo" else server.redo(RedoEdit(by=by))
                after = values()
                changed = {each for each in after if after[each] != before[each]}
                assert changed == set(answer.fields)
                if deed == "undo":
                    assert all(writer[each] == by for each in changed), "it was another's"
                marks = server._now.marks["w"]
                expected |= {each: after[each] for each in changed}
                writer |= {each: marks[each].by for each in after}
        except RefusedError as refused:
            assert "held by" in str(refused) or "nothing to" in str(refused)
            assert values() == before
        assert values() == expected, "a field was lost"
    copies = {state.name: state for state in told}
    assert copies == {"w": server.get("w").state()}, "who listens has what holds"
    assert [state.version for state in told] == sorted(state.version for state in told)
    again = AffordanceServer(file, clock=clock)
    assert {each: fields.value(again.get("w"), each) for each in expected} == expected


def test_an_edit_that_changes_nothing_is_not_told(server, told):
    edit(server, "anna", parameters={"radius": 0.2})
    count = len(told)
    answer = server.edit(EditInstance(name="w", parameters={"radius": 0.2}, by="anna"))
    server.set_parameters(SetParameters(name="w", parameters={"radius": 0.2}, by="ben"))
    assert answer.fields == [] and len(told) == count and server.get("w").version == 2
