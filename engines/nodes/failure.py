"""Why a node does not do what it was asked."""

from __future__ import annotations


class NodeFailed(Exception):
    """A node has ended, or does not take what it was given; `traceback` is its own, where its code raised."""

    def __init__(self, why: str, traceback: str = ""):
        self.why, self.traceback = why, traceback
        super().__init__(why)
