"""What is saved is what was edited: comments, order and all else stay."""

from __future__ import annotations

import difflib
import io
import math

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from ruamel.yaml import YAML

from affordance_templates import catalogue, template_file
from affordance_templates.authoring import Draft, recorded, saved_as, written
from affordance_templates.authoring_cli import instance_of
from affordance_templates.binding import bind
from affordance_templates.instance import Instance
from affordance_templates.placement import placed, rotation_of, to_message
from handrail.config import ConfigError
from handrail.messages import InstanceState, Pose
from handrail.robot import library as robots


@pytest.fixture(scope="module")
def robot():
    return robots.load("panda")


@pytest.mark.parametrize("name", sorted(catalogue.files()))
def test_a_template_that_was_not_edited_is_saved_as_it_was(name):
    assert Draft.of(catalogue.load(name)).text == catalogue.files()[name].read_text()


def test_an_edit_changes_its_line_alone(cabinet, cabinet_text):
    draft = Draft.of(cabinet)
    draft.set("parameters.width.default", 0.7)
    draft.set("trajectories.open.waypoints[1].until", 8)
    before, after = cabinet_text.splitlines(), draft.text.splitlines()
    changed = [(a, b) for a, b in zip(before, after, strict=True) if a != b]
    assert [b.strip() for _, b in changed] == [
        "width: {default: 0.7, unit: m, min: 0.2, max: 1.0, step: 0.05}",
        "until: 8",
    ]
    assert "# what it is" in draft.text and "# the door's" in draft.text


def _laid_out(text: str, mapping: int, sequence: int, dash: int, end: str, *, ended: bool) -> str:
    """The same file as somebody with other habits writes it."""
    yaml, stream = YAML(typ="rt"), io.StringIO()
    yaml.width, yaml.preserve_quotes = 10_000, True
    yaml.indent(mapping=mapping, sequence=sequence, offset=dash)
    yaml.dump(yaml.load(text), stream)
    other = stream.getvalue().replace("\n", end)
    return other if ended else other.removesuffix(end)


_LOOK = {"name": "look", "approach": "free", "position": [0, 0, 0.1]}
_EDITS = {
    "a parameter": (lambda d: d.set("parameters.width.default", 0.7), 1, 1),
    "a waypoint's field": (lambda d: d.set("trajectories.open.waypoints[1].until", 8), 1, 1),
    "a new field": (lambda d: d.set("title", "Another"), 1, 1),
    "one more waypoint": (lambda d: d.add_waypoint("open", _LOOK, at=1), 0, 1),
    "a new trajectory": (lambda d: d.add_waypoint("wave", {"name": "once", "approach": "free"}), 0, 3),
    "defaults": (lambda d: d.set_defaults({"width": 0.8}), 1, 1),
    "nothing": (lambda d: None, 0, 0),
}


@given(
    indents=st.sampled_from([(2, 4, 2), (2, 2, 0), (4, 4, 2), (4, 6, 4), (3, 5, 2), (4, 2, 0)]),
    end=st.sampled_from(["\n", "\r\n"]),
    ended=st.booleans(),
    edit=st.sampled_from(sorted(_EDITS)),
)
@settings(max_examples=15, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
def test_lines_that_an_edit_does_not_concern_are_the_same_bytes_in_every_layout(
    tmp_path, cabinet_text, indents, end, ended, edit
):
    change, most_gone, most_new = _EDITS[edit]
    text = _laid_out(cabinet_text, *indents, end, ended=ended)
    draft = Draft(text, tmp_path / "cabinet.yaml")
    change(draft)
    plain = Draft(cabinet_text, tmp_path / "cabinet.yaml")
    change(plain)
    assert draft.checked().document.data == plain.checked().document.data
    draft.save()
    saved = (tmp_path / "cabinet.yaml").read_bytes().decode()
    assert saved.endswith(end) == ended
    before, after = ((whole + ("" if ended else end)).split("\n") for whole in (text, saved))
    differ = [line for line in difflib.ndiff(before, after) if line[0] in "-+"]
    assert sum(line[0] == "-" for line in differ) <= most_gone
    assert sum(line[0] == "+" for line in differ) <= most_new
    assert all(line.endswith("\r") == (end == "\r\n") for line in differ)


def test_waypoints_are_added_moved_and_taken_away(cabinet):
    draft = Draft.of(cabinet)
    draft.add_waypoint("open", {"name": "look", "approach": "free", "position": [0, 0, 0.1]}, at=0)
    draft.add_waypoint("wave", {"name": "once", "approach": "free"})
    draft.move_waypoint("hold", 0, 0)
    draft.remove("trajectories.open.waypoints[5]")
    edited = draft.checked().resolve()
    assert [w.name for w in edited.trajectories["open"].waypoints] == ["look", "before", "grasp", "turn", "swing"]
    assert [w.name for w in edited.trajectories["wave"].waypoints] == ["once"]


def test_a_draft_that_does_not_resolve_never_reaches_the_disk(cabinet):
    file = cabinet.document.file
    before = file.read_text()
    draft = Draft.of(cabinet)
    draft.set("parameters.width.default", 99)
    with pytest.raises(ConfigError, match=r"parameters.width.default: got 99 m; expected 0.2 to 1"):
        draft.save()
    assert file.read_text() == before and not file.with_suffix(".new").exists()


@pytest.mark.parametrize(
    ("edit", "says"),
    [
        (lambda d: d.set("parameters.depth.default", 1), "no 'depth' there; expected one of width"),
        (lambda d: d.remove("parameters.depth"), "expected one of width"),
        (lambda d: d.set("trajectories.open.waypoints[9].until", 1), "no '9' there"),
        (lambda d: d.add_waypoint("open", {"name": "x"}, at=9), "expected 0 to 5"),
        (lambda d: d.move_waypoint("open", 0, 7), "expected 0 to 4"),
        (lambda d: d.set_defaults({"depth": 1.0}), "expected one of width"),
    ],
)
def test_what_is_not_there_can_not_be_edited(cabinet, edit, says):
    with pytest.raises(ValueError, match=says):
        edit(Draft.of(cabinet))


@given(
    width=st.floats(0.2, 1.0),
    swing=st.sampled_from([-1.0, 1.0]),
    buttons=st.integers(1, 6),
    at=st.tuples(*[st.floats(-1, 1)] * 3),
)
@settings(max_examples=4, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
def test_an_instance_saved_as_a_template_and_read_again_is_the_same(tmp_path, cabinet, width, swing, buttons, at):
    instance = Instance("it", cabinet, Pose(position=at), {"width": width, "swing": swing, "buttons": float(buttons)})
    file = tmp_path / "again.yaml"
    file.unlink(missing_ok=True)
    again = saved_as(instance, file).resolve()
    read, meant = template_file.read(file).resolve(), instance.resolve()
    for shape, other, third in zip(meant.shapes, again.shapes, read.shapes, strict=True):
        assert shape.size == other.size == third.size
        assert shape.pose_in_template == pytest.approx(third.pose_in_template)
    assert read.frame("open.away") == pytest.approx(meant.frame("open.away"))
    with pytest.raises(FileExistsError, match="is there already"):
        saved_as(instance, file)


@given(
    xyz=st.tuples(*[st.floats(-1, 1)] * 3),
    rpy=st.tuples(*[st.floats(-math.pi, math.pi)] * 3),
    frame=st.sampled_from(["", "handle", "edge(0.1)", "button[2]"]),
)
@settings(max_examples=4, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
def test_a_recorded_waypoint_brings_the_tip_back_to_where_it_was(cabinet, robot, xyz, rpy, frame):
    instance = Instance(
        "it", cabinet, to_message(placed(np.array([0.5, 0.1, 0.2]), rotation_of(np.array([0, 0, 0.4]))))
    )
    tip = placed(np.array(xyz), rotation_of(np.array(rpy)))
    draft = Draft.of(cabinet)
    draft.add_waypoint("taught", recorded(instance, robot.arms["arm"], tip, name="here", frame=frame, hand_pose="open"))
    taught = Instance("it", draft.checked(), instance.pose_in_world)
    assert bind(taught, "taught", robot, {}).waypoints[0].tip_in_world == pytest.approx(tip, abs=1e-4)


class _Placed:
    """A robot with one door."""

    def __init__(self, template_hash: str, **parameters: float):
        given = {
            "name": "d",
            "template": "door",
            "template_hash": template_hash,
            "version": 1,
            "joint_state": {"hinge": 0.2},
        }
        self._state = InstanceState(**given, pose_in_world=Pose(position=(1, 2, 3)), parameters=parameters)

    def instances(self):
        return [self._state]


def test_a_waypoint_more_is_recorded_of_an_instance_whose_template_has_one_more_already(capsys):
    taken = instance_of(_Placed("before", width=0.5), "d")
    assert taken.pose_in_world.position == (1, 2, 3) and taken.resolve().joints["hinge"].position == 0.2
    assert taken.parameters["width"] == 0.5 and "another version of door" in capsys.readouterr().err
    with pytest.raises(ValueError, match="width: got 9 m; expected"):
        instance_of(_Placed("before", width=9.0), "d")
    with pytest.raises(ValueError, match="got 'e'; expected one of d"):
        instance_of(_Placed("before"), "e")


def test_a_new_file_is_written_so_that_people_can_read_it():
    text = written({"title": "A thing", "objects": {"body": {"shapes": [{"kind": "box", "size": [1, 2, 3]}]}}})
    assert text == "title: A thing\nobjects:\n  body:\n    shapes:\n      - {kind: box, size: [1, 2, 3]}\n"
