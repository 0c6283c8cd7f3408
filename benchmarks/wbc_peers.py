"""Other whole-body controllers on the problem of benchmarks/wbc.py: a process in a virtual environment of its own.

    python wbc_peers.py tsid|placo|pink PROBLEM_FOLDER

Speaks JSON lines: {"tasks": 5, "states": "random", "torque": 1.0, "from": 0, "to": 100} → microseconds of each state; with
"torques": true, what came out. Knows nothing of Handrail: it runs where Handrail is not installed.
"""

import json
import sys
import time
from pathlib import Path

import numpy as np

KP, KD = 100.0, 20.0


class Tsid:
    """Inverse dynamics as one weighted quadratic program with torque bounds (Del Prete et al. 2016), eiquadprog."""

    def __init__(self, problem, tasks, torque, hard=False):
        import pinocchio as pin
        from tsid import tsid_pywrap as tsid

        paths = pin.StdVec_StdString()
        self.robot = robot = tsid.RobotWrapper(problem["urdf"], paths, False)
        self.formulation = form = tsid.InverseDynamicsFormulationAccForce("tsid", robot, False)
        home = np.array(problem["home"])
        form.computeProblemData(0.0, home, np.zeros(robot.nv))
        self.keep = []
        for number, task in enumerate(tasks):
            weight = 1e-3 if 0 < number == len(tasks) - 1 else 1.0
            kind = task["kind"]
            if kind == "posture":
                made = tsid.TaskJointPosture(f"t{number}", robot)
                made.setKp(KP * np.ones(robot.nv))
                made.setKd(KD * np.ones(robot.nv))
                reference = tsid.TrajectoryEuclidianConstant(f"r{number}", home)
            elif kind == "com":
                made = tsid.TaskComEquality(f"t{number}", robot)
                made.setKp(KP * np.ones(3))
                made.setKd(KD * np.ones(3))
                reference = tsid.TrajectoryEuclidianConstant(f"r{number}", np.array(task["position"]))
            else:
                made = tsid.TaskSE3Equality(f"t{number}", robot, task["frame"])
                made.setKp(KP * np.ones(6))
                made.setKd(KD * np.ones(6))
                made.useLocalFrame(False)
                made.setMask(np.array([kind != "ori"] * 3 + [kind != "pos"] * 3, float))
                pose = pin.SE3(np.array(task["rotation"]), np.array(task["position"]))
                reference = tsid.TrajectorySE3Constant(f"r{number}", pose)
            made.setReference(reference.computeNext())
            form.addMotionTask(made, weight, 0 if hard and kind != "posture" else 1, 0.0)
            self.keep.append((made, reference))
        bounds = tsid.TaskActuationBounds("torque", robot)
        most = torque * np.array(problem["torque"])
        bounds.setBounds(-most, most)
        form.addActuationTask(bounds, 1.0, 0, 0.0)
        self.keep.append(bounds)
        self.solver = tsid.SolverHQuadProgFast("solver")
        self.solver.resize(form.nVar, form.nEq, form.nIn)

    def __call__(self, q, v):
        data = self.formulation.computeProblemData(0.0, q, v)
        return self.formulation.getActuatorForces(self.solver.solve(data))


class Placo:
    """placo's DynamicsSolver: soft tasks with weights, torque limits as inequalities."""

    def __init__(self, problem, tasks, torque):
        import placo

        # placo floats every robot: its base is held by a mask, and its state has seven numbers more.
        self.robot = robot = placo.RobotWrapper(problem["urdf"], placo.Flags.ignore_collisions)
        self.solver = solver = placo.DynamicsSolver(robot)
        solver.mask_fbase(True)
        solver.dt = 1e-3
        for joint, limit in zip(problem["joints"], problem["torque"], strict=True):
            robot.set_torque_limit(joint, torque * limit)
        solver.enable_torque_limits(True)
        robot.update_kinematics()
        for number, task in enumerate(tasks):
            kind = task["kind"]
            if kind == "posture":
                made = solver.add_joints_task()
                made.set_joints(dict(zip(problem["joints"], problem["home"], strict=True)))
            elif kind == "com":
                made = solver.add_com_task(np.array(task["position"]))
            elif kind == "pos":
                made = solver.add_position_task(task["frame"], np.array(task["position"]))
            elif kind == "ori":
                made = solver.add_orientation_task(task["frame"], np.array(task["rotation"]))
            else:
                pose = np.eye(4)
                pose[:3, :3], pose[:3, 3] = task["rotation"], task["position"]
                made = solver.add_frame_task(task["frame"], pose)
            parts = [made] if kind != "se3" else [made.position(), made.orientation()]
            for part in parts:
                part.kp, part.kd = KP, KD
            made.configure(f"t{number}", "soft", *([1.0] * len(parts) if number < len(tasks) - 1 else [1e-3]))
        self.rows = [robot.get_joint_offset(joint) for joint in problem["joints"]]
        self.rows_v = [robot.get_joint_v_offset(joint) for joint in problem["joints"]]

    def __call__(self, q, v):
        state = self.robot.state
        state.q[self.rows], state.qd[self.rows_v] = q, v
        self.robot.update_kinematics()
        return self.solver.solve(False).tau


class Pink:
    """pin-pink: differential inverse kinematics (no dynamics, no torques), daqp."""

    def __init__(self, problem, tasks, torque):
        import pink
        import pinocchio as pin

        self.pink, self.model = pink, pin.buildModelFromUrdf(problem["urdf"])
        self.data = self.model.createData()
        self.tasks = []
        for task in tasks:
            kind = task["kind"]
            if kind == "posture":
                made = pink.tasks.PostureTask(cost=1e-2)
                made.set_target(np.array(problem["home"]))
            elif kind == "com":
                made = pink.tasks.ComTask(cost=1.0)
                made.set_target(np.array(task["position"]))
            else:
                made = pink.tasks.FrameTask(task["frame"], float(kind != "ori"), float(kind != "pos"))
                made.set_target(pin.SE3(np.array(task["rotation"]), np.array(task["position"])))
            self.tasks.append(made)

    def __call__(self, q, v):
        configuration = self.pink.Configuration(self.model, self.data, q)
        return self.pink.solve_ik(configuration, self.tasks, 1e-3, solver="daqp", safety_break=False)


def main() -> None:
    """Answer requests until the input ends."""
    kinds = {"tsid": Tsid, "placo": Placo, "pink": Pink}
    kind: type = kinds[sys.argv[1]]
    folder = Path(sys.argv[2])
    problem = json.loads((folder / "problem.json").read_text())
    states = {name: np.load(folder / f"{name}.npy") for name in problem["states"]}
    made = {}
    out = sys.stdout
    sys.stdout = sys.stderr
    for request in sys.stdin:
        wanted = json.loads(request)
        key = wanted["tasks"], wanted["torque"], wanted.get("hard", False)
        if key not in made:
            made[key] = kind(problem, problem["tasks"][str(key[0])], key[1], *([True] if key[2] else []))
        solve, (q, v) = made[key], states[wanted["states"]]
        if wanted.get("torques"):
            torques = [np.asarray(solve(q[i], v[i])).tolist() for i in range(wanted["from"], wanted["to"])]
            out.write(json.dumps(torques) + "\n")
            out.flush()
            continue
        times = []
        for i in range(wanted["from"], wanted["to"]):
            begin = time.perf_counter()
            solve(q[i], v[i])
            times.append((time.perf_counter() - begin) * 1e6)
        out.write(json.dumps(times) + "\n")
        out.flush()


if __name__ == "__main__":
    main()
