"""Other inverse kinematics on the problem of benchmarks/planning.py: a process in a virtual environment of its own.

    python planning_peers.py drake|placo|pink PROBLEM_FOLDER

Speaks JSON lines: {"knots": 1, "from": 0, "to": 10} → for each target seconds and the configurations found, each the base's (4, 4)
pose and the joints' positions. Timed is solving alone: models, tasks and mathematical programs are made before. Knows nothing of
Handrail: it runs where Handrail is not installed.
"""

import json
import sys
import time
from pathlib import Path

import numpy as np


def pose_of(position, rotation):
    pose = np.eye(4)
    pose[:3, :3], pose[:3, 3] = rotation, position
    return pose


class Drake:
    """A mathematical program, solved by SNOPT from the nominal configuration (Tedrake et al., InverseKinematics)."""

    def __init__(self, problem):
        from pydrake.math import RotationMatrix
        from pydrake.multibody import inverse_kinematics as ik
        from pydrake.multibody.parsing import Parser
        from pydrake.multibody.plant import MultibodyPlant
        from pydrake.solvers import MathematicalProgram, SnoptSolver

        self.ik, self.rotation, self.program, self.solver = ik, RotationMatrix, MathematicalProgram, SnoptSolver()
        self.problem = problem
        self.plant = plant = MultibodyPlant(0.0)
        Parser(plant).AddModels(problem["urdf"])
        plant.Finalize()
        self.base = plant.GetBodyByName("base_link")
        self.rows = [plant.GetJointByName(joint).position_start() for joint in problem["joints"]]
        self.home = self._configuration()

    def _configuration(self):
        from pydrake.math import RigidTransform

        context = self.plant.CreateDefaultContext()
        pose = RigidTransform(self.rotation(np.array(self.problem["base_rotation"])), self.problem["base_position"])
        self.plant.SetFreeBodyPose(context, self.base, pose)
        q = self.plant.GetPositions(context).copy()
        q[self.rows] = self.problem["home"]
        return q

    def prepare(self, target, knots):
        """`knots` 1: one configuration; else the first stands, the others are free, the hand's goal holds at the last."""
        self.contexts = []
        return self._program(target, knots), None if knots == 1 else self._program(target, 1)

    def _program(self, target, knots):
        plant, problem, ik = self.plant, self.problem, self.ik
        free = 1 if knots == 1 else knots - 1
        program, n = self.program(), plant.num_positions()
        q = program.NewContinuousVariables(free, n)
        low, high = plant.GetPositionLowerLimits(), plant.GetPositionUpperLimits()
        limited = [row for row in range(n) if row in set(self.rows)]
        for k in range(free):
            context = plant.CreateDefaultContext()
            self.contexts.append(context)
            program.AddBoundingBoxConstraint(low[limited], high[limited], q[k, limited])
            ik.AddUnitQuaternionConstraintOnPlant(plant, q[k], program)
            frames = list(problem["feet"])
            if k == free - 1:
                frames.append({"frame": problem["hand"], **target})
            for one in frames:
                frame, world = plant.GetFrameByName(one["frame"]), plant.world_frame()
                at, turn = np.array(one["position"]), self.rotation(np.array(one["rotation"]))
                position = ik.PositionConstraint(plant, world, at, at, frame, np.zeros(3), context)
                orientation = ik.OrientationConstraint(plant, world, turn, frame, self.rotation(), 0.0, context)
                program.AddConstraint(position, q[k])
                program.AddConstraint(orientation, q[k])
            support = np.asfortranarray(np.eye(3)[:2])
            low_com, high_com = np.array(problem["support"])
            program.AddConstraint(
                ik.ComInPolyhedronConstraint(plant, None, plant.world_frame(), support, low_com, high_com, context),
                q[k],
            )
        weight = np.full(n, 0.1)
        weight[self.rows] = 1.0
        smooth = np.eye(1) if knots == 1 else np.array(problem["smooth"])
        hessian = np.kron(smooth, np.diag(weight))
        flat = q.ravel()
        program.AddQuadraticErrorCost(hessian, np.tile(self.home, free), flat)
        program.SetInitialGuess(flat, np.tile(self.home, free))
        return program, q

    def solve(self, prepared):
        (program, q), last = prepared
        result = self.solver.Solve(program)
        if not result.is_success() and last is not None:  # the second start that ours has as well
            share = np.linspace(0.0, 1.0, len(q) + 1)[1:, None]
            guess = (1.0 - share) * self.home + share * self._end(*last)
            again = self.solver.Solve(program, guess.ravel())
            result = again if again.is_success() else result
        return [self._answer(row) for row in result.GetSolution(q)]

    def _end(self, program, q):
        """A configuration at the goal, from the nominal one or from two others drawn about it."""
        generator = np.random.default_rng(1)
        low, high = self.plant.GetPositionLowerLimits(), self.plant.GetPositionUpperLimits()
        for share in (0.0, 0.25, 0.5):
            guess = self.home.copy()
            guess[self.rows] += share * (generator.uniform(low[self.rows], high[self.rows]) - guess[self.rows])
            result = self.solver.Solve(program, guess)
            if result.is_success():
                break
        return result.GetSolution(q)[0]

    def _answer(self, q):
        context = self.plant.CreateDefaultContext()
        self.plant.SetPositions(context, q)
        pose = self.plant.GetFreeBodyPose(context, self.base).GetAsMatrix4()
        return pose.tolist(), q[self.rows].tolist()


class Placo:
    """placo's KinematicsSolver: the feet hard, the hand soft, the centre of mass in a polygon, up to 100 iterations."""

    def __init__(self, problem):
        import placo

        self.placo, self.problem = placo, problem

    def prepare(self, target, knots):
        problem = self.problem
        robot = self.placo.RobotWrapper(problem["urdf"], self.placo.Flags.ignore_collisions)
        robot.set_T_world_fbase(pose_of(problem["base_position"], problem["base_rotation"]))
        for joint, angle in zip(problem["joints"], problem["home"], strict=True):
            robot.set_joint(joint, angle)
        robot.update_kinematics()
        solver = robot.make_solver() if hasattr(robot, "make_solver") else self.placo.KinematicsSolver(robot)
        for foot in problem["feet"]:
            task = solver.add_frame_task(foot["frame"], pose_of(foot["position"], foot["rotation"]))
            task.configure(foot["frame"], "hard", 1.0, 1.0)
        goal = pose_of(target["position"], target["rotation"])
        solver.add_frame_task(problem["hand"], goal).configure("hand", "soft", 1.0, 1.0)
        (x0, y0), (x1, y1) = problem["support"]
        clockwise = [np.array(corner) for corner in ((x0, y0), (x0, y1), (x1, y1), (x1, y0))]
        solver.add_com_polygon_constraint(clockwise, 0.0).configure("support", "hard")
        solver.add_regularization_task(1e-4)
        solver.enable_joint_limits(True)
        return robot, solver, goal

    def solve(self, prepared):
        robot, solver, goal = prepared
        for _ in range(100):
            try:
                solver.solve(True)
            except RuntimeError:  # its quadratic program has no solution
                break
            robot.update_kinematics()
            found = robot.get_T_world_frame(self.problem["hand"])
            if np.abs(found - goal).max() < 1e-4:
                break
        joints = [robot.get_joint(joint) for joint in self.problem["joints"]]
        return [(np.asarray(robot.get_T_world_fbase()).tolist(), joints)]


class Pink:
    """pin-pink: feet, hand and centre of mass as weighted tasks, limits, daqp, up to 100 iterations."""

    def __init__(self, problem):
        import pink
        import pinocchio as pin

        self.pink, self.pin, self.problem = pink, pin, problem
        self.model = pin.buildModelFromUrdf(problem["urdf"], pin.JointModelFreeFlyer())
        self.rows = [self.model.joints[self.model.getJointId(joint)].idx_q for joint in problem["joints"]]
        base = pin.SE3(np.array(problem["base_rotation"]), np.array(problem["base_position"]))
        self.home = pin.neutral(self.model)
        self.home[:7], self.home[self.rows] = pin.SE3ToXYZQUAT(base), problem["home"]

    def prepare(self, target, knots):
        pin, tasks = self.pin, []
        goals = [*self.problem["feet"], {"frame": self.problem["hand"], **target}]
        for goal in goals:
            task = self.pink.tasks.FrameTask(goal["frame"], 10.0, 10.0)
            task.set_target(pin.SE3(np.array(goal["rotation"]), np.array(goal["position"])))
            tasks.append(task)
        middle = self.pink.tasks.ComTask([0.1, 0.1, 0.0])
        middle.set_target(np.append(np.mean(self.problem["support"], axis=0), 0.0))
        posture = self.pink.tasks.PostureTask(1e-3)
        posture.set_target(self.home)
        return self.pink.Configuration(self.model, self.model.createData(), self.home), [*tasks, middle, posture]

    def solve(self, prepared):
        configuration, tasks = prepared
        limits = [self.pink.limits.ConfigurationLimit(self.model)]
        for _ in range(100):
            try:
                velocity = self.pink.solve_ik(
                    configuration, tasks, 1.0, solver="daqp", safety_break=False, limits=limits
                )
            except self.pink.exceptions.PinkError:
                break
            configuration.integrate_inplace(velocity, 1.0)
            if max(np.abs(task.compute_error(configuration)).max() for task in tasks[:3]) < 1e-4:
                break
        q = configuration.q
        pose = self.pin.XYZQUATToSE3(q[:7]).homogeneous
        return [(pose.tolist(), q[self.rows].tolist())]


def main() -> None:
    """Answer requests until the input ends."""
    kind: type = {"drake": Drake, "placo": Placo, "pink": Pink}[sys.argv[1]]
    problem = json.loads((Path(sys.argv[2]) / "problem.json").read_text())
    out = sys.stdout
    sys.stdout = sys.stderr
    peer = kind(problem)
    for request in sys.stdin:
        wanted = json.loads(request)
        answers = []
        for target in problem["targets"][wanted["from"] : wanted["to"]]:
            prepared = peer.prepare(target, wanted["knots"])
            begin = time.perf_counter()
            found = peer.solve(prepared)
            answers.append({"seconds": time.perf_counter() - begin, "found": found})
        out.write(json.dumps(answers) + "\n")
        out.flush()


if __name__ == "__main__":
    main()
