"""The model's pass against pinocchio's own algorithms, field by field."""

from __future__ import annotations

import numpy as np
import pinocchio as pin
import pytest

from daemon.wbc.model import WholeBodyModel


def branched(*, free: bool = True) -> pin.Model:
    """Joints of every kind in branches, geared motors among them; on a free base, or one that slides."""
    model, rng = pin.Model(), np.random.default_rng(3)
    model.gravity.linear = np.array([0.3, -0.2, -9.7])
    slant = np.array([1.0, 2.0, -2.0]) / 3.0
    kinds = [
        (0, pin.JointModelFreeFlyer() if free else pin.JointModelPX()),
        (1, pin.JointModelPZ()),
        (2, pin.JointModelRevoluteUnaligned(slant)),
        (2, pin.JointModelPrismaticUnaligned(slant)),
        (1, pin.JointModelRY()),
        (5, pin.JointModelRX()),
    ]
    for parent, kind in kinds:
        joint = model.addJoint(parent, kind, pin.SE3.Random(), f"joint{model.njoints}")
        model.appendBodyToJoint(joint, pin.Inertia.Random(), pin.SE3.Identity())
    geared = model.nv - model.njoints + 2
    model.armature[geared:] = rng.uniform(0.1, 1.0, model.nv - geared)
    return model


@pytest.mark.parametrize("robot", ["talos_upper", "talos", "panda", "branched"])
def test_a_pass_leaves_in_memory_what_pinocchios_own_algorithms_do(model_of, robot: str) -> None:
    whole = WholeBodyModel(branched()) if robot == "branched" else model_of(robot, free=robot == "talos")
    model, seen, data = whole.model, whole.data, whole.model.createData()
    rng = np.random.default_rng(0)
    for _ in range(5):
        q, v = pin.integrate(model, pin.neutral(model), rng.normal(0.0, 1.0, model.nv)), rng.normal(0.0, 1.0, model.nv)
        whole.update(q, v)
        pin.crba(model, data, q, pin.Convention.WORLD)
        pin.nonLinearEffects(model, data, q, v)
        most = np.abs(data.M).max()
        assert whole.mass_matrix == pytest.approx(np.triu(data.M) + np.triu(data.M, 1).T, abs=1e-13 * most)
        assert whole.bias == pytest.approx(np.array(data.nle), abs=1e-13 * np.abs(data.nle).max())
        assert np.abs(seen.J - data.J).max() < 1e-13
        assert np.abs(seen.Ag - data.Ag).max() < 1e-13 * most
        assert whole.com == pytest.approx(np.array(data.oYcrb[0].lever), abs=1e-13)
        for joint in range(1, model.njoints):
            for name in ("oMi", "liMi"):
                mine, theirs = getattr(seen, name)[joint], getattr(data, name)[joint]
                assert np.abs(mine.homogeneous - theirs.homogeneous).max() < 1e-13, (name, joint)
            for name in ("v", "a_gf", "f"):
                mine, theirs = getattr(seen, name)[joint].vector, getattr(data, name)[joint].vector
                assert mine == pytest.approx(theirs, abs=1e-13 * max(np.abs(theirs).max(), most)), (name, joint)
