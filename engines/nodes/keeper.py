"""The nodes that an engine runs, by name: programs' and those that were started beside them. Their ports can be watched."""

from __future__ import annotations

import contextlib
import threading
import time
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Literal

import msgspec
import numpy as np

from engines.nodes import library
from engines.nodes.failure import NodeFailed
from engines.nodes.host import NodeProcess
from engines.nodes.ports import plain
from engines.nodes.wire import Hello, PortTold
from handrail import messages as m

_SMALL = 64
"""numbers of an array that is told whole"""


@dataclass
class _Kept:
    name: str
    file: Path
    process: NodeProcess | None = None
    values: dict[str, Any] = field(default_factory=dict)
    """port → its newest value"""
    counts: dict[str, int] = field(default_factory=dict)
    last: str = ""
    failure: NodeFailed | None = None
    run: str | None = None
    """that it ends with"""
    of_state: bool = False
    """that it ends with"""
    closing: threading.Event = field(default_factory=threading.Event)
    """set: nobody wants it any more, though it may still be loaded"""
    changed: threading.Condition = field(default_factory=threading.Condition)


@dataclass
class _Watch:
    period_s: float
    until: float
    told_at: float = float("-inf")


class NodeKeeper:
    """Starts nodes, knows what went through their ports last, and tells those that are watched. From any thread."""

    def __init__(
        self,
        tell: Callable[[msgspec.Struct], None] = lambda event: None,
        log: Callable[[str, str, str], None] = lambda level, text, node: None,
    ):
        """`tell`: publishes an event; `log(level, text, node)`: a line for people, and the node that it is of."""
        self._tell, self._log = tell, log
        self._lock = threading.Lock()
        self._kept: dict[str, _Kept] = {}
        self._watches: dict[tuple[str, str], _Watch] = {}

    # -------------------------------------------------------------------------------------------------------------- running

    @contextlib.contextmanager
    def running(
        self, file: Path, params: Mapping[str, Any] | None = None, *, closing: threading.Event | None = None,
        told: Callable[[dict[str, Any]], None] = lambda outputs: None, ended: Callable[[NodeFailed], None] = lambda failure: None,
    ) -> Iterator[NodeProcess]:  # fmt: skip
        """A node for as long as the block lasts; it is not started anew. Raises NodeFailed."""
        kept = self._place(file.stem, file, of_state=True)
        try:
            process = self._start(kept, params or {}, told, ended, restarts=0, closing=closing)
            try:
                yield process
            finally:
                process.close()
        finally:
            self._forget(kept)

    def start(self, node: str, name: str = "", params: Mapping[str, Any] | None = None) -> NodeProcess:
        """A node of the library that runs until `stop`. Raises NodeFailed; ValueError: no such node, or the name is taken."""
        file, name = library.find(node), name or Path(node).stem
        with self._lock:
            if name in self._kept:
                raise ValueError(f"node: {name!r} runs already; expected another name")
            kept = self._kept[name] = _Kept(name, file)
        return self._lasting(kept, params or {})

    def of_run(self, run: str, node: str, params: Mapping[str, Any]) -> tuple[str, NodeProcess]:
        """What it is called, and a node that runs until `end_run`: the same at each call, in its newest version.

        Raises NodeFailed, ValueError.
        """
        file = library.find(node)
        with self._lock:
            kept = next((each for each in self._kept.values() if each.run == run and each.file.stem == file.stem), None)
        if kept is not None and kept.failure is not None:
            self.stop(kept.name)
            kept = None
        if kept is None or kept.process is None:
            kept = self._place(file.stem, file, run=run)
            return kept.name, self._lasting(kept, params)
        with contextlib.suppress(NodeFailed):  # it goes on as it was, and has said why
            kept.process.reload(file)
        kept.process.put(params=params)
        return kept.name, kept.process

    def next_values(
        self, name: str, wanted: Callable[[Mapping[str, int]], bool], cancelled: threading.Event
    ) -> dict[str, Any]:
        """Newest values of a node's ports, once `wanted` is true of how many went through each. Raises NodeFailed."""
        with self._lock:
            kept = self._kept[name]
        with kept.changed:
            while not wanted(kept.counts):
                if cancelled.is_set():
                    raise NodeFailed(f"node {name} was cancelled")
                if kept.failure is not None:
                    raise kept.failure
                kept.changed.wait(0.1)
            return dict(kept.values)

    def counts(self, name: str) -> dict[str, int]:
        """How many values went through each port of a node so far."""
        with self._lock:
            kept = self._kept[name]
        with kept.changed:
            return dict(kept.counts)

    def stop(self, name: str) -> None:
        """Raises ValueError where none is called that, or a program's state runs it."""
        kept = self._find(name)
        if kept.of_state:
            raise ValueError(f"node: {name!r} is the running program's, and ends with its state")
        self._forget(kept)
        kept.closing.set()
        if kept.process is not None:
            kept.process.close()

    def end_run(self, run: str) -> None:
        """End what was started for a run."""
        with self._lock:
            names = [kept.name for kept in self._kept.values() if kept.run == run]
        for name in names:
            with contextlib.suppress(ValueError):  # stopped by somebody else
                self.stop(name)

    def close(self) -> None:
        """End all."""
        with self._lock:
            names = list(self._kept)
        for name in names:
            with contextlib.suppress(ValueError):
                self.stop(name)

    def reload(self, name: str) -> None:
        """See NodeProcess.reload; the file is looked for anew. Raises NodeFailed, ValueError."""
        kept = self._find(name)
        if kept.process is not None:
            kept.process.reload(library.find(kept.file.stem if kept.file.stem in library.files() else str(kept.file)))

    def process(self, name: str) -> NodeProcess:
        """Raises ValueError where none is called that."""
        process = self._find(name).process
        if process is None:
            raise ValueError(f"node: {name!r} is just being started")
        return process

    def _lasting(self, kept: _Kept, params: Mapping[str, Any]) -> NodeProcess:
        def ended(failure: NodeFailed) -> None:
            self._log("error", failure.traceback or failure.why, kept.name)

        try:
            process = self._start(kept, params, lambda outputs: None, ended, closing=kept.closing)
            if kept.closing.is_set():  # `stop` found no process yet
                process.close()
                raise NodeFailed(f"node {kept.name} was stopped while it was being started")
            return process
        except NodeFailed:
            self._forget(kept)
            raise

    def _start(
        self, kept: _Kept, params: Mapping[str, Any], told: Callable[[dict[str, Any]], None],
        ended: Callable[[NodeFailed], None], **how: Any,
    ) -> NodeProcess:  # fmt: skip
        def out(values: dict[str, Any]) -> None:
            self._through(kept, values)
            told(values)

        def over(failure: NodeFailed) -> None:
            with kept.changed:
                kept.failure, kept.last = failure, failure.why
                kept.changed.notify_all()
            ended(failure)

        def line(level: str, text: str) -> None:
            kept.last = text
            self._log(level, text, kept.name)

        def up() -> None:
            kept.failure = None

        kept.values.update(params)
        kept.process = NodeProcess(
            kept.file, params, told=out, given=lambda values: self._through(kept, values), ended=over, up=up,
            said=lambda text: line("info", text), noted=lambda text: line("warning", text), **how,
        )  # fmt: skip
        return kept.process

    def _place(self, name: str, file: Path, **of: Any) -> _Kept:
        """A name of its own for a node of a program: others may run the same."""
        with self._lock:
            free = next(each for each in (name, *(f"{name}_{k}" for k in range(2, 1000))) if each not in self._kept)
            kept = self._kept[free] = _Kept(free, file, **of)
        return kept

    def _forget(self, kept: _Kept) -> None:
        with self._lock:
            if self._kept.get(kept.name) is kept:
                del self._kept[kept.name]

    def _find(self, name: str) -> _Kept:
        with self._lock:
            if name not in self._kept:
                raise ValueError(
                    f"node: got {name!r}; expected one of those that run: {', '.join(self._kept) or 'none'}"
                )
            return self._kept[name]

    # ------------------------------------------------------------------------------------------------------------- watching

    def watch(self, name: str, port: str, rate: float, lasts: float) -> None:
        """Tell this port's values for `lasts` s, at most at `rate` Hz. Raises ValueError where there is no such port or node."""
        with self._lock:
            kept = self._kept.get(name)
        if kept is not None and kept.process is not None:
            hello = kept.process.hello
            ports = [each.name for each in (*hello.inputs, *hello.outputs, *hello.params)]
            if port not in ports:
                raise ValueError(f"port: node {name} has no {port!r}; expected one of {', '.join(ports)}")
        elif name not in library.files():
            known = sorted({*self._kept, *library.files()})
            raise ValueError(f"node: got {name!r}; expected one of {', '.join(known)}")
        now = time.monotonic()
        watch = _Watch(1.0 / rate, now + lasts)
        with self._lock:
            self._watches = {each: old for each, old in self._watches.items() if old.until > now}
            before = self._watches.get((name, port))
            if (
                before is not None
            ):  # asked again, or by somebody else: as often and as long as the more curious one wants
                watch.period_s, watch.until = min(watch.period_s, before.period_s), max(watch.until, before.until)
                watch.told_at = before.told_at
            self._watches[name, port] = watch
        if kept is not None and before is None and port in kept.values:
            watch.told_at = time.monotonic()
            self._tell(_told(kept, port, kept.values[port]))

    def _through(self, kept: _Kept, values: Mapping[str, Any]) -> None:
        now = time.monotonic()
        events = []
        with kept.changed:
            for port, value in values.items():
                kept.values[port] = value
                kept.counts[port] = kept.counts.get(port, 0) + 1
            kept.changed.notify_all()
        with self._lock:
            for port, value in values.items():
                watch = self._watches.get((kept.name, port))
                if watch is None:
                    continue
                if now > watch.until:
                    del self._watches[kept.name, port]
                elif now - watch.told_at >= 0.9 * watch.period_s:
                    watch.told_at = now
                    events.append(_told(kept, port, value))
        for event in events:
            self._tell(event)

    def states(self) -> list[m.NodeState]:
        """All that run, or have ended and were not stopped yet."""
        with self._lock:
            kept = [each for each in self._kept.values() if each.process is not None]
        return [_state(each) for each in kept]

    def state(self, name: str) -> m.NodeState:
        """Of one. Raises ValueError where none is called that, or it is just being started."""
        self.process(name)
        return _state(self._find(name))


def _told(kept: _Kept, port: str, value: Any) -> m.PortValue:
    small, summary = _shown(value)
    data = {} if small is None else {"value": small}
    return m.PortValue(name=kept.name, port=port, data=data, summary=summary, count=kept.counts.get(port, 0))


def _shown(value: Any) -> tuple[Any, str]:
    """(the value where it is small, of an array also its kind, shape and range)"""
    if not isinstance(value, np.ndarray):
        return plain(value), ""
    shape = " × ".join(map(str, value.shape))
    summary = f"{value.dtype} {shape}"
    if value.size:
        summary += f", {value.min():.4g} to {value.max():.4g}, mean {value.mean():.4g}"
    return (plain(value) if value.size <= _SMALL else None), summary


def ports_of(hello: Hello, values: Mapping[str, Any]) -> list[m.NodePort]:
    """All ports of a node, with what was last given to them or came out of them."""
    ways: tuple[tuple[Literal["input", "output", "parameter"], list[PortTold]], ...]
    ways = (("input", hello.inputs), ("output", hello.outputs), ("parameter", hello.params))
    found = []
    for way, told in ways:
        for port in told:
            value, summary = _shown(values[port.name]) if port.name in values else (port.default, "")
            found.append(
                m.NodePort(
                    name=port.name,
                    way=way,
                    kind=port.kind,
                    unit=port.unit,
                    value=value,
                    summary=summary,
                    doc=port.doc,
                    low=port.low,
                    high=port.high,
                    choices=list(port.choices),
                )
            )
    return found


def _state(kept: _Kept) -> m.NodeState:
    process = kept.process
    assert process is not None
    hello, usage = process.hello, process.usage
    return m.NodeState(
        name=kept.name,
        node=kept.file.stem,
        state="ended" if kept.failure else "up",
        why=kept.failure.why if kept.failure else "",
        process=process.process.pid,
        restarts=process.restarted,
        cpu_share=round(usage.share, 3) if usage else 0.0,
        memory_mb=round(usage.own_mb, 1) if usage else 0.0,
        every=hello.every,
        ports=ports_of(hello, kept.values),
        last=kept.last,
    )
