"""Gears by the laws of their effects, sixteen values side by side."""
