"""Where everything lies: the arrays of a problem, the columns of a task's plan, its parameters.

The variable is x = (q̈, f): accelerations (nv,) of the model, then the force coordinates (nf,) of all contacts and wrenches. Kernels
work in whitened coordinates y = (L q̈, f / σ) with M = Lᵀ L, so that |y|² is twice the kinetic energy of an acceleration: distances
in them mean the same for metres and radians, on any robot.
"""

from __future__ import annotations

import enum

from daemon.wbc.model import VIEWS

NAMES = (
    *VIEWS,
    "parameters",  # (tasks, PARAMETERS)
    "posture",  # (6 · postures, nv): position, velocity, acceleration, stiffness, damping, 1 where it counts, of each JPos
    "given",  # (rows of Given tasks, nv + nf + 1): rows of x, wanted value
    "limits",  # (6, nv): lower, upper, velocity, acceleration, torque, approach rate
    "factor",  # L (nv, nv), M = Lᵀ L
    "raw",  # (rows, n): task rows, whitened and of unit length
    "projected",  # (rows, n): the same, without what higher levels own
    "row",  # (ROW, rows): what is known of each task row
    "bounded",  # (rows, n): rows of the inequalities that are not on a joint, of x
    "active_row",  # (n, n): whitened, unit rows of the active bounds
    "active",  # (4, n): wanted value, scale, multiplier, first multiplier that is not 0, of each
    "basis",  # (2 n, n): orthonormal directions that are owned, in the order of priority
    "within",  # (rows, 2 n): what each row had of the directions when it was freed of them
    "owned",  # (3, 2 n): how much of a direction is owned, 0 to 1; the row it came from, −1 − a: active bound a; that row's length
    "y",  # (6, n): solution, scratch, scratch, the equalities' own, a y that keeps all bounds, what the levels so far want
    "level",  # (LEVEL_HEIGHT + 1, levels + 1): what became of each level, and its first direction
    "bound",  # (2, 2 nv + bounded): lower, upper of q̈, torque, bounded rows
    "value",  # (2, 2 nv + bounded): what the solution makes of them; what row 4 of y does
    "force_rows",  # (nf, nv): Jacobian of each force coordinate
    "out",  # (3, max(nv, nf)): q̈, torque, forces
    "posture_target",  # (1, n): y that the last level wants
    "force_scales",  # (1, nf): σ
    "gram",  # (6 · widest level, widest level): scratch of a level near a singularity
    "settings",  # (1, SETTINGS)
)  # fmt: skip
(
    MASS, BIAS, JACOBIAN, MOMENTUM, PLACEMENT, PARENT_PLACEMENT, VELOCITY, DRIFT, FORCE, COM, STATE,
    PARAMETERS, POSTURE, GIVEN, LIMITS, FACTOR, RAW, PROJECTED, ROW, BOUNDED, ACTIVE_ROW, ACTIVE, BASIS, WITHIN, OWNED, Y,
    LEVEL, BOUND, VALUE, FORCE_ROWS, OUT, POSTURE_TARGET, FORCE_SCALES, GRAM, SETTINGS,
) = range(len(NAMES))  # fmt: skip


class Kind(enum.IntEnum):
    """What a task's rows are made of."""

    POSTURE = 0
    POSE = 1
    COM = 2
    GAZE = 3
    CLEARANCE = 4
    WRENCH = 5
    GIVEN = 6
    TRANSMISSION = 7
    FRICTION = 8
    BALANCE = 9


(
    POSTURE_KIND,
    POSE_KIND,
    COM_KIND,
    GAZE_KIND,
    CLEARANCE_KIND,
    WRENCH_KIND,
    GIVEN_KIND,
    TRANSMISSION_KIND,
    FRICTION_KIND,
    BALANCE_KIND,
) = range(10)

# Columns of the plan (tasks, PLAN) int64: what about a task never changes.
KIND, JOINT, BASE_JOINT, MASK, FIRST, COUNT, SLOT, FORCE_FIRST, ON, MOVED = range(10)
PLAN = 10
"""MASK: bit i is axis i of linear x y z, angular x y z. FIRST, COUNT: its rows. SLOT: its place in `posture` or `given`, or a
number of its kind's own. FORCE_FIRST: its first force coordinate. ON: 0 leaves it out. MOVED: axes are not the world's."""

# Columns of the parameters (tasks, PARAMETERS) float64.
FRAME_P, FRAME_R, BASE_P, BASE_R = 0, 3, 12, 15
REF_P, REF_R, REF_V, REF_A = 24, 27, 36, 42
KP, KD, WEIGHT = 48, 54, 60
ERROR, SHARE = 61, 67
EXTRA = 68
PARAMETERS_WIDTH = 96
"""Rotations by rows. ERROR (6,): what is left, written by the kernels; SHARE: 0 to 1, how much a task is
there that comes and goes, likewise."""

# Rows of `row`.
WANTED, LENGTH, ROW_WEIGHT = range(3)
ROW_HEIGHT = 3

# Rows of `level`.
LEAST, FILTERED, FREE_LEFT = range(3)
LEVEL_HEIGHT = 3
"""LEAST: smallest sin² of the angle between the level's directions and what is above it (and each other); FILTERED: 1 where a
direction was damped; FREE_LEFT: dimensions that were left for it"""

# Columns of `sizes` int64.
(
    N,
    NV,
    NF,
    LEVELS,
    TASKS,
    BASE,
    BOUNDED_ROWS,
    POSTURE_TASK,
    ACTIVE_COUNT,
    ROOTS,
    WIDEST,
    EQUALITIES,
    READY,
    PASSES,
    CULPRIT,
    FIXED,
) = range(16)
SIZES = 16
"""EQUALITIES: rows of level 0. FIXED: directions that they own. Kernels write ACTIVE_COUNT, READY, PASSES, CULPRIT, FIXED."""

# Columns of `settings`.
GRAVITY_Z, MASS_TOTAL, FORCE_SCALE, MOMENT_SCALE, DAMPING, MOST_DAMPING = range(6)
SETTINGS_WIDTH = 6
"""DAMPING: λ of all levels now, written by the kernels; MOST_DAMPING: what it comes up to"""


class Status(enum.IntEnum):
    """How a cycle went."""

    SOLVED = 0
    SEARCHING = 1
    """the active bounds were not found in the kernel's number of passes: the slower search takes over"""
    NOT_FINITE = 2
    """a state or a reference is no finite number, or the mass matrix is not positive"""
    CONTRADICTION = 3
    """two equalities of the constraints exclude each other"""


SOLVED, SEARCHING, NOT_FINITE, CONTRADICTION = range(4)
