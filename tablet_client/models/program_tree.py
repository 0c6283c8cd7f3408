"""The program as a tree of states: what each does, which are lit, how long they took, where the run is to pause."""

from __future__ import annotations

from dataclasses import dataclass

from handrail.messages import (
    GetOutline,
    GetRunHistory,
    Message,
    Outline,
    OutlineState,
    RunHistory,
    RunState,
    StateVisit,
)

_OVER = ("succeeded", "failed", "stopped")
_ASKED_EVERY = 1.0  # s between two looks at what a run has passed: it grows with each state
_NS = 1_000_000_000


@dataclass(frozen=True)
class Row:
    """One line of the tree."""

    id: str
    title: str
    depth: int
    does: str
    mark: str
    """active, waiting (active, and has not begun what it does), failed, passed, or empty: not reached yet"""
    seconds: float
    """of its last stay; -1: it was never entered"""
    visits: int
    halts: bool
    """the run pauses before what it does"""
    outcome: str
    """of the program, where it ends it"""


class ProgramTree:
    """What is known of the states of the run's program. `want` says what to ask the engine for."""

    def __init__(self) -> None:
        self.outline: Outline | None = None
        self.visits: list[StateVisit] = []
        self._run: RunState | None = None
        self._under_way: dict[type, str] = {}
        """call → hash or id of the run that it was asked for"""
        self._refused = ""
        """hash of a program whose states the engine does not tell"""
        self._outdated = False
        self._asked_at = float("-inf")

    def take_run(self, run: RunState | None) -> None:
        """News of the run."""
        if run is None or self._run is None or run.run != self._run.run:
            self.visits = []
        if run is not None and (
            self._run is None
            or (run.run, run.status, run.active) != (self._run.run, self._run.status, self._run.active)
        ):
            self._outdated = True
        self._run = run
        if run is None or (self.outline is not None and self.outline.hash != run.hash):
            self.outline = None

    def take(self, answer: Outline | RunHistory) -> None:
        """What was asked for; that of another program or run is left aside."""
        self._under_way.pop(GetOutline if isinstance(answer, Outline) else GetRunHistory, None)
        if self._run is None:
            return
        if isinstance(answer, RunHistory):
            if answer.run == self._run.run:
                self.visits = list(answer.visits)
        elif answer.hash == self._run.hash:
            self.outline = answer

    def failed(self, call: Message, refused: bool) -> None:
        """A question was not answered, or refused."""
        asked = self._under_way.pop(type(call), "")
        if isinstance(call, GetOutline) and refused:
            self._refused = asked

    def detached(self) -> None:
        """Nothing that was asked will be answered any more."""
        self._under_way.clear()
        self._refused, self._outdated = "", self._run is not None

    def want(self, now: float) -> list[Message]:
        """What to ask the engine for, each once: s, monotonic."""
        run, wanted = self._run, list[Message]()
        if run is None:
            return wanted
        if self.outline is None and GetOutline not in self._under_way and self._refused != run.hash:
            self._under_way[GetOutline] = run.hash
            wanted.append(GetOutline())
        if self._outdated and GetRunHistory not in self._under_way and now - self._asked_at >= _ASKED_EVERY:
            self._under_way[GetRunHistory], self._outdated, self._asked_at = run.run, False, now
            wanted.append(GetRunHistory())
        return wanted

    def state(self, id: str) -> OutlineState | None:
        """A state by its id."""
        return next((state for state in self.states if state.id == id), None)

    @property
    def states(self) -> list[OutlineState]:
        """As they stand in the file; those of the run alone where the engine tells no others."""
        if self.outline is not None:
            return self.outline.states
        return [] if self._run is None else [OutlineState(id=id) for id in self._run.active]

    def rows(self, now_ns: int) -> list[Row]:
        """The tree, line by line; `now_ns`: the robot's clock."""
        run = self._run
        if run is None:
            return []
        last = {visit.state: visit for visit in self.visits}
        count: dict[str, int] = {}
        for visit in self.visits:
            count[visit.state] = count.get(visit.state, 0) + 1
        depths: dict[str, int] = {}
        rows = []
        for state in self.states:
            depth = depths[state.id] = depths[state.parent] + 1 if state.parent in depths else 0
            seen = last.get(state.id)
            active = state.id in run.active and run.status not in _OVER
            rows.append(
                Row(
                    id=state.id,
                    title=state.title or state.id.rpartition("/")[2].replace("_", " "),
                    depth=depth,
                    does=state.does,
                    mark=self._mark(run, state, active, seen),
                    seconds=_lasted(seen, active, now_ns),
                    visits=count.get(state.id, 0),
                    halts=state.id in run.breakpoints,
                    outcome=state.outcome,
                )
            )
        return rows

    @property
    def innermost(self) -> str:
        """The active state that does something (the last of several); of a run that is over the last that did. Empty: none."""
        run = self._run
        if run is None:
            return ""
        doing = {state.id for state in self.states if state.does} or set(run.active)
        inside = [id for id in run.active if id in doing] if run.status not in _OVER else []
        if inside:
            return inside[-1]
        passed = [visit.state for visit in self.visits if visit.state in doing]
        return passed[-1] if passed and run.status in _OVER else ""

    def _mark(self, run: RunState, state: OutlineState, active: bool, seen: StateVisit | None) -> str:
        if active:
            return "waiting" if state.id in run.waiting else "active"
        if run.status == "failed" and (state.id in run.active or state.id == self.innermost):
            return "failed"
        return "passed" if seen is not None or (run.status in _OVER and state.id in run.active) else ""


def _lasted(visit: StateVisit | None, active: bool, now_ns: int) -> float:
    if visit is None:
        return -1.0
    if visit.left_ns:
        return (visit.left_ns - visit.entered_ns) / _NS
    return (
        float(max(now_ns - visit.entered_ns, 0) // _NS) if active else -1.0
    )  # whole s: what lasts is not drawn all the time
