"""Success against facts, as plots: each run a dot, the share of successes along the way, the split that tells most."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from engines.learning.book import PastRun
from engines.learning.predictors import CHANCE, Predictor

_COLUMNS = 3
_MOST = 12
_GOOD, _BAD = "#2a9d4a", "#c8372d"


def draw(program: str, runs: Sequence[PastRun], found: Sequence[Predictor], file: Path) -> None:
    """One panel a fact, the surest predictor first; facts that never differ are left out.

    :param runs: that succeeded or failed
    :raises ValueError: where no fact differs, or the file's suffix is no picture's
    """
    import matplotlib

    matplotlib.use("Agg")
    from matplotlib import pyplot

    by_fact = {each.fact: each for each in found}
    names = sorted({name for run in runs for name in run.facts})
    names = [name for name in names if len({run.facts[name].value for run in runs if name in run.facts}) > 1]
    names = [*by_fact, *(name for name in names if name not in by_fact)][:_MOST]
    if not names:
        raise ValueError("no fact differs between the runs; nothing can be plotted")
    rows = -(-len(names) // _COLUMNS)
    figure, axes = pyplot.subplots(rows, _COLUMNS, figsize=(4.2 * _COLUMNS, 2.6 * rows), squeeze=False)
    for axis, name in zip(axes.flat, names, strict=False):
        _panel(axis, name, [run for run in runs if name in run.facts], by_fact.get(name))
    for axis in axes.flat[len(names) :]:
        axis.set_visible(False)
    succeeded = sum(run.status == "succeeded" for run in runs)
    figure.suptitle(f"{program}: {succeeded} of {len(runs)} runs succeeded", fontweight="bold")
    figure.tight_layout()
    figure.savefig(file, dpi=110)
    pyplot.close(figure)


def _panel(axis, name: str, runs: Sequence[PastRun], split: Predictor | None) -> None:  # type: ignore[no-untyped-def]
    good = np.array([run.status == "succeeded" for run in runs])
    facts = [run.facts[name] for run in runs]
    unit = facts[0].unit
    if any(isinstance(fact.value, str) for fact in facts):
        words = sorted({str(fact.value) for fact in facts})
        places = np.array([words.index(str(fact.value)) for fact in facts], float)
        axis.set_xticks(range(len(words)), words)
        shares = [good[places == place].mean() for place in range(len(words))]
        axis.bar(range(len(words)), shares, 0.5, color="0.88", zorder=0)
    else:
        scale = 180.0 / np.pi if unit == "rad" else 1.0
        places = np.array([float(fact.value) for fact in facts]) * scale
        order = np.argsort(places, kind="stable")
        width = max(3, len(runs) // 5)
        if len(runs) >= width:
            share = np.convolve(good[order], np.full(width, 1.0 / width), "valid")
            middle = np.convolve(places[order], np.full(width, 1.0 / width), "valid")
            axis.plot(middle, share, color="0.55", lw=1.5, label=f"of {width} neighbours")
        if split is not None:
            sure = split.chance < CHANCE
            axis.axvline(float(split.at) * scale, color=_BAD if sure else "0.7", ls="--", lw=1.2)
    spread = 0.04 * np.sin(np.arange(len(runs)) * 2.4)  # dots of the same place stay apart
    for status, colour in ((True, _GOOD), (False, _BAD)):
        axis.plot(places[good == status], status + spread[good == status], "o", ms=4, color=colour, alpha=0.8)
    axis.set_ylim(-0.15, 1.15)
    axis.set_yticks([0, 1], ["failed", "succeeded"])
    shown = "°" if unit == "rad" else unit
    title = name if split is None else f"{name}  (p {split.chance:.2g})"
    axis.set_title(title, fontsize=9, color=_BAD if split is not None and split.chance < CHANCE else "black")
    axis.set_xlabel(shown, fontsize=8)
    axis.tick_params(labelsize=8)
