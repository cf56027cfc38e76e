"""Sensors against each other, before any law is asked."""
