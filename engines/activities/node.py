"""`do: node`: give a process node inputs and go on with what it finds."""

from __future__ import annotations

import queue
import threading
from collections.abc import Mapping
from typing import Any

from engines.activities.base import Activity, ActivityFailed, Argument, Context, Kind
from engines.nodes import library
from engines.nodes.host import NodeFailed, NodeProcess
from engines.nodes.ports import plain


class NodeActivity(Activity):
    """Starts a node in a process of its own and ends it when all `outputs` were written: after one step, or, of a node that steps
    by itself, as soon as they are there. Done with them, by their names.
    """

    arguments = {
        "node": Argument(Kind.NODE),
        "inputs": Argument(Kind.PORTS, required=False),
        "params": Argument(Kind.PORTS, required=False),
        "outputs": Argument(Kind.NAMES),
    }

    def __init__(self, context: Context, values: Mapping[str, Any]):
        super().__init__(context, values)
        self._found: queue.SimpleQueue[dict[str, Any] | NodeFailed] = queue.SimpleQueue()
        self._process: NodeProcess | None = None
        self._lock = threading.Lock()

    @classmethod
    def outputs_of(cls, given: Mapping[str, Any]) -> frozenset[str]:
        """Those that the program asks for."""
        names = given.get("outputs", ())
        return frozenset(names if isinstance(names, list) else ())

    def run(self) -> dict[str, Any]:
        name, wanted = str(self.values["node"]), list(self.values["outputs"])
        self.services.daemon.hold_time(self.context.hold_s)
        try:
            return self._asked(name, wanted)
        except NodeFailed as failed:
            if failed.traceback:
                self.services.log("error", failed.traceback)
            reason = "cancelled" if self.cancelled.is_set() else "node_failed"
            raise ActivityFailed(reason, failed.why) from failed
        except ValueError as problem:
            raise ActivityFailed("refused", str(problem)) from problem
        finally:
            if self._process is not None:
                self._process.close()

    def _asked(self, name: str, wanted: list[str]) -> dict[str, Any]:
        process = NodeProcess(
            library.find(name),
            self.values["params"],
            restarts=0,  # `retry` is the program's
            told=self._found.put,
            ended=self._found.put,
            closing=self.cancelled,
        )
        with self._lock:
            self._process = process
            if self.cancelled.is_set():
                raise NodeFailed(f"node {name} was cancelled")
        known = [port.name for port in process.hello.outputs]
        if odd := [each for each in wanted if each not in known]:
            raise NodeFailed(f"output {odd[0]}: there is none; expected one of {', '.join(known) or 'none'}")
        inputs = self.values["inputs"] or {}
        if process.hello.every is None:
            found = process.step(inputs)
            if missing := [each for each in wanted if each not in found]:
                raise NodeFailed(f"node {name} did not write {', '.join(missing)} in its step")
        else:
            process.put(inputs)
            found = {}
            while not found.keys() >= set(wanted):
                news = self._found.get()
                if isinstance(news, NodeFailed):
                    raise news
                found |= news
        return {each: plain(found[each]) for each in wanted}

    def cancel(self) -> None:
        super().cancel()
        with self._lock:
            process = self._process
        self._found.put(NodeFailed(f"node {self.values['node']} was cancelled"))
        if process is not None:
            process.close()
