"""The engine of a diagnosis: observations, regression, search, judge. It knows no machine."""
