"""The benchmark's own half: its problem and its judge, without peers, and whatever the time."""

from __future__ import annotations

import numpy as np
import pytest

from benchmarks.planning import FEET, HAND, Problem
from engines.planning.ik.solver import Solver


@pytest.fixture(scope="module")
def problem(tmp_path_factory) -> Problem:
    return Problem(tmp_path_factory.mktemp("problem"), targets=10)


def test_all_targets_are_reached_and_the_judge_sees_it(problem):
    solver = Solver(problem.mechanism)
    assert problem.mechanism.nv == 34
    for number in range(10):
        answer = solver.solve([*problem.always, problem.goal(number)], problem.home)
        assert problem.kept(solver, number, [answer.q])
        assert not problem.kept(solver, (number + 1) % 10, [answer.q]), "it is another target's"
        off = answer.q.copy()
        off[0] += 2e-3  # m, base and all: feet that have slipped
        assert not problem.kept(solver, number, [off])


def test_an_answer_without_numbers_and_a_start_that_has_not_moved_are_no_success(problem):
    solver = Solver(problem.mechanism)
    assert not problem.kept(solver, 0, [np.full(problem.mechanism.nq, np.nan)])
    assert not problem.kept(solver, 0, [problem.home])


def test_a_peers_configuration_is_read_as_it_was_meant(problem, placed):
    q = problem.mechanism.within_limits(problem.home)
    base = placed(problem.mechanism, q, "base_link")
    again = problem.configuration(base.homogeneous.tolist(), q[problem.mechanism.q_rows].tolist())
    for frame in (HAND, *FEET):
        assert placed(problem.mechanism, again, frame).isApprox(placed(problem.mechanism, q, frame), 1e-9)
