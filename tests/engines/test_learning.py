"""Runs are remembered; what they tell is said before and during the next one, and nothing is said that chance explains."""

from __future__ import annotations

import sqlite3
from dataclasses import replace

import numpy as np
import pytest
from typer.testing import CliRunner

from engines.learning import cli
from engines.learning.book import BookError, PastRun, RunBook
from engines.learning.facts import Fact
from engines.learning.predictors import CHANCE, _fisher, predictors, splits, warnings
from handrail import messages as m


def past(number: int, status: str, **facts: float | str) -> PastRun:
    named = {
        name.replace("__", "."): Fact(value, "m" if name.startswith("valve") else "") for name, value in facts.items()
    }
    ended = f"2026-01-01T00:{number // 60:02d}:{number % 60:02d}.000+00:00"
    return PastRun(f"run-{number}", "two_joints", "turn_valve", "0", ended, 9.5, status, f"run {number}", named)


HIGH_FAILS = [
    past(k, "failed" if k % 4 == 0 else "succeeded", valve__z=0.3 + 0.2 * (k % 4 == 0), arm="right") for k in range(24)
]
"""every fourth valve hung high, and there it failed"""


@pytest.fixture
def book(tmp_path, monkeypatch) -> RunBook:
    monkeypatch.setenv("HANDRAIL_LEARNED", str(tmp_path / "learnt" / "runs.sqlite"))
    return RunBook(tmp_path / "learnt" / "runs.sqlite")


class TestTheBook:
    def test_keeps_runs_with_their_facts_the_last_of_them_in_order(self, book):
        assert book.runs() == []
        for run in HIGH_FAILS:
            book.add(run)
        assert book.runs("two_joints", "turn_valve", last=3) == HIGH_FAILS[-3:]
        assert book.runs("another") == []

    def test_has_a_run_once_that_was_taken_up_again(self, book):
        book.add(HIGH_FAILS[0])
        again = replace(HIGH_FAILS[0], status="succeeded", facts={"arm": Fact("left")})
        book.add(again)
        assert book.runs() == [again]

    def test_forgets_what_it_is_told_to(self, book):
        for run in HIGH_FAILS:
            book.add(run)
        assert book.forget(program="another") == 0
        assert book.forget("two_joints", "turn_valve") == 24
        assert book.runs() == []
        with sqlite3.connect(book.file) as raw:
            assert raw.execute("SELECT count(*) FROM fact").fetchone() == (0,)

    def test_says_which_file_it_can_not_read_and_leaves_it_as_it_is(self, book):
        book.file.parent.mkdir()
        book.file.write_text("no database at all, but somebody's words" * 40)
        with pytest.raises(BookError, match=r"runs\.sqlite"):
            book.add(HIGH_FAILS[0])
        assert book.file.read_text().startswith("no database")

    def test_of_another_version_is_refused(self, book):
        book.add(HIGH_FAILS[0])
        with sqlite3.connect(book.file) as raw:
            raw.execute("PRAGMA user_version = 7")
        with pytest.raises(BookError, match="format 7"):
            book.runs()


class TestPredictors:
    def test_find_the_side_on_which_runs_failed_and_say_it_in_numbers(self):
        (found,) = predictors(HIGH_FAILS)
        assert (found.fact, found.side) == ("valve.z", "above")
        assert found.at == pytest.approx(0.4)
        assert warnings([found], {"valve.z": Fact(0.52, "m")}) == [
            "6 of 6 past runs with valve.z above 0.4 m failed, 0 of 18 of the others: it is 0.52 m"
        ]
        assert warnings([found], {"valve.z": Fact(0.31, "m")}) == []
        assert warnings([found], {}) == []

    def test_find_a_word_as_well(self):
        runs = [
            past(k, "failed" if k % 3 == 0 else "succeeded", arm="left" if k % 3 == 0 else "right") for k in range(30)
        ]
        (found,) = predictors(runs)
        assert found.words(Fact("left")) == "10 of 10 past runs with arm is left failed, 0 of 20 of the others"

    def test_say_nothing_after_few_runs_or_where_all_ended_alike(self):
        assert splits(HIGH_FAILS[:5]) == []
        assert splits([past(k, "failed", valve__z=0.1 * k) for k in range(20)]) == []
        assert splits([past(k, "stopped", valve__z=0.1 * k) for k in range(20)]) == []

    def test_warn_of_facts_that_tell_nothing_no_more_often_than_chance_is_let(self):
        random, alarms, worlds = np.random.default_rng(4), 0, 60
        for _ in range(worlds):
            runs = [
                past(
                    k,
                    "failed" if random.random() < 0.5 else "succeeded",
                    valve__x=random.normal(),
                    valve__y=random.normal(),
                )
                for k in range(16)
            ]
            alarms += bool(predictors(runs))
        assert alarms <= 2 * CHANCE * worlds

    def test_know_chance_as_statistics_does(self):
        from scipy.stats import fisher_exact

        for failed, of, others_failed, others in ((6, 6, 0, 18), (3, 7, 2, 11), (0, 4, 5, 9), (5, 5, 5, 5)):
            table = [[failed, of - failed], [others_failed, others - others_failed]]
            expected = fisher_exact(table, alternative="greater").pvalue
            assert _fisher(failed, of, others_failed, others) == pytest.approx(expected)


class TestAnEngine:
    def test_writes_a_run_down_with_what_it_was_asked_and_what_it_met(self, book, stack):
        stack.place(spokes=5)
        stack.run(goal_deg=40)
        stack.call(m.AnswerPrompt(id=stack.prompt().id, answer="approve", by="test"))
        assert stack.ended().status == "succeeded"
        stack.engine._run.join(10.0)
        (run,) = book.runs("two_joints", "turn_valve")
        assert (run.status, run.facts["goal_deg"]) == ("succeeded", Fact(40.0, "deg"))
        assert (run.facts["arm"], run.facts["valve.spokes"]) == (Fact("right"), Fact(5.0))
        assert run.facts["valve.z"] == Fact(0.30, "m")
        assert run.facts["plan.clearance"].unit == "m"
        assert run.facts["motion.guarded"] == Fact(0.0)
        assert run.duration_s > 0.0

    def test_warns_before_a_run_that_looks_like_failures_and_not_before_another(self, book, stack):
        for k, run in enumerate(HIGH_FAILS):
            low = {"valve.z": Fact(0.5 if run.status == "succeeded" else 0.3, "m")}
            book.add(replace(run, id=f"low-{k}", facts=low))
        stack.place()
        deploy = m.Deploy(program="turn_valve", bindings={"arm": "right", "valve": "wheel_1"})
        deployed = stack.call(deploy)
        (warning,) = deployed.warnings
        assert warning.startswith("6 of 6 past runs with valve.z below 0.4 m failed")
        assert stack.call(m.Run(deployment=deployed.id)).warnings == [warning]
        assert stack.wait(lambda e: isinstance(e, m.LogLine) and warning in e.text).level == "warning"
        stack.call(m.StopRun())
        stack.ended()
        stack.call(m.MoveInstance(name="wheel_1", pose_in_world=m.Pose(position=(0.5, -0.3, 0.5))))
        assert stack.call(deploy).warnings == []

    def test_warns_while_a_run_meets_what_past_failures_met(self, book, stack, daemon):
        for k in range(24):
            bad = k % 3 == 0
            run = past(k, "failed" if bad else "succeeded")
            book.add(replace(run, facts={"motion.guarded": Fact(2.0 if bad else 0.0)}))
        daemon.resist(2)
        stack.place()
        assert stack.run(goal_deg=40).warnings == []
        stack.call(m.AnswerPrompt(id=stack.prompt().id, answer="approve", by="test"))
        (warning,) = stack.ended().warnings
        assert warning == "8 of 8 past runs with motion.guarded above 1 failed, 0 of 16 of the others: it is 2"

    def test_runs_on_with_a_book_that_nobody_can_read(self, book, stack):
        book.file.parent.mkdir()
        book.file.write_text("no database at all, but somebody's words" * 40)
        stack.place()
        stack.run(goal_deg=40)
        stack.call(m.AnswerPrompt(id=stack.prompt().id, answer="approve", by="test"))
        assert stack.ended().status == "succeeded"


class TestTheCommand:
    def test_reports_what_tells_and_plots_it(self, book, tmp_path):
        for run in HIGH_FAILS:
            book.add(run)
        done = CliRunner().invoke(cli.app, ["report", "turn_valve", "--png", str(tmp_path / "success.png")])
        assert done.exit_code == 0, done.output
        assert "18 of 24 runs succeeded" in done.output
        assert "valve.z above 0.4 m" in done.output
        assert (tmp_path / "success.png").read_bytes()[:4] == b"\x89PNG"
        assert "run 23" in CliRunner().invoke(cli.app, ["list"]).output
        assert "24 runs forgotten" in CliRunner().invoke(cli.app, ["forget", "turn_valve"]).output

    def test_says_what_is_wrong(self, book, tmp_path, monkeypatch):
        assert "no run of levitate" in CliRunner().invoke(cli.app, ["report", "levitate"]).output
        for run in HIGH_FAILS:
            book.add(run)
        nowhere = CliRunner().invoke(cli.app, ["report", "turn_valve", "--png", str(tmp_path / "success.xyz")])
        assert nowhere.exit_code == 1
        assert "success.xyz" in nowhere.output
        monkeypatch.setenv("HANDRAIL_LEARNED", "off")
        assert "--book" in CliRunner().invoke(cli.app, ["list"]).output
