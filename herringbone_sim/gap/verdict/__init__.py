"""Verdict from probabilities, its location on the gear, and the next experiment."""
