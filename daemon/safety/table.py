"""The safety rules in words: when each trips, what it does, how to recover. docs/safety.md has the same table."""

from __future__ import annotations

from typing import NamedTuple

from daemon.exchange import Rule


class Words(NamedTuple):
    """One rule, for people."""

    trips: str
    does: str
    recover: str
    detail: str
    """of one trip: a format string of joint, value and limit; of guards, of body and other instead of joint"""


_ANEW = "nothing to do: the next command is judged anew"
_CUTS = "cuts the set-point in that cycle; held back by more than 0.02 rad, the action ends (held_back)"
_BRAKES = (
    "whatever commands joints between the two brakes to a stand in the direction of its motion, without a jump and as hard as the "
    "joints' torque allows, and ends; the rest goes on. It latches: no motion starts"
)
_ACKNOWLEDGE = (
    "enable, which acknowledges it; then move away: what would lead nearer still is stopped in its first cycle"
)
TABLE: dict[Rule, Words] = {
    Rule.OPERATOR_STOP: Words(
        "anybody stops: `handrail stop`, the tablet, any client, the local stop socket; or the loop itself, where it missed as "
        "many periods in a row as `control.stop_after_misses` says",
        "every drive quick-stops in the next cycle: damps about its load, then closes its brake; all actions end; it latches",
        "`handrail stop --clear`, then enable",
        "",
    ),
    Rule.KEEPALIVE: Words(
        "an owner who is bound by a keepalive (`BindKeepalive`, `handrail safety keepalive`) has not answered for the timeout that "
        "he named; wrong answers don't count",
        "hold: his actions slow down to a stand and end, and he can start none. Settle: once the robot stands (or after 1 s) it is "
        "held for 2 s. Damping: then every drive quick-stops, and the keepalive has ended",
        "until damping, a good answer; then enable, and bind it anew",
        "silent for {value:.2f} s; allowed {limit:g}",
    ),
    Rule.NO_COMMAND: Words(
        "not even holding gives a set-point that is a finite number",
        "every drive quick-stops; all actions end",
        "find out why (this is a defect), then enable",
        "{joint} has no set-point that could be written",
    ),
    Rule.PROTOCOL: Words(
        "a drive says that it speaks another version of its protocol",
        "every drive quick-stops, or does not come to operation; all actions end",
        "update the drive or Handrail (`handrail drives info`), then enable",
        "the drive of {joint}",
    ),
    Rule.DRIVE_FAULT: Words(
        "a drive faults, leaves operation, does not answer for 50 cycles, or does not come to operation within 2 s",
        "its limb is isolated: all its drives quick-stop and stay so; all actions end and the other limbs hold, and may be moved. "
        "Where no other limb is left, every drive quick-stops",
        "remove the cause (`handrail hardware status`), then enable: that resets the fault and holds the limb where it is measured "
        "now; loaded controllers that it ended (`handrail controllers list` says which) come back by `handrail controllers switch`",
        "the drive of {joint}",
    ),
    Rule.BALANCE: Words(
        "a robot that stood on its own feet falls: for 0.1 s its capture point (centre of mass and where its speed carries it) is "
        "more than 5 cm outside the feet that hold, or no foot holds, or nobody knows where its base is",
        "every joint is damped in that cycle, none held; all actions end. Once it lies, or after 3 s, every drive quick-stops",
        "stand it up, then enable",
        "the capture point was {value:.3f} m outside the feet; allowed {limit:g}",
    ),
    Rule.SELF_COLLISION: Words(
        "two bodies of the robot would come nearer to each other than `guard.margin` (robot.yaml) if it braked after this cycle",
        _BRAKES,
        _ACKNOWLEDGE,
        "{body} was {value:.3f} m from {other}; at least {limit:g} must be left after braking",
    ),
    Rule.WORKSPACE: Words(
        "a link would come nearer to a half space or box of `guard.regions` (robot.yaml) than its margin if the robot braked after "
        "this cycle",
        _BRAKES,
        _ACKNOWLEDGE,
        "{body} was {value:.3f} m from {other}; at least {limit:g} must be left after braking",
    ),
    Rule.NOT_FINITE: Words(
        "a controller's set-point is no finite number, or can't be judged since what was measured is none",
        "the action ends in that cycle and its joints are held at the command before",
        "start another action",
        "{joint}'s set-point",
    ),
    Rule.HELD_BACK: Words(
        "the limits hold a command back by more than 0.02 rad",
        "the action ends in that cycle and its joints are held",
        "start another action, within the limits",
        "{joint} by {value:.3f} rad; allowed {limit:g}",
    ),
    Rule.STALE: Words(
        "a joint that an action or a loaded controller commands has not been measured for 20 cycles",
        "the action ends in that cycle and its joints are held; the controller is deactivated, and its joints go to those of its "
        "fallbacks that are not as blind, else they are held",
        "see to the bus (`handrail hardware status`), then start another action, or switch the controller on again",
        "{joint}'s state was {value:.0f} cycles old; allowed {limit:g}",
    ),
    Rule.DIVERGED: Words(
        "a joint that an action or a loaded controller commands is more than 0.5 rad from its command",
        "the action ends in that cycle and its joints are held; the controller is deactivated, and its fallbacks take over, else "
        "its joints are held",
        "see what holds the joint, then start another action, or switch the controller on again",
        "{joint} was {value:.3f} rad from its command; allowed {limit:g}",
    ),
    Rule.OWNER_LOST: Words(
        "whoever started an action has not checked in for 1 s, of the wall's time and of the robot's",
        "the action slows down to a stand on its path, then ends; its joints are held",
        "start another action",
        "",
    ),
    Rule.EXPIRED: Words(
        "a command comes later than it says that it may (`expires_ns`, the robot's clock)",
        "the command is refused; nothing changes",
        "send another one",
        "{value:.3f} s too late",
    ),
    Rule.POSITION: Words(
        "a set-point lies beyond a joint's position limits",
        _CUTS,
        _ANEW,
        "{joint}: {value:.4f} rad asked, {limit:.4f} allowed",
    ),
    Rule.VELOCITY: Words(
        "a set-point moves faster than the joint's velocity limit, or says so",
        _CUTS,
        _ANEW,
        "{joint}: {value:.3f} rad/s asked, {limit:.3f} allowed",
    ),
    Rule.TORQUE: Words(
        "the drive would make more torque of the set-points than the joint is rated for",
        "takes the rest off the feed-forward torque",
        _ANEW,
        "{joint}: {value:.1f} N·m asked, {limit:.1f} allowed",
    ),
    Rule.TORQUE_RATE: Words(
        "a command changes the drive's torque faster than `control.torque_rate` allows",
        "spreads the change over cycles by the feed-forward torque",
        _ANEW,
        "{joint}: {value:.2f} N·m in one cycle asked, {limit:.2f} allowed",
    ),
    Rule.GAIN: Words(
        "a stiffness or damping is below zero or more than the drive can be told, or the feed-forward is",
        "takes the nearest, or where the torque would be another one then, none: the feed-forward carries the joint",
        _ANEW,
        "{joint}: stiffness {value:.0f} N·m/rad asked, {limit:.0f} at most",
    ),
}


def markdown() -> str:
    """The table as docs/safety.md has it."""
    lines = ["| rule | trips when | does | how to recover |", "| --- | --- | --- | --- |"]
    lines += [f"| `{rule.name.lower()}` | {w.trips} | {w.does} | {w.recover} |" for rule, w in TABLE.items()]
    return "\n".join(lines)
