"""The fault campaign: each fault at random moments of a short valve turn, judged by what the plant really did."""
