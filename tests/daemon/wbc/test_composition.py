"""Compound tasks from files and from Python."""

from pathlib import Path

import pytest

from daemon.wbc import composition
from daemon.wbc.constraints import JointLimits
from daemon.wbc.tasks import SE3, CartPos, JPos
from handrail.config import ConfigError

BASE = """\
constraints:
  - {constraint: JointLimits, torque: 0.8}
levels:
  - - {task: CartPos, name: hand, frame: panda_hand, axes: [x, z]}
"""
TOP = """\
name: reach
extends: base.yaml
levels:
  - - {task: QuaternionOrientation, frame: panda_hand, weight: 2.0}
"""


def write(folder: Path, **files: str) -> Path:
    for name, text in files.items():
        (folder / f"{name}.yaml").write_text(text)
    return folder / f"{list(files)[-1]}.yaml"


def test_a_file_makes_what_python_makes(tmp_path: Path, model_of) -> None:
    model = model_of("panda")
    from_file = composition.load_on(write(tmp_path, base=BASE), model)
    in_python = composition.CompoundTask(
        constraints=[JointLimits(torque=0.8)], levels=[[CartPos(name="hand", frame="panda_hand", axes=("x", "z"))]]
    ).on(model)
    assert from_file.solve().torque == pytest.approx(in_python.solve().torque)


def test_a_file_that_extends_another_puts_its_levels_below(tmp_path: Path) -> None:
    compound = composition.load(write(tmp_path, base=BASE, top=TOP))
    assert compound.constraints == [JointLimits(torque=0.8)]
    assert [type(task).__name__ for level in compound.levels for task in level] == ["QuaternionOrientation", "CartPos"]


def test_compound_tasks_are_put_together_in_python_too() -> None:
    low, high = composition.CompoundTask(levels=[[JPos()]]), composition.CompoundTask("both", levels=[[SE3(frame="a")]])
    assert low.below(high) == composition.CompoundTask("both", levels=[[SE3(frame="a")], [JPos()]])


@pytest.mark.parametrize(
    ("text", "line", "message"),
    [
        (BASE.replace("panda_hand", "panda_hnd"), 4, "no frame 'panda_hnd'; expected one like panda_hand"),
        (BASE.replace("[x, z]", "[x, q]"), 4, "got 'q'; expected some of x y z"),
        (BASE.replace("task: CartPos", "task: CartPosition"), 4, "CartPosition"),
        (BASE.replace("torque: 0.8", "torque: -1"), 2, "got -1.0; expected more than 0"),
        (BASE.replace("frame: panda_hand, ", ""), 4, "frame"),
        ("extends: nothing.yaml\n", 1, "no such file"),
        ("extends: x.yaml\n", 1, "expected no circle"),
    ],
)
def test_what_is_wrong_in_a_file_is_told_with_its_line(tmp_path: Path, model_of, text, line, message) -> None:
    with pytest.raises(ConfigError) as refused:
        composition.load_on(write(tmp_path, x=text), model_of("panda"))
    assert f"x.yaml:{line}: " in str(refused.value)
    assert message in str(refused.value)
