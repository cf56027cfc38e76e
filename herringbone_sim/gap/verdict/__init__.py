"""From evidence to probabilities, and what to measure next."""
