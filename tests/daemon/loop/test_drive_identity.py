"""Drives that speak another version of their protocol are not enabled."""

from daemon.exchange import Answer, Flag, Kind
from daemon.exchange.reports import explain


def test_a_drive_of_another_protocol_version_refuses_enable_by_name(bench) -> None:
    bench.run(3)
    joint = bench.index("arm_left_3_joint")
    bench.hardware.protocol_version[joint] = 1.0
    assert bench.ask(Kind.ENABLE) is Answer.PROTOCOL_MISMATCH
    snapshot = bench.snapshot()
    assert (int(snapshot["answer_joint"]), float(snapshot["answer_value"])) == (joint, 1.0)
    words = explain(Answer.PROTOCOL_MISMATCH, "arm_left_3_joint", 1.0)[0]
    assert "the drive of arm_left_3_joint speaks another version of its protocol" in words
    assert not bench.run(20)["flags"] & Flag.ENABLED
    bench.hardware.protocol_version[joint] = bench.hardware.expected_protocol_version(joint)
    bench.enable()


def test_a_version_that_is_told_only_while_enabling_ends_it(bench) -> None:
    bench.run(3)
    assert bench.ask(Kind.ENABLE) is Answer.ACCEPTED
    bench.hardware.protocol_version[0] = 1.0
    assert not bench.run(20)["flags"] & (Flag.ENABLED | Flag.ENABLING)
