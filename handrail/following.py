"""A run followed to its end at the command line: what it does, what it asks, how it ended."""

from __future__ import annotations

import contextlib
import sys
from collections.abc import Callable

import typer
from rich.console import Console

from handrail.client import Client, RefusedError, Unreachable
from handrail.link.events import Events
from handrail.messages import LogLine, OnFailure, Prompt, PromptClosed, RunState

FOLLOWED = (RunState, Prompt, PromptClosed, LogLine)
"""what is listened to, from before the run begins"""
_RESULTS = {"succeeded": 0, "failed": 1, "stopped": 130}
_SILENT_S = 2.0
_out, _err = Console(), Console(stderr=True)


def on_failure(yes: bool) -> OnFailure:
    """Whether a run that fails waits for help: where somebody sits at the terminal and is asked."""
    return "pause" if sys.stdin.isatty() and not yes else "end"


def follow(robot: Client, events: Events, started: RunState, *, yes: bool) -> int:
    """Show a run until it has ended; the command's exit status. Ctrl-C stops it, at a prompt too.

    `yes`: approve every prompt, by its first option.
    """
    _out.print(f"{started.program} {started.hash} runs as {started.run}", highlight=False)
    shown = ""
    try:
        while True:
            event = events.next(_SILENT_S)
            if event is None:
                # A long motion is silent too, but the end may have been missed, or the engine be another one by now.
                try:
                    event = robot.snapshot().run
                except Unreachable:
                    continue
                if event is None or event.run != started.run:
                    _err.print("the engine was started anew since: this run is over", style="red")
                    return 1
            if isinstance(event, RunState) and event.run == started.run:
                line = f"{event.status:9} {' / '.join(event.active)}  {_numbers(event, started)}".rstrip()
                if line != shown:
                    _out.print(line, highlight=False, markup=False, soft_wrap=True)
                new, shown = line != shown, line
                if event.status == "paused" and event.failing and new:
                    _help(robot, event)
                if event.status in _RESULTS:
                    _out.print(f"{event.status}: {event.detail}", highlight=False, markup=False, soft_wrap=True)
                    return _RESULTS[event.status]
            elif isinstance(event, Prompt) and event.run == started.run:
                _answer(robot, event, yes)
            elif isinstance(event, LogLine) and event.level != "info":
                _err.print(f"{event.source}: {event.text}", markup=False, highlight=False, soft_wrap=True)
    except (KeyboardInterrupt, typer.Abort):  # the latter from a prompt, also where nobody can type an answer
        with contextlib.suppress(RefusedError):  # it has ended by itself in this moment
            robot.stop_run()
        _out.print("stopped: cancelled from the keyboard; the robot holds")
        return _RESULTS["stopped"]


def _answer(robot: Client, prompt: Prompt, yes: bool) -> None:
    details = ", ".join(f"{name} {value:.3g}" for name, value in prompt.details.items())
    _out.print(
        f"? {prompt.text} ({details})" if details else f"? {prompt.text}", style="bold", markup=False, highlight=False
    )
    answer = prompt.options[0] if yes else ""
    while answer not in prompt.options:
        answer = typer.prompt(" / ".join(prompt.options))
    try:
        robot.answer(prompt.id, answer, by="command line")
        _out.print(f"  {answer}", highlight=False, markup=False)
    except RefusedError as late:
        _out.print(f"  {late}", highlight=False, markup=False)


def _help(robot: Client, run: RunState) -> None:
    """Ask what is to become of what has failed."""
    calls: dict[str, Callable[[str], object]] = {
        "retry": lambda state: robot.resume_run(),
        "skip": robot.skip,
        "fail": robot.let_fail,
        "stop": lambda state: robot.stop_run(),
    }
    for state, why in run.failing.items():
        _out.print(f"{state} has failed: {why}", style="red", markup=False, highlight=False, soft_wrap=True)
        _out.print("  retry it (move the robot before, or see to the cause), skip it, let it fail, or stop the run")
        answer = ""
        while not answer:
            answer = typer.prompt(" / ".join(calls))
            try:
                calls.get(answer, lambda state: None)(state)
            except RefusedError as no:
                _out.print(f"  {no}", highlight=False, markup=False)
                now = robot.snapshot().run
                if now is None or state not in now.failing:
                    return  # somebody else was first
                answer = ""
            answer = answer if answer in calls else ""
        if answer in ("retry", "stop"):
            return
    with contextlib.suppress(RefusedError):  # what was done has ended it
        robot.resume_run()


def _numbers(state: RunState, started: RunState) -> str:
    """Those that the run has changed: parameters and what has not begun to count yet say nothing."""
    return "  ".join(
        f"{name} {value:.4g}"
        for name, value in state.data.items()
        if isinstance(value, int | float) and not isinstance(value, bool) and value != started.data.get(name)
    )
