"""Process nodes that an engine runs: which, what they use, and what flows through their ports."""

from __future__ import annotations

from typing import Annotated, Any, Literal

import msgspec
from msgspec import Meta

from handrail.messages.base import Message, Name, travels


@travels(priority=2, remote=True)
class StartNode(Message):
    """Start a node of the library beside the program; it runs until it is stopped. Answered once it is ready."""

    node: Name
    name: Annotated[str, Meta(max_length=128)] = ""
    """what to call it, where the node's own name is taken"""
    params: dict[str, Any] = {}
    inputs: dict[str, Any] = {}
    engine: str = ""


@travels(priority=2, remote=True)
class StopNode(Message):
    """End a node that was started by `StartNode`."""

    name: Name
    engine: str = ""


@travels(priority=2, remote=True)
class PutNode(Message):
    """New inputs and parameters of a node that runs; all of them count, or none."""

    name: Name
    inputs: dict[str, Any] = {}
    params: dict[str, Any] = {}
    step: bool = False
    """one step follows (of a node that does not step by itself)"""
    engine: str = ""


@travels(priority=2, remote=True)
class ReloadNode(Message):
    """Go on in the node's file as it is now, between two calls; refused, and it goes on as it was, where that can't run.

    Other code: over the link, a developer's.
    """

    name: Name
    engine: str = ""


@travels(priority=2, remote=True)
class GetNodes(Message):
    """Which nodes run?"""

    engine: str = ""


@travels(priority=2, remote=True)
class WatchPort(Message):
    """Tell what flows through a port, by `PortValue`, for a while; ask again to go on. Its node need not run yet."""

    name: Name
    port: Name
    rate: Annotated[float, Meta(gt=0, le=100)] = 5.0
    """Hz at most: of more values, the newest when its turn comes"""
    lasts: Annotated[float, Meta(gt=0, le=60)] = 10.0
    """s of wall time"""
    engine: str = ""


class NodePort(msgspec.Struct, kw_only=True):
    name: str
    way: Literal["input", "output", "parameter"]
    kind: str
    unit: str = ""
    value: Any = None
    """the newest, where it is small; None: none yet, or large. Of a parameter of a node that does not run: its default"""
    summary: str = ""
    doc: str = ""
    low: float | None = None
    """of a parameter, in its unit; None: no bound"""
    high: float | None = None
    choices: list[str] = []
    """of a parameter that is one of these texts"""


class NodeState(Message, kw_only=True):
    """A node that runs. Answer to StartNode and PutNode, too."""

    name: str
    node: str
    """of the library"""
    state: Literal["up", "ended"]
    why: str = ""
    """why it has ended"""
    process: int
    restarts: int
    """so far"""
    cpu_share: float
    """of a core, over the last seconds"""
    memory_mb: float
    """beyond its imports"""
    every: float | None
    """s between steps; None: when asked"""
    ports: list[NodePort]
    last: str = ""
    """the last line that it printed, or that was said about it"""


class Nodes(Message):
    """Answer to GetNodes."""

    nodes: list[NodeState]


@travels(priority=6, reliable=False, superseded_by=("name", "port"), remote=True)
class PortValue(Message):
    """What has just gone through a port that is watched."""

    name: str
    port: str
    data: dict[str, Any] = {}
    """`value`, unless it is an array that is too large to be told: see `summary`"""
    summary: str = ""
    """of an array: kind of number, shape, range, mean"""
    count: int = 0
    """of values through this port since the node was started, those that were not told included"""

    @property
    def value(self) -> Any:
        """None where it is too large to be told."""
        return self.data.get("value")
