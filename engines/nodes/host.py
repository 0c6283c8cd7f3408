"""A node as its host sees it: started, fed, started anew, ended. Whatever its code does, only the node ends, and says why."""

from __future__ import annotations

import sys
import threading
import time
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

from engines.nodes import library
from engines.nodes.failure import NodeFailed
from engines.nodes.launcher import NodesProcess
from engines.nodes.life import Life
from engines.nodes.wire import Hello
from handrail import workspace
from handrail.usage import Watch

__all__ = ["NodeFailed", "NodeProcess"]

_FIRST_DELAY_S, _LONGEST_DELAY_S = 0.2, 5.0
"""before it is started anew; doubled each time"""
_STEADY_S = 60.0
"""a node that went so long without a failure has all its restarts again"""


class NodeProcess:
    """One node. Methods may be called from any thread; callbacks must not wait."""

    def __init__(
        self, file: Path, params: Mapping[str, Any] | None = None, *, told: Callable[[dict[str, Any]], None] = lambda outputs: None,
        ended: Callable[[NodeFailed], None] = lambda failure: None, noted: Callable[[str], None] | None = None,
        said: Callable[[str], None] | None = None, given: Callable[[dict[str, Any]], None] = lambda values: None,
        up: Callable[[], None] = lambda: None, restarts: int | None = None, silent_s: float = 5.0, window_s: float = 10.0,
        closing: threading.Event | None = None,
    ):  # fmt: skip
        """Starts it and waits until it is loaded. Raises NodeFailed.

        :param told: what it wrote in each step
        :param ended: why it ended by itself; after `restarts` of them it stays ended
        :param noted: what a person should know and did not end it: slowed down, started anew (standard error, unless given)
        :param said: each line that it prints (standard error, unless given)
        :param given: inputs and parameters that it has taken
        :param up: it has been started anew
        :param restarts: None: as the node itself has it
        :param silent_s: of wall time without a sign of life, after which it is killed
        :param window_s: over which its share of a core is counted
        :param closing: set it and call `close` to end it; set while it is still being loaded, it is killed
        """
        self.file, self._told, self._ended = file, told, ended
        self._noted, self._said = noted or self._printed, said or self._printed
        self._given, self._up = given, up
        self._deployed = workspace.deployed()  # in this thread: where a composite's parts are found
        self._restarts, self._silent_s, self._window_s = restarts, silent_s, window_s
        self.restarted = 0
        self._params, self._inputs = dict(params or {}), dict[str, Any]()
        self._lock = threading.Lock()
        self._turn = threading.Lock()
        """of who asks it: it does one thing after the other"""
        self._closing = closing or threading.Event()
        self._failure: NodeFailed | None = None
        self._reloading = threading.Lock()
        self._puts = 0
        self._version = _version(file)
        self._life = self._begun()
        self._take_over(self._life)

    @property
    def hello(self) -> Hello:
        """What it says of itself."""
        return self._life.hello

    @property
    def process(self) -> NodesProcess:
        return self._life.process

    @property
    def usage(self) -> Watch | None:
        """What it uses, as of the last second or so."""
        return self._life.watch

    # ---------------------------------------------------------------------------------------------------------------- doing

    def put(self, inputs: Mapping[str, Any] | None = None, params: Mapping[str, Any] | None = None) -> None:
        """New inputs and parameters, from the next step on. Raises NodeFailed when it declines them, or has ended."""
        self._ask(inputs or {}, params or {}, step=False)

    def step(self, inputs: Mapping[str, Any] | None = None, params: Mapping[str, Any] | None = None) -> dict[str, Any]:
        """One step with these inputs; the outputs that it wrote. Raises NodeFailed: declined, raised, hung, killed."""
        return self._ask(inputs or {}, params or {}, step=True)

    def reload(self, file: Path | None = None) -> bool:
        """Go on in the file as it is now, between two calls, with the parameters and inputs that it still has. False: no change.

        Raises NodeFailed when the new version can't be loaded or started: then the node goes on in the version that it had. Told
        either way (`noted`). `file`: where it is found now.
        """
        with self._reloading:
            before_file, self.file = self.file, file or self.file
            self._deployed = workspace.deployed()
            version = _version(self.file)
            if version == self._version:
                return False
            with self._turn:
                puts, inputs, params = self._puts, dict(self._inputs), dict(self._params)
            fresh = self._new()
            try:
                fresh.load(inputs, params, fitting=True)
            except NodeFailed as problem:
                self._version, self.file = version, before_file  # tried once, until it changes again
                self._noted(f"goes on in the version that it had: {problem.why}")
                raise
            with self._turn:
                with self._lock:
                    before, self._failure = self._life, None
                    self.restarted = 0
                self._take_over(fresh)
                inputs, params = fresh.fitting("inputs", self._inputs), fresh.fitting("params", self._params)
                if self._puts != puts:  # while it was loaded
                    fresh.ask(inputs, params, step=False)
                gone = sorted((self._inputs.keys() - inputs.keys()) | (self._params.keys() - params.keys()))
                self._inputs, self._params, self._version = inputs, params, version
            before.told = lambda outputs: None
            before.end()
            self._up()
            if self._closing.is_set():
                fresh.end()
        lost = f"; it has no {', '.join(gone)} of that kind any more" if gone else ""
        self._noted(f"goes on in version {version[:8]}{lost}")
        return True

    def close(self) -> None:
        """End it: asked first, killed a second later."""
        self._closing.set()
        with self._lock:
            life = self._life
        life.end()

    def __enter__(self) -> NodeProcess:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def _ask(self, inputs: Mapping[str, Any], params: Mapping[str, Any], *, step: bool) -> dict[str, Any]:
        with self._turn:
            with self._lock:
                life, failure = self._life, self._failure
            if failure is not None:
                raise failure
            found = life.ask(inputs, params, step=step)
            self._inputs.update(inputs)
            self._params.update(params)
            self._puts += 1
        if inputs or params:
            self._given({**inputs, **params})
        return found

    # ------------------------------------------------------------------------------------------------------------- its lives

    def _begun(self) -> Life:
        """A new process, loaded with what the node has been given. Raises NodeFailed."""
        life = self._new()
        life.load(self._inputs, self._params)
        return life

    def _new(self) -> Life:
        with workspace.pinned(self._deployed):
            return Life(
                self.file, said=self._said, closing=self._closing, silent_s=self._silent_s, window_s=self._window_s
            )

    def _take_over(self, life: Life) -> None:
        """From now on it is the one that is asked and listened to."""
        life.told, life.noted = self._told, self._noted
        life.over = lambda failure: self._over(life, failure)
        with self._lock:
            self._life = life
            self._since = time.monotonic()
        life.listen()

    def _over(self, life: Life, failure: NodeFailed) -> None:
        """It has ended. In a thread of its own."""
        with self._lock:
            if self._closing.is_set() or life is not self._life:
                return
            if time.monotonic() - self._since >= _STEADY_S:
                self.restarted = 0
        limit = life.hello.limits.restarts if self._restarts is None else self._restarts
        while True:
            again = self.restarted < limit
            with self._lock:
                if self._life is not life:  # a new version has taken over while this one was tried once more
                    return
                self._failure = failure
            self._ended(failure)
            if not again:
                return
            delay_s = min(_FIRST_DELAY_S * 2**self.restarted, _LONGEST_DELAY_S)
            self.restarted += 1
            self._noted(f"is started anew in {delay_s:g} s ({self.restarted} of {limit} times): {failure.why}")
            if self._closing.wait(delay_s):
                return
            try:
                fresh = self._begun()
            except NodeFailed as problem:
                if self._closing.is_set():
                    return
                failure = problem
                continue
            with self._turn:
                with self._lock:
                    superseded = self._life is not life
                    if not superseded:
                        self._failure = None
                if not superseded:
                    self._take_over(fresh)
            if superseded:
                fresh.end()
                return
            self._up()
            if self._closing.is_set():  # `close` has ended the one before
                fresh.end()
            return

    def _printed(self, text: str) -> None:
        print(f"node {self.file.stem}: {text}", file=sys.stderr, flush=True)


def _version(file: Path) -> str:
    """Empty while there is no file."""
    try:
        return library.version(file)
    except OSError:
        return ""
