"""Machine code from the disk runs only where everything that it was made from is still the same."""

import importlib
import os
import subprocess
import sys
from pathlib import Path

import pytest

from handrail.compiled import fingerprint

ROOT = Path(__file__).parents[2]
CALLER = """
from handrail.compiled import compiled
import the_middle

@compiled
def total(x):
    return the_middle.twice(x) + 1
"""
MIDDLE = """
from handrail.compiled import compiled
from the_constants import GAIN, step

@compiled
def twice(x):
    return step(x) + step(x) + GAIN
"""
CONSTANTS = """
from handrail.compiled import compiled
GAIN = 100
UNUSED = 7

@compiled
def step(x):
    'What is counted.'
    return x
"""
ALONE = """
from handrail.compiled import compiled

@compiled
def twice(x):
    return x + x
"""


class House:
    """Modules in a folder, as many processes in turn find them: each `load` begins with none of them imported."""

    def __init__(self, folder: Path):
        self.folder = folder
        self.write(the_caller=CALLER, the_middle=MIDDLE, the_constants=CONSTANTS)

    def write(self, **modules):
        for name, text in modules.items():
            (self.folder / f"{name}.py").write_text(text)

    def load(self, module="the_caller"):
        for file in self.folder.glob("*.py"):
            sys.modules.pop(file.stem, None)
        importlib.invalidate_caches()
        return importlib.import_module(module)

    def call(self, argument=3):
        """What the top function gives, and whether it was compiled for that."""
        total = self.load().total
        return total(argument), bool(total.stats.cache_misses)

    def files(self):
        return sorted(file.name for file in self.folder.rglob("*.nb*"))


@pytest.fixture
def house(tmp_path, monkeypatch):
    monkeypatch.setattr(sys, "dont_write_bytecode", True)  # Python's own looks at whole seconds
    monkeypatch.syspath_prepend(str(tmp_path))
    yield House(tmp_path)
    for file in tmp_path.glob("*.py"):
        sys.modules.pop(file.stem, None)


def test_a_change_anywhere_below_is_seen_and_anything_else_is_read_from_the_disk(house):
    assert house.call() == (107, True)
    assert house.call() == (107, False)
    files = house.files()

    house.write(the_constants=CONSTANTS.replace("return x", "return 10 * x"))
    assert house.call() == (161, True), "a function of a function in another file"
    house.write(the_constants=CONSTANTS.replace("GAIN = 100", "GAIN = 200"))
    assert house.call() == (207, True), "a constant of another file"
    assert len(house.files()) == len(files), "former versions go"

    house.write(the_constants=CONSTANTS)
    assert house.call() == (107, True)
    assert house.files() == files

    moved = "# Constants.\n\n" + CONSTANTS.replace("UNUSED = 7", "UNUSED = 8").replace("What is", "Nothing is")
    house.write(the_constants=moved, the_caller="\n\n" + CALLER)
    os.utime(house.folder / "the_middle.py", (1, 1))
    assert house.call() == (107, False), "neither text, nor lines, nor times, nor what it doesn't name"


def test_another_process_finds_what_this_one_compiled(house):
    house.write(the_middle=ALONE, the_kinds=KINDS)
    house.load("the_middle").twice(3)
    program = "import the_middle, the_kinds; from handrail.compiled import fingerprint; the_middle.twice(3);"
    program += "print(sum(the_middle.twice.stats.cache_misses.values()), fingerprint(the_kinds.kernel))"
    told = subprocess.run(
        [sys.executable, "-c", program],
        env={**os.environ, "PYTHONPATH": f"{ROOT}:{house.folder}", "PYTHONHASHSEED": "4711"},
        capture_output=True,
        text=True,
        check=False,
        timeout=120,
    )
    assert told.stdout.split() == ["0", fingerprint(house.load("the_kinds").kernel)], told.stderr


def test_a_file_cut_short_or_under_another_signatures_name_is_compiled_anew(house):
    house.write(the_middle=ALONE)
    twice = house.load("the_middle").twice
    assert (twice(3), twice(0.5)) == (6, 1.0)
    first, second = house.folder.rglob("the_middle.*.nbc")
    contents = first.read_bytes(), second.read_bytes()
    for bad in (reversed(contents), (contents[0][:-100], b"")):
        for file, content in zip((first, second), bad, strict=True):
            file.write_bytes(content)
        twice = house.load("the_middle").twice
        assert (twice(3), twice(0.5)) == (6, 1.0)
        assert not twice.stats.cache_hits


KINDS = """
import enum, math
from typing import NamedTuple
import numpy as np
from numba import njit, types
from numba.extending import intrinsic
from handrail.compiled import compiled

NUMBER, TEXT, FLAG = 0.1, "left", True
NESTED = (1, (2.0, "three"))
TABLE = np.array([1, 2, 3])
ROW = np.dtype([("position", "<f8"), ("mode", "<i4")])
CHOICES = {"a", "b"}

class Mode(enum.IntEnum):
    TORQUE = 1

class Chain(NamedTuple):
    axes: int

HAND = Chain(7)

def _code(context, builder, signature, arguments):
    return arguments[0]

@intrinsic
def same(typing, value):
    return value(value), _code

def factory(scale):
    def scaled(x, offset=5):
        return scale * x + offset
    return njit(scaled)

scaled = factory(2)

@njit(error_model="python")
def inner(x):
    return x / 2

@compiled
def kernel(x):
    def within(y):
        return y + 1000
    if TEXT == "left" and FLAG and Mode.TORQUE == 1 and x in CHOICES:
        return NUMBER * within(x) + NESTED[0] + TABLE[0] + HAND.axes
    return same(scaled(inner(x))) + np.zeros(1, ROW)[0].position + math.pi
"""


@pytest.mark.parametrize(
    ("old", "new"),
    [
        ("0.1", "0.2"),
        ('"left", True', '"right", True'),
        ('"left", True', '"left", 1'),
        ('"three"', '"four"'),
        ("[1, 2, 3]", "[1, 2, 4]"),
        ("[1, 2, 3]", "[1, 2, 3.0]"),
        ('("position", "<f8"), ("mode", "<i4")', '("mode", "<i4"), ("position", "<f8")'),
        ('("mode", "<i4")]', '("mode", "<i4")], align=True'),
        ('{"a", "b"}', '{"a", "c"}'),
        ("TORQUE = 1\n", "TORQUE = 2\n"),
        ("Chain(7)", "Chain(6)"),
        ("return arguments[0]", "return builder.add(arguments[0], arguments[0])"),
        ("factory(2)", "factory(3)"),
        ("offset=5", "offset=6"),
        ('error_model="python"', 'error_model="numpy"'),
        ("x / 2", "x / 4"),
        ("y + 1000", "y + 1001"),
        ("@compiled\n", "@compiled(fastmath=True)\n"),
        ("math.pi", "math.e"),
    ],
)
def test_every_kind_of_constant_and_callee_counts(house, old, new):
    assert old in KINDS
    house.write(the_kinds=KINDS)
    before = fingerprint(house.load("the_kinds").kernel)
    assert fingerprint(house.load("the_kinds").kernel) == before
    house.write(the_kinds=KINDS.replace(old, new))
    assert fingerprint(house.load("the_kinds").kernel) != before


def test_functions_that_call_each_other_in_circles_have_a_fingerprint(house):
    circle = """
from numba import njit
from handrail.compiled import compiled

@compiled
def even(n):
    return n == 0 or odd(n - 1)

@njit
def odd(n):
    return n != 0 and even(n - 1)
"""
    house.write(the_circle=circle)
    module = house.load("the_circle")
    before = fingerprint(module.even)
    assert before != fingerprint(module.odd)
    house.write(the_circle=circle.replace("n != 0", "n > 0"))
    assert fingerprint(house.load("the_circle").even) != before


def test_no_source_leaves_its_functions_to_numbas_own_cache():
    packages = ("handrail", "hal", "daemon", "engines", "benchmarks")
    sources = [file for package in packages for file in (ROOT / package).rglob("*.py")]
    assert len(sources) > 200
    own = ROOT / "handrail" / "compiled.py"
    assert [str(file) for file in sources if file != own and "cache=True" in file.read_text()] == []
