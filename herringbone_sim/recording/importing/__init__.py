"""Files of other programs become a campaign: what a spec says of them, one room for each step."""
