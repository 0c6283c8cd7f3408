"""The process nodes of an engine's library: which there are, their source, and bringing an edited one into force."""

from __future__ import annotations

from typing import Annotated

import msgspec
from msgspec import Meta

from handrail.messages.base import Message, Name, travels
from handrail.messages.bundles import BundleState
from handrail.messages.nodes import NodePort


@travels(priority=1, remote=True)
class ListNodes(Message):
    """What process nodes does an engine's library have?"""

    engine: str = ""


class NodeEntry(msgspec.Struct, kw_only=True):
    """A node of the library, or a Python file beside nodes that they import."""

    name: str
    file: str
    """the file's name: it ends in .py, or in .yaml where other nodes are wired together"""
    builtin: bool
    """it comes with Handrail, and is saved under another name only"""


class NodeLibrary(Message):
    """Answer to ListNodes, by name."""

    nodes: list[NodeEntry]


@travels(priority=1, remote=True)
class GetNodeSource(Message):
    """A node's file, as the engine has it in force."""

    node: Name
    engine: str = ""


class NodeSource(Message):
    """Answer to GetNodeSource."""

    node: str
    file: str
    text: str
    builtin: bool


@travels(priority=1, remote=True)
class GetNodePorts(Message):
    """What goes into a node of the library and comes out of it? Refused where it can't be loaded, or is no node."""

    node: Name
    engine: str = ""


class NodePorts(Message, kw_only=True):
    """Answer to GetNodePorts."""

    node: str
    title: str
    """what it does, in a sentence"""
    every: float | None
    """s between steps; None: when asked"""
    ports: list[NodePort]
    """a parameter's value is its default"""


@travels(priority=1, remote=True)
class SaveNode(Message):
    """Bring a node that was edited into force, as a release (of ``nodes/NAME``); tried in a process of its own before.

    What runs of it goes on as it was until it is reloaded. Answered as PutBundle is.
    """

    node: Name
    text: str
    was: str = ""
    """the text that was edited: refused where the engine has another one by now. Empty: there is no node of that name"""
    wired: bool = False
    """of a new one: it is YAML that wires other nodes together"""
    note: Annotated[str, Meta(max_length=400)] = ""
    engine: str = ""
    by: Annotated[str, Meta(max_length=128)] = ""
    """whose key it came with; the link writes it here"""


GetNodePorts.Reply = NodePorts
ListNodes.Reply = NodeLibrary
GetNodeSource.Reply = NodeSource
SaveNode.Reply = BundleState
