"""The pictures of ``handrail bench sea --out FOLDER``: Bode plot, the hand's experiment, mismatched plants."""

from __future__ import annotations

import csv
from pathlib import Path

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import NullLocator

from benchmarks.sea import MISMATCHES, RATED, Floats, Response
from hal.plant.actuator import FIRMWARE_HZ

_BLUE, _RED, _GREY = "#1f5fa8", "#b5382a", "#777777"


def draw(
    folder: Path,
    opened: Response,
    closed: Response,
    hands: dict[str, tuple[Floats, Floats]],
    torque: float,
    without: list[Response],
    with_: list[Response],
) -> None:
    """Write bode.png, bode.csv, hand.png and mismatch.png."""
    _bode(folder / "bode.png", opened, closed)
    _table(folder / "bode.csv", opened, closed)
    _hand(folder / "hand.png", hands, torque)
    _mismatch(folder / "mismatch.png", without, with_)


def _frequency_axis(axes: Axes, ticks: tuple[int, ...]) -> None:
    axes.set_xscale("log")
    axes.set_xticks(ticks, labels=[f"{tick}" for tick in ticks])
    axes.xaxis.set_minor_locator(NullLocator())  # two hundred labels that nobody reads take seconds
    axes.grid(visible=True, alpha=0.25)


def _bode(file: Path, opened: Response, closed: Response) -> None:
    figure = Figure(figsize=(8, 7))
    figure.subplots_adjust(left=0.09, right=0.97, bottom=0.08, top=0.95, hspace=0.06)
    gain, phase = figure.subplots(2, 1, sharex=True)
    for response, style, name in ((opened, "--", "open loop"), (closed, "-", "closed loop with observer")):
        label = f"{name}: −3 dB at {response.bandwidth_hz:.0f} Hz"
        gain.plot(response.frequencies, response.decibel, style, color=_BLUE, label=label)
        phase.plot(response.frequencies, response.phase_deg, style, color=_BLUE)
        gain.plot(response.bandwidth_hz, -3.01, "o", color=_RED)
    gain.axhline(-3.01, color=_RED, linewidth=0.8)
    gain.set(ylim=(-30, 10), ylabel="dB")
    gain.set_title("Spring torque over torque set-point, output locked")
    gain.legend(loc="lower left")
    phase.set(xlabel="Hz", ylabel="degrees", xlim=(1, 200))
    for axes in (gain, phase):
        _frequency_axis(axes, (1, 2, 5, 10, 13, 20, 50, 70, 100, 200))
    figure.savefig(file, dpi=110)


def _table(file: Path, opened: Response, closed: Response) -> None:
    with file.open("w", newline="", encoding="utf-8") as stream:
        writer = csv.writer(stream)
        writer.writerow(["frequency_hz", "open_db", "open_deg", "closed_db", "closed_deg"])
        columns = (opened.frequencies, opened.decibel, opened.phase_deg, closed.decibel, closed.phase_deg)
        writer.writerows([f"{value:.4g}" for value in row] for row in zip(*columns, strict=True))


def _hand(file: Path, hands: dict[str, tuple[Floats, Floats]], torque: float) -> None:
    figure = Figure(figsize=(8, 6))
    figure.subplots_adjust(left=0.09, right=0.97, bottom=0.09, top=0.94, hspace=0.08)
    joint, error = figure.subplots(2, 1, sharex=True)
    position = hands["with"][0]
    time = np.arange(len(position)) / FIRMWARE_HZ
    joint.plot(time, position, color=_GREY)
    joint.set(ylabel="rad", title=f"A hand forces the joint while {torque:g} N·m are asked for (rated: {RATED:g} N·m)")
    for name, colour in (("without", _RED), ("with", _BLUE)):
        error.plot(time, (hands[name][1] - torque) / RATED * 100, color=colour, label=f"{name} observer")
    for limit in (-1.0, 1.0):
        error.axhline(limit, color=_GREY, linewidth=0.8, linestyle=":")
    error.set(xlabel="s", ylabel="torque error, % of rated")
    error.legend(loc="lower right")
    for axes in (joint, error):
        axes.grid(visible=True, alpha=0.25)
    figure.savefig(file, dpi=110)


def _mismatch(file: Path, without: list[Response], with_: list[Response]) -> None:
    figure = Figure(figsize=(12, 11))
    figure.subplots_adjust(left=0.06, right=0.99, bottom=0.05, top=0.97, wspace=0.06, hspace=0.2)
    panels = figure.subplots(4, 4, sharex=True, sharey=True)
    for axes in panels.flat[len(MISMATCHES) :]:
        axes.set_axis_off()
    for i, (mismatch, axes) in enumerate(zip(MISMATCHES, panels.flat, strict=False), 1):
        axes.plot(with_[0].frequencies, with_[0].decibel, color=_GREY, linewidth=3, alpha=0.4, label="as believed")
        axes.plot(without[i].frequencies, without[i].decibel, color=_RED, label="without observer")
        axes.plot(with_[i].frequencies, with_[i].decibel, color=_BLUE, label="with observer")
        axes.set_title(mismatch.name, fontsize=10)
        axes.set(ylim=(-9, 6), yticks=(-6, -3, 0, 3))
        _frequency_axis(axes, (1, 3, 10, 30, 70))
    for axes in panels[:, 0]:
        axes.set_ylabel("dB")
    for axes in panels[-1]:
        axes.set_xlabel("Hz")
    handles, labels = panels.flat[0].get_legend_handles_labels()
    figure.legend(handles, labels, loc="lower right")
    figure.savefig(file, dpi=100)
