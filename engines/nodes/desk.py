"""An engine's calls about process nodes."""

from __future__ import annotations

from collections.abc import Callable
from concurrent.futures import Future
from typing import Any

from engines.nodes import library
from engines.nodes.failure import NodeFailed
from engines.nodes.host import NodeProcess
from engines.nodes.keeper import NodeKeeper, ports_of
from handrail import messages as m
from handrail.topics import refuse


def answers(
    nodes: NodeKeeper, in_thread: Callable[[Callable[[], Any], str], Future[Any]]
) -> dict[type, Callable[[Any], Any]]:
    """Call → what answers it. What may take long does so beside the caller (`in_thread`)."""

    def start(call: m.StartNode) -> m.NodeState:
        if call.node not in (known := library.files()):  # no file of the robot's disk: code comes by deployment
            raise ValueError(f"node: got {call.node!r}; expected one of {', '.join(sorted(known)) or 'none'}")
        process = nodes.start(call.node, call.name, call.params)
        name = call.name or call.node
        try:
            process.put(call.inputs)
        except NodeFailed:
            nodes.stop(name)
            raise
        return nodes.state(name)

    def ports(call: m.GetNodePorts) -> m.NodePorts:
        if call.node not in (known := library.files()):
            raise ValueError(f"node: got {call.node!r}; expected one of {', '.join(sorted(known)) or 'none'}")
        with NodeProcess(known[call.node], restarts=0, said=_unheard, noted=_unheard) as process:
            hello = process.hello
        return m.NodePorts(node=call.node, title=hello.doc, every=hello.every, ports=ports_of(hello, {}))

    def put(call: m.PutNode) -> m.NodeState:
        process = nodes.process(call.name)
        (process.step if call.step else process.put)(call.inputs, call.params)
        return nodes.state(call.name)

    def beside(work: Callable[[Any], Any]) -> Callable[[Any], Future[Any]]:
        return lambda call: in_thread(lambda: _refusing(work, call), f"node {type(call).__name__}")

    return {
        m.GetNodes: lambda call: m.Nodes(nodes=nodes.states()),
        m.GetNodePorts: beside(ports),
        m.StartNode: beside(start),
        m.PutNode: beside(put),
        m.StopNode: beside(lambda call: nodes.stop(call.name)),
        m.ReloadNode: beside(lambda call: nodes.reload(call.name)),
        m.WatchPort: lambda call: _refusing(lambda _: nodes.watch(call.name, call.port, call.rate, call.lasts), call),
    }


def _unheard(line: str) -> None:
    """What a node prints while it is asked for its ports is nobody's."""


def _refusing(work: Callable[[Any], Any], call: Any) -> Any:
    try:
        return work(call)
    except NodeFailed as failed:
        raise refuse(failed.why) from failed
    except ValueError as problem:
        raise refuse(str(problem)) from problem
