"""Templates placed in the world, as the robot's engine believes them to stand."""

from __future__ import annotations

from handrail.messages import InstanceState


class World:
    """Instances by name."""

    def __init__(self) -> None:
        self.instances: dict[str, InstanceState] = {}

    def replace(self, instances: list[InstanceState]) -> None:
        self.instances.clear()
        self.instances.update((state.name, state) for state in instances if not state.removed)

    def take(self, state: InstanceState) -> None:
        known = self.instances.get(state.name)
        if known is not None and state.version < known.version:
            return  # an answer that an event has overtaken
        if state.removed:
            self.instances.pop(state.name, None)
        else:
            self.instances[state.name] = state
