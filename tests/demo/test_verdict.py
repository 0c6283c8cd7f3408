"""The verdict, read as timelines of the ground truth."""

from __future__ import annotations

import math

import pytest

from handrail.demo.verdict import Truth, enough, judge


def timeline(*stretches, start_deg=0.0, step_s=0.02):
    """Samples from stretches of (duration s, degrees that the hinge turns in it, contact force N)."""
    samples, time_s, angle, peak = [Truth(0.0, math.radians(start_deg), 0.0, 0.0)], 0.0, start_deg, 0.0
    for duration, turn, force in stretches:
        steps = round(duration / step_s)
        for _ in range(steps):
            time_s += step_s
            angle += turn / steps
            peak = max(peak, force)
            samples.append(Truth(time_s, math.radians(angle), force, peak))
    return samples


REACH = (2.0, 0.0, 0.0)
REST = (2.0, 0.0, 0.0)


def test_three_strokes_that_add_up_to_enough_are_a_success():
    stroke = [(3.0, 100.0, 30.0), (1.0, 0.0, 0.0)]
    verdict = judge(timeline(REACH, *stroke, *stroke, *stroke, REST), 1.0, "succeeded")
    assert verdict.success
    assert verdict.turned_deg == pytest.approx(300, abs=0.1)
    assert verdict.peak_force_n == 30.0
    assert verdict.problems == ()


def test_turning_back_after_the_release_counts_against_it():
    samples = timeline(REACH, (3.0, 280.0, 30.0), (0.5, -40.0, 0.0), REST)
    verdict = judge(samples, 1.0, "succeeded")
    assert not verdict.success
    assert verdict.turned_deg == pytest.approx(240, abs=0.5)
    assert "turned 240°, expected at least 270°" in verdict.problems


def test_what_happens_later_than_a_second_after_the_release_does_not_count():
    samples = timeline(REACH, (3.0, 200.0, 30.0), (1.5, 0.0, 0.0), (2.0, 300.0, 0.0))
    assert judge(samples, 1.0, "succeeded").turned_deg == pytest.approx(200, abs=0.1)


def test_turning_the_wrong_way_is_no_turning():
    verdict = judge(timeline(REACH, (3.0, -300.0, 30.0), REST), 1.0, "succeeded")
    assert not verdict.success
    assert verdict.turned_deg == pytest.approx(-300, abs=0.1)


def test_angles_count_from_where_the_hinge_was_when_the_program_began():
    verdict = judge(timeline(REACH, (3.0, 280.0, 30.0), REST, start_deg=-400.0), 1.0, "succeeded")
    assert verdict.success
    assert verdict.turned_deg == pytest.approx(280, abs=0.1)


def test_pressing_too_hard_once_is_no_success():
    samples = timeline(REACH, (3.0, 290.0, 30.0), (0.02, 0.0, 140.0), REST)
    verdict = judge(samples, 1.0, "succeeded")
    assert not verdict.success
    assert verdict.problems == ("pressed with 140 N, expected at most 100 N",)


def test_a_valve_that_is_still_touched_at_the_end_was_not_let_go():
    verdict = judge(timeline(REACH, (3.0, 290.0, 30.0)), 1.0, "succeeded")
    assert not verdict.success
    assert "not let go" in verdict.problems[0]


def test_a_program_that_failed_is_no_success_even_when_the_valve_turned():
    verdict = judge(timeline(REACH, (3.0, 290.0, 30.0), REST), 1.0, "failed")
    assert not verdict.success
    assert verdict.turned_deg == pytest.approx(290, abs=0.1)


def test_a_valve_that_nobody_touched_did_not_turn():
    verdict = judge(timeline(REACH, REST), 1.0, "succeeded")
    assert not verdict.success
    assert not verdict.touched
    assert verdict.turned_deg == 0.0


def test_a_plant_that_began_anew_in_between_proves_nothing():
    turned = timeline(REACH, (3.0, 290.0, 30.0), REST)
    verdict = judge(turned + timeline(REST), 1.0, "succeeded")
    assert not verdict.success
    assert verdict.problems == ("the plant was restarted",)


@pytest.mark.parametrize("samples", [[], timeline(REACH)[:1]], ids=["none", "one"])
def test_nothing_is_proven_without_ground_truth(samples):
    verdict = judge(samples, 1.0, "succeeded")
    assert not verdict.success
    assert "not heard" in verdict.problems[0]


@pytest.mark.parametrize(
    ("successes", "runs", "holds"),
    [(1, 1, True), (0, 1, False), (2, 2, True), (1, 2, False), (19, 20, True), (18, 20, False), (0, 0, False)],
)
def test_nineteen_of_twenty_are_enough(successes, runs, holds):
    assert enough(successes, runs) is holds
