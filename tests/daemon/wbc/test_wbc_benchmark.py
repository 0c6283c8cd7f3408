"""The benchmark's problem, without its peers."""

import json
from pathlib import Path

import numpy as np

from benchmarks import wbc


def test_the_problem_is_the_same_for_all_and_its_levels_are_met(tmp_path: Path) -> None:
    problem = wbc.Problem(tmp_path)
    for_peers = json.loads((tmp_path / "problem.json").read_text())
    assert len(for_peers["tasks"]["15"]) == 15
    assert np.load(tmp_path / "path.npy").shape == (2, wbc._STATES, problem.model.nv)
    assert problem.model.nv == 17
    assert wbc.largest_residual(problem, 5) <= wbc._EXACT


def test_tight_bounds_are_reached_by_enough_states_and_can_be_kept(tmp_path: Path) -> None:
    problem = wbc.Problem(tmp_path)
    torque, share = wbc.tight(problem, 5, "path")
    assert share >= wbc._ENOUGH
    model, body = problem.ours(5, torque)
    solved = 0
    for q, v in zip(*problem.states["path"], strict=True):
        model.update(q, v)
        solved += body.solve().solved
    assert solved == wbc._STATES
