"""The server's side of loaded controllers: calls checked against the roster, lists, and news."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from pathlib import Path

import msgspec
import numpy as np

from daemon.controllers.roster import Loaded, Roster, own_kinds, read_roster
from daemon.exchange import (
    CONTROLLERS,
    LOADED_CODE,
    ControllerState,
    Kind,
    Outcome,
    active_controllers,
    claimed_interfaces,
    encode_controllers,
    how_it_went,
)
from daemon.serving.validation import check_load, check_loaded
from hal.joint import COMMANDED
from handrail.messages import (
    ConfigureController,
    ControllerEvent,
    ControllerInfo,
    ControllerList,
    LoadController,
    SwitchControllers,
    UnloadController,
)
from handrail.robot.description import RobotDescription

LONGEST_TEXT = 65536
"""bytes of a LoadController or ConfigureController as JSON: the loop copies it in a cycle"""


class ControllerDesk:
    """What the server knows of loaded controllers; the file is read again when a snapshot names another roster."""

    def __init__(self, description: RobotDescription, file: Path):
        self._description, self._file = description, file
        self.roster = Roster()
        self._told = -1
        self._changes: np.ndarray | None = None

    def look(self, snapshot: np.ndarray) -> bool:
        """Read the roster if the snapshot is about a newer one. False while the loop's workshop has not written that yet."""
        wanted = int(snapshot["roster"])
        if self.roster.number != wanted or self._told < 0:
            self.roster = read_roster(self._file)
        return self.roster.number == wanted

    def begin_anew(self) -> None:
        """Another loop runs: it knows nothing of what was loaded before."""
        self.roster, self._told, self._changes = Roster(), -1, None

    def deactivations(self, snapshot: np.ndarray) -> Iterator[ControllerEvent]:
        """What has been deactivated since the last call, other than by a switch."""
        changes, before = snapshot["controller_changes"], self._changes
        if before is not None and not np.array_equal(changes["cycle"], before["cycle"]):
            for entry in self.roster.loaded:
                change = changes[entry.slot]
                if change["cycle"] == before[entry.slot]["cycle"] or change["why"] in (Outcome.NONE, Outcome.DONE):
                    continue
                yield ControllerEvent(
                    name=entry.name,
                    state="inactive",
                    time_ns=int(change["time_ns"]),
                    cycle=int(change["cycle"]),
                    detail=how_it_went(change, self._description.joints),
                )
        self._changes = changes.copy()

    def news(self) -> Iterator[ControllerEvent]:
        """What has been written to the roster since the last call; what a server finds at its start was told by another one."""
        newest = self.roster.news[-1].number if self.roster.news else 0
        if self._told >= 0:
            for news in self.roster.news:
                if news.number > self._told:
                    yield msgspec.convert(
                        {name: getattr(news, name) for name in ("name", "state", "time_ns", "cycle", "detail")},
                        ControllerEvent,
                    )
        self._told = newest

    def names(self) -> Mapping[int, str]:
        """Code in the snapshot's claims → name, of what is loaded."""
        return {LOADED_CODE + entry.slot: entry.name for entry in self.roster.loaded}

    def name_of(self, slot: float) -> str:
        """Name of the controller in a slot; empty: there is none."""
        return self.names().get(LOADED_CODE + int(slot), "")

    def list(self, snapshot: np.ndarray) -> ControllerList:
        """Everything that is loaded, then what the daemon runs by itself."""
        loaded = [self._info(entry, snapshot) for entry in self.roster.loaded]
        running = active_controllers(snapshot, self._description.joints)
        own = [
            ControllerInfo(
                name=name,
                kind=name,
                state="active",
                joints=joints,
                interfaces=claimed_interfaces(snapshot, CONTROLLERS.index(name)),
            )
            for name, joints in running.items()
        ]
        lost = {news.name: news.detail for news in self.roster.news if news.state == "finalized"}
        kinds = sorted({*self.roster.kinds, *own_kinds()})
        return ControllerList(time_ns=int(snapshot["time_ns"]), controllers=[*loaded, *own], kinds=kinds, lost=lost)

    # ----------------------------------------------------------------------------------------- calls, as the loop takes them

    def load(self, call: LoadController, serial: int) -> tuple[np.ndarray, np.ndarray]:
        """Raises RefusedError."""
        text = msgspec.json.encode(call)
        check_load(
            call, self._description, self.roster, sorted({*self.roster.kinds, *own_kinds()}), len(text), LONGEST_TEXT
        )
        return encode_controllers(Kind.LOAD, serial, text=text)

    def configure(self, call: ConfigureController, serial: int) -> tuple[np.ndarray, np.ndarray]:
        """Raises RefusedError."""
        entry = check_loaded(call.name, "name", self.roster)
        text = msgspec.json.encode(call)
        return encode_controllers(Kind.CONFIGURE, serial, go=1 << entry.slot, roster=self.roster.number, text=text)

    def unload(self, call: UnloadController, serial: int) -> tuple[np.ndarray, np.ndarray]:
        """Raises RefusedError."""
        entry = check_loaded(call.name, "name", self.roster)
        return encode_controllers(Kind.UNLOAD, serial, go=1 << entry.slot, roster=self.roster.number)

    def switch(self, call: SwitchControllers, serial: int) -> tuple[np.ndarray, np.ndarray]:
        """Raises RefusedError."""
        masks = {"activate": 0, "deactivate": 0}
        for field in masks:
            for place, name in enumerate(getattr(call, field)):
                masks[field] |= 1 << check_loaded(name, f"{field}[{place}]", self.roster).slot
        come, go = masks.values()
        return encode_controllers(Kind.SWITCH, serial, come=come, go=go, roster=self.roster.number)

    def _info(self, entry: Loaded, snapshot: np.ndarray) -> ControllerInfo:
        change = snapshot["controller_changes"][entry.slot]
        return ControllerInfo(
            name=entry.name,
            kind=entry.kind,
            state=ControllerState(int(snapshot["controller_states"][entry.slot])).name.lower(),
            joints=entry.joints,
            interfaces=entry.interfaces or list(COMMANDED),
            onto=entry.onto,
            references=entry.references,
            fallback=entry.fallback,
            parameters=entry.parameters,
            error=entry.error,
            since_ns=int(change["time_ns"]),
            why=how_it_went(change, self._description.joints),
        )
