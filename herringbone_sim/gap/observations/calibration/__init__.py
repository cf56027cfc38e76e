"""Sensors of a campaign before any effect is fitted: noise, copies, common delay and filter."""
