"""Sensor errors and sensor noise, from the consistency of the channels."""
