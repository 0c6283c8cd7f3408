"""Templates placed in the world, as the robot's engine believes them to stand."""

from __future__ import annotations

from handrail.messages import InstanceState


class World:
    """Instances by name."""

    def __init__(self) -> None:
        self.instances: dict[str, InstanceState] = {}

    def replace(self, instances: list[InstanceState]) -> None:
        self.instances = {state.name: state for state in instances if not state.removed}

    def take(self, state: InstanceState) -> None:
        if state.removed:
            self.instances.pop(state.name, None)
        else:
            self.instances[state.name] = state
