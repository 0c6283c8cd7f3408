"""What a node is: a class with ports and a `step`. It knows no robot, no engine and no other node."""

from __future__ import annotations

import math
import sys
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, ClassVar

import numpy as np

from engines.nodes.ports import Input, Output, Param, PortError, _Port
from handrail import source_module
from handrail.messages import Pose


@dataclass(frozen=True)
class Case:
    """One test of a node: what comes out of a new one after these inputs, one step each."""

    inputs: Sequence[Mapping[str, Any]]
    outputs: Mapping[str, Any]
    """after the last step"""
    params: Mapping[str, Any] = field(default_factory=dict)
    tolerance: float = 1e-9
    name: str = ""

    def missed(self, port: Output, value: Any) -> str:
        """What is wrong with an output, in words; empty: nothing."""
        wanted = port.taken(self.outputs[port.name])
        if isinstance(wanted, np.ndarray):
            same = wanted.shape == value.shape and np.allclose(wanted, value, rtol=0.0, atol=self.tolerance)
        elif isinstance(wanted, Pose):
            one, other = ([*each.position, *each.orientation] for each in (wanted, value))
            same = np.allclose(one, other, rtol=0.0, atol=self.tolerance)
        elif isinstance(wanted, float):
            same = math.isclose(wanted, value, rel_tol=0.0, abs_tol=self.tolerance)
        elif isinstance(wanted, dict):
            same = wanted.keys() == value.keys() and all(abs(wanted[k] - value[k]) <= self.tolerance for k in wanted)
        else:
            same = wanted == value
        return "" if same else f"output {port.name}: got {value}; expected {wanted}"


class Node:
    """Base of nodes. Its file holds one subclass, whose docstring says what it does."""

    every: ClassVar[float | None] = None
    """s between steps; 0: one after the other; None: only when it is asked to"""
    step_limit_s: ClassVar[float] = 5.0
    """wall time of one step, after which the node counts as hanging"""
    memory_mb: ClassVar[int] = 1024
    """that it may have of its own"""
    cpu_share: ClassVar[float] = 1.0
    """of a core: a node that steps by itself rests until it has used no more, one that uses half as much again is ended"""
    nice: ClassVar[int] = 5
    """how far it stands back for others, 0 to 19: the robot's loop goes first"""
    restarts: ClassVar[int] = 3
    """times that it is started anew after it has failed, later each time; counted anew after a minute without"""
    cases: ClassVar[Sequence[Case]] = ()

    inputs: ClassVar[dict[str, Input]] = {}
    outputs: ClassVar[dict[str, Output]] = {}
    params: ClassVar[dict[str, Param]] = {}

    def __init_subclass__(cls) -> None:
        ports = {
            name: port for base in reversed(cls.__mro__) for name, port in vars(base).items() if isinstance(port, _Port)
        }
        cls.inputs = {name: port for name, port in ports.items() if isinstance(port, Input)}
        cls.outputs = {name: port for name, port in ports.items() if isinstance(port, Output)}
        cls.params = {name: port for name, port in ports.items() if isinstance(port, Param)}
        odd = [name for name in ports if name in (*vars(Node), "values", "written")]
        if odd:
            raise PortError(
                f"{cls.__name__}: a port can't be called {odd[0]!r}; expected a name that Node does not use"
            )

    def __init__(self) -> None:
        self.values: dict[str, Any] = {}
        self.written: set[str] = set()

    def start(self) -> None:
        """Called once, when parameters are there and before the first step."""

    def step(self) -> None:
        """Read inputs, write outputs. What it raises ends the node."""
        raise NotImplementedError(f"{type(self).__name__}.step")

    def put(self, kind: str, values: Mapping[str, Any]) -> None:
        """Set `inputs` or `params`. Raises PortError; then none is set."""
        ports: Mapping[str, _Port] = getattr(self, kind)
        for name in values:
            if name not in ports:
                word = {"inputs": "input", "params": "parameter"}[kind]
                raise PortError(f"{word} {name}: there is none; expected one of {', '.join(ports) or 'none'}")
        self.values.update({name: ports[name].taken(value) for name, value in values.items()})

    def take_written(self) -> dict[str, Any]:
        """Outputs written since this was last called, as the wire carries them."""
        written = sorted(self.written)
        self.written.clear()
        return self.packed(written)

    def packed(self, outputs: Collection[str]) -> dict[str, Any]:
        """These as the wire carries them."""
        return {name: self.outputs[name].kind.pack(self.values[name]) for name in outputs}


def load(file: Path) -> type[Node]:
    """The node of a file, whose code is run. Raises PortError when it has none or several, OSError, and what its code raises."""
    if file.suffix != ".py":
        raise PortError(f"{file}: got no Python file; expected NAME.py")
    module = source_module.module_of(f"handrail_node_{file.stem}", file)
    sys.path.insert(0, str(file.parent))  # modules beside it
    try:
        source_module.run(module)
    finally:
        sys.path.remove(str(file.parent))
    found = [
        each for each in vars(module).values()
        if isinstance(each, type) and issubclass(each, Node) and each.__module__ == module.__name__
    ]  # fmt: skip
    if len(found) != 1:
        names = ", ".join(each.__name__ for each in found) or "none"
        raise PortError(f"{file}: got the nodes {names}; expected one subclass of engines.nodes.Node")
    return found[0]
