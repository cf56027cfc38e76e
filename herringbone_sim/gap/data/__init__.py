"""Recorded runs as arrays, and problems of the data."""
