"""`do: node`: give a process node inputs and go on with what it finds."""

from __future__ import annotations

import contextlib
import queue
import threading
from collections.abc import Iterator, Mapping
from typing import Any

from engines.activities.base import Activity, ActivityFailed, Argument, Context, Kind
from engines.nodes import library
from engines.nodes.host import NodeFailed, NodeProcess
from engines.nodes.ports import plain
from engines.runs.preconditions import Precondition


class NodeActivity(Activity):
    """Starts a node in a process of its own and ends it when all `outputs` were written: after one step, or, of a node that steps
    by itself, as soon as they are there. Done with them, by their names.

    With `lives: run` it goes on, with what it remembers, until the run ends, and the next state that asks for it asks the same.
    """

    arguments = {
        "node": Argument(Kind.NODE),
        "inputs": Argument(Kind.PORTS, required=False),
        "params": Argument(Kind.PORTS, required=False),
        "outputs": Argument(Kind.NAMES),
        "lives": Argument(Kind.CHOICE, required=False, default="state", choices=("state", "run")),
    }

    def __init__(self, context: Context, values: Mapping[str, Any]):
        super().__init__(context, values)
        self._found: queue.SimpleQueue[dict[str, Any] | NodeFailed] = queue.SimpleQueue()
        self._process: NodeProcess | None = None
        self._lock = threading.Lock()
        self._called = ""

    @classmethod
    def outputs_of(cls, given: Mapping[str, Any]) -> frozenset[str]:
        """Those that the program asks for."""
        names = given.get("outputs", ())
        return frozenset(names if isinstance(names, list) else ())

    def run(self) -> dict[str, Any]:
        name, wanted = str(self.values["node"]), list(self.values["outputs"])
        self.services.daemon.hold_time(self.context.hold_s)
        try:
            if self.values["lives"] == "run":
                found = self._of_run(name, wanted)
            else:
                found = self._of_state(name, wanted)
        except NodeFailed as failed:
            if failed.traceback:
                self.services.log("error", failed.traceback, name)
            reason = "cancelled" if self.cancelled.is_set() else "node_failed"
            raise ActivityFailed(reason, failed.why) from failed
        except ValueError as problem:
            raise ActivityFailed("refused", str(problem)) from problem
        return {each: plain(found[each]) for each in wanted}

    def _of_state(self, name: str, wanted: list[str]) -> dict[str, Any]:
        with self.services.nodes.running(
            library.find(name),
            self.values["params"],
            told=self._found.put,
            ended=self._found.put,
            closing=self.cancelled,
        ) as process:
            self._have(process, wanted)
            inputs = self.values["inputs"] or {}
            if process.hello.every is None:
                return _all_of(process.step(inputs), wanted, name)
            process.put(inputs)
            found: dict[str, Any] = {}
            while not found.keys() >= set(wanted):
                news = self._found.get()
                if isinstance(news, NodeFailed):
                    raise news
                found |= news
            return found

    def _of_run(self, name: str, wanted: list[str]) -> dict[str, Any]:
        nodes = self.services.nodes
        called, process = nodes.of_run(self.context.run, name, self.values["params"] or {})
        self._called = called
        self._have(process, wanted)
        inputs = self.values["inputs"] or {}
        if process.hello.every is None:
            return _all_of(process.step(inputs), wanted, name)
        before = nodes.counts(called)
        process.put(inputs)
        return nodes.next_values(
            called, lambda now: all(now.get(each, 0) > before.get(each, 0) for each in wanted), self.cancelled
        )

    def _have(self, process: NodeProcess, wanted: list[str]) -> None:
        """From now on `cancel` ends it. Raises NodeFailed when it has no such outputs."""
        with self._lock:
            self._process = process
            if self.cancelled.is_set():
                raise NodeFailed(f"node {self.values['node']} was cancelled")
        known = [port.name for port in process.hello.outputs]
        if odd := [each for each in wanted if each not in known]:
            raise NodeFailed(f"output {odd[0]}: there is none; expected one of {', '.join(known) or 'none'}")

    def preconditions(self) -> Iterator[Precondition]:
        """See Activity."""
        name = str(self.values["node"])
        try:
            library.find(name)
        except ValueError as gone:
            yield Precondition(f"there is the node {name}", False, str(gone))

    def cancel(self) -> None:
        super().cancel()
        with self._lock:
            process = self._process
        self._found.put(NodeFailed(f"node {self.values['node']} was cancelled"))
        if process is None:
            return
        if self.values["lives"] == "state":
            process.close()
        elif process.hello.every is None:
            # It may be in its step: what it remembers is lost with it.
            with contextlib.suppress(ValueError):
                self.services.nodes.stop(self._called)


def _all_of(found: dict[str, Any], wanted: list[str], name: str) -> dict[str, Any]:
    if missing := [each for each in wanted if each not in found]:
        raise NodeFailed(f"node {name} did not write {', '.join(missing)} in its step")
    return found
