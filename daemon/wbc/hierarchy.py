"""Tasks in strict order under constraints, solved once a cycle: what a controller holds.

    body = WholeBody(model, levels=[[CartPos(frame="hand")], [JPos()]], constraints=[JointLimits()])
    body["CartPos hand"].pose(position=(0.4, -0.2, 0.1))
    model.place(position, velocity)
    result = body.solve()

Level by level, min Σ wᵢ² |J_i x − a_i|² over x = (q̈, f), subject to the constraints and to everything that the levels above have
reached (Kanoun, Lamiraux and Wieber 2011; Escande, Mansard and Wieber 2014). The kernel (kernels.py) finds which bounds are active,
from those of the last cycle on; where it knows no point that keeps them all, feasibility.py finds one, or says what is in the way.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import pinocchio as pin

from daemon.wbc import kernels
from daemon.wbc import layout as at
from daemon.wbc.constraints import Constraint, JointLimits, unlimited
from daemon.wbc.feasibility import Feasibility
from daemon.wbc.handle import Handle
from daemon.wbc.layout import Kind
from daemon.wbc.memory import Array, Integers, Memory
from daemon.wbc.model import WholeBodyModel
from daemon.wbc.parameters import Entry, WbcError, entry, joint_row
from daemon.wbc.result import Result
from daemon.wbc.rows import task_rows
from daemon.wbc.tasks import JPos, Task

_GRAVITY_REACH = 0.1
"""m: a moment counts as a force at this distance, where forces are shared out"""
_LED = "joints that others move"
_FORCE_SHARE = 0.1
"""of an acceleration's weight, that of the force which makes it"""


class WholeBody:
    """The solver of one robot, one list of constraints and one of levels, highest first."""

    def __init__(
        self,
        model: WholeBodyModel,
        levels: Sequence[Sequence[Task]],
        constraints: Sequence[Constraint] = (),
        led: Sequence[str] = (),
    ):
        """References start where the model is now. Raises WbcError naming what is wrong in which task.

        `led`: joints that somebody else moves: their accelerations are given (`lead`), no torque of theirs is asked for or bounded.
        """
        self.model = model
        self._led: Integers = np.array([joint_row(model, joint, "led") for joint in led], np.int64)
        limits = [c for c in constraints if isinstance(c, JointLimits)]
        if len(limits) > 1:
            raise WbcError("JointLimits", f"got {len(limits)}; expected at most one")
        self.handles: dict[str, Handle] = {}
        self._entries: list[Entry] = []
        self._titles: list[str] = []
        equalities: list[tuple[str, Entry]] = []
        bounded: list[tuple[str, Entry]] = []
        for number, constraint in enumerate(constraints):
            for made in _named(lambda c=constraint: c.entries(model), f"constraints[{number}]"):
                self._check_moved(made, f"constraints[{number}]")
                holds = made.kind in (Kind.POSE, Kind.TRANSMISSION)
                (equalities if holds else bounded).append((constraint.title, made))
        by_level = [
            [(task, _named(lambda t=task: t.entry(model), f"levels[{i}][{j}]")) for j, task in enumerate(level)]
            for i, level in enumerate(levels)
        ]
        posture = _posture_of(by_level, model)
        for i, level in enumerate(by_level):
            for j, (_, made) in enumerate(level):
                self._check_moved(made, f"levels[{i}][{j}]")
                self._leave_led(made, made is posture, f"levels[{i}][{j}]")
        if led:
            others = entry(Kind.GIVEN, model, count=len(led))
            others.given = np.zeros((len(led), 1))
            equalities.insert(0, (_LED, others))
        self._lay_out(equalities, by_level, bounded, posture)
        self._limits = self._memory["limits"]
        self._limits[:] = limits[0].table(model) if limits else unlimited(model)
        self._limits[:, self._led] = unlimited(model)[:, self._led]
        self._limits_title = limits[0].title if limits else "JointLimits"
        self._led_postures = self._find_led()
        self.result = Result(
            self._memory["out"][0, : model.nv], self._memory["out"][1, : model.nv], self._memory["out"][2]
        )
        self._coming = [
            k for k, made in enumerate(self._entries) if made.kind == Kind.CLEARANCE and self._level_of(k) > 0
        ]
        self._feasibility = Feasibility(self)

    def _lay_out(
        self,
        equalities: list[tuple[str, Entry]],
        by_level: list[list[tuple[Task, Entry]]],
        bounded: list[tuple[str, Entry]],
        posture: Entry | None,
    ) -> None:
        model = self.model
        nv = model.nv
        free = len(equalities)
        count = len(by_level) + 1
        self._entries = [made for _, made in equalities] + [made for level in by_level for _, made in level]
        self._entries += [made for _, made in bounded]
        self._titles = [title for title, _ in equalities] + [task.title for level in by_level for task, _ in level]
        self._titles += [title for title, _ in bounded]
        nf = self._share_forces()
        n = nv + nf
        tasks = len(self._entries)
        self.plan: Integers = np.zeros((max(tasks, 1), at.PLAN), np.int64)
        self.levels: Integers = np.zeros((count + 1, 4), np.int64)
        self.sizes: Integers = np.zeros(at.SIZES, np.int64)
        sizes = self.sizes
        row, first_task, widest = model.base, 0, 1
        self._row_task: list[int] = [-1] * model.base
        for level, members in enumerate(
            [[made for _, made in equalities], *([m for _, m in level] for level in by_level)]
        ):
            first_row = 0 if level == 0 else row
            for k, made in enumerate(members, first_task):
                self.plan[k, at.FIRST] = row
                self.plan[k, at.COUNT] = 0 if made is posture else made.count
                row += int(self.plan[k, at.COUNT])
                self._row_task += [k] * int(self.plan[k, at.COUNT])
            self.levels[level] = first_task, len(members), first_row, row - first_row
            first_task += len(members)
            widest = max(widest, row - first_row if level else 1)
        self.levels[count] = first_task, len(bounded), 0, 0
        rows, extra = row, 0
        for k, (_, made) in enumerate(bounded, first_task):
            self.plan[k, at.FIRST], self.plan[k, at.COUNT] = extra, made.count
            extra += made.count
        self._bounded_title = [title for title, made in bounded for _ in range(made.count)]
        postures = [made for made in self._entries if made.posture is not None]
        given = [made for made in self._entries if made.given is not None]

        memory = self._memory = Memory(at.NAMES)
        model.share(memory)
        memory.make("parameters", tasks, at.PARAMETERS_WIDTH)
        memory.make("posture", 6 * len(postures), nv)
        memory.make("given", sum(made.count for made in given), n + 1)
        memory.make("limits", 6, nv)
        memory.make("factor", nv, nv)
        memory.make("raw", rows, n)
        memory.make("projected", rows, n)
        memory.make("row", at.ROW_HEIGHT, rows)
        memory.make("bounded", extra, n)
        memory.make("active_row", n, n)
        memory.make("active", 4, n)
        memory.make("basis", 2 * n, n)
        memory.make("within", rows, 2 * n)
        memory.make("owned", 3, 2 * n)
        memory.make("y", 6, n)
        memory.make("level", at.LEVEL_HEIGHT + 1, count + 1)
        memory.make("bound", 2, 2 * nv + extra)
        memory.make("value", 2, 2 * nv + extra)
        memory.make("force_rows", nf, nv)
        memory.make("out", 3, max(nv, nf))
        memory.make("posture_target", 1, n)
        memory.make("force_scales", 1, nf)
        memory.make("gram", 6 * max(widest, 1), max(widest, 1))
        settings = memory.make("settings", 1, at.SETTINGS_WIDTH)[0]
        settings[at.GRAVITY_Z], settings[at.MASS_TOTAL] = model.model.gravity.linear[2], model.mass
        settings[at.FORCE_SCALE] = np.sqrt(model.mass) / _FORCE_SHARE
        settings[at.MOMENT_SCALE] = settings[at.FORCE_SCALE] * _GRAVITY_REACH

        posture_slot = given_slot = 0
        for k, made in enumerate(self._entries):
            plan = self.plan[k]
            plan[at.KIND], plan[at.JOINT], plan[at.BASE_JOINT] = made.kind, made.joint, made.base_joint
            plan[at.MASK], plan[at.SLOT], plan[at.ON] = made.mask, made.slot, 1
            plan[at.FORCE_FIRST] = self._force_first[k]
            memory["parameters"][k] = made.parameters
            if made.posture is not None:
                plan[at.SLOT] = posture_slot
                memory["posture"][6 * posture_slot : 6 * posture_slot + 6] = made.posture
                posture_slot += 1
            if made.given is not None:
                plan[at.SLOT] = given_slot
                given_slot += made.count
        sizes[at.N], sizes[at.NV], sizes[at.NF], sizes[at.LEVELS] = n, nv, nf, count
        sizes[at.TASKS], sizes[at.BASE], sizes[at.BOUNDED_ROWS] = tasks, model.base, extra
        sizes[at.POSTURE_TASK] = next((k for k, made in enumerate(self._entries) if made is posture), -1)
        sizes[at.EQUALITIES] = self.levels[0, 3]
        self.bounds: Integers = np.zeros((n, 2), np.int64)
        self.arguments = (memory.table, self.plan, model.support, model.roots, self.levels, sizes, self.bounds)
        for k, level_task in enumerate((task for level in by_level for task, _ in level), free):
            title = level_task.title
            if title in self.handles:
                raise WbcError(title, "got this name twice; expected a name of its own (name: ...)")
            self.handles[title] = Handle(self, k, self._entries[k])
        for k, (title, made) in enumerate([*equalities], 0):
            if made.kind in (Kind.POSE, Kind.TRANSMISSION, Kind.GIVEN) and title not in self.handles:
                self.handles[title] = Handle(self, k, made)

    def _share_forces(self) -> int:
        """Give out force coordinates: contacts and free wrenches bring theirs, others use those of a contact. Returns how many."""
        first = [-1] * len(self._entries)
        at_frame: dict[str, int] = {}
        nf = 0
        for k, made in enumerate(self._entries):
            if made.force_frame:
                if made.force_frame in at_frame:
                    raise WbcError(made.force_frame, "has two contacts; expected one a frame")
                first[k] = at_frame[made.force_frame] = nf
                nf += made.force_axes.bit_count()
        of_contact = {self._entries[k].force_frame: self._entries[k] for k in range(len(first)) if first[k] >= 0}
        for k, made in enumerate(self._entries):
            if made.force_of and made.force_of in at_frame:
                contact = of_contact[made.force_of]
                if made.mask & ~contact.force_axes:
                    raise WbcError(
                        self._titles[k], "asks for moments of a point contact; expected forces, or a flat contact"
                    )
                first[k] = at_frame[made.force_of]
                made.slot = 1
            elif made.force_of:
                first[k], nf = nf, nf + made.force_axes.bit_count()
        self._force_first = first
        return nf

    def _level_of(self, number: int) -> int:
        """A task's level, 0 for a constraint."""
        first, count = self.levels[1 : int(self.sizes[at.LEVELS]), :2].T
        inside = np.flatnonzero((first <= number) & (number < first + count))
        return int(inside[0]) + 1 if len(inside) else 0

    def __getitem__(self, title: str) -> Handle:
        """A task's (or an equality's) handle, by its title. Raises KeyError."""
        return self.handles[title]

    def lead(self, acceleration: Array) -> None:
        """What the joints that others move will do: rad/s², in the order of `led`."""
        self.handles[_LED].wanted[:] = acceleration
        for posture in self._led_postures:
            posture[2, self._led] = acceleration

    def _find_led(self) -> list[Array]:
        """Fill in the rows of the joints that others move; the postures (6, nv) that have to follow them."""
        if not len(self._led):
            return []
        self.handles[_LED].rows[:, self._led] = np.eye(len(self._led))
        postures = [handle.posture for handle in self.handles.values() if handle.posture.shape[1]]
        return [posture for posture in postures if posture[5, self._led].any()]

    def _check_moved(self, made: Entry, where: str) -> None:
        """What no joint moves but those that others lead would be out of reach for ever. Raises WbcError."""
        if not len(self._led):
            return
        led = set(self._led.tolist())
        if made.kind == Kind.TRANSMISSION:
            moved = made.joint not in led and made.base_joint not in led
        elif made.kind in (Kind.POSE, Kind.GAZE, Kind.CLEARANCE, Kind.WRENCH):
            support = self.model.support
            columns = {c for j in (made.joint, made.base_joint) for c in support[j, 1 : support[j, 0] + 1].tolist()}
            moved = bool(columns - led)
        else:
            return
        if not moved:
            field = "follower" if made.kind == Kind.TRANSMISSION else "body" if made.kind == Kind.CLEARANCE else "frame"
            raise WbcError(f"{where}.{field}", "none of the motion's joints moves it; expected one that they move")

    def _leave_led(self, made: Entry, nearest: bool, where: str) -> None:
        """Take the joints that others move out of a posture; `nearest`: of that which is met in the mass metric, what they do
        is what is wanted."""
        if made.posture is None or not len(self._led):
            return
        made.posture[3:5, self._led] = 0.0
        if nearest:
            return
        made.posture[5, self._led] = 0.0
        made.count = int(made.posture[5].sum())
        if not made.count:
            raise WbcError(f"{where}.joints", "got none of the motion's joints; expected at least one")

    def solve(self) -> Result:
        """Solve for the state that the model was last put in."""
        if self._coming:
            return self._solve_between()
        self._solve_once()
        return self.result

    def damp(self, most: float) -> None:
        """Make torques continuous where bounds are active, too: see docs/wbc.md. `most`: λ, a sine; 0: exact to the bounds."""
        settings = self._memory["settings"][0]
        settings[at.MOST_DAMPING], settings[at.DAMPING] = most, min(settings[at.DAMPING], most)

    @property
    def damping(self) -> float:
        """Share 0 to 1 of the damping that is there now: 1 where a level is singular or a bound is active for a while."""
        settings = self._memory["settings"][0]
        return float(settings[at.DAMPING] / settings[at.MOST_DAMPING]) if settings[at.MOST_DAMPING] else 0.0

    def _solve_once(self) -> None:
        result = self.result
        status = kernels.solve(*self.arguments)
        if status == at.SOLVED:
            result.solved, result.active = True, int(self.sizes[at.ACTIVE_COUNT])
            result.why, result.blocked = "", ()
        else:
            self._feasibility.solve(status)

    def _solve_between(self) -> Result:
        """With tasks that come and go: between the solutions with those that are there, the most first.

        With shares s₁ ≥ s₂ ≥ …, x = (1 − s₁) x() + (s₁ − s₂) x(1) + (s₂ − s₃) x(1, 2) + …: continuous in the shares, strict where
        they are 0 or 1, and within all bounds, which are convex (Lovász' extension; Lee, Mansard and Park 2012 for one task).
        """
        coming = [k for k in self._coming if self.plan[k, at.ON]]
        row, wanted = np.zeros((1, int(self.sizes[at.N]))), np.zeros(1)
        for k in coming:
            self.task_rows(k, row, wanted)
        shares = np.nan_to_num(
            self._memory["parameters"][:, at.SHARE], nan=1.0
        )  # a broken state goes through, and is told
        order = sorted(coming, key=lambda k: -shares[k])
        out, blend, worst = self._memory["out"], np.zeros_like(self._memory["out"]), None
        most = 1.0
        self.plan[coming, at.ON] = 0
        try:
            for there in range(len(order) + 1):
                if there:
                    self.plan[order[there - 1], at.ON] = 1
                least = float(shares[order[there]]) if there < len(order) else 0.0
                if not most - least > 0.0:
                    most = least
                    continue
                self._solve_once()
                blend += (most - least) * out
                most = least
                if not self.result.solved:
                    worst = (self.result.why, self.result.blocked)
        finally:  # whoever goes on after an error goes on with all of them
            self.plan[coming, at.ON] = 1
        out[:] = blend
        if worst:
            self.result.solved, (self.result.why, self.result.blocked) = False, worst
        return self.result

    def start_here(self) -> None:
        """Take every reference that was not given from where the model is now, as when this was made."""
        model, memory = self.model, self._memory
        for number, made in enumerate(self._entries):
            p = memory["parameters"][number]
            if made.posture is not None and made.given_joints is not None:
                first = 6 * int(self.plan[number, at.SLOT])
                memory["posture"][first] = np.where(made.given_joints, made.posture[0], model.state[0])
            elif made.kind == Kind.COM and made.finds_position:
                p[at.REF_P : at.REF_P + 3] = model.com
            elif made.kind == Kind.POSE and (made.finds_position or made.finds_orientation):
                base = self._placed(made.base_joint, p[at.BASE_P : at.BASE_P + 3], p[at.BASE_R : at.BASE_R + 9])
                frame = self._placed(made.joint, p[at.FRAME_P : at.FRAME_P + 3], p[at.FRAME_R : at.FRAME_R + 9])
                here = base.actInv(frame)
                if made.finds_position:
                    p[at.REF_P : at.REF_P + 3] = here.translation
                if made.finds_orientation:
                    p[at.REF_R : at.REF_R + 9] = here.rotation.ravel()

    def _placed(self, joint: int, position: Array, rotation: Array) -> pin.SE3:
        """What lies at `position` (3,) m, `rotation` (9,) on a joint's body, in the world, as of the model's last pass."""
        return self.model.data.oMi[joint] * pin.SE3(rotation.reshape(3, 3), position)

    def warm_up(self) -> None:
        """Compile (or load) all kernels: before a loop starts."""
        self.solve()
        kernels.descend(*self.arguments)
        self._feasibility.solve(at.SEARCHING)
        self.sizes[at.ACTIVE_COUNT] = 0

    def task_rows(self, number: int, rows: Array, wanted: Array) -> None:
        """J (count, n) and a (count,) of the task with this number in the plan, as of the model's last pass."""
        nv, n = int(self.sizes[at.NV]), int(self.sizes[at.N])
        task_rows(self._memory.table, self.plan, self.model.support, self.model.roots, nv, n, number, rows, wanted, 0)

    def residual(self, title: str) -> Array:
        """J x − a of a task (count,), in its own units, for the last solution: what priorities and bounds left."""
        return self.handles[title].residual()

    def exact(self, level: int) -> bool:
        """No direction of a level (0: the first) was damped or had to give way to those above, in the last walk."""
        about = self._memory["level"]
        if self.damping > 0.0:
            return False
        return bool(about[at.FILTERED, level + 1] == 0.0 and about[at.LEAST, level + 1] > 0.0)

    def bound_title(self, number: int) -> tuple[str, str]:
        """(what it is called, its unit) of a bound."""
        nv = self.model.nv
        if number >= 2 * nv:
            return self._bounded_title[number - 2 * nv], "N or m/s²"
        joint = self.model.joints[int(np.flatnonzero(self.model.rows == number % nv)[0])]
        if number >= nv:
            return f"{self._limits_title} torque of {joint}", "N·m"
        return f"{self._limits_title} motion of {joint}", "rad/s²"

    def equality_title(self, row: int) -> str:
        """What the equality of a row is called."""
        task = self._row_task[row]
        return "free base's dynamics" if task < 0 else self._titles[task]

    @property
    def memory(self) -> Memory:
        """The arrays that the kernels work on."""
        return self._memory


def _posture_of(by_level: list[list[tuple[Task, Entry]]], model: WholeBodyModel) -> Entry | None:
    """The posture that the last level is nothing else but, for all joints: it is met in the mass metric."""
    if not by_level or len(by_level[-1]) != 1:
        return None
    task, made = by_level[-1][0]
    return made if isinstance(task, JPos) and made.count == model.nv - model.base else None


def _named(make, where: str):  # type: ignore[no-untyped-def]
    try:
        return make()
    except WbcError as error:
        raise WbcError(f"{where}.{error.field}", error.problem) from error
