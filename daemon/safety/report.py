"""Which safety rules hold the robot, and which have tripped: a snapshot, turned into words."""

from __future__ import annotations

from collections.abc import Iterator, Mapping

import numpy as np

from daemon.exchange import Flag, Rule, frame_names
from daemon.safety.ledger import GUARDS
from daemon.safety.table import TABLE
from handrail.messages import SafetyReport, SafetyRule
from handrail.robot.description import RobotDescription


def safety_report(snapshot: np.ndarray, description: RobotDescription, problems: Mapping[str, str]) -> SafetyReport:
    """`problems`: joint → what is wrong with its drive (daemon.serving.drive_reports)."""
    flags = Flag(int(snapshot["flags"]))
    return SafetyReport(
        robot=description.name,
        time_ns=int(snapshot["time_ns"]),
        state=(
            "stopped"
            if Flag.STOPPED in flags
            else "enabled"
            if Flag.ENABLED in flags
            else "enabling"
            if Flag.ENABLING in flags
            else "inactive"
        ),
        rules=list(_rules(snapshot, description, problems)),
    )


def _rules(snapshot: np.ndarray, description: RobotDescription, problems: Mapping[str, str]) -> Iterator[SafetyRule]:
    for rule in Rule:
        row, words = snapshot["safety"][rule], TABLE[rule]
        if not row["times"]:
            continue
        numbers = {"value": float(row["value"]), "limit": float(row["limit"])}
        if rule in GUARDS:
            joint, links = "", frame_names(description)
            at = int(row["other"])
            other = links[at] if rule is Rule.SELF_COLLISION else description.guard.regions[at].name
            detail = words.detail.format(body=links[int(row["joint"])], other=other, **numbers)
        else:
            joint = description.joints[int(row["joint"])] if row["joint"] >= 0 else ""
            detail = words.detail.format(joint=joint, **numbers)
        if "{joint}" in words.detail and not joint:
            detail = ""
        if rule is Rule.OPERATOR_STOP and row["holds"]:
            detail = bytes(snapshot["stop_reason"]).rstrip(b"\0").decode(errors="replace")
        if rule is Rule.DRIVE_FAULT and row["holds"] and joint in problems:
            detail = f"{detail}: {problems[joint]}"
        yield SafetyRule(
            rule=rule.name.lower(),
            holds=bool(row["holds"]),
            times=int(row["times"]),
            last_time_ns=int(row["time_ns"]),
            joint=joint,
            detail=detail,
            does=words.does,
            recover=words.recover,
        )
