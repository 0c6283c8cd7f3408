"""What tasks and constraints have in common: their frames, gains and parameters as a kernel reads them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np
import pinocchio as pin
from numpy.typing import NDArray

from daemon.wbc import layout as at
from daemon.wbc.layout import Kind
from daemon.wbc.memory import Array
from daemon.wbc.model import WholeBodyModel

AXES = {"x": 1, "y": 2, "z": 4, "rx": 8, "ry": 16, "rz": 32}
Gain = float | tuple[float, ...]


class WbcError(ValueError):
    """A task or constraint that can't be. `str()`: field, value, expectation; `field` is the field alone."""

    def __init__(self, field: str, problem: str):
        self.field, self.problem = field, problem
        super().__init__(f"{field}: {problem}" if field else problem)


@dataclass
class Entry:
    """A task or constraint as the kernels know it: columns of the plan, parameters, and what else it needs room for."""

    kind: Kind
    count: int
    joint: int = 0
    base_joint: int = 0
    mask: int = 0
    slot: int = 0
    force_axes: int = 0
    """mask of the force coordinates that it brings with it"""
    force_of: str = ""
    """frame of the contact whose force coordinates it uses"""
    force_frame: str = ""
    """frame under which others find its force coordinates"""
    parameters: Array = field(default_factory=lambda: np.zeros(at.PARAMETERS_WIDTH))
    posture: Array | None = None
    """(6, nv), of a posture"""
    given_joints: NDArray[np.bool_] | None = None
    """(nv,), of a posture: whose reference was given"""
    finds_position: bool = False
    """its reference was not given: it is where the frame stands at the start"""
    finds_orientation: bool = False
    given: Array | None = None
    """(count, n + 1), of given rows; filled in by the caller"""


def entry(
    kind: Kind,
    model: WholeBodyModel,
    *,
    count: int,
    frame: str = "",
    point: Sequence[float] = (0.0, 0.0, 0.0),
    base: str = "",
    mask: int = 0,
    weight: float = 1.0,
) -> Entry:
    """An entry about a point of a frame, seen from another frame ("": the world). Raises WbcError for unknown frames."""
    made = Entry(kind, count, mask=mask)
    p = made.parameters
    made.joint, placement = frame_on_joint(model, frame, "frame")
    placement = placement * pin.SE3(np.eye(3), np.asarray(point, float))
    made.base_joint, base_placement = frame_on_joint(model, base, "relative_to")
    p[at.FRAME_P : at.FRAME_P + 3], p[at.FRAME_R : at.FRAME_R + 9] = placement.translation, placement.rotation.ravel()
    p[at.BASE_P : at.BASE_P + 3] = base_placement.translation
    p[at.BASE_R : at.BASE_R + 9] = base_placement.rotation.ravel()
    p[at.REF_R : at.REF_R + 9] = np.eye(3).ravel()
    p[at.WEIGHT], p[at.SHARE] = weight, 1.0
    if not (np.isfinite(weight) and weight > 0.0):
        raise WbcError("weight", f"got {weight!r}; expected a number above 0")
    return made


def frame_on_joint(model: WholeBodyModel, frame: str, field: str) -> tuple[int, pin.SE3]:
    """(joint, placement) of a frame. Raises WbcError, naming a frame that is spelt alike."""
    try:
        return model.frame_on_joint(frame)
    except KeyError:
        raise WbcError(
            field, f"no frame {frame!r}; expected {_alike(frame, [f.name for f in model.model.frames])}"
        ) from None


def joint_row(model: WholeBodyModel, joint: str, field: str) -> int:
    """A joint's velocity index. Raises WbcError, naming a joint that is spelt alike."""
    if joint not in model.joints:
        raise WbcError(field, f"no joint {joint!r}; expected {_alike(joint, list(model.joints))}")
    return int(model.rows[model.joints.index(joint)])


def _alike(name: str, names: list[str]) -> str:
    import difflib

    close = difflib.get_close_matches(name, names, 3)
    return "one like " + ", ".join(close) if close else f"one of {len(names)}, such as {names[-1]}"


def axes_mask(axes: Sequence[str], allowed: int, field: str = "axes") -> int:
    """x y z rx ry rz as a mask. Raises WbcError."""
    mask = 0
    for axis in axes:
        if axis not in AXES or not AXES[axis] & allowed:
            expected = " ".join(name for name, bit in AXES.items() if bit & allowed)
            raise WbcError(field, f"got {axis!r}; expected some of {expected}")
        mask |= AXES[axis]
    if not mask:
        raise WbcError(field, "got none; expected at least one axis")
    return mask


def gains(made: Entry, stiffness: Gain, damping: Gain | None, mask: int) -> None:
    """Stiffness 1/s² and damping 1/s (none: critical, 2 sqrt(stiffness)) of the axes in `mask`, one for all or one an axis."""
    axes = [i for i in range(6) if mask & (1 << i)]
    kp = _per_axis(stiffness, len(axes), "stiffness")
    kd = 2.0 * np.sqrt(kp) if damping is None else _per_axis(damping, len(axes), "damping")
    made.parameters[at.KP + np.array(axes)], made.parameters[at.KD + np.array(axes)] = kp, kd


def _per_axis(gain: Gain, count: int, field: str) -> Array:
    values = np.atleast_1d(np.asarray(gain, float))
    if values.shape not in ((1,), (count,)) or not np.isfinite(values).all() or (values < 0.0).any():
        raise WbcError(field, f"got {gain!r}; expected one number of at least 0, or {count}")
    return np.broadcast_to(values, (count,)).copy()


def numbers(value: Sequence[float], count: int, field: str) -> Array:
    """`count` finite numbers. Raises WbcError."""
    array = np.asarray(value, float)
    if array.shape != (count,) or not np.isfinite(array).all():
        raise WbcError(field, f"got {value!r}; expected {count} finite numbers")
    return array
