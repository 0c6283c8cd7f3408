"""Process nodes: Python with typed inputs, outputs and parameters, each in a process of its own (docs/nodes.md)."""

from engines.nodes.node import Case, Node
from engines.nodes.ports import Input, Output, Param

__all__ = ["Case", "Input", "Node", "Output", "Param"]
