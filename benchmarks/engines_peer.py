"""A chain of motions as a behaviour tree: py_trees ticks it, over the bus that the engine uses. A process of its own.

    python engines_peer.py RUNTIME MOTION MOTIONS TICK_MS

Each behaviour starts its action when it is entered and succeeds when the daemon tells that it has ended.
"""

import sys
import time

import msgspec
import py_trees

from handrail.messages import ActionEvent, StartAction, TakeLease, WholeBody
from handrail.runtime import Runtime
from handrail.topics import Caller, Subscriber

OWNER = "tree"


class Act(py_trees.behaviour.Behaviour):
    """One action of the daemon's."""

    def __init__(self, name, caller, events, motion, lease):
        super().__init__(name)
        self.caller, self.events, self.motion, self.lease = caller, events, motion, lease

    def initialise(self):
        self.lease.sequence += 1
        lease = self.lease
        self.caller.call(
            StartAction(id=self.name, owner=OWNER, motion=self.motion, lease=lease.epoch, sequence=lease.sequence)
        )

    def update(self):
        for event in self.events.drain():
            if event.id == self.name and event.state == "ended":
                return py_trees.common.Status.SUCCESS
        return py_trees.common.Status.RUNNING


def main():
    folder, motion, motions, tick_ms = sys.argv[1:]
    runtime = Runtime.at(folder)
    caller, events = Caller(runtime.endpoint("daemon.call")), Subscriber(runtime.endpoint("daemon.events"), ActionEvent)
    lease = caller.call(TakeLease(owner=OWNER, part="body"))
    wanted = msgspec.json.decode(motion.encode(), type=WholeBody)
    root = py_trees.composites.Sequence("chain", memory=True)
    root.add_children([Act(f"act {k}", caller, events, wanted, lease) for k in range(int(motions))])
    tree = py_trees.trees.BehaviourTree(root)
    due = time.monotonic()
    while tree.root.status not in (py_trees.common.Status.SUCCESS, py_trees.common.Status.FAILURE):
        tree.tick()
        due = max(due + float(tick_ms) * 1e-3, time.monotonic())
        time.sleep(max(0.0, due - time.monotonic()))


if __name__ == "__main__":
    main()
