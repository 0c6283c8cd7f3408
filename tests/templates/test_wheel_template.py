"""The wheel of the library, and what a wrong template file is told."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pytest

from affordance_templates import catalogue, template_file
from handrail.config import ConfigError

WHEEL = catalogue.files()["wheel"].read_text()


def test_the_wheel_is_engaged_where_it_was_proven_to_turn():
    turn = catalogue.load("wheel").resolve().trajectories["turn"]
    by_name = {waypoint.name: waypoint for waypoint in turn.waypoints}
    assert list(by_name) == ["approach", "standoff", "engage", "turn", "release", "withdraw"]
    assert [round(float(w.position[0]), 3) for w in turn.waypoints] == [-0.15, -0.08, 0.02, 0.02, 0.02, -0.08]
    assert all(w.position[1] == pytest.approx(0.10) and w.axis.tolist() == [1, 0, 0] for w in turn.waypoints)
    assert by_name["engage"].guard == 0.02
    assert by_name["turn"].to == "arc_end" and by_name["turn"].path_force == (1500, 60)
    assert by_name["release"].to == pytest.approx(-math.radians(8))
    assert turn.entry.span == pytest.approx(math.radians(120))
    assert turn.entry.contact_offset == pytest.approx(math.asin(0.22))
    spokes = sorted(round(math.degrees(angle)) % 360 for angle in turn.entry.avoid)
    assert spokes == [0, 90, 180, 270]


def test_spokes_are_drawn_where_the_entry_avoids_them_and_turn_with_the_hinge():
    template = catalogue.load("wheel")
    for hinge in (0.0, 0.7):
        resolved = template.resolve({"spokes": 3}, {"hinge": hinge})
        drawn = [s for s in resolved.shapes if s.object == "spokes"]
        angles = [math.atan2(s.pose_in_template[2, 3], s.pose_in_template[1, 3]) for s in drawn]
        avoided = [a + resolved.joints["hinge"].position for a in resolved.trajectories["turn"].entry.avoid]
        assert np.exp(1j * np.array(angles)) == pytest.approx(np.exp(1j * np.array(avoided)))
        for shape in drawn:
            outward = shape.pose_in_template[:3, 3] / np.linalg.norm(shape.pose_in_template[:3, 3])
            assert abs(shape.pose_in_template[:3, 2] @ outward) == pytest.approx(1), "a spoke points at the hub"


def test_the_rim_is_a_torus_about_the_hinge():
    rim = next(s for s in catalogue.load("wheel").resolve().shapes if s.object == "rim")
    assert rim.kind == "torus" and rim.size == pytest.approx((0.15, 0.012))
    assert abs(rim.pose_in_template[:3, 2] @ [1, 0, 0]) == pytest.approx(1)


def test_a_larger_wheel_is_engaged_further_out():
    turn = catalogue.load("wheel").resolve({"radius": 0.21}).trajectories["turn"]
    assert turn.waypoints[2].position[1] == pytest.approx(0.14)


@pytest.mark.parametrize("given", [{"radius": 5.0}, {"radius": float("nan")}, {"spokes": 3.5}, {"colour": 1.0}])
def test_parameters_that_do_not_fit_are_refused_naming_them(given):
    with pytest.raises(ValueError, match=f"{next(iter(given))}: .*expected"):
        catalogue.load("wheel").resolve(given)


def test_the_hash_differs_when_the_content_differs(tmp_path: Path):
    file = tmp_path / "wheel.yaml"
    file.write_text(WHEEL)
    first = template_file.read(file).hash
    file.write_text(WHEEL.replace("guard: 0.02", "guard: 0.03"))
    assert template_file.read(file).hash != first


@pytest.mark.parametrize(
    ("old", "new", "field", "expectation"),
    [
        ("2/3 * radius", "2/3 * radios", "definitions.engage_radius", "unknown name 'radios'"),
        ("2/3 * radius", "radius.__class__", "definitions.engage_radius", "not allowed"),
        ("kind: torus", "kind: donut", "objects.rim.shapes[0].kind", "donut"),
        ("size: [radius, rim_radius]", "size: [radius]", "objects.rim.shapes[0].size", "expected 2 of a torus"),
        ("size: [radius, rim_radius]", "size: [radius, 0 - 1]", "objects.rim.shapes[0].size", "above 0"),
        ("default: 0.15", "default: 15", "parameters.radius.default", "expected 0.08 to 0.4 m"),
        ("  rim:\n    joint: hinge", "  rim:\n    joint: hinges", "objects.rim.joint", "expected one of hinge"),
        ("kind: continuous, axis: [1, 0, 0]", "kind: continuous, axis: [0, 0, 0]", "joints.hinge.axis", "a direction"),
        ("kind: continuous", "kind: revolute", "joints.hinge.lower", "expected a number"),
        ("guard: 0.02", "guards: 0.02", "trajectories.turn.waypoints[2].guards", "unknown field"),
        ("guard: 0.02", "guard: 0 - 1", "trajectories.turn.waypoints[2].guard", "above 0"),
        ("to: arc_end", "to: the_end", "trajectories.turn.waypoints[3].to", "unknown name 'the_end'"),
        ("name: engage,", "name: standoff,", "trajectories.turn.waypoints[2].name", "there twice"),
        ("repeat: {i: spokes}}", "repeat: {i: 0.5}}", "trajectories.turn.entry.avoid.repeat.i", "a whole number"),
    ],
)
def test_a_wrong_template_is_told_line_field_and_expectation(tmp_path: Path, old, new, field, expectation):
    assert old in WHEEL
    file = tmp_path / "wheel.yaml"
    file.write_text(WHEEL.replace(old, new, 1))
    with pytest.raises(ConfigError) as caught:
        template_file.read(file)
    assert caught.value.field.startswith(field), str(caught.value)
    assert expectation in caught.value.problem
    changed = next(k for k, text in enumerate(file.read_text().splitlines(), 1) if new.splitlines()[-1] in text)
    assert caught.value.line is not None and abs(caught.value.line - changed) <= 4


def test_a_place_on_the_rim_is_picked_by_its_angle_goes_with_the_radius_and_turns_with_the_wheel():
    wheel = catalogue.load("wheel")
    for radius in (0.15, 0.3):
        for turned in (0.0, 0.4):
            resolved = wheel.resolve({"radius": radius}, {"hinge": turned})
            for angle in (0.5, math.pi):
                there = resolved.frame(f"on_rim({angle})")[:3, 3]
                assert there == pytest.approx(
                    [0.0, radius * math.cos(angle + turned), radius * math.sin(angle + turned)]
                )
            assert resolved.frame("on_rim")[:3, 3] == pytest.approx(resolved.frame(f"on_rim({math.pi / 2})")[:3, 3])
