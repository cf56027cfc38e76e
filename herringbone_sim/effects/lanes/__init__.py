"""Integration of sixteen gears side by side by the compiled laws of their effects."""
