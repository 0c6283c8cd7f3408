"""Which facts tell success from failure: one split of one fact, as far as chance does not explain it.

A fact predicts where past runs on one side of a threshold (or with one word) failed more often than those on the other. Whether
that may be chance is Fisher's exact test of the two-by-two table (R. A. Fisher, The Design of Experiments, 1935, ch. 2), its p
multiplied by the number of splits that were looked at (Bonferroni): with many facts and few runs something always fits.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Sequence
from dataclasses import dataclass

from engines.learning.book import PastRun
from engines.learning.facts import Fact, Facts

FEWEST = 8
"""runs, with an end of their own, before anything is said"""
CHANCE = 0.05
"""of a warning from facts that tell nothing"""
_SPLITS = 16
"""thresholds that are tried for a number"""


@dataclass(frozen=True)
class Predictor:
    """Runs on its side fail more often."""

    fact: str
    side: str
    """above, below or is"""
    at: float | str
    unit: str
    failed: int
    of: int
    """runs on its side, and how many of them failed"""
    others_failed: int
    others: int
    chance: float
    """corrected p: how likely so clear a split is where no fact tells anything"""

    def holds(self, fact: Fact) -> bool:
        """Whether a run with this fact is on its side."""
        if isinstance(fact.value, str) or isinstance(self.at, str):
            return fact.value == self.at
        return fact.value > self.at if self.side == "above" else fact.value <= self.at

    def words(self, fact: Fact | None = None) -> str:
        """For people; with the fact of the run at hand."""
        side = f"{self.fact} {self.side} {Fact(self.at, self.unit).words()}"
        now = f": it is {fact.words()}" if fact is not None and self.side != "is" else ""
        return f"{self.failed} of {self.of} past runs with {side} failed, {self.others_failed} of {self.others} of the others{now}"


def predictors(runs: Sequence[PastRun]) -> list[Predictor]:
    """The best split of each fact by which failures are told, that chance does not explain; the surest first."""
    return [each for each in splits(runs) if each.chance < CHANCE and 2 * each.failed > each.of]


def splits(runs: Sequence[PastRun]) -> list[Predictor]:
    """The best split of each fact of past runs, the surest first. Runs that an operator stopped say neither."""
    ended = [run for run in runs if run.status in ("succeeded", "failed")]
    failed = [run.status == "failed" for run in ended]
    if len(ended) < FEWEST or all(failed) or not any(failed):
        return []
    candidates: list[tuple[str, str, float | str, str]] = []
    for name in sorted({name for run in ended for name in run.facts}):
        known = [run.facts[name] for run in ended if name in run.facts]
        for side, at in _sides(known):
            candidates.append((name, side, at, known[-1].unit))
    best: dict[str, Predictor] = {}
    for name, side, at, unit in candidates:
        probe = Predictor(name, side, at, unit, 0, 0, 0, 0, 1.0)
        inside = [
            bad for run, bad in zip(ended, failed, strict=True) if name in run.facts and probe.holds(run.facts[name])
        ]
        outside = [
            bad
            for run, bad in zip(ended, failed, strict=True)
            if name in run.facts and not probe.holds(run.facts[name])
        ]
        table = (sum(inside), len(inside), sum(outside), len(outside))
        chance = min(1.0, _fisher(*table) * len(candidates))
        found = Predictor(name, side, at, unit, *table, chance)
        if name not in best or found.chance < best[name].chance:
            best[name] = found
    return sorted(best.values(), key=lambda each: (each.chance, each.fact))


def _fisher(failed: int, of: int, others_failed: int, others: int) -> float:
    """How likely at least `failed` of the `of` runs are among all that failed, where the split tells nothing: the tail of the
    hypergeometric distribution. (SciPy's takes half a second to import, in the thread that answers the engine's calls.)
    """
    bad = failed + others_failed
    ways = sum(math.comb(of, k) * math.comb(others, bad - k) for k in range(failed, min(of, bad) + 1))
    return ways / math.comb(of + others, bad)


def _sides(known: Sequence[Fact]) -> list[tuple[str, float | str]]:
    words = sorted({fact.value for fact in known if isinstance(fact.value, str)})
    if words:
        return [("is", word) for word in words] if len(words) > 1 else []
    values = sorted({float(fact.value) for fact in known if math.isfinite(float(fact.value))})
    middles = [(low + high) / 2.0 for low, high in itertools.pairwise(values)]
    step = max(1, math.ceil(len(middles) / _SPLITS))
    return [(side, at) for at in middles[step // 2 :: step] for side in ("above", "below")]


def warnings(found: Sequence[Predictor], facts: Facts) -> list[str]:
    """Why a run with these facts looks like past failures, the surest reason first."""
    return [each.words(facts[each.fact]) for each in found if each.fact in facts and each.holds(facts[each.fact])]
