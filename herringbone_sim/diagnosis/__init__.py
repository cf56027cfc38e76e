"""The engine of a diagnosis: observations, regression, search, judge; for any kind of machine."""
