"""The plant's world: rigid bodies in PyBullet, and the robot's actuators and drives between them and the bus.

`World` is the physics alone, stepped by whoever holds it, so that tests can drive it without a bus. As a process
(`python -m hal.plant.world --robot NAME --scene FILE_OR_NAME --clock lockstep|wall --runtime DIR`) it is `hal.plant.service`.

The world's frame is the robot's fixed base, or where a free one is at the start. A step is 1 ms; the
firmware runs five times in it.
"""

from __future__ import annotations

import tempfile
from pathlib import Path

import numpy as np

from hal.plant.actuator import FIRMWARE_HZ, Actuators
from hal.plant.bodies import HINGE, hinge_names, is_loose, object_urdf
from hal.plant.bullet import pybullet as p
from hal.plant.devices import DevicePlant
from hal.plant.drive_node import STEP_NS, DriveNodes
from hal.plant.hoist import Hoist
from hal.plant.joint_port import JointPort
from hal.plant.linkage import LinkageBody
from hal.plant.robot_body import BASE, RobotBody
from hal.plant.scene import EMPTY, Linkage, Scene, Wheel
from hal.plant.sensors import GRAVITY
from hal.plant.stretch import stretch
from handrail.messages import GroundTruth, Pose
from handrail.robot.description import RobotDescription

_STEP = STEP_NS * 1e-9
_FIRMWARE_CYCLES = round(FIRMWARE_HZ * _STEP)
# Torque of a brake over the drive's rated torque. The constraint that holds a braked joint pulls it back by this share of its
# error in each step.
_BRAKE_RESERVE, _BRAKE_GAIN = 3.0, 0.2
# Contacts are looked at every so many steps: a push lasts longer, and looking costs as much as the firmware.
_CONTACT_STEPS = 4
_FLOOR_FRICTION = 1.0
_NOTHING = np.zeros(0, np.int64)


class World:
    """A robot and what stands around it. Robot arrays have shape (n,), in the description's order."""

    def __init__(
        self, description: RobotDescription, scene: Scene = EMPTY, *, posture: str = "ready", visual: bool = False
    ):
        """The robot stands still at a home `posture`, brakes closed. `visual`: with its looks, for pictures.

        Raises KeyError for a posture that the robot has not.
        """
        self.description, self.scene = description, scene
        self.steps = 0
        self._contact_force, self._peak_contact_force = (dict.fromkeys(scene.objects, 0.0) for _ in range(2))
        self._contacts_due = False
        self._client = p.connect(p.DIRECT)
        # Of so few bodies every pair is asked quicker than a tree is kept up to date: a tenth of a step's time, and the same pairs.
        p.resetSimulation(p.RESET_USE_SIMPLE_BROADPHASE, physicsClientId=self._client)
        p.setGravity(0, 0, -GRAVITY, physicsClientId=self._client)
        p.setTimeStep(_STEP, physicsClientId=self._client)
        p.setPhysicsEngineParameter(deterministicOverlappingPairs=1, physicsClientId=self._client)
        self.robot = RobotBody(description, self._client, visual=visual)
        self._robot = self.robot.number
        self._rows = [self.robot.joints[joint] for joint in description.joints]
        for joint, angle in zip(description.joints, description.home_position(posture), strict=True):
            self.robot.place(joint, angle)
        self.floor = None if description.floor is None else self._lay_floor(description.floor)
        """PyBullet's number of the floor, if there is one"""
        self.hoist: Hoist | None = None
        """what lets the robot down, where its support is a hoist"""
        if description.support == "hoist" and self.floor is not None:
            self.hoist = Hoist(self.robot, self.floor, _STEP)
        self._objects = {name: self._load_object(name) for name in scene.objects}
        self._hinges = {name: body for name, body in self._objects.items() if isinstance(scene.objects[name], Wheel)}
        self._hinge_names = [hinge for name, thing in scene.objects.items() for hinge in hinge_names(name, thing)]
        self._linkages = {
            name: LinkageBody(self._client, self._objects[name], thing.links, thing.latches, thing.threads)
            for name, thing in scene.objects.items()
            if isinstance(thing, Linkage)
        }
        self._loose = {name: body for name, body in self._objects.items() if is_loose(scene.objects[name])}
        self.drives = DriveNodes(description, Actuators.of(description))
        self.devices = DevicePlant(self.robot, self.drives, lambda: self.time_ns)
        self._joints = JointPort(self._robot, self._client, self._rows, self.devices.joints, self.devices.links)
        self.position, self.velocity = self._joints.position, self._joints.velocity
        """rad, rad/s"""
        self.devices.attach(self._joints)
        self.drives.actuators.relax(self.position)
        self.drives.actuators.set_position_gains(description.stiffness, self._damping())
        self._braked = np.zeros(len(self.position), np.bool_)
        self._work_brakes()

    @property
    def client(self) -> int:
        """PyBullet's handle of this world."""
        return self._client

    @property
    def time_ns(self) -> int:
        """Simulated time since the start."""
        return self.steps * STEP_NS

    def _lay_floor(self, height: float) -> int:
        plane = p.createCollisionShape(p.GEOM_PLANE, physicsClientId=self._client)
        floor = p.createMultiBody(0, plane, basePosition=(0, 0, height), physicsClientId=self._client)
        p.changeDynamics(floor, BASE, lateralFriction=_FLOOR_FRICTION, physicsClientId=self._client)
        return floor

    def _load_object(self, name: str) -> int:
        thing, pose = self.scene.objects[name], self.scene.poses_in_world[name]
        with tempfile.TemporaryDirectory(prefix="handrail-") as folder:
            file = Path(folder) / f"{name}.urdf"
            file.write_text(object_urdf(name, thing), encoding="utf-8")
            body = p.loadURDF(
                str(file),
                pose.position,
                pose.orientation,
                useFixedBase=not is_loose(thing),
                flags=p.URDF_USE_INERTIA_FROM_FILE,
                physicsClientId=self._client,
            )
        for link in range(-1, p.getNumJoints(body, self._client)):
            p.changeDynamics(
                body,
                link,
                jointDamping=0,
                linearDamping=0,
                angularDamping=0,
                lateralFriction=thing.friction,
                physicsClientId=self._client,
            )
        if isinstance(thing, Wheel):
            p.resetJointState(body, HINGE, thing.hinge_angle, physicsClientId=self._client)
            # A motor that wants to stand still, and may use so much torque for it, is Coulomb friction.
            p.setJointMotorControl2(
                body,
                HINGE,
                p.VELOCITY_CONTROL,
                targetVelocity=0,
                force=thing.hinge_friction,
                physicsClientId=self._client,
            )
        return body

    def _damping(self) -> np.ndarray:
        """N·m·s/rad (n,): what fits the description's stiffness here, D = 2 ζ sqrt(K sqrt(M_ii / (M⁻¹)_ii))."""
        joints = self.description.joints
        mass = self.robot.mass_matrix(dict(zip(joints, self.position.tolist(), strict=True)))
        rows = [self.robot.dofs[joint] for joint in joints]
        mass = mass[np.ix_(rows, rows)]
        inertia = np.sqrt(np.diag(mass) / np.diag(np.linalg.inv(mass)))
        return 2.0 * self.description.damping_ratio * np.sqrt(self.description.stiffness * inertia)

    def step(self, *, felt: bool = True) -> None:
        """Go on by 1 ms. felt: the devices can be measured then; without it PyBullet is spared what only they want to know."""
        drives = self.drives
        self.catch_up()
        self.devices.sense(felt)
        self.devices.work_power()
        for linkage in self._linkages.values():
            linkage.work()
        torque = drives.step(self.position, self.velocity, _FIRMWARE_CYCLES)
        if drives.brakes_moved:
            self._work_brakes()
        if self.hoist is not None and not self.hoist.slack:
            self.hoist.work(not self._braked.any())
        self._joints.step(torque)
        self.steps += 1
        self._contacts_due = self.steps % _CONTACT_STEPS == 0

    def catch_up(self, *, felt: bool | None = None) -> None:
        """Do what a step leaves to do, at the latest before the next one: whoever has told others of the step by then keeps nobody
        waiting with it. felt: of the next step, where that is known."""
        if self._contacts_due:
            self._contacts_due = False
            self._watch_contacts()
        if felt is not None:
            self.devices.sense(felt)

    @property
    def contact_force(self) -> dict[str, float]:
        """Object → N, sum of the normal forces between it and the robot, when it was last looked at."""
        self.catch_up()
        return self._contact_force

    @property
    def peak_contact_force(self) -> dict[str, float]:
        """Object → N, the largest so far."""
        self.catch_up()
        return self._peak_contact_force

    def advance(self, steps: int) -> None:
        """Go on by `steps` ms, the last of which is felt."""
        while steps:
            steps -= self.go_on(steps)

    def go_on(self, most: int) -> int:
        """Go on by up to `most` ms, of which the last one is felt; returns by how many.

        As many at once as nothing but drives and bodies does anything in: the same as `step` so often, for fewer calls.
        """
        steps, hoist = min(most, _CONTACT_STEPS - self.steps % _CONTACT_STEPS), self.hoist
        devices, drives, joints = self.devices, self.drives, self._joints
        eventful = self._linkages or drives.brakes_moved or not devices.powered or not (hoist is None or hoist.slack)
        if steps == 1 or eventful or not joints.native:
            self.step(felt=most == 1)
            return 1
        self.catch_up()
        devices.sense(False)
        devices.work_power()
        done = stretch(drives, joints, steps, _FIRMWARE_CYCLES, devices.felt if steps == most else _NOTHING)
        devices.note_felt(steps == most and done >= steps - 1)
        if drives.brakes_moved:
            self._work_brakes()
            joints.step(drives.actuators.spring_torque)
            done += 1
        self.steps += done
        self._contacts_due = self.steps % _CONTACT_STEPS == 0
        return done

    def _work_brakes(self) -> None:
        """Close and open brakes as the drives say: a closed one is a constraint that holds the joint where it closed."""
        brakes = self.drives.brakes
        for j in np.flatnonzero(brakes != self._braked):
            if brakes[j]:
                p.setJointMotorControl2(
                    self._robot,
                    self._rows[j],
                    p.POSITION_CONTROL,
                    targetPosition=self.position[j],
                    positionGain=_BRAKE_GAIN,
                    velocityGain=1.0,
                    force=_BRAKE_RESERVE * self.description.torque_limit[j],
                    physicsClientId=self._client,
                )
            else:
                # A motor that wants to stand still, and may use so much torque for it, is Coulomb friction.
                p.setJointMotorControl2(
                    self._robot,
                    self._rows[j],
                    p.VELOCITY_CONTROL,
                    force=self.description.actuators[j].friction,
                    physicsClientId=self._client,
                )
        self._braked[:] = brakes
        self.drives.brakes_moved = False

    def place(self, position: np.ndarray) -> None:
        """Put the joints at `position` rad (n,), at rest, and close the brakes there (for pictures and tests)."""
        self.catch_up()
        for row, angle in zip(self._rows, position, strict=True):
            p.resetJointState(self._robot, row, angle, physicsClientId=self._client)
        self._joints.look()
        self.drives.actuators.relax(self.position)
        self.drives.switch_off()
        self._braked[:] = False
        self._work_brakes()

    def _watch_contacts(self) -> None:
        for name, body in self._objects.items():
            contacts = p.getContactPoints(self._robot, body, physicsClientId=self._client)
            force = sum(abs(contact[9]) for contact in contacts)
            self._contact_force[name] = force
            self._peak_contact_force[name] = max(self._peak_contact_force[name], force)

    def body(self, name: str) -> int:
        """PyBullet's number of an object (for tests and exercises that push it). Raises KeyError when there is none."""
        return self._objects[name]

    def linkage(self, name: str) -> LinkageBody:
        """An object with joints of its own. Raises KeyError when there is none."""
        return self._linkages[name]

    def hinge_angle(self, name: str) -> float:
        """A wheel's hinge's signed angle, rad, without end; of OBJECT.JOINT a linkage's joint, rad or m. Raises KeyError."""
        thing, _, joint = name.partition(".")
        if joint:
            return self._linkages[thing].position(joint)
        return p.getJointState(self._hinges[name], HINGE, physicsClientId=self._client)[0]

    def set_hinge_angle(self, name: str, angle: float) -> None:
        """Turn a hinge (OBJECT or OBJECT.JOINT) to an angle, rad (m), and stop it there (for pictures and tests)."""
        thing, _, joint = name.partition(".")
        if joint:
            self._linkages[thing].place(joint, angle)
            return
        p.resetJointState(self._hinges[name], HINGE, angle, physicsClientId=self._client)

    def truth(self) -> GroundTruth:
        """What is really the case, now."""
        return GroundTruth(
            time_ns=self.time_ns,
            joints=self._all_joints(),
            hinges={hinge: self.hinge_angle(hinge) for hinge in self._hinge_names},
            poses_in_world={
                **self.scene.poses_in_world,
                **{name: self._pose(body) for name, body in self._loose.items()},
            },
            contact_force=dict(self.contact_force),
            peak_contact_force=dict(self.peak_contact_force),
            base_in_world=Pose() if self.robot.fixed else self._base_pose(),
        )

    def _all_joints(self) -> dict[str, float]:
        """Joint → rad or m; after the drives' own those that grippers move."""
        joints = dict(zip(self.description.joints, self.position.tolist(), strict=True))
        for gripper in self.devices.grippers.values():
            for joint in (gripper.joint, *gripper.followers):
                joints[joint] = p.getJointState(self._robot, self.robot.joints[joint], physicsClientId=self._client)[0]
        return joints

    def _base_pose(self) -> Pose:
        _, position, orientation, _, _ = self.robot.link_motion(BASE)
        x, y, z = position
        i, j, k, w = orientation
        return Pose(position=(x, y, z), orientation=(i, j, k, w))

    def _pose(self, body: int) -> Pose:
        position, orientation = p.getBasePositionAndOrientation(body, physicsClientId=self._client)
        return Pose(position=position, orientation=orientation)

    def close(self) -> None:
        """Free the physics."""
        if self._client >= 0:
            self._joints.close()
            p.disconnect(self._client)
            self._client = -1


if __name__ == "__main__":
    from hal.plant.service import main

    main()
