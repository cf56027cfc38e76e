"""Tables of results, as CSV and as text."""
