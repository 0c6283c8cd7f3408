"""What a client can do with process nodes that an engine runs (docs/nodes.md)."""

from __future__ import annotations

import time
from collections.abc import Iterator, Mapping
from typing import TYPE_CHECKING, Any

from handrail.link.events import Events
from handrail.messages import (
    GetNodePorts,
    GetNodes,
    GetNodeSource,
    ListNodes,
    NodeEntry,
    NodePorts,
    NodeSource,
    NodeState,
    PortValue,
    PutNode,
    Release,
    ReloadNode,
    SaveNode,
    StartNode,
    StopNode,
    WatchPort,
)

_LASTS_S, _RENEWED_S = 10.0, 4.0


class NodeCalls:
    """Part of `handrail.client.Client`."""

    if TYPE_CHECKING:  # the client has them

        def call(self, message: Any, timeout_s: float | None = None) -> Any: ...
        def events(self, *kinds: type, timeout_s: float = 5.0) -> Events: ...

    def nodes(self) -> list[NodeState]:
        """The nodes that the engine runs: their ports with the newest values, what they use, how often they were started anew."""
        return self.call(GetNodes()).nodes

    def start_node(
        self,
        node: str,
        *,
        name: str = "",
        params: Mapping[str, Any] | None = None,
        inputs: Mapping[str, Any] | None = None,
    ) -> NodeState:
        """Start a node of the library beside the program, until `stop_node`; `name`: what to call it, if not by its own."""
        return self.call(StartNode(node=node, name=name, params=dict(params or {}), inputs=dict(inputs or {})))

    def put_node(
        self,
        name: str,
        inputs: Mapping[str, Any] | None = None,
        params: Mapping[str, Any] | None = None,
        *,
        step: bool = False,
    ) -> NodeState:
        """New inputs and parameters of a node that runs, all or none; `step`: of one that steps when asked, one step with them."""
        return self.call(PutNode(name=name, inputs=dict(inputs or {}), params=dict(params or {}), step=step))

    def reload_node(self, name: str) -> None:
        """Go on in the node's file as it is now; developers' keys only. Refused where that can't run: then it goes on as it was."""
        self.call(ReloadNode(name=name))

    def stop_node(self, name: str) -> None:
        """End a node that `start_node` started."""
        self.call(StopNode(name=name))

    def node_library(self) -> list[NodeEntry]:
        """The nodes that the engine's library has, and which of them come with Handrail."""
        return self.call(ListNodes()).nodes

    def node_ports(self, node: str) -> NodePorts:
        """What goes into a node of the library and comes out of it; it is loaded for that. Refused where it can't be."""
        return self.call(GetNodePorts(node=node))

    def node_source(self, node: str) -> NodeSource:
        """A node's file, as the engine has it in force."""
        return self.call(GetNodeSource(node=node))

    def save_node(self, node: str, text: str, was: str = "", *, wired: bool = False, note: str = "") -> Release:
        """Bring a node that was edited into force, as a release; developers' keys only.

        `was`: the text that was edited, empty for a new node; `wired`: that is YAML which wires other nodes together. Refused, with
        FILE:LINE and why, where it can't be loaded, and where somebody else has saved it meanwhile. What runs of it goes on as it
        was until `reload_node`.
        """
        return self.call(SaveNode(node=node, text=text, was=was, wired=wired, note=note)).release

    def watch_port(self, name: str, port: str, *, rate: float = 5.0) -> Iterator[PortValue]:
        """What goes through a port from now on, at most `rate` times a second, for as long as one iterates.

        The newest value comes at once, where there is one. Waits for a node that does not run yet. Raises RefusedError where there
        is no such node or port.
        """
        watch = WatchPort(name=name, port=port, rate=rate, lasts=_LASTS_S)
        with self.events(PortValue) as told:
            self.call(watch)
            renewed = time.monotonic()
            while True:
                if told.closed:
                    return
                event = told.next(_RENEWED_S / 4)
                if isinstance(event, PortValue) and (event.name, event.port) == (name, port):
                    yield event
                if time.monotonic() - renewed >= _RENEWED_S:
                    self.call(watch)
                    renewed = time.monotonic()
