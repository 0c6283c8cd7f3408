"""How far a joint may be off its command, and for how long nobody may know."""

DIVERGED = 0.5
"""rad between a joint and its command at which any action ends, whatever its conditions say"""
STALE = 20
"""cycles without a new measurement after which no action goes on: when drives stop by themselves that hear as little as they say"""
