"""A drive's life follows CiA 402."""

from __future__ import annotations

import numpy as np
import pytest

from hal.drives.lifecycle import (
    COMMAND_OF_CONTROLWORD,
    CONTROLWORD,
    Command,
    State,
    controlword_towards,
    decode_statusword,
    statusword,
    transition,
)

_REACHABLE = [s for s in State if s not in (State.NOT_READY_TO_SWITCH_ON, State.FAULT_REACTION_ACTIVE)]


# IEC 61800-7-201, statusword table: mask and value
_STATUSWORDS = {
    State.NOT_READY_TO_SWITCH_ON: (0x4F, 0x00),
    State.SWITCH_ON_DISABLED: (0x4F, 0x40),
    State.READY_TO_SWITCH_ON: (0x6F, 0x21),
    State.SWITCHED_ON: (0x6F, 0x23),
    State.OPERATION_ENABLED: (0x6F, 0x27),
    State.QUICK_STOP_ACTIVE: (0x6F, 0x07),
    State.FAULT_REACTION_ACTIVE: (0x4F, 0x0F),
    State.FAULT: (0x4F, 0x08),
}


@pytest.mark.parametrize("state", State)
def test_a_statusword_is_the_standards_and_reads_back(state: State) -> None:
    mask, value = _STATUSWORDS[state]
    for flags in ({}, {"warning": True}, {"internal_limit": True}):
        word = int(statusword(state, **flags))
        assert word & mask == value
        assert decode_statusword(word) == state


def test_every_word_with_a_states_bits_is_that_state() -> None:
    words = np.arange(1 << 16)
    states = decode_statusword(words)
    for state, (mask, value) in _STATUSWORDS.items():
        assert np.all(states[words & mask == value] == state)


@pytest.mark.parametrize("start", _REACHABLE)
def test_controlwords_towards_operation_arrive_there_from_everywhere(start: State) -> None:
    state, previous = start, 0
    for _ in range(5):
        word = int(controlword_towards(State.OPERATION_ENABLED, state, previous))
        state, previous = State(int(transition(state, word, previous))), word
    assert state == State.OPERATION_ENABLED


def test_from_quick_stop_the_way_on_leads_through_switch_on_disabled() -> None:
    seen = [State.QUICK_STOP_ACTIVE]
    while seen[-1] != State.OPERATION_ENABLED:
        word = controlword_towards(State.OPERATION_ENABLED, seen[-1])
        seen.append(State(int(transition(seen[-1], word))))
    assert seen == [
        State.QUICK_STOP_ACTIVE,
        State.SWITCH_ON_DISABLED,
        State.READY_TO_SWITCH_ON,
        State.SWITCHED_ON,
        State.OPERATION_ENABLED,
    ]


def test_nothing_but_disable_voltage_leaves_quick_stop() -> None:
    words = np.arange(256)
    after = transition(State.QUICK_STOP_ACTIVE, words)
    disables = COMMAND_OF_CONTROLWORD[0, words] == Command.DISABLE_VOLTAGE
    assert np.all(after[disables] == State.SWITCH_ON_DISABLED)
    assert np.all(after[~disables] == State.QUICK_STOP_ACTIVE)
    assert np.all(words[disables & (words < 0x80)] & 0x02 == 0)


def test_only_fault_reset_leaves_a_fault_and_only_on_its_rising_edge() -> None:
    words = np.arange(256)
    left = transition(State.FAULT, words, previous=0x00) != State.FAULT
    assert np.array_equal(left, words >= 0x80)
    assert np.all(transition(State.FAULT, words, previous=0x80) == State.FAULT)


def test_a_fault_reset_that_did_not_take_gets_a_new_edge() -> None:
    first = controlword_towards(State.OPERATION_ENABLED, State.FAULT, previous=0x06)
    second = controlword_towards(State.OPERATION_ENABLED, State.FAULT, previous=first)
    third = controlword_towards(State.OPERATION_ENABLED, State.FAULT, previous=second)
    assert (first & 0x80, second & 0x80, third & 0x80) == (0x80, 0, 0x80)


@pytest.mark.parametrize("state", State)
def test_quick_stop_never_moves_a_drive_towards_operation(state: State) -> None:
    word = controlword_towards(State.QUICK_STOP_ACTIVE, state)
    after = transition(state, word)
    expected = {State.OPERATION_ENABLED: State.QUICK_STOP_ACTIVE}
    for powered in (State.READY_TO_SWITCH_ON, State.SWITCHED_ON):
        expected[powered] = State.SWITCH_ON_DISABLED
    assert after == expected.get(state, state)


def test_no_single_controlword_skips_a_rung_upwards() -> None:
    ladder = [State.SWITCH_ON_DISABLED, State.READY_TO_SWITCH_ON, State.SWITCHED_ON, State.OPERATION_ENABLED]
    for rung, state in enumerate(ladder):
        after = transition(state, np.arange(256))
        for higher in ladder[rung + 2 :]:
            assert not np.any(after == higher)


def test_arrays_go_through_as_single_values_do() -> None:
    states = np.array(list(State))
    words = controlword_towards(State.OPERATION_ENABLED, states)
    assert words.dtype == np.uint8 and words.shape == (8,)
    assert [int(controlword_towards(State.OPERATION_ENABLED, s)) for s in State] == words.tolist()
    assert transition(states, words).tolist() == [int(transition(s, w)) for s, w in zip(states, words, strict=True)]
    assert statusword(states).dtype == np.uint16
    assert decode_statusword(statusword(states)).tolist() == states.tolist()


def test_a_goal_that_no_controlword_asks_for_is_refused() -> None:
    with pytest.raises(ValueError, match="OPERATION_ENABLED"):
        controlword_towards(State.FAULT, State.OPERATION_ENABLED)


def test_controlwords_are_the_standards() -> None:
    assert CONTROLWORD.tolist() == [0x00, 0x02, 0x06, 0x07, 0x0F, 0x80]
    assert COMMAND_OF_CONTROLWORD[0, CONTROLWORD].tolist() == list(Command)
